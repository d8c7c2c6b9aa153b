"""Any topic can be recorded or left out, at a rate, from the begin or from a moment on; pictures keep every pixel."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.camera.opencv import load_opencv
from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.exchange.base import LocalExchange, Publisher
from gloc3.log.payloads import PACKED
from gloc3.log.pictures import pack_picture, unpack_picture
from gloc3.log.reader import LogReader
from gloc3.log.record import Recorder
from gloc3.log.selection import TopicChoice, merged, period_s
from gloc3.messages.perception import ImuSample
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import HeightAboveGround, Image

from .samples import HEIGHT, LogInMemory

TABLE = TopicTable(TOPICS)
IMU = ImuSample(rate_frd_rad_s=(0.0, 0.0, 0.1), specific_force_frd_m_s2=(0.0, 0.0, -9.81))


def recorded(log: LogInMemory, file: Path, topic: str) -> list[float]:
    """The times of the messages of a topic."""
    file.write_bytes(log.close())
    with LogReader(file, TABLE.types) as reader:
        return [entry.envelope.t_s for entry in reader.entries(topic)]


@pytest.mark.parametrize(
    ("topic", "chosen", "period"),
    [
        ("imu", {}, None),
        ("pose", {}, 0.0),
        ("imu", {"imu": True}, 0.0),
        ("pose", {"pose": False}, None),
        ("camera/front", {"camera/*": 2.0}, 0.5),
        ("camera/front", {"camera/*": 2.0, "camera/front": True}, 0.0),
        ("camera/front", {"camera/front": True, "camera/*": 2.0}, 0.0),
        ("camera/front", {"**": False, "camera/*": 4.0}, 0.25),
        ("camera/front", {"camera/*": 4.0, "**": False}, None),
        ("of_others", {}, 0.0),
    ],
)
def test_an_exact_name_counts_most_then_the_last_pattern_then_the_row(
    topic: str, chosen: dict[str, TopicChoice], period: float | None
) -> None:
    assert period_s(topic, TABLE.row(f"pelican/{topic}"), chosen) == period


@pytest.mark.parametrize(("rate_hz", "count"), [(100.0, 100), (50.0, 50), (40.0, 40), (7.0, 7), (1.0, 1)])
def test_a_topic_is_thinned_to_its_rate_although_times_jitter(rate_hz: float, count: int, tmp_path: Path) -> None:
    log = LogInMemory(TABLE, {"imu": rate_hz})
    jitter = np.random.default_rng(1).uniform(-0.001, 0.001, 1000)
    for index in range(1000):
        log.send("imu", IMU, 0.01 * index + float(jitter[index]) + 0.001, HEIGHT)
    times = recorded(log, tmp_path / "log.mcap", "imu")
    assert len(times) == pytest.approx(10 * count, abs=2)
    assert max(np.diff(times)) < 1.5 / rate_hz + 0.01


def test_a_time_that_jumps_back_does_not_silence_a_topic(tmp_path: Path) -> None:
    log = LogInMemory(TABLE, {"imu": 1.0})
    for t_s in (100.0, 100.5, 1.0, 1.5, 2.0):
        log.recorder.record(log.envelope("imu", IMU, t_s, HEIGHT))
    assert recorded(log, tmp_path / "log.mcap", "imu") == [100.0, 1.0, 2.0]


def test_what_is_recorded_changes_while_recording(tmp_path: Path) -> None:
    log = LogInMemory(TABLE)
    for index in range(30):
        if index == 10:
            log.recorder.select({"imu": True, "height": False})
        if index == 20:
            log.recorder.select({})
        log.send("imu", IMU, float(index), HEIGHT)
        log.send("height", HeightAboveGround(height_m=1.0, is_valid=True), float(index), HEIGHT)
    file = tmp_path / "log.mcap"
    assert recorded(log, file, "imu") == [float(index) for index in range(10, 20)]
    with LogReader(file, TABLE.types) as reader:
        heights = [entry.envelope.t_s for entry in reader.entries("height")]
        assert heights == [float(index) for index in (*range(10), *range(20, 30))]
        assert len(reader.scan.channels) == 3  # one for each, and the frames


def test_a_pattern_that_fits_no_topic_is_refused_with_the_nearest() -> None:
    assert merged({"imu": True, "laser": True}, {"imu": 2.0}, TABLE) == {"laser": True, "imu": 2.0}
    with pytest.raises(Refused, match="no topic fits 'lasers'; did you mean 'laser'"):
        merged({}, {"lasers": True}, TABLE)


def picture(seed: int, *, is_colour: bool, is_derived: bool = True) -> Image:
    random = np.random.default_rng(seed)
    colour = random.integers(0, 256, (24, 32, 3), np.uint8)
    cv2 = load_opencv()
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY) if is_derived else random.integers(0, 256, (24, 32), np.uint8)
    bgr = colour.tobytes() if is_colour else b""
    return Image(camera="front", width=32, height=24, data=grey.tobytes(), bgr=bgr)


@pytest.mark.parametrize("image", [picture(1, is_colour=False), picture(2, is_colour=True), picture(3, is_colour=True, is_derived=False)])  # fmt: skip
def test_a_packed_picture_keeps_every_pixel(image: Image) -> None:
    packed = pack_picture(image)
    assert packed.data.startswith(b"\x89PNG")
    assert unpack_picture(packed) == image


@given(st.binary(max_size=40), st.binary(max_size=40), st.integers(0, 8), st.integers(0, 8))
def test_whatever_a_picture_holds_it_comes_back(data: bytes, bgr: bytes, width: int, height: int) -> None:
    image = Image(camera="front", width=width, height=height, data=data, bgr=bgr)
    assert unpack_picture(pack_picture(image)) == image


def test_pictures_are_recorded_as_png_files_and_read_back_whole(tmp_path: Path) -> None:
    log = LogInMemory(TABLE, {"camera/*": True})
    sent = [log.send("camera/front", picture(seed, is_colour=seed % 2 == 1), float(seed), HEIGHT) for seed in range(4)]
    file = tmp_path / "log.mcap"
    file.write_bytes(log.close())
    with LogReader(file, TABLE.types) as reader:
        assert [entry.envelope for entry in reader.entries("camera/*")] == sent
        schemas = {schema.name for schema in reader.scan.schemas.values()}
    assert "foxglove.CompressedImage" in schemas


@pytest.mark.sockets
@pytest.mark.parametrize("flush_s", [0.02, 60.0])
async def test_in_wall_time_pictures_are_compressed_in_a_thread_and_none_is_missing(
    tmp_path: Path, flush_s: float
) -> None:
    loop, exchange, file = asyncio.get_running_loop(), LocalExchange(), tmp_path / "log.mcap"
    recorder = Recorder(file, Clock(loop), TABLE, {"platform": "bench"}, flush_s=flush_s, chosen={"camera/*": True})
    recorder.attach(exchange, loop)
    camera = Publisher(exchange, "bench", "camera", 1)
    sent: list[Any] = [picture(seed, is_colour=True) for seed in range(80)]
    times = []
    for image in sent:
        times.append(loop.time())
        camera.publish("bench/camera/front", image, times[-1])
        await asyncio.sleep(0.005)
    recorder.close()
    assert recorder.lost == 0
    with LogReader(file, TABLE.types) as reader:
        entries = list(reader.entries("camera/front"))
        assert [entry.envelope.payload for entry in entries] == sent
        assert [entry.envelope.t_s for entry in entries] == times
        assert all(0.0 <= entry.now_s - t_s < 0.1 for entry, t_s in zip(entries, times, strict=True))
        assert reader.losses() == []


@pytest.mark.sockets
@pytest.mark.parametrize(
    "error", [MemoryError("no room"), OSError("no room"), RuntimeError("(-4:Insufficient memory)")]
)
async def test_a_picture_that_cannot_be_compressed_is_lost_and_the_log_goes_on(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pack(image: Image) -> Any:
        if image == bad:
            raise error
        return pack_picture(image)

    good, bad = picture(1, is_colour=True), picture(2, is_colour=True)
    monkeypatch.setitem(PACKED, Image, (pack, unpack_picture))
    loop, exchange, file = asyncio.get_running_loop(), LocalExchange(), tmp_path / "log.mcap"
    recorder = Recorder(file, Clock(loop), TABLE, {"platform": "bench"}, flush_s=0.01, chosen={"camera/*": True})
    recorder.attach(exchange, loop)
    camera = Publisher(exchange, "bench", "camera", 1)
    for image in (good, bad, good):
        camera.publish("bench/camera/front", image, loop.time())
        await asyncio.sleep(0.1)
    assert (recorder.lost, recorder.problem) == (1, "")
    with LogReader(file, TABLE.types) as reader:
        assert [entry.envelope.payload for entry in reader.entries("camera/front")] == [good, good], "it is flushed"
    recorder.close()


def test_flushing_goes_on_after_a_flush_that_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    log, exchange = LogInMemory(), LocalExchange()
    log.recorder.attach(exchange, log.loop)
    flushed: list[float] = []

    def flush() -> None:
        flushed.append(log.loop.time())
        if len(flushed) == 1:
            raise MemoryError

    monkeypatch.setattr(log.recorder._writer, "flush", flush)
    log.loop.run_until_complete(asyncio.sleep(0.8))
    assert flushed == pytest.approx([0.25, 0.5, 0.75])
    assert [type(error) for error in log.loop.failures] == [MemoryError]
    log.close()
