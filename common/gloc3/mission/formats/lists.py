"""MAVProxy's lists of fence points and rally points: text files with one point a line."""

from collections.abc import Sequence
from math import isfinite

from gloc3.errors import Finding, InputError
from gloc3.mission.formats.items import FenceArea, ForeignPlan

_LEAST_FENCE = 4
"""A return point, and three corners."""
_RALLY = "RALLY"
_RALLY_COLUMNS = 7


def is_list(lines: Sequence[str]) -> bool:
    """Whether a file begins as one of them."""
    words = next((line.split() for line in lines if line.strip() and not line.startswith("#")), [])
    return words[:1] == [_RALLY] or (len(words) == 2 and _numbers(words) is not None)


def read_list(lines: Sequence[str], file: str) -> ForeignPlan:
    """Reads a list of fence points (return point, then the corners) or of rally points.

    Raises:
        InputError: with everything that is wrong in it.
    """
    rows = [
        (number, line.split())
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    findings: list[Finding] = []
    plan = _rally(rows, file, findings) if rows[0][1][0] == _RALLY else _fence(rows, file, findings)
    if any(not finding.is_warning for finding in findings):
        raise InputError(sorted(findings))
    return ForeignPlan(fence=plan.fence, fence_return=plan.fence_return, rally=plan.rally, findings=tuple(findings))


def _fence(rows: Sequence[tuple[int, list[str]]], file: str, findings: list[Finding]) -> ForeignPlan:
    points: list[tuple[float, float]] = []
    for line, words in rows:
        numbers = _numbers(words)
        if numbers is None or len(numbers) != 2 or not _is_on_earth(*numbers):
            message = "a latitude and a longitude are expected here"
            findings.append(Finding(file=file, line=line, column=1, message=message, hint="one point a line"))
        else:
            points.append((numbers[0], numbers[1]))
    corners = points[1:-1] if len(points) > 2 and points[1] == points[-1] else points[1:]
    if not findings and len(corners) < _LEAST_FENCE - 1:
        message = "a fence needs its return point and three corners"
        findings.append(Finding(file=file, line=rows[-1][0], column=1, message=message, hint="add corners"))
    return ForeignPlan(
        fence=(FenceArea(is_inclusion=True, polygon=tuple(corners)),), fence_return=points[0] if points else None
    )


def _rally(rows: Sequence[tuple[int, list[str]]], file: str, findings: list[Finding]) -> ForeignPlan:
    points: list[tuple[float, float, float]] = []
    for line, words in rows:
        numbers = _numbers(words[1:])
        if words[0] != _RALLY or numbers is None or not 3 <= len(numbers) < _RALLY_COLUMNS:
            message = "RALLY, a latitude, a longitude and a height are expected here"
            findings.append(Finding(file=file, line=line, column=1, message=message, hint="one point a line"))
        elif not _is_on_earth(numbers[0], numbers[1]):
            message = f"{numbers[0]:g}, {numbers[1]:g} is not a latitude and longitude"
            findings.append(Finding(file=file, line=line, column=1, message=message))
        else:
            points.append((numbers[0], numbers[1], numbers[2]))
            if any(numbers[3:]):
                message = "the rally point's break altitude, landing direction and flags are left out"
                hint = "set them in the autopilot"
                findings.append(Finding(file=file, line=line, column=1, message=message, hint=hint, is_warning=True))
    return ForeignPlan(rally=tuple(points))


def _numbers(words: Sequence[str]) -> list[float] | None:
    try:
        found = [float(word) for word in words]
    except ValueError:
        return None
    return found if all(isfinite(number) for number in found) else None


def _is_on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0
