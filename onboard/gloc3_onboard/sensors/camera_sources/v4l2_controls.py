"""The controls of a V4L2 device, such as exposure, gain and white balance, by their names.

Linux, `videodev2.h`: VIDIOC_QUERYCTRL, VIDIOC_QUERYMENU, VIDIOC_G_CTRL and VIDIOC_S_CTRL. Names are those of `v4l2-ctl
--list-ctrls`.
"""

import os
import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Refused, nearest

QUERYCTRL: Final = 0xC0445624
QUERYMENU: Final = 0xC02C5625
G_CTRL: Final = 0xC008561B
S_CTRL: Final = 0xC008561C
NEXT: Final = 0x8000_0000
"""With an identifier: the next control after it."""
IS_DISABLED, IS_READ_ONLY = 0x0001, 0x0004
INTEGER, BOOLEAN, MENU, BUTTON, INTEGER_MENU = 1, 2, 3, 4, 9
_CONTROL: Final = struct.Struct("=II32siiiiI8x")
"""Identifier, type, name, least, greatest, step, default, flags."""
_ITEM: Final = struct.Struct("=II32s4x")
"""Identifier, index, name (or a number of 64 bits)."""
_VALUE: Final = struct.Struct("=Ii")


class V4l2Control(NamedTuple):
    """One control of a device."""

    number: int
    least: int
    greatest: int
    items: Mapping[str, int]
    """Values of a menu, by name."""

    def __str__(self) -> str:
        """What it can be set to."""
        return (
            " or ".join(f"{value} {name}" for name, value in self.items.items()) or f"{self.least} to {self.greatest}"
        )


def parse_controls(device: str, text: str) -> Sequence[tuple[str, str]]:
    """Names and values of `NAME:VALUE,NAME:VALUE`, in their order.

    Raises:
        Refused: the text has another form.
    """
    parts = [part.partition(":") for part in text.split(",")] if text else []
    for name, _, value in parts:
        if not name or not value:
            raise Refused(f"{device}: controls={text} must be NAME:VALUE,…, such as gain:40,white_balance_automatic:0")
    return [(name, value) for name, _, value in parts]


def set_controls(device: str, path: Path, wanted: Sequence[tuple[str, str]]) -> None:
    """Sets controls one after the other, as automatic modes have to end before what they control can be set.

    Args:
        device: name of the device, for messages.
        path: the device file.
        wanted: names and values; a value is a number or the name of an item of a menu.

    Raises:
        Gloc3Error: the device has no such control, or does not take the value; with what it has.
    """
    try:
        file = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        raise Gloc3Error(f"{device}: {path}: {error.strerror}") from error
    try:
        known = controls_of(file)
        for name, text in wanted:
            if name not in known:
                has = "; ".join(f"{each} ({control})" for each, control in known.items()) or "none"
                raise Gloc3Error(
                    f"{device}: {path} has no control {name!r}; {nearest(name, list(known))}. It has: {has}"
                )
            _set(f"{device}: {path}: {name}:{text}", file, known[name], text)
    finally:
        os.close(file)


def controls_of(file: int) -> dict[str, V4l2Control]:
    """The controls of an open device that can be set to a value, by name."""
    found: dict[str, V4l2Control] = {}
    number = 0
    while (row := _asked(file, QUERYCTRL, _CONTROL, number | NEXT)) is not None:
        number, kind, name, least, greatest, _, _, flags = row
        if kind in (INTEGER, BOOLEAN, MENU, INTEGER_MENU) and not flags & (IS_DISABLED | IS_READ_ONLY):
            found[_plain(name)] = V4l2Control(number, least, greatest, _items(file, number, kind, least, greatest))
    return found


def _items(file: int, number: int, kind: int, least: int, greatest: int) -> dict[str, int]:
    items: dict[str, int] = {}
    for index in range(least, greatest + 1) if kind in (MENU, INTEGER_MENU) else ():
        row = _asked(file, QUERYMENU, _ITEM, number, index)
        if row is not None:  # menus have gaps
            items[_plain(row[2]) if kind == MENU else str(int.from_bytes(row[2][:8], "little", signed=True))] = index
    return items


def _set(what: str, file: int, control: V4l2Control, text: str) -> None:
    value = control.items.get(text)
    if value is None:
        is_number = re.fullmatch(r"-?\d+", text) is not None
        is_known = int(text) in control.items.values() if is_number and control.items else is_number
        if not is_known or not control.least <= int(text) <= control.greatest:
            raise Gloc3Error(f"{what} must be {control}")
        value = int(text)
    import fcntl

    try:
        fcntl.ioctl(file, S_CTRL, _VALUE.pack(control.number, value))
        _, now = _VALUE.unpack(fcntl.ioctl(file, G_CTRL, _VALUE.pack(control.number, 0)))
    except OSError as error:
        hint = "an automatic mode may control it; set that first" if error.errno != 1 else "it may not be set"
        raise Gloc3Error(f"{what}: {error.strerror}; {hint}") from error
    if now != value:
        raise Gloc3Error(f"{what}: the device has set {now} in place of {value}")


def _asked(
    file: int, request: int, form: struct.Struct, *given: int
) -> tuple[int, int, bytes, int, int, int, int, int] | None:
    """What the device answers to a question about a control; None where there is no such."""
    import fcntl

    data = struct.pack(f"={len(given)}I", *given).ljust(form.size, b"\0")
    try:
        answer: tuple[int, int, bytes, int, int, int, int, int] = form.unpack(fcntl.ioctl(file, request, data))
    except OSError:
        return None
    return answer


def _plain(name: bytes) -> str:
    """A name as `v4l2-ctl` writes it: lower case, every other sign a line below, and no two of them."""
    text = name.partition(b"\0")[0].decode("utf-8", "replace").lower()
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")
