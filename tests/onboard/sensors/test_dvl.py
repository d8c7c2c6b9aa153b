"""Doppler velocity logs: what they say on the wire, over a real socket, and what the sampler makes of it."""

import socket
import threading
from math import nan
from time import monotonic

import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.perception import BottomVelocity
from gloc3_onboard.components.samplers.dvl import DvlSampler
from gloc3_onboard.sensors.devices import Bell, StampedBottomVelocity
from gloc3_onboard.sensors.registry import parse_source
from gloc3_onboard.sensors.sources.doppler import A50Decoder, Pd6Decoder
from gloc3_onboard.sensors.sources.dvl import DvlSource

VELOCITY = (
    b'{"time":106.39,"vx":0.512,"vy":-0.021,"vz":0.003,"fom":0.0016,"covariance":[[1e-6,0,0],[0,1e-6,0],[0,0,1e-6]],'
    b'"altitude":4.91,"transducers":[],"velocity_valid":true,"status":0,"format":"json_v3.1","type":"velocity",'
    b'"time_of_validity":%d,"time_of_transmission":1638191471752336}\r\n'
)
"""As a Water Linked A50 sends it."""
RECKONED = b'{"ts":49056.809,"x":12.4,"y":64.0,"z":1.7,"std":0.001,"type":"position_local","format":"json_v3.1"}\r\n'
UNLOCKED = (
    b'{"vx":0,"vy":0,"vz":0,"fom":2.7,"altitude":-1,"velocity_valid":false,"type":"velocity","format":"json_v3.1"}\r\n'
)
PD6 = b":SA, +0.20, -1.10,181.20\r\n:BD,+00012,+00003,-00001,0012.34,000.12\r\n:BS,-00021,+00512,-00003,A\r\n"
"""As a Workhorse Navigator sends it; its normal velocity is positive from keel to mast."""


def test_an_a50_says_its_velocity_in_the_axes_of_the_body_in_any_pieces() -> None:
    decoder = A50Decoder()
    data = RECKONED + VELOCITY % 1638191471563017
    reports = [report for cut in range(0, len(data), 37) for report in decoder.receive(data[cut : cut + 37])]
    assert [report.stamp_us for report in reports] == [1638191471563017]
    bottom = reports[0].bottom
    assert bottom.velocity_frd_m_s == pytest.approx((0.512, -0.021, 0.003))
    assert (bottom.altitude_m, bottom.std_m_s, bottom.is_valid) == (4.91, 0.0016, True)
    assert decoder.damaged == 0


def test_an_a50_without_bottom_lock_says_so() -> None:
    (report,) = A50Decoder().receive(UNLOCKED)
    assert not report.bottom.is_valid
    assert report.bottom.reason == "no bottom lock"
    assert report.bottom.altitude_m == 0.0


def test_one_that_is_mounted_turned_is_turned_back() -> None:
    (report,) = A50Decoder(yaw_deg=90.0).receive(VELOCITY % 1)
    assert report.bottom.velocity_frd_m_s == pytest.approx((0.021, 0.512, 0.003))


def test_pd6_says_ship_velocities_in_millimetres() -> None:
    (report,) = Pd6Decoder().receive(PD6)
    assert report.bottom.velocity_frd_m_s == pytest.approx((0.512, -0.021, 0.003))
    assert report.bottom.altitude_m == 12.34
    (unlocked,) = Pd6Decoder().receive(b":BS,-32768,-32768,-32768,V\r\n")
    assert not unlocked.bottom.is_valid


@pytest.mark.parametrize(
    "line",
    [
        b"\x00\xff\xfe\n",
        b'{"type":"velocity"}\n',
        b'{"type":"velocity","vx":"x"}\n',
        b"[1]\n",
        b":BS,1\n",
        b":BS,a,b,c,A\n",
        VELOCITY % int("1" * 400),
        VELOCITY.replace(b"%d", b"1e300"),
        VELOCITY.replace(b"%d", b"-1"),
        b"[" * 30_000 + b"\n",
    ],
    ids=lambda line: line.decode("latin1")[:40],
)
def test_damaged_lines_are_counted_or_passed_over_and_the_next_one_is_read(line: bytes) -> None:
    for decoder, good in ((A50Decoder(), VELOCITY % 7), (Pd6Decoder(), PD6)):
        assert decoder.receive(line) == []
        assert len(decoder.receive(good)) == 1


