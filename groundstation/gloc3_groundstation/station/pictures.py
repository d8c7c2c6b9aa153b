"""Decodes previews for the screen. OpenCV is imported with the first one."""

import sys
from typing import NamedTuple

from gloc3.camera.opencv import load_opencv
from gloc3.messages.watch import Preview


class GreyImage(NamedTuple):
    """Grey values, row after row."""

    width: int
    height: int
    data: bytes


def is_loaded() -> bool:
    """Whether pictures can be unpacked without a pause."""
    return "cv2" in sys.modules


def load() -> None:
    """Loads the image decoder, which is slow."""
    load_opencv()


def unpack_picture(preview: Preview, room: tuple[int, int] | None = None) -> GreyImage | None:
    """The picture, scaled to the available room with its proportions kept; None where there is none.

    Args:
        preview: as received.
        room: pixels across and down; None for its own size.
    """
    if not preview.data:
        return None
    import numpy as np

    cv2 = load_opencv()
    pixels = cv2.imdecode(np.frombuffer(preview.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        return None
    height, width = pixels.shape
    if room is not None:
        scale = min(room[0] / width, room[1] / height)
        size = max(1, int(width * scale)), max(1, int(height * scale))
        if size != (width, height):
            pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)
    height, width = pixels.shape
    return GreyImage(width, height, pixels.tobytes())
