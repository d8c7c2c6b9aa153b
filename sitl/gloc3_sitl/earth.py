"""Missions of any format as YAML, and where on Earth they begin: the simulated vehicle is put there."""

from pathlib import Path

from gloc3.errors import Gloc3Error
from gloc3.frames import GeoPoint
from gloc3.mission.formats import mission_text
from gloc3.mission.model import Mission

DEFAULT_ALTITUDE_M = 488.0
"""Altitude of open ground when the mission does not say it, above mean sea level."""


def home_of(mission: Mission) -> GeoPoint:
    """The first place of a mission in frame geo, on the ground.

    Raises:
        Gloc3Error: the mission has no position.
    """
    for action in mission.actions().values():
        for field in ("waypoints", "position", "at"):
            value = getattr(action.arguments, field, None)
            if value:
                latitude, longitude = (value[0] if field == "waypoints" else value)[:2]
                return GeoPoint(latitude, longitude, DEFAULT_ALTITUDE_M)
    raise Gloc3Error(f"the mission {mission.name!r} names no place on Earth")


def as_yaml(name: str, speed_limit_m_s: float, folder: Path) -> str:
    """The name of a mission in our format; a plan of another format is converted into a folder first.

    Raises:
        InputError: it cannot be read, or not be expressed.
    """
    if Path(name).suffix in ("", ".yaml", ".yml"):
        return name
    _, text, _ = mission_text(name, speed_limit_m_s)
    folder.mkdir(parents=True, exist_ok=True)
    converted = folder / "mission.yaml"
    converted.write_text(text)
    return str(converted)