@pytest.mark.parametrize("fom", [b'"nan"', b'"inf"', b"-0.1"])
def test_an_accuracy_that_is_none_is_not_taken_for_a_good_one(fom: bytes) -> None:
    (report,) = A50Decoder().receive(VELOCITY.replace(b"0.0016", fom) % 7)
    assert not report.bottom.is_valid


def test_no_distance_and_no_velocity_is_beyond_all_numbers() -> None:
    (report,) = Pd6Decoder().receive(PD6.replace(b"0012.34", b"inf").replace(b"+00512", b"nan"))
    assert (report.bottom.altitude_m, report.bottom.is_valid) == (0.0, False)


def test_a_line_without_an_end_is_not_kept_for_ever() -> None:
    decoder = A50Decoder()
    decoder.receive(b"x" * 200_000)
    assert len(decoder.receive(b"\n" + VELOCITY % 7)) == 1


def test_an_a50_over_tcp_is_read() -> None:
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        stream, _ = server.accept()
        with stream:
            stream.sendall(RECKONED + VELOCITY % 1_000_000)
            stream.recv(1)

    threading.Thread(target=serve, daemon=True).start()
    device = DvlSource("dvl", parse_source("dvl", f"a50://127.0.0.1:{server.getsockname()[1]}"), monotonic)
    received = threading.Event()
    unwatch = device.on_new_data(received.set)
    device.open()
    assert received.wait(10.0)
    stamped = device.bottom_velocity()
    device.close()
    unwatch()
    server.close()
    assert stamped is not None
    assert stamped.bottom.velocity_frd_m_s == pytest.approx((0.512, -0.021, 0.003))
    assert abs(stamped.t_s - monotonic()) < 30.0


def test_one_that_is_not_there_is_an_error_that_names_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    device = DvlSource("dvl", parse_source("dvl", f"a50://127.0.0.1:{port}"), monotonic)
    with pytest.raises(Gloc3Error, match=f"dvl: 127.0.0.1:{port}: Connection refused"):
        device.open()


def test_a_place_that_is_no_address_is_refused() -> None:
    with pytest.raises(Refused, match="write an address"):
        DvlSource("dvl", parse_source("dvl", "a50://nowhere"), monotonic)


class Device:
    """A DVL as the test sets it."""

    def __init__(self) -> None:
        self.now: StampedBottomVelocity | None = None
        self.bell = Bell()

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def on_new_data(self, ready: object) -> object:
        return self.bell.listen(ready)  # type: ignore[arg-type]

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        return self.now


@pytest.mark.parametrize(
    ("bottom", "reason"),
    [
        (BottomVelocity(velocity_frd_m_s=(0.5, 0.0, 0.0), std_m_s=0.01), ""),
        (BottomVelocity(is_valid=False, reason="no bottom lock"), "no bottom lock"),
        (BottomVelocity(velocity_frd_m_s=(nan, 0.0, 0.0)), "its numbers are not finite"),
        (BottomVelocity(velocity_frd_m_s=(12.0, 0.0, 0.0)), "it is faster than 5 m/s"),
    ],
)
def test_the_sampler_reports_each_velocity_once_and_marks_what_cannot_be_used(
    bottom: BottomVelocity, reason: str
) -> None:
    with Bench() as bench:
        device = Device()
        bench.host(ComponentRow(name="dvl", class_name="x:Y", rate_hz=8.0), lambda: DvlSampler(device))  # type: ignore[arg-type]
        device.now = StampedBottomVelocity(bench.loop.time(), bottom)
        bench.run(0.6)
        (text,) = bench.all("dvl")
        assert (text.is_valid, text.reason) == (not reason, reason)
        bench.run(3.0)
        assert bench.last("dvl").reason.startswith("no velocity for")
