"""Pictures of a folder: their size, and the pictures as frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from gloc3.camera.opencv import load_opencv
from gloc3.messages.vehicle import Image

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
PATTERNS: Final = ("image_*/*.png", "image_*/data/*.png", "*.png")


def pixels_for_people(image: Image) -> "NDArray[np.uint8]":
    """The pixels of a picture that is whole: rows, columns and blue, green and red where it has colours, else grey."""
    import numpy as np

    shape = (image.height, image.width)
    if len(image.bgr) == 3 * image.height * image.width:
        return np.frombuffer(image.bgr, np.uint8).reshape(*shape, 3)
    return np.frombuffer(image.data, np.uint8).reshape(shape)


def load_picture(path: Path, camera: str) -> Image:
    """One picture; it may take some milliseconds. One that is not there is a frame that is not valid."""
    cv2 = load_opencv()
    pixels = cv2.imread(str(path), cv2.IMREAD_ANYCOLOR) if path.is_file() else None
    if pixels is None:
        why = "cannot be read" if path.is_file() else "is missing"
        return Image(camera=camera, width=0, height=0, data=b"", is_valid=False, reason=f"{path.name} {why}")
    height, width = pixels.shape[:2]
    if pixels.ndim == 2:
        return Image(camera=camera, width=width, height=height, data=pixels.tobytes())
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    return Image(camera=camera, width=width, height=height, data=grey.tobytes(), bgr=pixels.tobytes())


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder in the order of their names."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".pgm"))


def picture_size(folder: Path) -> tuple[int, int] | None:
    """Width and height of the first picture, from its PNG header: no library is loaded for it; None where there is no PNG."""
    for pattern in PATTERNS:
        first = next(folder.glob(pattern), None)
        if first is not None:
            with first.open("rb") as file:
                head = file.read(24)
            if head[:8] == SIGNATURE and head[12:16] == b"IHDR":
                return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    return None
