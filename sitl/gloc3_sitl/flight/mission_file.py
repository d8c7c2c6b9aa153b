"""Mission files before a simulated flight: finding, converting and checking them."""

from pathlib import Path
from typing import Final, NamedTuple

from gloc3.documents.document import load_bytes, parse
from gloc3.errors import Finding, Gloc3Error, InputError, Refused
from gloc3.messages.frames import GeoPoint
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.checking.plan_check import check_plan, planned_home
from gloc3.mission.examples import find_mission
from gloc3.mission.formats import is_plan_file, load_plan, mission_text
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.model import GEO, Mission
from gloc3.platform.platform import Platform
from gloc3.terrain import Terrain
from gloc3_sitl.vehicles.table import vehicle_named

HOLD: Final = "hold"
"""The frame, and the world, of the paper's inspections."""
INDOORS: Final = "pelican"
"""The platform of a mission in a local frame that names none."""
OUTDOORS: Final = "pelican_rtk"
"""Default platform of missions on Earth."""
UNKNOWN_DURATION_S: Final = 600.0
"""Duration assumed for a mission that the checker cannot estimate, s."""


class FlyableMission(NamedTuple):
    """A mission that passed the check."""

    file: str
    """In our format."""
    mission: Mission
    duration_s: float
    """As the checker estimates it."""
    estimate: MissionEstimate | None
    warnings: list[Finding]
    home: GeoPoint | None = None
    """The planned home of a plan of another format; None where there is none."""


def find_file(name: str) -> Path:
    """Finds the file of a mission by its path or the name of an example.

    Raises:
        InputError: there is no example of that name.
        Refused: there is no such file.
    """
    path = find_mission(name)
    if not path.is_file():
        raise Refused(f"{path} is a folder, not a mission file" if path.is_dir() else f"there is no file {path}")
    return path


def platform_for(path: Path) -> str:
    """Returns the default platform of a mission."""
    if is_plan_file(path):
        return OUTDOORS
    try:
        written = parse(load_bytes(path), str(path)).value
    except InputError:  # it is told with everything else that is wrong
        return INDOORS
    if not isinstance(written, dict):
        return INDOORS
    named = written.get("platform")
    return named if isinstance(named, str) else OUTDOORS if written.get("frame") == GEO else INDOORS


class FlightSite(NamedTuple):
    """Place in which a flight is simulated."""

    world: str
    home: GeoPoint | None = None
    """None for where the world's file says."""
    heading_deg: float | None = None


def place_for(mission: Mission, platform: Platform, vehicle: str, home: GeoPoint | None = None) -> FlightSite:
    """Returns the world of a mission's frame.

    That is the vehicle's usual one, such as water with a floor: at the origin of a frame of the platform, and for missions
    on Earth at the planned home, or without one at the first place of the mission.

    Raises:
        Gloc3Error: a mission on Earth has no position.
    """
    row = platform.frames.get(mission.frame)
    if row is not None and mission.frame != HOLD:
        return FlightSite(vehicle_named(vehicle).world, GeoPoint(*row.origin.geo), row.x_axis_bearing_deg)
    if mission.frame != GEO:
        return FlightSite(HOLD)
    return FlightSite(vehicle_named(vehicle).world, home or home_of(mission))


def is_without_satellites(platform: Platform) -> bool:
    """Whether a platform's autopilot has no position source but the pose that the platform sends."""
    kinds = {kind.__name__ for row in platform.components for kind in row.load_class().__mro__}
    return "VisionPoseDriver" in kinds and "SatellitesSampler" not in kinds


def read_mission_file(
    path: Path, platform: Platform, folder: Path, terrain: Terrain | None = None, home: GeoPoint | None = None
) -> FlyableMission:
    """Reads and checks a mission; a plan of another format is converted into a folder first.

    Args:
        path: the file.
        platform: that flies it.
        folder: for what a plan is converted to.
        terrain: against which its heights are checked.
        home: of the plan that a mission in our format was once converted from; a plan says it itself.

    Raises:
        InputError: it cannot be read, not be expressed, or may not fly; with everything that is wrong.
    """
    if is_plan_file(path):
        home = planned_home(load_plan(path))
    circumstances = Circumstances(platform=platform, terrain=terrain)
    if home is not None:
        circumstances = Circumstances(
            platform=platform,
            origin=home,
            home_altitude_m=home.altitude_m,
            home_ned_m=(0.0, 0.0, 0.0),
            terrain=terrain,
        )
    if not is_plan_file(path):
        file, text, _ = mission_text(str(path), platform)
        return _flyable(file, check_text(text, file, circumstances), home)
    _, report, text = check_plan(path, circumstances)
    report.flyable()
    converted = folder / "mission-converted.yaml"
    converted.write_text(text, encoding="utf-8")
    return _flyable(str(converted), report, home)


def _flyable(file: str, report: CheckReport, home: GeoPoint | None) -> FlyableMission:
    mission = report.flyable()
    duration_s = report.estimate.duration_s if report.estimate is not None else UNKNOWN_DURATION_S
    return FlyableMission(file, mission, duration_s, report.estimate, list(report.findings), home)


def faces_down(platform: Platform, mission: Mission) -> bool:
    """Whether a downward camera is in use; its pictures double the cost of a flight."""
    if any(action.capability == "record_images" for action in mission.actions().values()):
        return True
    recorder = platform.capabilities.get("record_images")
    return any(
        "camera/ground" in row.topics(name) and (recorder is None or row.name != recorder.performed_by)
        for row in platform.components
        for name in row.load_class().inputs
    )


def recordable_cameras(platform: Platform) -> frozenset[str]:
    """Names of the cameras whose pictures can be recorded."""
    rows = (row for row in platform.capabilities.values() if row.arguments == "record_images")
    return frozenset(str(camera) for row in rows for camera in row.options.get("camera", ()))


DEFAULT_ALTITUDE_M = 488.0
"""Altitude of open ground when the mission does not say it, above mean sea level."""


def home_of(mission: Mission) -> GeoPoint:
    """Returns the first position of a mission in frame geo, on the ground.

    Raises:
        Gloc3Error: the mission has no position.
    """
    for action in mission.actions().values():
        if isinstance(action.order, FlyFileOrder) and (place := action.order.first_place) is not None:
            return place._replace(altitude_m=place.altitude_m or DEFAULT_ALTITUDE_M)
        for field in ("waypoints", "position", "at", "area", "wall", "to"):
            value = getattr(action.arguments, field, None)
            if value:
                latitude, longitude = (value[0] if isinstance(value[0], tuple) else value)[:2]
                return GeoPoint(latitude, longitude, DEFAULT_ALTITUDE_M)
    raise Gloc3Error(f"the mission {mission.name!r} has no position on Earth")
