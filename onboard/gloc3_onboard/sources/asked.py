"""Which source each sensor of a platform has: what was asked for on the command line goes before the platform's file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gloc3.errors import Refused, nearest
from gloc3.platform.platform import Platform
from gloc3_onboard.sources.places import FILES
from gloc3_onboard.sources.url import sensor_of

NOWHERE: Final = "none://"


def source_urls(platform: Platform, used: Sequence[str], overrides: Sequence[str]) -> dict[str, str]:
    """Where each sensor's data comes from: what was asked for, else what the platform file says, else nowhere.

    Raises:
        Refused: what was asked for is not NAME=URL, or the platform has no such device.
    """
    sensors = {name for name in (*used, *platform.devices) if sensor_of(name) is not None}
    urls = {name: platform.devices.get(name, NOWHERE) for name in sorted(sensors)}
    for text in overrides:
        name, equals, url = text.partition("=")
        if not equals:
            raise Refused(f"--device {text!r} must be NAME=URL, such as ground_camera=v4l2:///dev/video0")
        if name not in urls:
            raise Refused(f"--device {text!r}: {platform.platform} has no sensor {name!r}; {nearest(name, [*urls])}")
        scheme, separator, place = url.partition("://")
        urls[name] = f"{scheme}{separator}{_from_here(scheme, place)}"
    return urls


def is_asked_here(platform: Platform, used: Sequence[str], text: str) -> bool:
    """Whether a source that was asked for, as NAME=URL, is for this process, or for none of the platform's at all."""
    name = text.partition("=")[0]
    return name in used or not any(name in row.devices.values() for row in platform.components)


def _from_here(scheme: str, place: str) -> str:
    """On a command line files are relative to where it was typed, in a platform file to that file."""
    return str(Path.cwd() / place) if scheme in FILES and not place.startswith("/") else place
