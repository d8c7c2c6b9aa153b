"""OAK cameras by Luxonis' own library: its messages, made by a node on the host, through its queues into our source.

The nodes of the camera itself need one: the library makes them only for a device.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.errors import Gloc3Error
from gloc3_onboard.sensors.camera_sources import oak
from gloc3_onboard.sensors.camera_sources.shared import SharedCamera, SharedDepthCamera, SharedStereoCamera
from gloc3_onboard.sensors.registry import parse_source

WITHIN_S = 10.0


dai: Any = pytest.importorskip("depthai", reason="depthai is not installed (400 MB, and not in the lock)")
BLUE, GREEN, RED = 10, 120, 200


def pixels(name: str, number: int) -> NDArray[Any]:
    if name == "depth":
        return np.full((48, 64), 1000 + number, np.uint16)
    if name == "colour":
        return np.full((48, 64, 3), (BLUE, GREEN, RED), np.uint8)
    return np.full((48, 64), (30 if name == "left" else 90) + number % 50, np.uint8)


def types(name: str) -> Any:
    forms = dai.ImgFrame.Type
    return {"depth": forms.RAW16, "colour": forms.BGR888i}.get(name, forms.GRAY8)


class Feeder(dai.node.ThreadedHostNode):  # type: ignore[misc] # without types
    """Sends a picture of each stream thirty times a second; the right one of a pair some pictures late."""

    def __init__(self) -> None:
        super().__init__()
        self.outputs = {name: self.createOutput() for name in ("colour", "left", "right", "depth")}

    def run(self) -> None:
        number = 0
        while self.isRunning():
            for name, output in self.outputs.items():
                frame = dai.ImgFrame()
                frame.setCvFrame(pixels(name, number), types(name))
                frame.setTimestamp(timedelta(seconds=time.monotonic() - 0.02))
                frame.setSequenceNum(number)
                if not (name == "right" and number % 3):
                    output.send(frame)
            number += 1
            time.sleep(1.0 / 30.0)


class HostOak(oak.Oak):
    """Our source, with a host's node in place of the camera's."""

    def _require(self, depthai: Any) -> None:
        """Nothing need be connected."""

    @contextmanager
    def pipeline(self, depthai: Any) -> Iterator[tuple[Any, oak.Queues]]:
        names = {"camera": ["colour"], "stereo_camera": ["left", "right"], "depth_camera": ["depth"]}
        with depthai.Pipeline(False) as pipeline:
            outputs = pipeline.create(Feeder).outputs
            yield (
                pipeline,
                {kind: [outputs[n].createOutputQueue(2, False) for n in names[kind]] for kind in self.wanted},
            )


@contextmanager
def opened(**urls: str) -> Iterator[Any]:
    device = HostOak("any", time.monotonic)
    kinds = {"camera": SharedCamera, "stereo_camera": SharedStereoCamera, "depth_camera": SharedDepthCamera}
    sensors = []
    for kind, url in urls.items():
        device.wanted[kind] = (f"front_{kind}", parse_source(f"front_{kind}", url))
        sensors.append(kinds[kind](device, kind))
    for sensor in sensors:
        sensor.open()
    yield sensors
    for sensor in sensors:
        sensor.close()
    until(lambda: not device.is_reading)


def until(is_so: Callable[[], Any]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.003)


@pytest.mark.sockets
def test_colour_pair_and_depth_come_from_one_device_with_their_times() -> None:
    with opened(camera="oak://any", stereo_camera="oak://any", depth_camera="oak://any?max_m=8") as sensors:
        camera, stereo, depth = sensors
        until(lambda: None not in (camera.frame(), stereo.pair(), depth.depth()))
        frame, pair, stamped = camera.frame(), stereo.pair(), depth.depth()
        now_s = time.monotonic()
    assert (frame.image.camera, frame.image.width, frame.image.height) == ("front", 64, 48)
    assert tuple(frame.image.bgr[:3]) == (BLUE, GREEN, RED)
    assert len(frame.image.data) == 64 * 48
    assert pair.right.data[0] - pair.left.data[0] == 60, "both of one exposure"
    assert (pair.left.camera, pair.right.camera) == ("front_left", "front_right")
    assert (stamped.depth.camera, stamped.depth.scale_m, stamped.depth.range_max_m) == ("front_depth", 0.001, 8.0)
    values = np.frombuffer(stamped.depth.data, "<u2")
    assert len(values) == 64 * 48
    assert set(values - 1000) == {int(values[0]) - 1000}
    assert 0.02 <= now_s - stamped.t_s < 1.0


@pytest.mark.sockets
def test_grey_has_no_colours_and_a_picture_of_another_clock_has_the_time_of_its_arrival() -> None:
    with opened(camera="oak://any?pixels=grey") as (camera,):
        until(camera.frame)
        assert camera.frame().image.bgr == b""
    frame = dai.ImgFrame()
    frame.setTimestamp(timedelta(seconds=12.0))
    assert oak._stamp_s(frame, 5000.0) == 5000.0
    assert oak._stamp_s(frame, 12.1) == pytest.approx(12.0)


@pytest.mark.sockets
@pytest.mark.parametrize("place", ["any", "14442C10D13EABCE00"])
def test_a_camera_that_is_not_connected_is_said_to_be_so(place: str) -> None:
    with pytest.raises(Gloc3Error, match=f"oak {place} is not connected; connected cameras: none"):
        oak.Oak(place, time.monotonic).open()
