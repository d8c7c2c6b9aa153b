"""OpenCV, as everything here uses it: loaded when it is needed, and at work on the caller's thread alone."""

from typing import Any


def load_opencv() -> Any:
    """The library; the first call takes a while.

    A picture is small, other cores have other work, and on one thread the same pictures always give the same.
    """
    import cv2

    cv2.setNumThreads(1)
    return cv2
