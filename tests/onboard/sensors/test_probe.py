"""Probes of one number: their lines, alone and over a real socket, and their readings in a log."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic

import pytest

from gloc3.clock import Clock
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error
from gloc3.exchange import Publisher
from gloc3.log.record import Recorder
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.sensors.registry import SourceHost, make_sources, parse_source
from gloc3_onboard.sensors.sources.probe import LineDecoder, LineProbe

CO2 = "co2_probe"


@pytest.mark.parametrize(
    ("name", "line", "values"),
    [
        ("co2", b"co2 612.4 ppm\n", [612.4]),
        ("co2", b"t=20.1 CO2=612ppm\r\n", [612.0]),
        ("z", b" Z 00612 z 00620\r\n", [612.0]),
        ("", b"-1.5e2\n.5\n", [-150.0, 0.5]),
        ("", b"co2: 7\n", [7.0]),
        ("co2", b"xco2 5\nco2x 5\nco2 nan\n\n\xff\xfe\n", []),
        ("", b"1e999\n", []),
        ("co2", b"co2 612", []),
        ("co2", b"x" * 600 + b" co2 612\n", []),
    ],
)
def test_the_number_after_the_name_is_the_value(name: str, line: bytes, values: list[float]) -> None:
    decoder = LineDecoder(name)
    assert decoder.receive(line) == values
    assert decoder.unread == line.count(b"\n") - len(values)


def test_lines_come_in_any_pieces_and_one_without_an_end_is_not_kept() -> None:
    decoder = LineDecoder("co2")
    assert [value for piece in (b"co", b"2 61", b"2.5 ppm\nco2 6", b"13\n") for value in decoder.receive(piece)] == [
        612.5,
        613.0,
    ]
    decoder.receive(b"x" * 10_000)
    assert decoder.receive(b"\nco2 614\n") == [614.0]


@contextmanager
def served(data: bytes) -> Iterator[str]:
    """The URL of a device that sends some bytes to whoever connects."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        stream, _ = server.accept()
        with stream:
            stream.sendall(data)
            stream.recv(1)

    threading.Thread(target=serve, daemon=True).start()
    with server:
        yield f"lines://127.0.0.1:{server.getsockname()[1]}"


def test_a_probe_over_tcp_is_read() -> None:
    with served(b"temperature 18.5 C\nco2 612.5 ppm\n") as url:
        device = LineProbe(CO2, parse_source(CO2, f"{url}#co2"), monotonic)
        received = threading.Event()
        device.on_new_data(received.set)
        device.open()
        assert received.wait(10.0)
        reading = device.reading()
        device.close()
    assert reading is not None
    assert reading.value == 612.5
    assert abs(reading.t_s - monotonic()) < 30.0


def open_and_read(device: LineProbe) -> None:
    """Reads until it raises; a thread of the device has to see the lines first, and it may have done so at once."""
    device.open()
    between = threading.Event()
    for _ in range(1000):
        assert device.reading() is None
        between.wait(0.01)


def test_one_that_never_says_the_name_is_given_up_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gloc3_onboard.sensors.threaded.GIVE_UP_S", 0.0)
    with served(b"temperature 18.5 C\n" * 60) as url:
        device = LineProbe(CO2, parse_source(CO2, f"{url}#co2"), monotonic)
        with pytest.raises(Gloc3Error, match=r"\d+ sends lines, but none with a number after 'co2'"):
            open_and_read(device)
        device.close()


def logged(path: Path) -> None:
    """A log of ours with a topic that has numbers."""
    with Bench() as bench:
        rows = {"depth_below": TopicRow(HeightAboveGround, 10.0)}
        recorder = Recorder(path, Clock(bench.loop), TopicTable(rows), {"platform": "bench"})
        recorder.attach(bench.exchange, bench.loop)
        publisher = Publisher(bench.exchange, "bench", "source", 7)
        for number in range(5):
            bench.run(0.2)
            publisher.publish(
                "bench/depth_below", HeightAboveGround(height_m=float(number), is_valid=True), t_s=bench.loop.time()
            )
        recorder.close()


def test_a_number_of_any_topic_of_a_log_is_a_probes_reading(tmp_path: Path) -> None:
    logged(tmp_path / "log.mcap")
    with Bench() as bench:
        host = SourceHost(bench.loop, tmp_path, lambda boot_s: boot_s)
        device = make_sources({CO2: "mcap://log.mcap#depth_below.height_m"}, host)[CO2]
        found = []
        device.on_new_data(lambda: found.append(tuple(device.reading())))
        device.open()
        bench.run(1.0)
    assert found == [(pytest.approx(0.2 * number, abs=1e-6), float(number)) for number in range(5)]


@pytest.mark.parametrize(
    ("part", "says"),
    [
        ("#depth_below", "of which topic it reads .*#TOPIC.FIELD"),
        ("#depth_below.height", "has no field 'height' .*did you mean 'height_m'"),
        ("#depth_belov.height_m", "did you mean 'depth_below'"),
    ],
)
def test_what_is_no_number_of_a_log_is_refused_with_a_hint(tmp_path: Path, part: str, says: str) -> None:
    logged(tmp_path / "log.mcap")
    with Bench() as bench:
        host = SourceHost(bench.loop, tmp_path, lambda boot_s: boot_s)
        device = make_sources({CO2: f"mcap://log.mcap{part}"}, host)[CO2]
        with pytest.raises(Gloc3Error, match=says):
            device.open()
