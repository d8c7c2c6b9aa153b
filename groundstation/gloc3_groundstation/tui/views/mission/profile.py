"""The height profile below the map: requested and flown heights, along the path or over time."""

from math import dist

import numpy as np

from gloc3_groundstation.mapping.progress import PathProgress
from gloc3_groundstation.mapping.requested import Requested
from gloc3_groundstation.mapping.tracks import TrackChannel, Tracks
from gloc3_groundstation.tui.views.charts import (
    AXIS,
    Curve,
    chart_lines,
    round_scale,
    scale_of,
    time_axis,
    window_at,
    with_axis,
)
from gloc3_groundstation.tui.widgets.canvas import CellCanvas
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone

TIME_S = 300.0
"""The time that the profile over time shows."""
LEAST_M = 1.0


def along_lines(request: Requested, progress: PathProgress | None, tone: Tone, width: int, height: int) -> list[Line]:
    """Heights along the requested path: dashed as requested, in the vehicle's colour as flown, the ground hatched.

    Args:
        request: the mission.
        progress: of the vehicle along its path; None before it flies it.
        tone: that of the vehicle.
        width: columns.
        height: lines, the last one with the distances.
    """
    path = np.array(request.path_ned_m)
    heights = -path[:, 2]
    flown = progress.flown if progress is not None else np.empty((0, 2))
    ceiling = request.fence.ceiling_m if request.fence is not None else None
    ground = np.array(request.ground_m).reshape(-1, 2)
    known = [*heights, *flown[:, 1], *ground[~np.isnan(ground[:, 1]), 1]]
    scale = round_scale(min(known), max(known), LEAST_M)
    canvas = CellCanvas(width - AXIS, height - 1)
    across, down = canvas.size
    length_m = max(request.length_m, 0.1)
    steps = [0.0, *(dist(a, b) for a, b in zip(request.path_ned_m, request.path_ned_m[1:], strict=False))]
    along_m = np.cumsum(steps)

    def placed(distances_m: object, values: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        x = np.asarray(distances_m, np.float64) / length_m * (across - 1)
        y = (scale.high - np.asarray(values, np.float64)) / (scale.high - scale.low) * (down - 1)
        return np.column_stack((x, y))

    if len(ground):
        edge = placed(ground[:, 0], ground[:, 1])
        canvas.area([(edge[0, 0], down), *edge[~np.isnan(edge[:, 1])].tolist(), (edge[-1, 0], down)], Tone.DIM, hatch=2)
        canvas.line(edge, Tone.STALE)
    if ceiling is not None and scale.low <= ceiling <= scale.high:
        canvas.line(placed((0.0, length_m), (ceiling, ceiling)), Tone.WARN)
    canvas.line(placed(along_m, heights), Tone.TEXT, on=3, off=2)
    if len(flown):
        canvas.line(placed(flown[:, 0], flown[:, 1]), tone)
        x, y = placed(flown[-1:, 0], flown[-1:, 1])[0]
        canvas.text(int(x // 2), int(y // 4), "◆", tone)
    room = width - AXIS
    middle, end = f"{length_m / 2.0:.0f} m", f"{length_m:.0f} m along the path"
    left = "0" + " " * max(1, room // 2 - 1 - len(middle) // 2) + middle
    foot = left + " " * max(1, room - len(left) - len(end)) + end
    return [*with_axis(canvas.lines(), scale), (Span(" " * AXIS), Span(foot, Tone.DIM))]


def time_lines(tracks: Tracks, name: str, tone: Tone, now_s: float, width: int, height: int) -> list[Line]:
    """Heights over the last minutes: dotted as requested, in the vehicle's colour as flown."""
    track = tracks.get(name)
    if track is None:
        return []
    window = window_at(now_s, TIME_S, width - AXIS)
    points = 2 * (width - AXIS)
    curves = [
        Curve("wanted", track.series(TrackChannel.WANTED_HEIGHT, *window, points), Tone.TEXT, is_dotted=True),
        Curve("height", track.series(TrackChannel.HEIGHT, *window, points), tone),
    ]
    scale = scale_of(curves, window, LEAST_M)
    return [*chart_lines((), curves, window, scale, width, height)[1:], time_axis(window, now_s, width)]
