"""Traffic near vehicles: distance, relative height, and whether they come closer. Pure geometry with stated limits."""

from collections.abc import Iterable
from math import cos, hypot, radians, sin
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3_groundstation.station.snapshots import Encounter, PlatformSnapshot, TrafficContact

LISTED_M: Final = 5000.0
"""Horizontal distance up to which traffic is listed, m."""
NEAR_M, NEAR_HEIGHT_M = 500.0, 150.0
"""Distances, horizontal and vertical, within which traffic is an error."""
CLOSING_M, CLOSING_HEIGHT_M = 2000.0, 300.0
"""Distances within which closing traffic is a warning."""
PASSES_M: Final = 500.0
"""It is closing if it will pass within this distance, m, as both move now..."""
PASSES_WITHIN_S: Final = 60.0
"""...and within this time, s."""
CLOSING_M_S: Final = 1.0
KEEPS: Final = 1.2
"""An alert lasts until its limits are exceeded by this factor..."""
KEEPS_S: Final = 10.0
"""...and for this time after that, s."""
MOST_AHEAD_S: Final = 10.0
"""A position is moved on by its velocity for this time at most, s."""
MOST_ENCOUNTERS: Final = 8
"""Of a vehicle: the worst and nearest."""


def encounters_of(
    platform: PlatformSnapshot, contacts: Iterable[TrafficContact], now_s: float, before: Iterable[Encounter] = ()
) -> tuple[Encounter, ...]:
    """The traffic near a vehicle, worst and nearest first; none while the vehicle's position is not known.

    Args:
        platform: the vehicle.
        contacts: all traffic.
        now_s: the station's time.
        before: encounters as they were; their alerts do not end at the limits where they begin.
    """
    timed = platform.vehicle
    if timed is None or timed.value.geo is None or timed.is_stale(now_s) or platform.is_quiet_link(now_s):
        return ()
    plane = TangentPlane(GeoPoint(*timed.value.geo))
    own = velocity_ne_m_s(platform)
    alerts = {one.key: one for one in before if one.platform == platform.name and one.severity is not None}
    found = [
        one
        for contact in contacts
        if (one := _encounter(platform, plane, own, contact, alerts.get(contact.key), now_s)) is not None
    ]
    found.sort(key=lambda one: (Severity.INFO if one.severity is None else one.severity, one.distance_m))
    return tuple(found[:MOST_ENCOUNTERS])


def _encounter(
    platform: PlatformSnapshot,
    plane: TangentPlane,
    own_ne_m_s: tuple[float, float],
    contact: TrafficContact,
    alert: Encounter | None,
    now_s: float,
) -> Encounter | None:
    altitude_m = plane.origin.altitude_m if contact.altitude_m is None else contact.altitude_m
    north, east, down = plane.ned_from_geo(*contact.place, altitude_m)
    ahead_s = min(MOST_AHEAD_S, max(0.0, now_s - contact.received_s))
    theirs = contact.velocity_ne_m_s or (0.0, 0.0)
    north, east = north + ahead_s * theirs[0], east + ahead_s * theirs[1]
    distance_m = hypot(north, east)
    if distance_m > LISTED_M:
        return None
    vn, ve = theirs[0] - own_ne_m_s[0], theirs[1] - own_ne_m_s[1]
    closing_m_s = -(north * vn + east * ve) / max(1.0, distance_m)
    square = vn * vn + ve * ve
    passes_s = -(north * vn + east * ve) / square if square > 0.0 else 0.0
    passes_m = hypot(north + passes_s * vn, east + passes_s * ve)
    wider = 1.0 if alert is None else KEEPS
    is_closing = (
        closing_m_s > CLOSING_M_S / wider and passes_s < PASSES_WITHIN_S * wider and passes_m < PASSES_M * wider
    )
    above_m = None if contact.altitude_m is None else -down
    severity = _severity(distance_m, above_m, is_closing=is_closing, alert=alert) if platform.is_armed else None
    alert_s = now_s
    if alert is not None and platform.is_armed and now_s - alert.alert_s < KEEPS_S:
        worst = alert.severity if severity is None else min(severity, alert.severity or severity)
        if worst is not severity:
            severity, alert_s = worst, alert.alert_s
    return Encounter(
        platform=platform.name,
        key=contact.key,
        name=contact.label,
        distance_m=distance_m,
        above_m=above_m,
        is_closing=is_closing,
        severity=severity,
        alert_s=alert_s,
    )


def _severity(
    distance_m: float, above_m: float | None, *, is_closing: bool, alert: Encounter | None
) -> Severity | None:
    """By the limits above, wider for an alert that is on; traffic of unknown height counts as being at the vehicle's."""
    height_m = abs(above_m or 0.0)
    wider = KEEPS if alert is not None and alert.severity is Severity.ERROR else 1.0
    if distance_m < NEAR_M * wider and height_m < NEAR_HEIGHT_M * wider:
        return Severity.ERROR
    wider = 1.0 if alert is None else KEEPS
    if is_closing and distance_m < CLOSING_M * wider and height_m < CLOSING_HEIGHT_M * wider:
        return Severity.WARNING
    return None


def velocity_ne_m_s(platform: PlatformSnapshot) -> tuple[float, float]:
    """Velocity of a vehicle to north and east; zero where it is not known."""
    if platform.motion is None or platform.site is None:
        return 0.0, 0.0
    x, y, _ = (part / 100.0 for part in platform.motion.value.velocity_cm_s)
    bearing = radians(platform.site.value.x_axis_bearing_deg)
    return x * cos(bearing) + y * sin(bearing), x * sin(bearing) - y * cos(bearing)
