"""Other traffic on the map: a sign with callsign, relative height and distance, and a line ahead of it."""

from math import hypot
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3_groundstation.mapping.ground import FARTHEST_M, Ground
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.station.snapshots import Encounter, TrafficContact
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.canvas import CELL, CellCanvas
from gloc3_groundstation.tui.widgets.lines import Tone

TRAFFIC_SIGN: Final = "◆"
AHEAD_S: Final = 30.0
"""Length of the line, in time of its motion."""
STALE_S: Final = 15.0


def traffic_tone(encounter: Encounter | None) -> Tone:
    """By the severity of its alert."""
    if encounter is None or encounter.severity is None:
        return Tone.TEXT
    return Tone.BAD if encounter.severity <= Severity.ERROR else Tone.WARN


def draw_traffic(canvas: CellCanvas, view: StationView, ground: Ground, projection: Projection) -> None:
    """Draws all contacts that are on the map."""
    if ground.plane is None or view.platform is None:
        return
    near = {one.key: one for one in view.fleet.encounters if one.platform == view.platform.name}
    for contact in view.fleet.traffic:
        north, east, _ = ground.plane.ned_from_geo(*contact.place, ground.plane.origin.altitude_m)
        if hypot(north, east) > FARTHEST_M:
            continue
        is_stale = view.now_s - contact.received_s > STALE_S
        tone = Tone.STALE if is_stale else traffic_tone(near.get(contact.key))
        dot = projection.dot(north, east)
        if contact.velocity_ne_m_s is not None:
            vn, ve = contact.velocity_ne_m_s
            canvas.line([dot, projection.dot(north + AHEAD_S * vn, east + AHEAD_S * ve)], tone, on=1, off=1)
        column, row = int(dot[0] // CELL[0]), int(dot[1] // CELL[1])
        canvas.text(column, row, TRAFFIC_SIGN, tone)
        label = _label(contact, near.get(contact.key))
        for at, line in ((column + 2, row), (column + 2, row + 1), (column - 1 - len(label), row)):
            if canvas.is_free(at, line, len(label)):
                canvas.text(at, line, label, tone)
                break


def _label(contact: TrafficContact, encounter: Encounter | None) -> str:
    """`SWR123 +30 m 400 m`: relative height and distance where it is near the vehicle in view."""
    if encounter is None:
        return contact.label
    height = "" if encounter.above_m is None else f" {encounter.above_m:+.0f} m"
    return f"{contact.label}{height} {encounter.distance_m:.0f} m"
