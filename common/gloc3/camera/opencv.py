"""Access to OpenCV: loaded when needed, and restricted to the caller's thread."""

from typing import Any


def load_opencv() -> Any:
    """The library; the first call takes a while.

    A picture is small, other cores have other work, and on one thread the same pictures always give the same.
    """
    import cv2

    cv2.setNumThreads(1)
    return cv2
