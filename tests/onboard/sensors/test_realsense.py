"""RealSense cameras by Intel's own library: a software device is recorded, and the recording played by our source."""

import asyncio
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gloc3.errors import Gloc3Error, Refused
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.sensors.camera_sources import shared
from gloc3_onboard.sensors.registry import SourceHost, make_sources, parse_source, place_problem

recordings = pytest.importorskip(
    "tests.onboard.sensors.realsense_recordings",
    reason="pyrealsense2 or its libusb is not installed",
    exc_type=ImportError,
)

pytestmark = pytest.mark.sockets
WITHIN_S = 20.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = recordings.record(
        tmp_path_factory.mktemp("realsense") / "flight.db3", "depth", "colour", "left", "right"
    )
    return path


@pytest.fixture
def made(recording: Path) -> Iterator[Callable[..., dict[str, Any]]]:
    """Makes sensors by URL; closes what was opened."""
    loop, opened = asyncio.new_event_loop(), []

    def make(**urls: str) -> dict[str, Any]:
        host = SourceHost(loop, recording.parent, lambda boot_s: boot_s, AutopilotSensors())
        found = make_sources(urls, host._replace(loop=Clockwork()))  # type: ignore[arg-type]
        for sensor in found.values():
            sensor.open()
            opened.append(sensor)
        return found

    yield make
    for sensor in opened:
        sensor.close()
    loop.close()


class Clockwork:
    """The part of an event loop that such sources use."""

    def time(self) -> float:
        return time.monotonic()


def all_of(sensor: Any, read: Callable[[], Any], count: int) -> list[Any]:
    """The next different readings of a sensor."""
    found: list[Any] = []
    end_s = time.monotonic() + WITHIN_S
    while len(found) < count:
        assert time.monotonic() < end_s
        now = read()
        if now is not None and (not found or now.t_s != found[-1].t_s):
            found.append(now)
        time.sleep(0.003)
    return found


def test_depths_are_those_that_were_recorded_in_their_unit_and_at_their_times(made: Callable[..., Any]) -> None:
    begin_s = time.monotonic()
    camera = made(depth_camera="realsense-log://flight.db3?max_m=6")["depth_camera"]
    found = all_of(camera, camera.depth, 6)
    for stamped in found:
        depth = stamped.depth
        values = np.frombuffer(depth.data, "<u2").reshape(48, 64)
        assert set(np.unique(values[:, 32:])) == {0}
        number = int(values[0, 0]) - 2000
        assert np.array_equal(values, recordings.pixels("depth", number))
        assert (depth.camera, depth.width, depth.height, depth.range_max_m) == ("depth", 64, 48, 6.0)
        assert depth.scale_m == pytest.approx(recordings.UNIT_M)
    gaps_s = np.diff([stamped.t_s for stamped in found])
    assert gaps_s / np.round(gaps_s * 30.0) == pytest.approx(1.0 / 30.0, abs=0.002), "its own clock, not the arrival"
    assert begin_s <= found[0].t_s <= found[-1].t_s <= time.monotonic()


def test_one_device_gives_colour_depth_and_a_pair_at_once(made: Callable[..., Any]) -> None:
    url = "realsense-log://flight.db3"
    sensors = made(front_camera=url, front_depth_camera=url, stereo_camera=url)
    colour, depth, pair = (
        all_of(sensors[name], read, 1)[0]
        for name, read in (
            ("front_camera", sensors["front_camera"].frame),
            ("front_depth_camera", sensors["front_depth_camera"].depth),
            ("stereo_camera", sensors["stereo_camera"].pair),
        )
    )
    bgr = np.frombuffer(colour.image.bgr, np.uint8).reshape(48, 64, 3)
    assert (colour.image.camera, tuple(bgr[0, 0, ::2])) == ("front", (10, 200))
    assert 100 <= bgr[0, 0, 1] < 112
    assert len(colour.image.data) == 64 * 48
    assert depth.depth.camera == "front_depth"
    assert (pair.left.camera, pair.right.camera) == ("front_left", "front_right")
    assert pair.right.data[0] - pair.left.data[0] == 40, "both of one moment"


def test_grey_is_grey_and_a_recording_that_ends_falls_silent(made: Callable[..., Any]) -> None:
    camera = made(front_camera="realsense-log://flight.db3?pixels=grey")["front_camera"]
    all_of(camera, camera.frame, 3)
    time.sleep(1.0)
    last = camera.frame()
    time.sleep(0.5)
    assert last.image.bgr == b""
    assert camera.frame() is last


def test_a_sensor_that_is_closed_leaves_the_others_open_and_one_that_is_opened_again_begins_again(
    made: Callable[..., Any],
) -> None:
    url = "realsense-log://flight.db3"
    sensors = made(front_camera=url, depth_camera=url)
    depth = sensors["depth_camera"]
    sensors["front_camera"].close()
    first = all_of(depth, depth.depth, 2)[0]
    depth.close()
    sensors["front_camera"].open()
    depth.open()
    again = all_of(depth, depth.depth, 1)[0]
    assert again.t_s > first.t_s


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("realsense-log://nowhere.db3", "nowhere.db3 is not there"),
        ("realsense-log://flat.db3", "it has Color 64 x 48 at 30 Hz"),
        ("realsense-log://flight.db3?width=640&height=480", "Depth 64 x 48 at 30 Hz"),
        ("realsense://any", "is not connected; connected cameras: none"),
        ("realsense://0123", "realsense 0123 is not connected"),
    ],
)
def test_what_cannot_be_had_is_said_with_what_there_is(
    url: str, why: str, recording: Path, made: Callable[..., Any]
) -> None:
    if "flat" in url:
        recordings.record(recording.parent / "flat.db3", "colour", count=4)
    begin_s = time.monotonic()
    with pytest.raises(Gloc3Error, match=why):
        made(depth_camera=url)
    assert time.monotonic() - begin_s < 3.0, "a start may take 5 s"


def test_two_sensors_cannot_take_the_same_pictures() -> None:
    urls = dict.fromkeys(("a_depth_camera", "b_depth_camera"), "realsense://any")
    host = SourceHost(Clockwork(), Path(), lambda boot_s: boot_s)  # type: ignore[arg-type]
    with pytest.raises(Refused, match="a_depth_camera takes the same pictures of any"):
        make_sources(urls, host)


def test_a_device_that_is_lost_is_opened_by_each_sensor_that_tries_again() -> None:
    class Device(shared.SharedDevice):
        """It can be opened once in two times."""

        tries = 0

        def connect(self) -> Any:
            self.tries += 1
            raise Gloc3Error("gone")

    device = Device("x", time.monotonic)
    for number in range(1, 4):
        with pytest.raises(Gloc3Error, match="gone"):
            device.open()
        assert device.tries == number


@pytest.mark.parametrize("extra", ["realsense", "oak"])
def test_a_missing_library_names_its_extra(
    extra: str, monkeypatch: pytest.MonkeyPatch, made: Callable[..., Any]
) -> None:
    import gloc3_onboard.sensors.registry as registry

    monkeypatch.setattr(registry, "find_spec", lambda module: None)
    with pytest.raises(Gloc3Error, match=rf"{extra} any: .* pip install 'gloc3\[{extra}\]'"):
        made(depth_camera=f"{extra}://any")
    problem = place_problem(parse_source("depth_camera", f"{extra}://any"), Path())
    assert f"gloc3[{extra}]" in problem
