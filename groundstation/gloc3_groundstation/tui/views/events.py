"""What happened, one event after the other, the newest last."""

from gloc3.messages import Severity
from gloc3_groundstation import wording
from gloc3_groundstation.snapshots import Fleet, FleetEvent
from gloc3_groundstation.tui.lines import Line, Span, Tone, wrapped
from gloc3_groundstation.tui.views.chrome import tone_of

SHOWN = 200


def event_lines(fleet: Fleet, start_s: float, width: int) -> list[Line]:
    """The last events; long ones go over several lines.

    Args:
        fleet: whose events.
        start_s: when the station started, from which times are counted.
        width: columns.
    """
    lines: list[Line] = []
    for event in fleet.events[-SHOWN:]:
        lines += _lines(event, len(fleet.platforms) > 1, start_s, width)
    return lines or [(Span(" Nothing has happened yet.", Tone.DIM),)]


def _lines(event: FleetEvent, has_many: bool, start_s: float, width: int) -> list[Line]:
    clock = f" {wording.clock(event.heard_s - start_s)}  "
    who = f"{event.platform}: " if event.platform and (has_many or not event.source) else ""
    who += f"{event.source}: " if event.source else ""
    grade = f"{event.severity.name.lower()}: " if event.severity <= Severity.WARNING else ""
    rows = wrapped(grade + who + event.text, width - len(clock))
    tone = tone_of(event.severity)
    indent = " " * len(clock)
    return [(Span(clock if n == 0 else indent, Tone.DIM), Span(text, tone)) for n, text in enumerate(rows)]
