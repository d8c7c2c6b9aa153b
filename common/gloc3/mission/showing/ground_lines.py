"""The height profile of a mission as text: the path over the ground, and where it is lowest."""

from typing import Final

import numpy as np

from gloc3.mission.checking.terrain_check import GroundProfile
from gloc3.mission.model.model import Mission

HEIGHT: Final = 9
"""Lines of the drawing."""
_AXIS: Final = 8
_BLOCKS: Final = " ▁▂▃▄▅▆▇█"


def ground_lines(mission: Mission, profile: GroundProfile, width: int) -> list[str]:
    """The path as dots over the ground as blocks; heights on the left count from the origin of NED.

    Args:
        mission: that was checked.
        profile: of its path.
        width: columns.
    """
    columns, path_m, clearance_m = width - _AXIS, profile.path_m, profile.clearance_m
    if not len(path_m) or np.isnan(clearance_m).all():
        return ["ground: not known along the path"]
    ground_m = path_m - clearance_m
    low, high = float(np.nanmin([path_m, ground_m])), float(np.nanmax([path_m, ground_m]))
    low, high = low - 0.1 * (high - low), max(high, low + 1.0)
    length_m = max(1.0, float(profile.along_m[-1]))
    cells = [[" "] * columns for _ in range(HEIGHT)]
    known = ~np.isnan(ground_m)
    middles_m = (np.arange(columns) + 0.5) / columns * length_m
    levels = (np.interp(middles_m, profile.along_m[known], ground_m[known]) - low) / (high - low) * HEIGHT * 8
    rows = (high - np.interp(middles_m, profile.along_m, path_m)) / (high - low) * HEIGHT
    for column, level in enumerate(levels.astype(int).tolist()):
        for row in range(HEIGHT):
            cells[HEIGHT - 1 - row][column] = _BLOCKS[max(0, min(8, level - 8 * row))]
    for column, row in enumerate(np.clip(rows.astype(int), 0, HEIGHT - 1).tolist()):
        cells[row][column] = "•"
    labels = {0: f"{high:.0f} m", HEIGHT - 1: f"{low:.0f} m"}
    drawn = [f"{labels.get(row, ''):>{_AXIS - 1}}│{''.join(line)}" for row, line in enumerate(cells)]
    foot = f"{'0':<{columns - 12}}{f'{length_m:.0f} m':>12}"
    lowest = f"the path is lowest {profile.lowest(mission.document)}" if mission.document is not None else ""
    unknown = " (unknown in places)" if np.isnan(clearance_m).any() else ""
    return [f"ground: {lowest}{unknown}", *drawn, " " * _AXIS + foot]
