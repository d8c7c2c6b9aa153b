"""Stereo cameras: two cameras that expose at the same time, one picture with both sides, and their replay from logs."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.component.workers import guard
from gloc3.errors import Refused, nearest
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Camera, StampedImage, StampedPair, StereoCamera, Unwatch
from gloc3_onboard.sensors.registry import SensorKind, SourceKind, SourceRequest, sensor_of
from gloc3_onboard.sensors.replay import Recorded, Replay, matching, topic_records
from gloc3_onboard.sensors.source_url import Number

STEREO: Final = "stereo_camera"
WITHIN_S: Final = 0.005
"""How far apart in time the frames of a pair may be, unless the URL says so."""
KEPT: Final = 4
"""Frames of each side that wait for their partner."""


class PairedCameras:
    """Two cameras as one: frames exposed within a time of each other; notifies when the later one arrives.

    Args:
        left: left camera; opened and closed with the pair.
        right: right camera; likewise.
        within_s: largest time difference within a pair.
        is_virtual: whether they are opened one after the other, without a thread, as virtual time demands.
    """

    def __init__(self, left: Camera, right: Camera, within_s: float, *, is_virtual: bool = False) -> None:
        self._left, self._right, self._within_s, self._is_virtual = left, right, within_s, is_virtual
        self._lefts: deque[StampedImage] = deque(maxlen=KEPT)
        self._rights: deque[StampedImage] = deque(maxlen=KEPT)
        self._latest: StampedPair | None = None
        self._lock = threading.Lock()

    def open(self) -> None:
        """Opens both, at the same time: each may take nearly as long as a start may.

        Raises:
            Gloc3Error: one of them cannot be had.
        """
        with self._lock:
            self._lefts.clear()
            self._rights.clear()
            self._latest = None
        errors: list[BaseException | None] = [None, None]

        def open_left() -> None:
            _, errors[0] = guard(self._left.open)

        opening = threading.Thread(target=open_left, name="pair", daemon=True)
        if self._is_virtual:
            open_left()
        else:
            opening.start()
        _, errors[1] = guard(self._right.open)
        if not self._is_virtual:
            opening.join()
        failed = errors[0] or errors[1]
        if failed is not None:
            for camera, error in zip((self._left, self._right), errors, strict=True):
                if error is None:
                    camera.close()
            raise failed

    def close(self) -> None:
        """Closes both."""
        self._left.close()
        self._right.close()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when either has a frame."""
        unwatch = (self._left.on_new_data(ready), self._right.on_new_data(ready))

        def both() -> None:
            for one in unwatch:
                one()

        return both

    def pair(self) -> StampedPair | None:
        """The latest two frames that belong together; None before the first. Any thread may ask."""
        with self._lock:
            return self._paired()

    def _paired(self) -> StampedPair | None:
        for camera, kept in ((self._left, self._lefts), (self._right, self._rights)):
            frame = camera.frame()
            if frame is not None and (not kept or frame.t_s != kept[-1].t_s):
                kept.append(frame)
        after_s = self._latest.t_s if self._latest is not None else float("-inf")
        matches = [
            (max(left.t_s, right.t_s), left.image, right.image)
            for left in self._lefts
            for right in self._rights
            if abs(left.t_s - right.t_s) <= self._within_s and max(left.t_s, right.t_s) > after_s
        ]
        if matches:
            self._latest = StampedPair(*max(matches, key=lambda match: match[0]))
        return self._latest


class SideBySide:
    """A stereo camera that delivers both views side by side in one picture.

    Args:
        camera: source of the pictures.
        names: names of the left and the right camera.
    """

    def __init__(self, camera: Camera, names: tuple[str, str]) -> None:
        self._camera, self._names = camera, names
        self._cut: tuple[StampedImage, StampedPair] | None = None

    def open(self) -> None:
        """Opens the camera."""
        self._camera.open()

    def close(self) -> None:
        """Closes it."""
        self._camera.close()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when it has a frame."""
        return self._camera.on_new_data(ready)

    def pair(self) -> StampedPair | None:
        """The halves of the latest frame; None before the first."""
        frame = self._camera.frame()
        if frame is None:
            return None
        if self._cut is None or self._cut[0] is not frame:
            left, right = (half(frame.image, side, self._names[side]) for side in (0, 1))
            self._cut = (frame, StampedPair(frame.t_s, left, right))
        return self._cut[1]


def half(image: Image, side: int, name: str) -> Image:
    """The left (0) or right (1) half of a picture; one that is not whole stays so."""
    width = image.width // 2
    if len(image.data) != image.width * image.height or image.width % 2:
        return msgspec.structs.replace(image, camera=name)
    import numpy as np

    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
    data = rows[:, side * width : (side + 1) * width].tobytes()
    bgr = b""
    if len(image.bgr) == 3 * len(image.data):
        colours = np.frombuffer(image.bgr, np.uint8).reshape(image.height, image.width, 3)
        bgr = colours[:, side * width : (side + 1) * width].tobytes()
    return msgspec.structs.replace(image, camera=name, width=width, data=data, bgr=bgr)


def pair_names(device: str) -> tuple[str, str]:
    """What the pictures of a stereo camera are called: those of `stereo_camera` are *front_left* and *front_right*."""
    name = device.removesuffix(STEREO).rstrip("_") or "front"
    return f"{name}_left", f"{name}_right"


class ReplayStereoCamera(Replay[tuple[Image, Image]]):
    """A stereo pair of a log."""

    _pair: StampedPair | None = None

    def play(self, t_s: float, item: tuple[Image, Image]) -> None:
        """Keeps a pair."""
        self._pair = StampedPair(t_s, *item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._pair = None

    def pair(self) -> StampedPair | None:
        """The latest two frames; None before the first."""
        self.check()
        return self._pair


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[tuple[Image, Image]]]:
    """The pairs of two cameras' topics that have the same time."""
    names, (left, _, right) = pair_names(device), part.partition(",")
    topics = (left or f"camera/{names[0]}", right or f"camera/{names[1]}")
    lefts, rights = (topic_records(log, topic, Image) for topic in topics)
    return matching(lefts, rights)


def _poll(device: StereoCamera) -> Sequence[Image]:
    pair = device.pair()
    return () if pair is None else (pair.left, pair.right)


def _make(request: SourceRequest) -> PairedCameras:
    name, url = request.device, request.url
    sides = url.place.split(",")
    known = [device for device in request.urls if (sensor := sensor_of(device)) is not None and sensor.name == "camera"]
    if len(sides) != 2:
        raise Refused(f"{name}: {url.text!r}: name two cameras, as in pair://left_camera,right_camera")
    for side in sides:
        if side not in known:
            raise Refused(f"{name}: there is no camera {side!r}; {nearest(side, known)}")
    left, right = map(request.other, sides)
    is_virtual = Clock(request.host.loop).is_virtual
    return PairedCameras(left, right, url.number("within_s", WITHIN_S), is_virtual=is_virtual)


SENSORS: Final = (SensorKind(STEREO, ReplayStereoCamera, _recorded, _poll, pair_names),)
SOURCES: Final = (
    SourceKind(
        "pair", (STEREO,), "pair://left_camera,right_camera?within_s=0.005", _make, {"within_s": Number(0.0, 1.0)}
    ),
)
