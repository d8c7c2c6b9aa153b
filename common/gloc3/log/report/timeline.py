"""Component timelines: the state of each component over the time of a log, as bars, with its errors marked."""

from pathlib import Path
from typing import Final

import msgspec

from gloc3.component.lci import State
from gloc3.errors import Refused
from gloc3.log.info import is_serious, list_events
from gloc3.log.reader import LogReader
from gloc3.log.report.figure import drawing
from gloc3.log.report.flight_path import value_of
from gloc3.messages.summaries import Health, health_of

COLOURS: Final = {
    Health.IDLE: "#bdbdbd",
    Health.STANDBY: "#f2c14e",
    Health.WORKING: "#3f9b54",
    Health.QUIET: "#5b8fd6",
    Health.FAULTY: "#d62728",
    Health.ABSENT: "#ffffff",
}
ROW_IN: Final = 0.28


class Bar(msgspec.Struct, frozen=True):
    """A component in one state for a time."""

    start_s: float
    end_s: float
    state: Health


class ComponentTimeline(msgspec.Struct, frozen=True):
    """One component over the time of the log."""

    component: str
    bars: list[Bar]
    errors_s: list[float]
    """When it reported an error or a warning."""


def read_timelines(reader: LogReader) -> list[ComponentTimeline]:
    """The states of all components, in the order of their first report."""
    changes: dict[str, list[tuple[float, Health]]] = {}
    end_s = 0.0
    for entry in reader.entries("components/*/status"):
        state = value_of(entry.envelope.payload, "state")
        health = health_of(State(state) if state in list(State) else None)
        rows = changes.setdefault(entry.envelope.source.component, [])
        end_s = max(end_s, entry.envelope.t_s)
        if not rows or rows[-1][1] is not health:
            rows.append((entry.envelope.t_s, health))
    errors: dict[str, list[float]] = {}
    for event in list_events(reader):
        if is_serious(event):
            errors.setdefault(event.component, []).append(event.t_s)
    found = []
    for component, rows in changes.items():
        ends = [t_s for t_s, _ in rows[1:]] + [end_s]
        bars = [Bar(start_s, stop_s, health) for (start_s, health), stop_s in zip(rows, ends, strict=True)]
        found.append(ComponentTimeline(component, bars, errors.get(component, [])))
    return found


def plot_timelines(timelines: list[ComponentTimeline], file: Path, title: str = "") -> None:
    """Draws a bar for each component.

    Raises:
        Refused: there is no component.
        Gloc3Error: matplotlib is not installed, or the file cannot be written.
    """
    if not timelines:
        raise Refused("the log has no component status")
    with drawing(file, 9.0, 1.5 + ROW_IN * len(timelines)) as figure:
        from matplotlib.patches import Patch

        axes = figure.subplots()
        for row, timeline in enumerate(timelines):
            for state, colour in COLOURS.items():
                spans = [(bar.start_s, bar.end_s - bar.start_s) for bar in timeline.bars if bar.state is state]
                if spans:
                    edge = "#999999" if state is Health.ABSENT else "none"
                    axes.broken_barh(
                        spans, (row - 0.36, 0.72), facecolor=colour, edgecolor=edge, gid=f"{timeline.component}-{state}"
                    )
            if timeline.errors_s:
                places = [row] * len(timeline.errors_s)
                axes.plot(
                    timeline.errors_s, places, "v", color="black", markersize=4, gid=f"{timeline.component}-errors"
                )
        axes.set_yticks(range(len(timelines)), [timeline.component for timeline in timelines])
        axes.set(xlabel="time since boot, s", ylim=(len(timelines) - 0.4, -0.6), title=title)
        axes.grid(visible=False, axis="y")
        axes.margins(x=0.01)
        shown = [state for state in COLOURS if any(bar.state is state for line in timelines for bar in line.bars)]
        handles = [Patch(facecolor=COLOURS[state], edgecolor="#999999", label=state.value) for state in shown]
        figure.legend(handles=handles, loc="outside lower center", ncols=6)
