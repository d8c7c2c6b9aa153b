"""The pre-flight list as lines: verdict, finding, and advice below it."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from msgspec.structs import replace

from gloc3.messages.preflight import Check, Group, Verdict, red, summary
from gloc3_groundstation.desk.preflight_desk import CheckList
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.wording import duration
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, column, cut, wrapped

SIGNS: Final[Mapping[Verdict, tuple[str, Tone]]] = {
    Verdict.OK: ("✓ ok", Tone.GOOD),
    Verdict.UNKNOWN: ("? unknown", Tone.DIM),
    Verdict.WARNING: ("▲ warning", Tone.WARN),
    Verdict.RED: ("✗ RED", Tone.BAD),
}
GROUP: Final = 11
VERDICT: Final = 10
NAME: Final = 20
NOT_LOADED: Final = f"{Group.MISSION}: loaded"
STREAM_IT: Final = "u uploads the open mission"
OPEN_ONE: Final = "open one: 3, then o"
STALE_S: Final = 60.0
"""Age from which a list is marked as old."""


class CheckRow(NamedTuple):
    """A line of the list; further lines of a check have no key."""

    line: Line
    key: str


def preflight_title(checks: CheckList) -> str:
    """Summary of the checks, and their age."""
    if checks.age_s is None:
        return "checks"
    requesting = ", refreshing…" if checks.is_requesting else ""
    return f"checks: {summary(checks.checks)}, {duration(checks.age_s)} ago{requesting}"


def preflight_headline(
    platform: PlatformSnapshot | None, checks: CheckList | None, width: int, *, can_start: bool = True
) -> Line:
    """What the list means for a start.

    Args:
        platform: the selected vehicle; None before the first contact.
        checks: its list; None without a vehicle.
        width: columns.
        can_start: whether there is a mission that could be started now.
    """
    if platform is None or checks is None:
        return EMPTY
    if not platform.has_companion:
        return (Span(f" {platform.name} has no GLOC3 companion, which provides the list", Tone.WARN),)
    if checks.problem:
        lack = "no list" if checks.age_s is None else "no newer list"
        return (Span(cut(f" {lack}: {checks.problem}", width), Tone.WARN),)
    if checks.age_s is None:
        return (Span(f" {platform.name}: requesting its list…", Tone.DIM),)
    bad = red(checks.checks)
    vehicle = platform.vehicle
    if vehicle is not None and vehicle.value.is_armed:
        return (Span(" armed: this is the current state; nothing is refused in the air", Tone.DIM),)
    if bad:
        lines = "1 line is red" if len(bad) == 1 else f"{len(bad)} lines are red"
        refused = Span(f" {lines}: the start is refused", Tone.BAD)
        override = Span("   o", Tone.KEY), Span(" starts anyway, and is logged")
        return (refused, *override) if can_start else (refused,)
    if not can_start:
        return (Span(" nothing is red", Tone.GOOD), Span("   there is no mission to start now", Tone.DIM))
    return (Span(" nothing is red", Tone.GOOD), Span("   s", Tone.KEY), Span(" starts the mission"))


def no_list_lines(platform: PlatformSnapshot, problem: str, width: int) -> list[Line]:
    """What to do where there is no list."""
    if not platform.has_companion:
        advice = (
            "Only its autopilot is heard. Use the screen Services, or, on the computer that is connected "
            "to it, with: gloc3 doctor PLATFORM --autopilot URL"
        )
        return [(Span(f" {text}", Tone.TEXT),) for text in wrapped(advice, max(20, width - 2))]
    return [(Span(f" {text}", Tone.WARN),) for text in wrapped(problem, max(20, width - 2))] if problem else []


def preflight_rows(checks: CheckList, width: int, *, has_plan: bool = False) -> list[CheckRow]:
    """Every check; the name of a group precedes its first check.

    Args:
        checks: the checks.
        width: columns.
        has_plan: whether a mission is selected, so that the key for sending it has an effect.
    """
    rows: list[CheckRow] = []
    group = ""
    for check in checks.checks:
        if check.title == NOT_LOADED and check.verdict is Verdict.UNKNOWN:
            check = replace(check, advice=STREAM_IT if has_plan else OPEN_ONE)
        rows += _rows(check, check.group if check.group != group else "", width)
        group = check.group
    if checks.age_s is not None and checks.age_s > STALE_S:
        rows = [CheckRow(tuple(Span(span.text, Tone.STALE) for span in row.line), row.key) for row in rows]
    return rows


def _rows(check: Check, group: str, width: int) -> list[CheckRow]:
    sign, tone = SIGNS[check.verdict]
    before = 1 + GROUP + VERDICT + NAME
    room = max(20, width - before - 1)
    is_calm = check.verdict in (Verdict.OK, Verdict.UNKNOWN)
    found = wrapped(check.finding, room)
    first = (
        Span(" " + column(group, GROUP), Tone.STRONG),
        Span(column(sign, VERDICT), tone),
        Span(column(check.name, NAME - 1) + " ", Tone.TEXT if is_calm else Tone.STRONG),
        Span(found[0]),
    )
    blank = " " * before
    rows = [CheckRow(first, check.title)]
    rows += [CheckRow((Span(blank), Span(text)), "") for text in found[1:]]
    advice = wrapped(check.advice, room - 2) if check.advice else []
    for number, text in enumerate(advice):
        arrow = "→ " if number == 0 else "  "
        rows.append(CheckRow((Span(blank), Span(arrow + text, Tone.DIM if is_calm else Tone.BUSY)), ""))
    return rows
