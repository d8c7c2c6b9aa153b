"""A small artificial horizon: the ground in eighths of a cell, the vehicle in the middle.

The vehicle's own cells show no ground: they could do so in whole cells only, and would jump where all else glides.
"""

from math import cos, radians, tan
from typing import Final

from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone

DEGREES_PER_LINE: Final = 5.0
STEEPEST_DEG: Final = 88.0
EIGHTHS: Final = " ▁▂▃▄▅▆▇█"
VEHICLE: Final = "━━╸◦╺━━"


def horizon_lines(roll_deg: float, pitch_deg: float, width: int, height: int, *, is_stale: bool = False) -> list[Line]:
    """The horizon as seen from the vehicle: it sinks when the nose rises, and turns to the left in a roll to the right.

    Args:
        roll_deg: positive to the right.
        pitch_deg: positive with the nose up.
        width: columns.
        height: lines.
        is_stale: whether that was so long ago.
    """
    roll = (roll_deg + 180.0) % 360.0 - 180.0
    is_inverted = abs(roll) > 90.0
    turn = roll - (180.0 if roll > 0.0 else -180.0) if is_inverted else roll
    turn = max(-STEEPEST_DEG, min(STEEPEST_DEG, turn))
    slope = tan(radians(turn)) / 2.0  # a cell is twice as high as it is wide
    sunk = pitch_deg / DEGREES_PER_LINE / max(0.1, cos(radians(turn)))
    middle = height / 2.0 + (-sunk if is_inverted else sunk)
    edges = [middle - slope * (column + 0.5 - width / 2.0) for column in range(width)]
    tone, over = (Tone.STALE, Tone.STALE) if is_stale else (Tone.GROUND, Tone.STRONG)
    rows: list[list[str]] = []
    for row in range(height):
        shares = [max(0.0, min(1.0, edge - row if is_inverted else row + 1.0 - edge)) for edge in edges]
        if is_inverted:  # blocks grow from below only: the ground above is drawn in whole cells
            rows.append(["█" if share >= 0.5 else " " for share in shares])
        else:
            rows.append([EIGHTHS[round(8.0 * share)] for share in shares])
    at = (width - len(VEHICLE)) // 2
    found: list[Line] = []
    for number, cells in enumerate(rows):
        if number == height // 2:
            left, right = "".join(cells[:at]), "".join(cells[at + len(VEHICLE) :])
            found.append((Span(left, tone), Span(VEHICLE, over), Span(right, tone)))
        else:
            found.append((Span("".join(cells), tone),))
    return found
