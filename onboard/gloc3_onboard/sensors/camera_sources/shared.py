"""Cameras of several streams: one device, opened once, from which sensors of different kinds take their pictures."""

import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

from gloc3.errors import Refused
from gloc3_onboard.sensors.camera_sources.camera import CAMERA, camera_name
from gloc3_onboard.sensors.camera_sources.depth import DEPTH, depth_name
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, pair_names
from gloc3_onboard.sensors.devices import StampedDepth, StampedImage, StampedPair, Unwatch
from gloc3_onboard.sensors.registry import SourceRequest
from gloc3_onboard.sensors.source_url import DEPTHS, PIXELS, Number, Options, SourceUrl
from gloc3_onboard.sensors.threaded import ThreadedSource

STREAMS: Final[Options] = {
    "width": Number(16, 16_384, True),
    "height": Number(16, 16_384, True),
    "rate_hz": Number(1.0, 300.0),
    **PIXELS,
    **DEPTHS,
}
"""The options of each stream."""
EVERY: Final = (CAMERA, STEREO, DEPTH)
SILENT_S: Final = 3.0
"""So long a device that works is never without a picture."""


class SharedDevice(ThreadedSource[Mapping[str, Any]]):
    """The base of such devices. It reads the streams that its sensors want, while at least one of them is open.

    What was read last is by kind of sensor, each with its time.
    """

    def __init__(self, name: str, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self.wanted: Final[dict[str, tuple[str, SourceUrl]]] = {}
        """By kind of sensor: the name of the device, and its URL."""
        self._users = 0
        self._lock = threading.Lock()

    def open(self) -> None:
        """Starts reading, unless it does."""
        with self._lock:
            if not self.is_reading or self._users == 0:
                super().open()
            self._users += 1

    def close(self) -> None:
        """Stops reading when no sensor is open any more."""
        with self._lock:
            self._users -= 1
            if self._users == 0:
                super().close()


class _Sensor:
    def __init__(self, device: SharedDevice, kind: str) -> None:
        self._device, self._kind = device, kind

    def open(self) -> None:
        """Opens the device.

        Raises:
            Gloc3Error: it cannot be opened; the message says what to do.
        """
        self._device.open()

    def close(self) -> None:
        """Takes no more pictures."""
        self._device.close()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when the device has a picture."""
        return self._device.on_new_data(ready)

    def _latest(self) -> Any:
        return (self._device.latest() or {}).get(self._kind)


class SharedCamera(_Sensor):
    """The colour camera of such a device."""

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        frame: StampedImage | None = self._latest()
        return frame


class SharedStereoCamera(_Sensor):
    """Its stereo pair."""

    def pair(self) -> StampedPair | None:
        """The latest two frames; None before the first."""
        pair: StampedPair | None = self._latest()
        return pair


class SharedDepthCamera(_Sensor):
    """Its depth camera."""

    def depth(self) -> StampedDepth | None:
        """The latest frame; None before the first."""
        depth: StampedDepth | None = self._latest()
        return depth


def sensor_of_device(request: SourceRequest, device: SharedDevice) -> Any:
    """The sensor that takes its pictures from a device.

    Raises:
        Refused: another device takes the same pictures.
    """
    kind = request.sensor.name
    if device.wanted.setdefault(kind, (request.device, request.url))[0] != request.device:
        raise Refused(f"{request.device}: {device.wanted[kind][0]} takes the same pictures of {request.url.place}")
    return {CAMERA: SharedCamera, STEREO: SharedStereoCamera, DEPTH: SharedDepthCamera}[kind](device, kind)


def picture_names(kind: str, device: str) -> tuple[str, ...]:
    """What the pictures of a sensor are called."""
    if kind == STEREO:
        return pair_names(device)
    return (depth_name(device) if kind == DEPTH else camera_name(device),)
