"""Laser scanners by the real bytes of their protocols: an RPLIDAR on a pseudo-terminal, a Hokuyo on one and over TCP."""

import math
import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.onboard.scripted_sources import scan

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import LaserScan
from gloc3_onboard.sensors.devices import StampedScan
from gloc3_onboard.sensors.registry import parse_source
from gloc3_onboard.sensors.sources.hokuyo import HokuyoLaser
from gloc3_onboard.sensors.sources.laser import mounted_scan
from gloc3_onboard.sensors.sources.rplidar import RpLidar, scan_of
from gloc3_onboard.sensors.sources.scip import ScipError, ScipReader, parameters_of, turn_of

WITHIN_S = 20.0
FIRST, LAST, FRONT, STEPS = 44, 725, 384, 1024


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def summed(line: bytes, end: bytes = b"") -> bytes:
    """A line of SCIP with its checksum."""
    return line + end + bytes([(sum(line) & 0x3F) + 0x30]) + b"\n"


def digits(value: int, count: int) -> bytes:
    return bytes(0x30 + (value >> 6 * (count - 1 - place) & 0x3F) for place in range(count))


def parameters() -> bytes:
    rows = {"MODL": "URG-04LX", "DMIN": 20, "DMAX": 5600, "ARES": STEPS, "AMIN": FIRST, "AMAX": LAST, "AFRT": FRONT}
    rows["SCAN"] = 600
    lines = b"".join(summed(f"{key}:{value}".encode(), b";") for key, value in rows.items())
    return b"PP\n" + summed(b"00") + lines + b"\n"


def turn(stamp_ms: int, ranges_mm: list[int]) -> bytes:
    data = b"".join(digits(value, 3) for value in ranges_mm)
    blocks = b"".join(summed(data[at : at + 64]) for at in range(0, len(data), 64))
    return b"MD0044072501000\n" + summed(b"99") + summed(digits(stamp_ms, 4)) + blocks + b"\n"


def ranges() -> list[int]:
    found = [4000] * (LAST - FIRST + 1)
    found[FRONT - FIRST] = 1234
    found[FRONT + 256 - FIRST] = 2500
    found[0] = 19
    return found


def toward(found: LaserScan, angle_deg: float) -> float:
    beams = np.frombuffer(found.ranges_m, "<f4")
    return float(beams[round((math.radians(angle_deg) - found.angle_min_rad) / found.angle_step_rad)])


class Hokuyo:
    """The scanner's end of a line: answers as SCIP 2 says, and measures when told to."""

    def __init__(self, read: Callable[[], bytes], write: Callable[[bytes], object]) -> None:
        self._read, self._write = read, write
        self.received = b""
        self.is_mute = False

    def run(self) -> None:
        count, is_measuring = 0, False
        while True:
            try:
                data = self._read()
                self.received += data
                if b"QT\n" in data:
                    self._write(b"QT\n" + summed(b"00") + b"\n")
                if b"PP\n" in data and not self.is_mute:
                    self._write(parameters())
                is_measuring = is_measuring or b"MD0044072501000\n" in self.received
                if is_measuring:
                    broken = b"MD0044072501000\n" + summed(b"99") + b"0000$\n" + b"\n"
                    self._write(broken if count == 1 else turn((1 << 24) - 150 + 100 * count & (1 << 24) - 1, ranges()))
                    count += 1
                    time.sleep(0.02)
            except OSError:
                return


@contextmanager
def hokuyo_on_a_terminal(*, is_mute: bool = False, is_slow: bool = False) -> Iterator[str]:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)

    closed = threading.Event()

    def read() -> bytes:
        try:
            return os.read(ours, 4096)
        except BlockingIOError:
            time.sleep(0.005)
            return b""

    def write(data: bytes) -> None:
        for piece in [bytes((byte,)) for byte in data] if is_slow else [data]:
            if closed.is_set():
                raise OSError("the scanner is switched off")
            os.write(ours, piece)
            time.sleep(1e-3 if is_slow else 0.0)

    scanner = Hokuyo(read, write)
    scanner.is_mute = is_mute
    running = threading.Thread(target=scanner.run, daemon=True)
    running.start()
    try:
        yield os.ttyname(theirs)
    finally:
        closed.set()
        running.join(0.2)  # it may wait for its line, whose end it sees then
        os.close(theirs)
        os.close(ours)


