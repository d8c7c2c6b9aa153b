"""The one form in which a device's source is written: `SCHEME://PLACE?OPTION=VALUE&…#PART`."""

import os
from collections.abc import Mapping
from pathlib import Path
from stat import S_ISCHR
from typing import Final, NamedTuple

from gloc3.errors import Refused


class Number(NamedTuple):
    """An option that is a number."""

    low: float
    high: float
    is_whole: bool = False


Options = Mapping[str, Number | frozenset[str] | None]
"""The options of a kind of source; None for those that are text, a set for a choice."""
BAUD: Final[Options] = {"baud": Number(1200, 4_000_000, True)}
RATE: Final[Options] = {"rate_hz": Number(0.1, 1000.0)}
GREY: Final = "grey"
PIXELS: Final[Options] = {"pixels": frozenset({"colour", GREY})}
"""Whether a camera keeps its colours, which is the default, or only grey values."""
DELAY: Final[Options] = {"delay_s": Number(0.0, 1.0)}
REPLAY: Final[Options] = {"skip_s": Number(0.0, 1e6)}
YAW: Final[Options] = {"yaw_deg": Number(-360.0, 360.0)}
DEPTHS: Final[Options] = {"min_m": Number(0.0, 100.0), "max_m": Number(0.1, 1000.0)}
"""Nearest and farthest depth that a camera measures."""
NEAR_M: Final = 0.2
FAR_M: Final = 10.0
"""These, unless the URL says otherwise."""
SERIAL_GROUP: Final = "dialout"
VIDEO_GROUP: Final = "video"
"""The groups of users that may use serial lines and cameras (Debian's names)."""


class SourceUrl(NamedTuple):
    """A source, taken apart and checked."""

    text: str
    scheme: str
    place: str
    """Part between `://` and `?`: a file, an address, a pipeline."""
    options: Mapping[str, str]
    part: str
    """Part after `#`."""

    def number(self, name: str, default: float) -> float:
        """An option that is a number."""
        return float(self.options.get(name, default))

    @property
    def is_grey(self) -> bool:
        """Whether only grey values of a camera are wanted."""
        return self.options.get("pixels") == GREY

    def path(self, folder: Path) -> Path:
        """The place as a file, relative to a folder."""
        return folder / self.place

    def address(self, device: str) -> tuple[str, int]:
        """Host and port of a place that is an address.

        Raises:
            Refused: it is none.
        """
        host, _, port = self.place.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
            raise Refused(f"{device}: {self.text!r}: write an address as {self.scheme}://127.0.0.1:5600")
        return host, int(port)

    @property
    def device_file(self) -> Path | None:
        """The device file that the place names, as a path or the number of a camera; None for an address."""
        if self.place.isdecimal():
            return Path(f"/dev/video{self.place}")
        return Path(self.place) if self.place.startswith("/") else None


def option_problem(options: Options, name: str, text: str) -> str:
    """Why the value of a known option cannot be; empty if it can."""
    bounds = options[name]
    if bounds is None:
        return "" if text else f"{name} is empty"
    if isinstance(bounds, frozenset):
        return "" if text in bounds else f"{name}={text} must be {' or '.join(sorted(bounds))}"
    try:
        value = float(text)
    except ValueError:
        return f"{name}={text} is not a number"
    if bounds.is_whole and not value.is_integer():
        return f"{name}={text} must be a whole number"
    if not bounds.low <= value <= bounds.high:
        return f"{name}={text} must be from {bounds.low:g} to {bounds.high:g}"
    return ""


def device_problem(path: Path, group: str) -> str:
    """Reason why a device file cannot be used and what to do; empty if it can."""
    try:
        status = path.stat()
    except OSError:
        return f"{path} is not there; is it plugged in? look into {path.parent}"
    if not S_ISCHR(status.st_mode):
        return f"{path} is not a device"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"{path} may not be used by this user: sudo usermod -aG {group} $USER, then log in again"
    return ""
