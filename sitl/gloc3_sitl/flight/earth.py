"""Where on Earth a mission begins: the simulated vehicle is put there."""

from gloc3.errors import Gloc3Error
from gloc3.messages.frames import GeoPoint
from gloc3.mission.model.model import Mission

DEFAULT_ALTITUDE_M = 488.0
"""Altitude of open ground when the mission does not say it, above mean sea level."""


def home_of(mission: Mission) -> GeoPoint:
    """The first place of a mission in frame geo, on the ground.

    Raises:
        Gloc3Error: the mission has no position.
    """
    for action in mission.actions().values():
        for field in ("waypoints", "position", "at", "area", "wall", "to"):
            value = getattr(action.arguments, field, None)
            if value:
                latitude, longitude = (value[0] if isinstance(value[0], tuple) else value)[:2]
                return GeoPoint(latitude, longitude, DEFAULT_ALTITUDE_M)
    raise Gloc3Error(f"the mission {mission.name!r} names no place on Earth")
