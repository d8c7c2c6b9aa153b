"""Details of the item under the graph's cursor: its action, order, progress, and failures."""

from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.states import ActionState
from gloc3.mission.showing.show import answers
from gloc3_groundstation.missions.draft import NEW_NAME, Draft
from gloc3_groundstation.missions.outline import COMMANDS, Outline, OutlineAction
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.views.mission.graph import sign_of
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, fitted, wrapped

PROBLEM_TONE = (ActionState.FAILED, ActionState.ABORTED)


def detail_title(outline: Outline | None, target: str) -> str:
    """What the panel is about."""
    if outline is None:
        return ""
    if not target:
        return "the mission"
    if target.startswith(COMMANDS):
        return f"single action {target}"
    return f"action {target}" if "." in target else f"task {target}"


def detail_lines(outline: Outline | None, reported: MissionSummary | None, target: str, width: int) -> list[Line]:
    """The item, and all failures in the mission."""
    if outline is None:
        return []
    lines = _mission(outline, reported, width) if not target else _item(outline, reported, target, width)
    if reported is not None:
        for failed, reason in reported.reasons.items():
            if failed != target and reported.tasks.get(failed) == ActionState.FAILED:
                lines += _text(f"✗ {failed} failed: {reason}", Tone.BAD, width)
    return lines


def position_line(
    draft: Draft | None,
    platform: PlatformSnapshot | None,
    now_s: float,
    width: int,
    *,
    is_loaded: bool,
    is_at_hand: bool,
) -> Line:
    """Which mission is shown: the one on the vehicle, the open one, or both if they are the same."""
    name = platform.name if platform is not None else "the vehicle"
    held = platform.mission if platform is not None else None
    has_loaded = held is not None and bool(held.value.state)
    unsaved = [(1, Span("not saved", Tone.WARN))] if draft is not None and draft.is_changed else []
    parts: list[tuple[int, Span]] = []
    if is_loaded:
        parts.append((0, Span(f" on {name}", Tone.STRONG)))
        if held is not None and held.is_stale(now_s):
            parts.append((1, Span(f"as last heard {wording.duration(held.age_s(now_s))} ago", Tone.BAD)))
        if is_at_hand and draft is not None:
            parts += [(2, Span(f"open: {draft.name}", Tone.DIM)), *unsaved]
        elif draft is not None:
            parts.append((2, Span(f"m shows the open one: {draft.name}", Tone.DIM)))
        return fitted(parts, width)
    if draft is None:
        return ()
    parts += [(0, Span(f" open: {draft.name}", Tone.STRONG)), *unsaved]
    if draft.errors:
        parts.append((1, Span(f"{draft.errors} error{'s' if draft.errors > 1 else ''}: e shows them", Tone.BAD)))
    elif draft.outline is not None and platform is not None:
        parts.append((2, Span("u uploads it, s starts it", Tone.DIM)))
    if has_loaded:
        parts.append((3, Span(f"m shows the one on {name}", Tone.DIM)))
    return fitted(parts, width)


def text_line(draft: Draft | None) -> Line:
    """Name of the edited text, and whether it is saved."""
    if draft is None:
        return ()
    where = "" if draft.path else "   no file yet" if draft.name == NEW_NAME else "   an example"
    origin = f"   converted from {draft.made_of}" if draft.made_of else where
    if draft.is_fixed:
        return (Span(f" {draft.name}", Tone.STRONG), Span("   not a mission that can be edited", Tone.WARN))
    state = Span("   not saved", Tone.WARN) if draft.is_changed else Span(origin, Tone.DIM)
    return (Span(f" {draft.name}", Tone.STRONG), state)


def nothing_lines(draft: Draft | None, platform: PlatformSnapshot | None, recent: tuple[str, ...]) -> list[Line]:
    """Lines shown without a graph: the reason, and what can be done."""
    if draft is not None:
        return [
            (Span(f" {draft.name} cannot be drawn as a graph.", Tone.WARN),),
            (
                Span(
                    f" {draft.errors} finding{'s' if draft.errors != 1 else ''}: e shows the text and the findings.",
                    Tone.DIM,
                ),
            ),
        ]
    lately = f" The last one was {recent[0]}." if recent else ""
    where = f" {platform.name} holds none either." if platform is not None and platform.mission is not None else ""
    return [
        (Span(f" No mission is open.{where}"),),
        (Span(f" o opens one: a mission file, a plan of QGroundControl, waypoints, or an example.{lately}", Tone.DIM),),
        (Span(" n creates a new one.", Tone.DIM),),
    ]


def _mission(outline: Outline, reported: MissionSummary | None, width: int) -> list[Line]:
    lines: list[Line] = []
    if reported is not None and reported.reason:
        is_problem = reported.state in (*PROBLEM_TONE, ActionState.PAUSED)
        lines += _text(f"{reported.state}: {reported.reason}", Tone.WARN if is_problem else Tone.DIM, width)
    if reported is not None and reported.took_s >= 0.0:
        lines += _text(wording.used(reported, outline), Tone.DIM, width)
    if reported is not None and reported.policy:
        lines += _text(f"policy {reported.policy} is running", Tone.WARN, width)
    if not outline.is_ordered:
        lines += _text("its graph is not known here yet; reading it back", Tone.DIM, width)
    if outline.policies is not None:
        lines += _text(", ".join(answers(outline.policies)), Tone.DIM, width)
    return lines


def _item(outline: Outline, reported: MissionSummary | None, target: str, width: int) -> list[Line]:
    step, stage = outline.step(target), outline.stage(target)
    item = step or stage
    if item is None:
        return []
    state = reported.tasks.get(target, "") if reported is not None else ""
    sign, tone = sign_of(state)
    head = [Span(f" {sign} {state or 'on no vehicle'}", tone)]
    progress = reported.progress.get(target) if reported is not None else None
    if progress and state in ("running", "paused"):
        head.append(Span(f"  {progress * 100:.0f} %", tone))
    if isinstance(item, OutlineAction):
        head.append(Span(f"   {item.what}"))
        if item.duration_s is not None:
            head.append(Span(f"   about {wording.duration(item.duration_s)}", Tone.DIM))
    else:
        ended = (
            sum(reported.tasks.get(one.target) in ("done", "skipped") for one in item.steps)
            if reported is not None
            else 0
        )
        if reported is not None and (time := wording.times(reported, target)):
            head.append(Span(f"   {time} times", Tone.DIM))
        head.append(Span(f"   {ended} of {len(item.steps)} actions done" if reported is not None else "", Tone.DIM))
    lines: list[Line] = [tuple(head)]
    reason = reported.reasons.get(target, "") if reported is not None else ""
    if reason:
        lines += _text(reason, Tone.BAD if state == ActionState.FAILED else Tone.WARN, width)
    terms = [f"after {', '.join(item.after)}"] if item.after else []
    terms += [f"until {step.until}"] if step is not None and step.until else []
    terms += item.terms
    if terms:
        lines += _text("; ".join(terms), Tone.DIM, width)
    return lines


def _text(text: str, tone: Tone, width: int) -> list[Line]:
    return [(Span(f" {row}", tone),) for row in wrapped(" ".join(text.split()), max(10, width - 2))]
