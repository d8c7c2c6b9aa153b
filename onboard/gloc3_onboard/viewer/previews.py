"""Images made small for a station's terminal: scaled to fit, grey, compressed. OpenCV comes in when one is wanted."""

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.messages.vehicle import Image
from gloc3.messages.watch import Preview

ENCODING: Final = ".webp"
"""Of a picture of 64 × 48 it needs two thirds of what JPEG does, whose tables alone take 150 bytes."""

Shrink = Callable[[Image, int, int, int], Preview]
"""Makes a preview of an image that fits a width and a height, in a quality from 1 to 100."""


@cache
def load_shrinker() -> Shrink:
    """The function that makes previews; the first call loads OpenCV, which takes a while."""
    import numpy as np

    cv2 = load_opencv()

    def shrink(image: Image, width: int, height: int, quality: int) -> Preview:
        size = fit((image.width, image.height), (width, height))
        data = b""
        if image.is_valid and image.width > 0 and len(image.data) == image.width * image.height:
            pixels: Any = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
            if size != (image.width, image.height):
                pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
            is_done, packed = cv2.imencode(ENCODING, pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])
            data = packed.tobytes() if is_done else b""
        return Preview(
            camera=image.camera,
            width=size[0],
            height=size[1],
            full_width=image.width,
            full_height=image.height,
            data=data,
            is_valid=image.is_valid and bool(data),
            reason=image.reason or ("" if data else "the image is empty or damaged"),
        )

    return shrink


def fit(size: tuple[int, int], room: tuple[int, int]) -> tuple[int, int]:
    """The largest size of the same proportions that has room, never more than the size itself."""
    width, height = size
    if width <= 0 or height <= 0:
        return 0, 0
    scale = min(1.0, room[0] / width, room[1] / height)
    return max(1, round(width * scale)), max(1, round(height * scale))
