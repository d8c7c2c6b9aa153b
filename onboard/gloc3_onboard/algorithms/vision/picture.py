"""Preprocessing of pictures: usability, and equalization of light."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3.messages.vehicle import Image

Picture = NDArray[np.uint8]
"""Grey values, rows by columns."""

_STEP: Final = 7
_DARK: Final = 6.0
_BRIGHT: Final = 250.0
_FLAT: Final = 1.0
_LOG_FROM: Final = 12.0
"""Grey values well below this are noise: the logarithm is bent straight there."""


def pixels_of(image: Image) -> Picture:
    """The grey values of a camera's complete picture."""
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)


def problem(picture: Picture, camera: CameraModel) -> str:
    """Why a picture cannot be used; empty if it can."""
    if picture.ndim != 2 or picture.dtype != np.uint8:
        return "the picture is not grey, 8 bits a pixel"
    if picture.shape != (camera.height, camera.width):
        height, width = picture.shape
        return f"the picture is {width} x {height}, and the calibration is for {camera.width} x {camera.height}"
    some = picture[::_STEP, ::_STEP]
    mean = float(some.mean())
    if mean < _DARK and float(some.std()) < _DARK:
        return "the picture is black"
    if mean > _BRIGHT:
        return "the picture is white"
    return "the picture shows nothing but one grey" if float(some.std()) < _FLAT else ""


class LightEvener:
    """Removes the effects of lamps, exposure and shadows, so that a patch looks the same in all pictures.

    The logarithm turns brightness factors into offsets; structures wider than the box are subtracted.

    Args:
        box_px: side of the box; larger than a matched patch.
    """

    def __init__(self, box_px: int = 41) -> None:
        self._cv2 = load_opencv()
        self._box = (box_px, box_px)
        greys = np.log1p(np.arange(256) / _LOG_FROM)
        self._table = np.round(greys * (255.0 / greys[-1])).astype(np.uint8)

    def even(self, picture: Picture) -> Picture:
        """The picture with its light evened out, around a grey of 128."""
        bent = self._cv2.LUT(picture, self._table)
        evened: Picture = self._cv2.addWeighted(bent, 1.0, self._cv2.blur(bent, self._box), -1.0, 128.0)
        return evened
