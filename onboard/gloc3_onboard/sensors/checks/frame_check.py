"""Checks that a picture is usable: whole, of the calibrated size, neither black nor white, not the last one again."""

from typing import Annotated, Final

import msgspec

from gloc3.camera.model import CameraModel, misfit
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Rig

BLACK_MEAN: Final = 6.0
BLACK_MAX: Final = 48
"""A dark picture with one light in it is brighter than that somewhere."""
WHITE_MEAN: Final = 250.0
FILLERS: Final = (0, 128)
"""Fill values of missing rows: nothing, or the grey of an empty JPEG block."""
LEAST_TORN: Final = 0.06
"""Share of empty rows at the end above which a picture counts as torn."""
STEP: Final = 7
"""Sampling step of the mean, px."""


class FrameSettings(Settings, frozen=True):
    """Settings of everything that samples cameras."""

    silent_s: Annotated[float, Bounds(0.05, 60.0)] = 1.0
    """Time without a picture after which the camera counts as silent, s."""
    may_repeat: bool = False
    """Whether two pictures may be the same to the last bit; else the camera counts as stuck."""


def complaint(image: Image) -> str:
    """Why a processor cannot use a picture that a sampler reported; empty if it can."""
    if not image.is_valid:
        return image.reason or "the camera reports it"
    return "" if len(image.data) == image.width * image.height else "the picture is torn"


class FrameCheck:
    """Checks the pictures of one camera.

    Args:
        model: as it was calibrated; None where that is not known: its first picture then tells the size.
        may_repeat: whether two pictures may be the same to the last bit, as those of a camera without noise are.
    """

    def __init__(self, model: CameraModel | None = None, *, may_repeat: bool = False) -> None:
        self._model = model
        self._size: tuple[int, int] | None = None
        self._may_repeat = may_repeat
        self._last = b""

    def problem(self, image: Image) -> str:
        """Why the picture cannot be used; empty if it can."""
        if not image.is_valid:
            return complaint(image)
        size, count = (image.width, image.height), len(image.data)
        if min(size) <= 0 or image.width * image.height != count:
            return f"torn: {count} bytes of a picture of {image.width} x {image.height}"
        if self._model is not None and (problem := misfit(self._model, *size)):
            return problem
        if self._size is None:
            self._size = size
        if size != self._size:
            return f"the picture is {size[0]} x {size[1]}, and the first was {self._size[0]} x {self._size[1]}"
        is_same, self._last = image.data == self._last, image.data
        if is_same and not self._may_repeat:
            return "the same picture again: the camera is stuck"
        return _content_problem(image)


class FrameChecks:
    """The checks of a sampler's cameras, each made with its first picture."""

    def __init__(self, rig: Rig | None, *, may_repeat: bool) -> None:
        self._rig, self._may_repeat = rig, may_repeat
        self._checks: dict[str, FrameCheck] = {}

    def marked(self, image: Image, problem: str) -> Image:
        """The picture; not valid where it cannot be used, or for a problem that is known already."""
        if image.camera not in self._checks:
            model = self._rig.model(image.camera) if self._rig is not None else None
            self._checks[image.camera] = FrameCheck(model, may_repeat=self._may_repeat)
        problem = problem or self._checks[image.camera].problem(image)
        return msgspec.structs.replace(image, is_valid=False, reason=problem) if problem else image


def no_frame(camera: str, reason: str) -> Image:
    """What is reported where no picture comes."""
    return Image(camera=camera, width=0, height=0, data=b"", is_valid=False, reason=reason)


def _content_problem(image: Image) -> str:
    import numpy as np

    pixels = np.frombuffer(image.data, np.uint8)
    mean = float(pixels[::STEP].mean())
    if mean < BLACK_MEAN and int(pixels.max()) < BLACK_MAX:
        return f"black: its mean is {mean:.0f} of 255"
    if mean > WHITE_MEAN:
        return f"white: its mean is {mean:.0f} of 255"
    if pixels[-1] in FILLERS:
        rows = pixels.reshape(image.height, image.width)
        is_empty = (rows == pixels[-1]).all(axis=1)
        empty = image.height if is_empty.all() else int(np.argmin(is_empty[::-1]))
        if empty >= LEAST_TORN * image.height:
            return f"torn: the last {empty} of its {image.height} rows are empty"
    return ""
