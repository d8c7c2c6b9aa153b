"""Whether the place that a source names can be used, without opening it."""

from importlib.util import find_spec
from pathlib import Path
from typing import Final

from gloc3_onboard.sources.url import SourceUrl
from gloc3_onboard.sources.video import device_problem

GROUPS: Final = {"v4l2": "video", "rplidar": "dialout", "hokuyo": "dialout", "pd6": "dialout"}
"""The group of users that may use a device, by scheme (Debian's names)."""
FILES: Final = ("video", "euroc", "kitti", "carmen", "mcap")
"""Schemes whose place is a file or folder."""


def place_problem(url: SourceUrl, folder: Path) -> str:
    """Why a source will not open, with what to do; empty as far as it can be told.

    Args:
        url: the source.
        folder: to which files are relative.
    """
    if url.scheme == "rplidar" and find_spec("adafruit_rplidar") is None:
        return "its library is not installed; pip install 'gloc3[laser]'"
    if url.scheme in GROUPS and (url.place.startswith("/") or url.place.isdecimal()):
        path = Path(f"/dev/video{url.place}") if url.place.isdecimal() else Path(url.place)
        return device_problem(path, GROUPS[url.scheme])
    if url.scheme in FILES:
        path = url.path(folder)
        if not (path.parent.is_dir() if "%" in path.name else path.exists()):
            return f"{url.place} is not there; files are relative to the platform file"
    return ""
