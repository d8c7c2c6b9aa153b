"""Drawing of the chain from samplers to command interface, marking where the data flow stops."""

from collections.abc import Mapping, Sequence
from typing import Final

from gloc3.messages.summaries import Health
from gloc3_groundstation.station.data_chain import ChainStage, Wiring, stages
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.views.components import HEALTH_TONES
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, cut

SIGNS: Final = {
    Health.WORKING: "●",
    Health.QUIET: "◐",
    Health.STANDBY: "○",
    Health.IDLE: "○",
    Health.ABSENT: "·",
    Health.FAULTY: "✕",
    None: "?",
}
LEGENDS: Final = (
    "SS sampler  DP processor  CC controller  AD driver  CI command interface",
    "● working  ◐ quiet  ○ standby, idle  ✕ faulty  · absent",
)
"""What the letters and the signs of the chain mean; shown as far as there is room."""
MOST_SIGNS: Final = 8
"""Most components of a stage shown individually; a larger stage is shown as counts."""


def chain_lines(platform: PlatformSnapshot | None, wiring: Wiring | None, now_s: float, width: int) -> list[Line]:
    """The drawing, and a line that summarizes it.

    Args:
        platform: the selected vehicle.
        wiring: the connections between components; None where they are unknown here.
        now_s: the station's time.
        width: columns.
    """
    components = platform.components(now_s) if platform is not None else ()
    if not components:
        return [EMPTY, EMPTY]
    chain = stages(components)
    is_stale = all(component.is_stale for component in components)
    spans = [Span(" ")]
    has_stopped = False
    signs = MOST_SIGNS if width >= 76 else 0
    for place, stage in enumerate(chain):
        if place:
            has_stopped = has_stopped or bool(chain[place - 1].stops)
            arrow = " ─✕╌▷ " if chain[place - 1].stops else " ╌╌╌▷ " if has_stopped else " ───▶ "
            spans.append(Span(arrow, Tone.STALE if is_stale else Tone.BAD if has_stopped else Tone.GOOD))
        spans.append(Span(f"{stage.kind} ", Tone.STRONG if not stage.stops else Tone.BAD))
        spans += _signs(stage, signs)
    drawn = tuple(Span(span.text, Tone.STALE) for span in spans) if is_stale else tuple(spans)
    return [drawn, _with_legend(_text(chain, wiring, components, width, is_stale=is_stale), width)]


def _with_legend(line: Line, width: int) -> Line:
    """A line with as much of the legend at its end as there is room for."""
    room = width - sum(len(span.text) for span in line) - 4
    shown = next((text for text in ("   ".join(LEGENDS), LEGENDS[0]) if len(text) <= room), "")
    return (*line, Span(f"{shown:>{room + 3}}", Tone.DIM)) if shown else line


def wiring_lines(wiring: Wiring | None, name: str, width: int) -> list[Line]:
    """A component's inputs with their sources, and its outputs with their readers."""
    if wiring is None:
        return []
    lines: list[Line] = []
    for title, known in (("takes", wiring.inputs(name)), ("gives", wiring.gives(name))):
        text = "; ".join(_topic(topic, others, title) for topic, others in known.items())
        if text:
            lines.append((Span(f" {title} ", Tone.DIM), Span(cut(text, width - 8), Tone.DIM)))
    return lines


def _topic(topic: str, others: Sequence[str], title: str) -> str:
    if not others:
        return topic
    return f"{topic} {'from' if title == 'takes' else 'to'} {', '.join(others)}"


def _signs(stage: ChainStage, most: int) -> list[Span]:
    if len(stage.components) > most:
        well = sum(component.is_well for component in stage.components)
        return [Span(f"{well}/{len(stage.components)}", Tone.GOOD if well == len(stage.components) else Tone.WARN)]
    return [Span(SIGNS[each.health], _tone(each)) for each in stage.components]


def _tone(component: ComponentSnapshot) -> Tone:
    if component.health is None:
        return Tone.STALE
    return Tone.GOOD if component.is_well else HEALTH_TONES[component.health]


def _text(
    chain: Sequence[ChainStage],
    wiring: Wiring | None,
    components: Sequence[ComponentSnapshot],
    width: int,
    *,
    is_stale: bool,
) -> Line:
    starved = wiring.starved(components) if wiring is not None else {}
    stopped = next((stage for stage in chain if stage.stops), None)
    if stopped is not None:
        who = ", ".join(f"{each.name} is {each.health}" for each in stopped.stops)
        text, tone = f"the data stops at {stopped.kind}: {who}{_missing(starved)}", Tone.BAD
    elif starved:
        text, tone = f"all required components work{_missing(starved)}", Tone.WARN
    elif all(component.is_well or component.health is None for component in components):
        text, tone = "the data flows from end to end", Tone.GOOD
    else:
        unhealthy = ", ".join(each.name for each in components if not each.is_well and each.health is not None)
        text, tone = f"the data flows; optional, not well: {unhealthy}", Tone.WARN
    if is_stale:
        return (Span(cut(f" as last heard, {text}", width - 1), Tone.STALE),)
    return (Span(cut(f" {text}", width - 1), tone),)


def _missing(starved: Mapping[str, str]) -> str:
    if not starved:
        return ""
    by_topic: dict[str, list[str]] = {}
    for name, topic in starved.items():
        by_topic.setdefault(topic, []).append(name)
    return "; " + "; ".join(f"no {topic} for {', '.join(names)}" for topic, names in by_topic.items())
