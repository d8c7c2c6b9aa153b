"""The components of a platform: SS, DP, CC, AD, CI, each with state, rate, load and errors; and one of them in full."""

from typing import Final

from gloc3.messages.status_fields import STATUS_FIELDS, StatusField
from gloc3.messages.summaries import Health
from gloc3_groundstation.desk.component_desk import ComponentReply
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, FittedTable, table_of

HEALTH_TONES: Final = {
    Health.WORKING: Tone.GOOD,
    Health.QUIET: Tone.BUSY,
    Health.STANDBY: Tone.WARN,
    Health.IDLE: Tone.WARN,
    Health.ABSENT: Tone.BAD,
    Health.FAULTY: Tone.BAD,
}
KINDS: Final = {
    "SS": "sensor sampler",
    "DP": "data processor",
    "CC": "controller",
    "AD": "actuator driver",
    "CI": "command interface",
}
COLUMNS: Final = (
    Column("", 2),
    Column("component", 16, grows=1, most=24),
    Column("state", 11),
    *(Column(field.title, field.width, is_right=True) for field in STATUS_FIELDS),
    Column("last error", 24, rank=1, grows=4),
)


def components_title(platform: PlatformSnapshot | None, now_s: float) -> str:
    """How many are well, and which are not."""
    components = platform.components(now_s) if platform is not None else ()
    if not components:
        return "components"
    if all(component.is_stale for component in components):
        return "components, as last heard"
    unhealthy = [component.name for component in components if not component.is_well]
    if not unhealthy:
        return f"components: all {len(components)} well"
    others = f" +{len(unhealthy) - 1}" if len(unhealthy) > 1 else ""
    return f"components: {unhealthy[0]}{others} not well"


def components_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(COLUMNS, width).header()


def component_rows(platform: PlatformSnapshot | None, now_s: float, width: int) -> list[tuple[str, Line]]:
    """A name and a line for each component; without any, a line that says so."""
    components = platform.components(now_s) if platform is not None else ()
    if not components:
        if platform is not None and not platform.has_companion:
            return [("", (Span(f" {text}", Tone.DIM),)) for text in wrapped(wording.bare(platform), width - 2)]
        return [("", (Span(" requesting the components…" if platform else " no vehicle is heard", Tone.DIM),))]
    table = table_of(COLUMNS, width)
    rows = []
    kind = ""
    for component in components:
        rows.append((component.name, _line(table, component, component.kind if component.kind != kind else "")))
        kind = component.kind
    return rows


def component_lines(platform: PlatformSnapshot | None, name: str, now_s: float, width: int) -> list[Line]:
    """One component, with its last error in full."""
    components = platform.components(now_s) if platform is not None else ()
    component = next((component for component in components if component.name == name), None)
    if component is None:
        return []
    role = [KINDS.get(component.kind, component.kind), "required" if component.is_required else "not required"]
    if component.standby_for:
        role.append(f"standby for {component.standby_for}")
    rate = f"{component.nominal_rate_hz:g} Hz" if component.nominal_rate_hz > 0.0 else ""
    pace = " when ".join(part for part in (rate, "triggered" if component.is_triggered else "") if part)
    role += [pace] if pace else []
    lines: list[Line] = [(Span(f" {', '.join(role)}", Tone.DIM),)]
    if component.cause:
        count = f" ({component.errors} so far)" if component.errors > 1 else ""
        tone = Tone.STALE if component.is_stale else Tone.TEXT if component.is_well else Tone.BAD
        lines += [(Span(f" last error{count}:", Tone.DIM),)]
        lines += [(Span(f"   {row}", tone),) for row in wrapped(component.cause, width - 4)]
    elif component.errors:
        lines.append((Span(f" {component.errors} errors; details not received yet", Tone.WARN),))
    else:
        lines.append((Span(" no errors", Tone.DIM),))
    return lines


def answer_lines(answer: ComponentReply | None, now_s: float, width: int) -> list[Line]:
    """Reply to the last request to a component."""
    if answer is None:
        return []
    rows = wrapped(f"{answer.requested}: {answer.text}", width - 18)
    ago = f" {wording.duration(now_s - answer.received_s)} ago"
    tone = Tone.GOOD if answer.is_accepted else Tone.BAD
    return [(Span(f"{ago if n == 0 else '':<16}", Tone.DIM), Span(row, tone)) for n, row in enumerate(rows)]


def _line(table: FittedTable, component: ComponentSnapshot, kind: str) -> Line:
    if component.health is None:
        state, tone = "not heard", Tone.STALE
    else:
        state = component.health.value
        tone = Tone.GOOD if component.is_well else HEALTH_TONES[component.health]
    if component.is_stale:
        state, tone = f"was {state}", Tone.STALE
    rest = Tone.STALE if component.is_stale or component.health is None else None
    cause = component.cause.strip().splitlines()[-1] if component.cause.strip() else ""
    return table.line(
        [
            Span(kind, Tone.DIM),
            Span(component.name, rest or Tone.TEXT),
            Span(state, tone),
            *(_cell(field, component, rest) for field in STATUS_FIELDS),
            Span(cause, rest or (Tone.DIM if component.is_well else Tone.BAD)),
        ]
    )


def _cell(field: StatusField, component: ComponentSnapshot, rest: Tone | None) -> Span:
    value = component.values.get(field.name)
    if value is None:
        return Span("", rest or Tone.DIM)
    return Span(field.show(value, component), rest or (Tone.WARN if field.is_notable(value, component) else Tone.DIM))
