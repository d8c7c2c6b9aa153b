"""The frame of every service pane: the list of services, the running job, and the last outcome."""

from collections.abc import Mapping

from gloc3_groundstation.desk.service_jobs import JobOutcome, ServiceJob, ServiceKind
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, bar, spread, wrapped

BAR_WIDTH = 20
MOST_LINES = 6


def services_line(shown: ServiceKind, running: Mapping[ServiceKind, ServiceJob], title: str, width: int) -> Line:
    """All services, with the progress of running ones. The vehicle's firmware at the right where it fits."""
    spans = [Span(" ")]
    for service in ServiceKind:
        job = running.get(service)
        figure = "" if job is None else f" {job.fraction * 100:.0f} %" if job.fraction is not None else " …"
        if service is shown:
            spans.append(Span(f"{service}{figure}", Tone.CHOSEN))
        else:
            spans += [Span(str(service), Tone.DIM), Span(figure, Tone.BUSY)]
        spans.append(Span("  "))
    return spread(tuple(spans[:-1]), (Span(f"{title} ", Tone.DIM),), width)


def job_lines(job: ServiceJob | None, outcome: JobOutcome | None, width: int) -> list[Line]:
    """The running job with its progress; else the outcome of the last one."""
    if job is not None:
        spans = [Span(f" {job.what} ", Tone.BUSY)]
        if job.fraction is not None:
            spans += [Span(bar(job.fraction, BAR_WIDTH), Tone.BUSY), Span(f" {job.fraction * 100:3.0f} %")]
        elif not job.detail:
            spans.append(Span("…", Tone.BUSY))
        spans.append(Span(f"  {job.detail}" if job.detail else "", Tone.DIM))
        return [spread(tuple(spans), (Span("esc", Tone.KEY), Span(" cancels ")), width)]
    if outcome is None:
        return [EMPTY]
    sign, tone = ("✓", Tone.GOOD) if outcome.is_good else ("✗", Tone.BAD)
    found: list[Line] = []
    texts = [outcome.text, *(outcome.lines if len(outcome.lines) > 1 else ())]
    for text in texts:
        for number, row in enumerate(wrapped(text, width - 4)):
            is_first = number == 0 and not found
            found.append((Span(f" {sign} " if is_first else "   ", tone), Span(row, Tone.TEXT)))
    if len(found) > MOST_LINES:
        more = len(found) - MOST_LINES + 1
        found[MOST_LINES - 1 :] = [(Span(f"   and {more} lines more", Tone.DIM),)]
    return found


def unreachable_lines(reason: str, width: int) -> list[Line]:
    """Why there are no services of the vehicle in view."""
    return [EMPTY, *((Span(f" {row}", Tone.WARN),) for row in wrapped(reason, width - 2))]


def hint_lines(*texts: str) -> list[Line]:
    """What to do where a list is empty."""
    return [EMPTY, *((Span(f" {text}", Tone.DIM),) for text in texts)]
