"""Access to OpenCV: loaded when needed, and restricted to the caller's thread."""

from typing import Any

from gloc3.loading import load_modules


def load_opencv() -> Any:
    """Loads the library; the first call is slow.

    OpenCV runs on one thread: pictures are small, other cores have other work, and results are reproducible.
    """
    load_modules("cv2")
    import cv2

    cv2.setNumThreads(1)
    return cv2
