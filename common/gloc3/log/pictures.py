"""Pictures in a log: compressed without loss, so that Foxglove shows them and a replay gets every pixel.

`data` of the record is a PNG file of the colour picture, where there is one, else of the grey one. The grey picture
that belongs to a colour picture is `bgr` of the record, unless OpenCV's conversion of the colours gives exactly it.
"""

from typing import Any, Final

import msgspec

from gloc3.camera.opencv import load_opencv
from gloc3.messages.vehicle import Image

FORMAT: Final = "png"
_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"


def pack_picture(image: Image) -> Image:
    """The picture compressed; as it is where its bytes do not fit its size."""
    if not image.data or len(image.data) != image.width * image.height:
        return image
    import numpy as np

    cv2 = load_opencv()
    grey = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
    if len(image.bgr) != 3 * grey.size:
        return msgspec.structs.replace(image, data=_png(cv2, grey))
    colour = np.frombuffer(image.bgr, np.uint8).reshape(image.height, image.width, 3)
    is_derived = np.array_equal(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), grey)
    return msgspec.structs.replace(image, data=_png(cv2, colour), bgr=b"" if is_derived else _png(cv2, grey))


def unpack_picture(image: Image) -> Image:
    """The picture that was compressed; as it is where it was not, or where the file is damaged."""
    if not image.data.startswith(_SIGNATURE):
        return image
    import numpy as np

    cv2 = load_opencv()
    found = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None or found.shape[:2] != (image.height, image.width):
        return image
    if found.ndim == 2:
        return msgspec.structs.replace(image, data=found.tobytes())
    kept = cv2.imdecode(np.frombuffer(image.bgr, np.uint8), cv2.IMREAD_UNCHANGED) if image.bgr else None
    grey = cv2.cvtColor(found, cv2.COLOR_BGR2GRAY) if kept is None else kept
    return msgspec.structs.replace(image, data=grey.tobytes(), bgr=found.tobytes())


def _png(cv2: Any, pixels: Any) -> bytes:
    found, data = cv2.imencode(".png", pixels, (cv2.IMWRITE_PNG_COMPRESSION, 1))
    if not found:
        raise ValueError("OpenCV cannot compress the picture")
    return bytes(data)
