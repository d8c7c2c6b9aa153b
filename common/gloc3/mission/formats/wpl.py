"""`QGC WPL 110`: the text files of waypoints of Mission Planner, MAVProxy and QGroundControl.

The same programs keep fences and rally points in such files, or in lists of their own (`lists`).
"""

from math import isfinite, isnan
from typing import Final, NamedTuple

from gloc3.amounts import beside
from gloc3.cli.counting import counted
from gloc3.errors import Finding, InputError, Refused
from gloc3.mission.formats.commands import JUMP, RALLY, RETURN_POINT, WAYPOINT
from gloc3.mission.formats.items import FenceParts, ForeignPlan, MavItem, PlanEntry, fence_parts, rally_points
from gloc3.mission.formats.lists import is_list, read_list

HEADER: Final = "QGC WPL 110"
MAX_BYTES: Final = 5_000_000
_WITHOUT_HOME: Final = "120"
"""The version of QGroundControl's older files, which have no home."""
_COLUMNS: Final = 12
_ABSOLUTE: Final = 0
"""MAV_FRAME_GLOBAL: heights above mean sea level."""


class _Row(NamedTuple):
    line: int
    number: int
    """As written in the file."""
    item: MavItem


def read_wpl(data: bytes | str, file: str) -> ForeignPlan:
    """Reads a file of waypoints, fences or rally points; lines that begin with `#` are comments.

    The first item is home. Items are numbered by their order; where the file numbers them otherwise, a warning says so.

    Raises:
        InputError: with everything that is wrong in it.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_BYTES:
        message = f"{beside(len(raw) / 1e6, MAX_BYTES / 1e6)} MB is too large: the limit is {MAX_BYTES / 1e6:g} MB"
        raise InputError([Finding(file=file, message=message, hint="is this the right file?")])
    try:
        lines = raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(
            [Finding(file=file, message="not UTF-8 text", hint=f"a mission begins with {HEADER!r}")]
        ) from error
    if is_list(lines):
        return read_list(lines, file)
    version = _version(lines[0] if lines else "", file)
    findings: list[Finding] = []
    rows: list[_Row] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            rows.append(_Row(number, *_item(line.split())))
        except _BadLine as error:
            findings.append(Finding(file=file, line=number, column=1, message=str(error), hint=error.hint))
            if len(findings) >= 20:
                break
    if findings:
        raise InputError(findings)
    return _plan(rows, file, has_home=version != _WITHOUT_HOME)


def _plan(rows: list[_Row], file: str, *, has_home: bool) -> ForeignPlan:
    """The plan in the rows of a file: a mission, and the fence and rally points among its items."""
    findings = _numbering(rows, file)
    home: tuple[float, float, float] | None = None
    if has_home and rows and rows[0].item.command == WAYPOINT:
        first = rows.pop(0)
        if first.item.has_position:
            home = (first.item.x or 0.0, first.item.y or 0.0, first.item.z or 0.0)
        if home is not None and first.item.frame != _ABSOLUTE and first.item.z:
            message = f"item {first.number} is home: its height {first.item.z:g} m is read as above mean sea level"
            findings.append(_warning(file, first.line, message, "give home in frame 0"))
    elif has_home and rows and rows[0].item.command < RETURN_POINT:
        message = "the first item is not home: it is flown like the others"
        findings.append(_warning(file, rows[0].line, message, "begin with home, a NAV_WAYPOINT"))
    fence = [row for row in rows if RETURN_POINT <= row.item.command < RALLY]
    rally = [row for row in rows if row.item.command == RALLY]
    mission = [row for row in rows if row not in fence and row not in rally]
    try:
        parts = fence_parts([row.item for row in fence]) if fence else FenceParts()
    except Refused as refusal:
        raise InputError([Finding(file=file, line=fence[0].line, column=1, message=str(refusal))]) from refusal
    return ForeignPlan(
        entries=tuple(PlanEntry(items=(row.item,)) for row in mission),
        fence=parts.areas,
        fence_return=parts.return_point,
        rally=rally_points([row.item for row in rally]),
        home=home,
        lines=tuple(row.line for row in mission),
        findings=tuple(findings),
    )


def _numbering(rows: list[_Row], file: str) -> list[Finding]:
    """Where the numbers in the file are not the order of the items; jumps name the items by these numbers."""
    first = next(((row, place) for place, row in enumerate(rows) if row.number != place), None)
    if first is None:
        return []
    row, place = first
    has_jumps = any(other.item.command == JUMP for other in rows)
    message = f"item {row.number} stands where item {place} is expected: items count by their order"
    hint = "check where the jumps lead" if has_jumps else "number the items from 0 without gaps"
    return [_warning(file, row.line, message, hint)]


def _warning(file: str, line: int, message: str, hint: str) -> Finding:
    return Finding(file=file, line=line, column=1, message=message, hint=hint, is_warning=True)


def write_wpl(plan: ForeignPlan) -> str:
    """The waypoint file of a plan: home first, then its items, without fence, rally points and speeds.

    A plan that has no items holds its fence or rally points alone, as such a file does; numbers that are not given are 0,
    because the format and its readers have no other way to say so.
    """
    items = plan.items or (*plan.fence_items(), *plan.rally_items())
    if plan.items or not items:
        x, y, z = plan.home or (0.0, 0.0, 0.0)
        items = (MavItem(command=WAYPOINT, frame=_ABSOLUTE, x=x, y=y, z=z, is_current=True), *items)
    lines = [HEADER]
    for index, item in enumerate(items):
        numbers = [*item.params, item.x, item.y, item.z]
        columns = [index, int(item.is_current), item.frame, item.command, *map(_spell, numbers), int(item.is_continued)]
        lines.append("\t".join(str(column) for column in columns))
    return "\n".join(lines) + "\n"


class _BadLine(Exception):
    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


def _item(columns: list[str]) -> tuple[int, MavItem]:
    if len(columns) != _COLUMNS:
        hint = "index, current, frame, command, four parameters, latitude, longitude, altitude, autocontinue"
        raise _BadLine(f"{counted(len(columns), 'column')}, but an item has {_COLUMNS}", hint)
    index, current, frame, command = (_whole(text) for text in columns[:4])
    if not 0 <= frame <= 255 or not 0 <= command <= 65_535:
        raise _BadLine(f"frame {frame} or command {command} is not a MAVLink number")
    p1, p2, p3, p4, x, y, z = (_number(text) for text in columns[4:11])
    return index, MavItem(
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
    value = value or 0.0
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


def _version(first: str, file: str) -> str:
    words = first.split()
    if words[:2] == ["QGC", "WPL"] and words[2:] in (["110"], [_WITHOUT_HOME]):
        return words[2]
    if words[:2] == ["QGC", "WPL"]:
        message, hint = f"WPL version {' '.join(words[2:]) or '?'} is not supported, only 110", "save it as version 110"
    else:
        message, hint = "not a waypoint file", f"its first line is {HEADER!r}"
    raise InputError([Finding(file=file, line=1, column=1, message=message, hint=hint)])