def first_turns(device: HokuyoLaser | RpLidar, count: int = 3) -> list[StampedScan]:
    found: list[StampedScan] = []

    def keep() -> None:
        stamped = device.scan()
        assert stamped is not None
        found.append(stamped)

    unwatch = device.on_new_data(keep)
    device.open()
    try:
        until(lambda: len(found) >= count)
    finally:
        device.close()
        unwatch()
    return found[:count]


def expect_hokuyo(found: list[StampedScan]) -> None:
    for stamped in found:
        assert (stamped.scan.range_min_m, stamped.scan.range_max_m) == (0.02, 5.6)
        assert toward(stamped.scan, 0.0) == pytest.approx(1.234)
        assert toward(stamped.scan, 90.0) == pytest.approx(2.5), "to the left"
        assert np.frombuffer(stamped.scan.ranges_m, "<f4")[0] == 0.0, "an error code is no reading"
    assert found[0].t_s < found[1].t_s < found[2].t_s <= time.monotonic()


@pytest.mark.sockets
def test_a_hokuyo_on_a_serial_line_is_read_and_a_damaged_turn_left_out() -> None:
    with hokuyo_on_a_terminal() as path:
        expect_hokuyo(first_turns(HokuyoLaser("laser", parse_source("laser", f"hokuyo://{path}"), time.monotonic)))


@pytest.mark.sockets
def test_an_answer_in_many_pieces_is_read() -> None:
    with hokuyo_on_a_terminal(is_slow=True) as path:
        device = HokuyoLaser("laser", parse_source("laser", f"hokuyo://{path}"), time.monotonic)
        device.open()
        device.close()


@pytest.mark.sockets
def test_a_hokuyo_over_tcp_is_read() -> None:
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        stream, _ = server.accept()
        with stream:
            stream.settimeout(0.02)

            def read() -> bytes:
                try:
                    return stream.recv(4096)
                except TimeoutError:
                    return b""

            Hokuyo(read, stream.sendall).run()

    threading.Thread(target=serve, daemon=True).start()
    url = parse_source("laser", f"hokuyo://127.0.0.1:{server.getsockname()[1]}")
    expect_hokuyo(first_turns(HokuyoLaser("laser", url, time.monotonic)))
    server.close()


@pytest.mark.sockets
def test_what_does_not_answer_as_a_scanner_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from gloc3_onboard.sensors.sources import hokuyo

    monkeypatch.setattr(hokuyo, "WAIT_S", 0.02)
    monkeypatch.setattr(hokuyo, "ANSWER_S", 0.1)
    with hokuyo_on_a_terminal(is_mute=True) as path:
        device = HokuyoLaser("laser", parse_source("laser", f"hokuyo://{path}"), time.monotonic)
        with pytest.raises(Gloc3Error, match="does not answer as a Hokuyo"):
            device.open()
    device = HokuyoLaser("laser", parse_source("laser", "hokuyo:///dev/nothing"), time.monotonic)
    with pytest.raises(Gloc3Error, match="is not there; is it plugged in"):
        device.open()
    device = HokuyoLaser("laser", parse_source("laser", "hokuyo://127.0.0.1:1"), time.monotonic)
    with pytest.raises(Gloc3Error, match=r"127\.0\.0\.1:1: "):
        device.open()


@pytest.mark.thorough
def test_replies_survive_being_cut_anywhere_and_are_decoded() -> None:
    data = parameters() + turn(123_456, ranges())
    for cut in range(0, len(data), 7):
        reader = ScipReader()
        replies = reader.receive(data[:cut]) + reader.receive(data[cut:])
        assert len(replies) == 2
        found = parameters_of(replies[0])
        assert (found.model, found.first, found.last, found.front) == ("URG-04LX", FIRST, LAST, FRONT)
        measured = turn_of(replies[1], LAST - FIRST + 1)
        assert measured.stamp_ms == 123_456
        assert list(measured.ranges_mm) == ranges()


@settings(max_examples=60)
@given(st.integers(0, 2200), st.integers(0, 255))
def test_no_damage_to_a_turn_is_taken_for_another_distance(place: int, byte: int) -> None:
    good = turn(5, ranges())
    data = bytearray(good)
    place %= len(data)
    data[place] = byte
    if bytes(data) == good:
        return
    for reply in ScipReader().receive(bytes(data)):
        try:
            found = turn_of(reply, LAST - FIRST + 1)
        except ScipError:
            continue
        assert list(found.ranges_mm) == ranges(), "only the echo or the stamp's own checksum may be other"


