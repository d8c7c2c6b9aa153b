"""Stereo pairs of cameras that are not one device: two that expose at the same time, or one picture with both sides."""

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

import msgspec

from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Camera, StampedImage, StampedPair, Unwatch

KEPT: Final = 4
"""Frames of each side that wait for their partner."""


class PairedCameras:
    """Two cameras as one: the frames that were exposed within a time of each other; the later side tells when.

    Args:
        left: opened and closed with the pair, as is `right`.
        right: the other one.
        within_s: how far apart in time the frames of a pair may be.
    """

    def __init__(self, left: Camera, right: Camera, within_s: float) -> None:
        self._left, self._right, self._within_s = left, right, within_s
        self._lefts: deque[StampedImage] = deque(maxlen=KEPT)
        self._rights: deque[StampedImage] = deque(maxlen=KEPT)
        self._latest: StampedPair | None = None

    def open(self) -> None:
        """Opens both.

        Raises:
            Gloc3Error: one of them cannot be had.
        """
        self._lefts.clear()
        self._rights.clear()
        with ExitStack() as undo:
            self._left.open()
            undo.callback(self._left.close)
            self._right.open()
            undo.pop_all()

    def close(self) -> None:
        """Closes both."""
        self._left.close()
        self._right.close()

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when either has a frame."""
        unwatch = (self._left.on_news(ready), self._right.on_news(ready))

        def both() -> None:
            for one in unwatch:
                one()

        return both

    def pair(self) -> StampedPair | None:
        """The latest two frames that belong together; None before the first."""
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
    """One camera whose pictures show the left eye's view beside the right one's.

    Args:
        camera: what takes the pictures.
        names: of the left and the right camera.
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

    def on_news(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when it has a frame."""
        return self._camera.on_news(ready)

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
    return msgspec.structs.replace(image, camera=name, width=width, data=data)
