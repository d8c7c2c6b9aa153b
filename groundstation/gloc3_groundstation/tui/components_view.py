"""The components of a platform, one a line: SS, DP, CC, AD, CI, with state, rate, load and errors."""

from gloc3_groundstation.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.lines import Line, Span, Tone, faded, wrapped
from gloc3_groundstation.tui.vehicle_view import HEALTH_TONES

NAME_WIDTH = 17
WIDE = 52
"""From this width on load and overruns are shown too."""
SLOW_PERCENT = 80
"""A component that cycles slower than this share of its rate is worth a look."""
BUSY_PERCENT = 80


def components_title(platform: PlatformSnapshot | None, now_s: float) -> str:
    """How many are well, and who is not."""
    components = platform.components(now_s) if platform is not None else ()
    if not components:
        return "components"
    if all(component.is_stale for component in components):
        return "components, as last heard"
    unwell = [component.name for component in components if not component.is_well]
    if not unwell:
        return f"components: all {len(components)} well"
    others = f" +{len(unwell) - 1}" if len(unwell) > 1 else ""
    return f"components: {unwell[0]}{others} not well"


def component_lines(platform: PlatformSnapshot | None, now_s: float, width: int) -> list[Line]:
    """A line for each component; under an unwell one what its last error was."""
    components = platform.components(now_s) if platform is not None else ()
    if not components:
        return [(Span(" asking for the components…" if platform else "", Tone.DIM),)]
    lines: list[Line] = []
    kind = ""
    for component in components:
        lines.append(_line(component, component.kind if component.kind != kind else "", width))
        kind = component.kind
        if component.cause and not component.is_well:
            cause = wrapped(component.cause, width - 6)
            lines += [(Span("      " + text, Tone.STALE if component.is_stale else Tone.BAD),) for text in cause[:2]]
    return lines


def _line(component: ComponentSnapshot, kind: str, width: int) -> Line:
    spans = [Span(f" {kind:<3}", Tone.DIM), Span(f"{component.name[:NAME_WIDTH]:<{NAME_WIDTH}} ")]
    if component.health is None:
        return (*spans, Span("not heard yet", Tone.STALE))
    health = component.health
    if component.is_stale:
        return faded((*spans, Span(f"was {health}")))
    spans.append(Span(f"{health:<9}", Tone.GOOD if component.is_well else HEALTH_TONES[health]))
    if component.nominal_rate_hz > 0.0:
        is_slow = component.is_well and component.rate_percent < SLOW_PERCENT
        spans.append(Span(f"{component.rate_percent:>4} %", Tone.WARN if is_slow else Tone.DIM))
    elif width >= WIDE:
        spans.append(Span(" " * 6))
    if width >= WIDE:
        tone = Tone.WARN if component.load_percent >= BUSY_PERCENT else Tone.DIM
        spans.append(Span(f"  load {component.load_percent:>3} %", tone))
        if component.overruns:
            spans.append(Span(f"  {component.overruns} late", Tone.DIM))
    if component.errors:
        spans.append(Span(f"  {component.errors} err" if width >= WIDE else f" !{component.errors}", Tone.WARN))
    return tuple(spans)
