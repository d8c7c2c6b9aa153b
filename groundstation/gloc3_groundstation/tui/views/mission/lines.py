"""The mission: its tasks and actions in order, each with its state and progress."""

from collections.abc import Mapping
from typing import Final

from gloc3.mission.model.states import ActionState
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, bar, cut, faded, wrapped

SIGNS: Final[Mapping[str, tuple[str, Tone]]] = {
    ActionState.WAITING: ("·", Tone.DIM),
    ActionState.RUNNING: ("►", Tone.BUSY),
    ActionState.PAUSED: ("=", Tone.WARN),
    ActionState.DONE: ("✓", Tone.GOOD),
    ActionState.FAILED: ("✗", Tone.BAD),
    ActionState.SKIPPED: ("»", Tone.DIM),
    ActionState.ABORTED: ("■", Tone.BAD),
}
"""By state, and its tone."""
BAR_WIDTH = 10
WIDEST = 60
"""On wide screens states stay near the names that they belong to."""


def mission_title(platform: PlatformSnapshot | None, now_s: float) -> str:
    """The mission's name, state and policy."""
    timed = platform.mission if platform is not None else None
    if timed is None or not timed.value.state:
        return "mission"
    mission = timed.value
    policy = f", policy {mission.policy}" if mission.policy else ""
    was = "was " if timed.is_stale(now_s) else ""
    return f"{mission.name}: {was}{mission.state}{policy}"


def mission_lines(platform: PlatformSnapshot | None, plan: CheckedPlan | None, now_s: float, width: int) -> list[Line]:
    """A line for each task and action; without a mission, what can be done."""
    timed = platform.mission if platform is not None else None
    if platform is not None and not platform.has_companion:
        return [(Span(cut(" Its autopilot's plan: Services (6).", width), Tone.DIM),)]
    if timed is None or not timed.value.state:
        at_hand = f" {plan.title!r} is open." if plan is not None else " No mission is loaded."
        hint = " u uploads it, s starts it." if plan is not None else " 3, then o opens one."
        return [(Span(at_hand[:width]),), (Span(hint[:width], Tone.DIM),)]
    mission = timed.value
    lines = [_line(item, min(width, WIDEST)) for item in wording.items(mission)]
    if mission.reason:
        tone = Tone.DIM if mission.state in (ActionState.RUNNING, ActionState.DONE) else Tone.WARN
        lines += [(Span(f" {text}", tone),) for text in wrapped(mission.reason, width - 2)]
    if timed.is_stale(now_s):
        return [faded(line) for line in (*lines, (Span(f" {wording.duration(timed.age_s(now_s))} ago"),))]
    return lines


def _line(item: wording.ItemLabel, width: int) -> Line:
    sign, tone = SIGNS.get(item.state, ("?", Tone.WARN))
    indent = " " if item.is_task else "   "
    state = f"{item.state} {item.times}".rstrip()
    if item.progress and item.state in (ActionState.RUNNING, ActionState.PAUSED):
        state = f"{bar(item.progress, BAR_WIDTH)} {item.progress * 100:3.0f} %"
    room = width - len(indent) - 3 - len(state)
    name = item.name[: max(0, room)]
    name_tone = Tone.DIM if item.state in (ActionState.WAITING, ActionState.SKIPPED) else Tone.TEXT
    name_tone = Tone.STRONG if item.is_task and name_tone is Tone.TEXT else name_tone
    return (Span(indent), Span(f"{sign} ", tone), Span(f"{name:<{max(0, room)}} ", name_tone), Span(state, tone))
