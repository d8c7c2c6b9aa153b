"""KITTI's `calib.txt`: rectified cameras as 3 by 4 projections, all in the frame of the left grey one.

A line is `P0: ` and twelve numbers; some extracts omit the names; lines then count from P0. The file has no image
size, which must therefore be given.
"""

import re
from typing import Final

from gloc3.camera.model import CameraModel
from gloc3.errors import Finding, InputError
from gloc3_onboard.calibration.lens import NARROWEST_DEG, PIXELS
from gloc3_onboard.calibration.mounting import FORWARD

NUMBERS: Final = 12
_NAMED: Final = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_]*):")


def looks_like_kitti(text: str) -> bool:
    """Whether the text is perhaps such a calibration."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    named = _NAMED.match(first)
    words = first[named.end() if named else 0 :].split()
    return len(words) == NUMBERS and (named is None or named[1].startswith("P"))


def read_kitti(text: str, file: str, size: tuple[int, int] | None) -> dict[str, CameraModel]:
    """The cameras P0, P1… with the size of their pictures.

    Raises:
        InputError: with everything that is wrong.
    """
    found: dict[str, CameraModel] = {}
    wrong: list[Finding] = []
    if size is None:
        hint = "name a folder with its pictures, or write calib.txt?size=1226x370"
        raise InputError(
            [Finding(file=file, message="KITTI's calibration does not contain the picture size", hint=hint)]
        )
    count = 0
    for line, text_line in enumerate(text.splitlines(), start=1):
        if not text_line.strip():
            continue
        named = _NAMED.match(text_line)
        name = named[1] if named else f"P{count}"
        count += 1
        if not name.startswith("P"):
            continue  # Tr: the laser scanner
        begin = named.end() if named else 0
        try:
            found[name] = _camera(text_line[begin:], size)
        except _Wrong as error:
            column = begin + error.offset + 1
            message = f"{name}: {error}"
            wrong.append(Finding(file=file, line=line, column=column, message=message, hint=error.hint))
    if not found and not wrong:
        wrong.append(Finding(file=file, message="no camera is in it", hint="lines are P0: and twelve numbers"))
    if wrong:
        raise InputError(wrong)
    return found


class _Wrong(Exception):
    """A line that is no projection."""

    def __init__(self, message: str, offset: int = 0, hint: str = "") -> None:
        super().__init__(message)
        self.offset, self.hint = offset, hint


def _camera(text: str, size: tuple[int, int]) -> CameraModel:
    words = list(re.finditer(r"\S+", text))
    if len(words) != NUMBERS:
        raise _Wrong(f"{len(words)} numbers, expected {NUMBERS}", words[0].start() if words else 0)
    p: list[float] = []
    for word in words:
        try:
            p.append(float(word[0]))
        except ValueError:
            raise _Wrong(f"{word[0]!r} is not a number", word.start()) from None
    width, height = size
    focal, is_projection = p[0], p[8:11] == [0.0, 0.0, 1.0] and p[1] == p[4] == 0.0
    if not is_projection or not all(abs(value) < 1e6 for value in p):
        raise _Wrong("this is not a rectified projection", words[0].start(), "fx 0 cx tx 0 fy cy ty 0 0 1 tz")
    if not 0.05 * width < focal < width * 57.3 / NARROWEST_DEG or not 0.5 < p[5] / focal < 2.0:
        hint = f"pictures of {width} x {height}; were they made smaller?"
        raise _Wrong(f"focal lengths {p[0]:g} and {p[5]:g} pixels", words[0].start(), hint)
    if not (0.0 <= p[2] <= width and 0.0 <= p[6] <= height):
        hint = "were they cut, or made smaller?"
        message = f"the optical axis at {p[2]:g}, {p[6]:g} is outside pictures of {width} x {height}"
        raise _Wrong(message, words[2].start(), hint)
    right_m, down_m, forward_m = -p[3] / p[0], -p[7] / p[5], -p[11]
    low, high = PIXELS
    if not (low <= min(size) and max(size) <= high):
        raise _Wrong(f"pictures of {width} x {height}")
    return CameraModel(
        width=width,
        height=height,
        focal_px=(p[0], p[5]),
        center_px=(p[2], p[6]),
        position_frd_m=(forward_m, right_m, down_m),
        frd_from_rdf=FORWARD,
    )
