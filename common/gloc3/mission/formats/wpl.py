"""`QGC WPL 110`: the text files of waypoints of Mission Planner, MAVProxy and QGroundControl."""

from math import isfinite, isnan
from typing import Final

from gloc3.cli.counting import counted
from gloc3.errors import Finding, InputError
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry

HEADER: Final = "QGC WPL 110"
MAX_BYTES: Final = 5_000_000
_COLUMNS: Final = 12
_NOT_A_NUMBER: Final = float("nan")


def read_wpl(data: bytes | str, file: str) -> ForeignPlan:
    """Reads a file of waypoints; such files have no fences or rally points.

    Raises:
        InputError: with everything that is wrong in it.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_BYTES:
        message = f"{len(raw) / 1e6:.1f} MB is too large: the limit is {MAX_BYTES / 1e6:g} MB"
        raise InputError([Finding(file=file, message=message, hint="is this the right file?")])
    try:
        lines = raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(
            [Finding(file=file, message="not UTF-8 text", hint=f"a mission begins with {HEADER!r}")]
        ) from error
    if not lines or lines[0].split() != HEADER.split():
        raise InputError([_no_mission(lines[0] if lines else "", file)])
    findings: list[Finding] = []
    items: list[MavItem] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        try:
            items.append(_item(line.split(), len(items)))
        except _BadLine as error:
            findings.append(Finding(file=file, line=number, column=1, message=str(error), hint=error.hint))
            items.append(MavItem(command=0, frame=0))
            if len(findings) >= 20:
                break
    if findings:
        raise InputError(findings)
    return ForeignPlan(entries=tuple(PlanEntry(items=(item,)) for item in items))


def write_wpl(plan: ForeignPlan) -> str:
    """The waypoint file of a plan's items, without fence, rally points and speeds."""
    lines = [HEADER]
    for index, item in enumerate(plan.items):
        numbers = [*item.params, item.x, item.y, item.z]
        columns = [index, int(item.is_current), item.frame, item.command, *map(_spell, numbers), int(item.is_continued)]
        lines.append("\t".join(str(column) for column in columns))
    return "\n".join(lines) + "\n"


class _BadLine(Exception):
    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


def _item(columns: list[str], expected: int) -> MavItem:
    if len(columns) != _COLUMNS:
        hint = "index, current, frame, command, four parameters, latitude, longitude, altitude, autocontinue"
        raise _BadLine(f"{counted(len(columns), 'column')}, but an item has {_COLUMNS}", hint)
    index, current, frame, command = (_whole(text) for text in columns[:4])
    if index != expected:
        raise _BadLine(f"item {index} stands where item {expected} is expected", "number the items from 0 without gaps")
    if not 0 <= frame <= 255 or not 0 <= command <= 65_535:
        raise _BadLine(f"frame {frame} or command {command} is not a MAVLink number")
    p1, p2, p3, p4, x, y, z = (_number(text) for text in columns[4:11])
    return MavItem(
        command=command,
        frame=frame,
        params=(p1, p2, p3, p4),
        x=x,
        y=y,
        z=z,
        is_continued=bool(_whole(columns[11])),
        is_current=bool(current),
    )


def _whole(text: str) -> int:
    value = _number(text)
    if value is None or value != int(value) or abs(value) > 1e9:
        raise _BadLine(f"{text!r} is not a whole number")
    return int(value)


def _number(text: str) -> float | None:
    try:
        value = float(text) if len(text) <= 40 else None
    except ValueError:
        value = None
    if value is None or (not isfinite(value) and not isnan(value)):
        raise _BadLine(f"{text[:40]!r} is not a number")
    return None if isnan(value) else value


def _spell(value: float | None) -> str:
    """A number so that it is read again as it was, without an exponent or `.0` where that is possible."""
    if value is None:
        return repr(_NOT_A_NUMBER)
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


def _no_mission(first: str, file: str) -> Finding:
    words = first.split()
    if words[:2] == ["QGC", "WPL"]:
        message, hint = f"WPL version {' '.join(words[2:]) or '?'} is not supported, only 110", "save it as version 110"
    elif words[:1] == ["RALLY"]:
        message, hint = "this is a list of rally points, not a mission", "choose the file with the waypoints"
    elif len(words) == 2 and all(_is_coordinate(word) for word in words):
        message, hint = "this is a list of fence points, not a mission", "choose the file with the waypoints"
    else:
        message, hint = "not a waypoint file", f"its first line is {HEADER!r}"
    return Finding(file=file, line=1, column=1, message=message, hint=hint)


def _is_coordinate(word: str) -> bool:
    try:
        return abs(float(word)) <= 180.0
    except ValueError:
        return False