def test_a_stream_without_an_end_is_refused() -> None:
    reader = ScipReader()
    reader.receive(b"x" * 60_000)
    with pytest.raises(ScipError):
        reader.receive(b"x" * 60_000)


# --- RPLIDAR ---


def measurement(angle_deg: float, distance_m: float, *, is_first: bool) -> bytes:
    """The five bytes of a point."""
    angle, distance = round(angle_deg * 64.0), round(distance_m * 4000.0)
    first = 0b01 if is_first else 0b10
    return bytes([47 << 2 | first, (angle << 1 & 0xFF) | 1, angle >> 7 & 0xFF, distance & 0xFF, distance >> 8 & 0xFF])


@contextmanager
def rplidar_on_a_terminal() -> Iterator[str]:
    """A scanner that answers health and scan commands, and sends a point each degree: 2 m, but 1 m to the right."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    stop = threading.Event()

    def run() -> None:
        is_scanning = False
        while not stop.is_set():
            try:
                data = os.read(ours, 4096)
            except BlockingIOError:
                data = b""
                time.sleep(0.002)
            except OSError:
                return
            if b"\xa5\x25" in data:
                is_scanning = False
            if b"\xa5\x52" in data:
                os.write(ours, bytes([0xA5, 0x5A, 3, 0, 0, 0, 6, 0, 0, 0]))
            if b"\xa5\x20" in data:
                os.write(ours, bytes([0xA5, 0x5A, 5, 0, 0, 0x40, 0x81]))
                is_scanning = True
            if is_scanning:
                points = [(k + 0.3, 1.0 if 85 <= k <= 95 else 0.0 if k == 200 else 2.0) for k in range(360)]
                try:
                    os.write(ours, b"".join(measurement(*p, is_first=k == 0) for k, p in enumerate(points)))
                except OSError:
                    continue
                time.sleep(0.03)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        stop.set()
        thread.join()
        os.close(theirs)
        os.close(ours)


@pytest.mark.sockets
def test_an_rplidar_on_a_serial_line_is_read_by_its_library() -> None:
    pytest.importorskip("adafruit_rplidar", reason="the extra `laser` is not installed")
    with rplidar_on_a_terminal() as path:
        device = RpLidar("laser", parse_source("laser", f"rplidar://{path}"), time.monotonic)
        found = first_turns(device)
    for stamped in found:
        assert toward(stamped.scan, 0.0) == pytest.approx(2.0)
        assert toward(stamped.scan, -90.0) == pytest.approx(1.0), "its angles are clockwise"
        assert toward(stamped.scan, 90.0) == pytest.approx(2.0)
        assert toward(stamped.scan, 160.0) == 0.0, "no reading"
    assert 0.0 < found[1].scan.duration_s < 1.0


def test_points_of_a_turn_are_put_into_beams_of_a_degree_the_nearest_kept() -> None:
    found = scan_of("laser", [(0.2, 2000.0), (359.9, 1500.0), (90.0, 3000.0), (91.0, 0.0)], 0.1, 12.0)
    assert toward(found, 0.0) == pytest.approx(1.5)
    assert toward(found, -90.0) == pytest.approx(3.0)
    assert toward(found, -91.0) == 0.0
    assert len(found.ranges_m) == 4 * 360


def test_a_scanner_may_be_turned_or_hang_upside_down_and_its_times_be_shifted() -> None:
    seen = scan([1.0, 2.0, 3.0, 4.0, 5.0])  # from 90 degrees right to 90 degrees left
    t_s, turned = mounted_scan(2.0, seen, parse_source("laser", "hokuyo:///dev/a?yaw_deg=45&time_shift_s=-0.02"))
    assert t_s == pytest.approx(1.98)
    assert turned.angle_min_rad == pytest.approx(-math.pi / 4)
    _, flipped = mounted_scan(2.0, seen, parse_source("laser", "hokuyo:///dev/a?is_flipped=1"))
    assert toward(flipped, 90.0) == 1.0
    assert toward(flipped, -90.0) == 5.0
