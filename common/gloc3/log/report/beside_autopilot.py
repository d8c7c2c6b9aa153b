"""Our log and the autopilot's own in one picture, on one time axis."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gloc3.errors import Refused
from gloc3.log.autopilot_log import AutopilotLog, Floats, MotionTrack, autopilot_series, autopilot_track, fit_offset_s
from gloc3.log.reader import LogReader
from gloc3.log.report.figure import drawing, thin
from gloc3.log.report.flight_path import POSE, value_of

AXES = ("north, m", "east, m", "height, m")


class BesideAutopilot(NamedTuple):
    """What is drawn, and how the clocks were brought together."""

    ours: MotionTrack
    theirs: MotionTrack
    """On our time axis, moved to our origin."""
    offset_s: float
    """What was added to the autopilot's times."""
    correlation: float | None
    """How well the speeds agree, up to 1; None where the offset was given."""
    moved_m: tuple[float, float, float]
    """By how much the autopilot's positions were moved, north, east, down."""
    series: Mapping[str, tuple[Floats, Floats]]
    """Further fields of the autopilot's log, on our time axis."""


def read_beside(reader: LogReader, log: AutopilotLog, fields: Sequence[str], offset_s: float | None) -> BesideAutopilot:
    """Brings both logs together.

    Args:
        reader: our log.
        log: the autopilot's.
        fields: further fields of the autopilot's, as `MESSAGE.FIELD`.
        offset_s: what is added to the autopilot's times; None to find it by the motion.

    Raises:
        Refused: one of them lacks what is needed, or they are not of one flight.
    """
    reader.require_ours("pose", POSE)
    ours, theirs = _our_track(reader), autopilot_track(log)
    correlation = None
    if offset_s is None:
        offset_s, correlation = fit_offset_s(ours, theirs)
    moved = theirs._replace(t_s=theirs.t_s + offset_s)
    both = (moved.t_s >= ours.t_s[0]) & (moved.t_s <= ours.t_s[-1])
    if not both.any():
        raise Refused(f"with an offset of {offset_s:.3f} s, the logs have no time in common")
    at = np.stack([np.interp(moved.t_s[both], ours.t_s, one) for one in ours.position_ned_m.T], axis=1)
    shift = np.median(at - moved.position_ned_m[both], axis=0)
    series = {}
    for name in fields:
        t_s, values = autopilot_series(log, name)
        series[name] = t_s + offset_s, values
    north, east, down = map(float, shift)
    placed = moved._replace(position_ned_m=moved.position_ned_m + shift)
    return BesideAutopilot(ours, placed, offset_s, correlation, (north, east, down), series)


def _our_track(reader: LogReader) -> MotionTrack:
    rows = [
        (envelope.t_s, *value_of(envelope.payload, "position_ned_m"), *value_of(envelope.payload, "velocity_ned_m_s"))
        for _, envelope in reader.entries(POSE)
        if value_of(envelope.payload, "is_valid") is not False and value_of(envelope.payload, "velocity_ned_m_s")
    ]
    if len(rows) < 2:
        raise Refused(f"{reader.path}: no valid pose was recorded")
    table = np.array(sorted(rows))
    return MotionTrack(table[:, 0], table[:, 1:4], table[:, 4:7])


def plot_beside(found: BesideAutopilot, form: str, file: Path, title: str) -> None:
    """Draws positions, speeds and further fields over our time.

    Raises:
        Gloc3Error: matplotlib is not installed, or the file cannot be written.
    """
    panels = len(AXES) + 1 + len(found.series)
    with drawing(file, 9.0, 1.2 + 1.5 * panels) as figure:
        axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
        for track, name, style in ((found.ours, "GLOC3", "-"), (found.theirs, form, "--")):
            step = thin(len(track.t_s))
            columns = [*(track.position_ned_m * (1.0, 1.0, -1.0)).T, np.linalg.norm(track.velocity_ned_m_s, axis=1)]
            for panel, values, label in zip(axes, columns, (*AXES, "speed, m/s"), strict=False):
                panel.plot(track.t_s[::step], values[::step], style, linewidth=1.1, label=name)
                panel.set_ylabel(label)
        for panel, (name, (t_s, values)) in zip(axes[len(AXES) + 1 :], found.series.items(), strict=True):
            step = thin(len(t_s))
            panel.plot(t_s[::step], values[::step], linewidth=1.1, gid=name)
            panel.set_ylabel(name, fontsize=7)
        axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
        axes[-1].set_xlabel("time since boot, s")
        axes[0].set_xlim(found.ours.t_s[0], found.ours.t_s[-1])
        figure.suptitle(title, x=0.02, ha="left", fontweight="bold")


def in_words(found: BesideAutopilot) -> str:
    """How the logs were brought together, for people."""
    how = "as given" if found.correlation is None else f"by the speeds, which agree by {found.correlation:.3f} of 1"
    north, east, down = found.moved_m
    return (
        f"autopilot's time {found.offset_s:+.3f} s is ours ({how}); "
        f"its positions moved by {north:.2f} m north, {east:.2f} m east, {-down:.2f} m up"
    )
