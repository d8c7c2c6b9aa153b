"""Makes a plan of MAVLink items from a mission of GLOC3, as far as it is a chain in geographic positions."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from gloc3.errors import Finding, InputError
from gloc3.messages.frames import GeoPoint
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3.mission.formats.on_earth import geofence_on_earth
from gloc3.mission.model.arguments import (
    Arguments,
    Dive,
    DriveOff,
    FollowWaypoints,
    GoTo,
    Heading,
    Hold,
    Land,
    LookAt,
    ReturnHome,
    TakeOff,
    Wait,
)
from gloc3.mission.model.model import GEO, AreaFile, GeofenceFile, Mission, where_of
from gloc3.mission.model.patterns import Pattern
from gloc3.mission.model.payload import RecordImages
from gloc3.mission.model.placement import GeoPlacement, HeightAbove
from gloc3.mission.model.structure import PartialOrder
from gloc3.mission.model.waypoint_options import given_options, rest_s
from gloc3.platform.platform import FrameRow

_FRAMES: Final = {HeightAbove.SEA: 0, HeightAbove.HOME: 3, HeightAbove.GROUND: 10}
_EARTH: Final = GeoPoint(0.0, 0.0, 0.0)
_NO_PARAMS: Final = (0.0, 0.0, 0.0, None)


def from_mission(mission: Mission, file: str) -> tuple[ForeignPlan, list[Finding]]:
    """Converts a mission to a plan with the same path.

    Args:
        mission: the mission.
        file: name of the mission in findings.

    Returns:
        The plan, and warnings about parts that were left out.

    Raises:
        InputError: the mission is not in frame geo, or an action that moves the vehicle cannot be expressed.
    """
    return _Converter(mission, file).plan()


class _Converter:
    """Goes through the actions in the order in which they run."""

    def __init__(self, mission: Mission, file: str) -> None:
        self._mission, self._file = mission, file
        self._findings: list[Finding] = []
        self._items: list[MavItem] = []
        self._speed_m_s: float | None = None
        self._polls = False
        self._returned = False

    def plan(self) -> tuple[ForeignPlan, list[Finding]]:
        mission = self._mission
        if mission.frame != GEO:
            self._refuse(
                "",
                f"frame {mission.frame} has no place on Earth in a plan",
                "name the platform that declares it, or write the mission in frame geo",
            )
            raise InputError(self._findings)
        actions = mission.actions()
        for name, task in mission.tasks.items():
            if task.options.repeat is not None:
                self._refuse(name, f"{name} is repeated, which a plan cannot express", "write its actions out")
            if task.options.when is not None:
                self._refuse(name, f"{name} has a guard, which a plan cannot express", "remove when")
        for target in PartialOrder.of(mission).targets:
            if actions[target].options.when is not None:
                self._refuse(target, f"{target} has a guard, which a plan cannot express", "remove when")
            self._action(target, actions[target].filled)
        if mission.contingencies:
            hint = "the autopilot's own failsafes apply"
            self._note("", "a plan cannot hold the contingencies", hint, is_warning=True)
        fence = self._fence()
        if any(not finding.is_warning for finding in self._findings):
            raise InputError(sorted(self._findings))
        entries = tuple(PlanEntry(items=(item,)) for item in self._items)
        return ForeignPlan(entries=entries, fence=fence, home=self._home()), self._findings

    def _home(self) -> tuple[float, float, float] | None:
        """Home is not part of a mission: the first position that it flies to, at sea level."""
        return next(((item.x or 0.0, item.y or 0.0, 0.0) for item in self._items if item.has_position), None)

    def _note(self, target: str, message: str, hint: str, *, is_warning: bool) -> None:
        document = self._mission.document
        if document is None:
            finding = Finding(file=self._file, message=message, hint=hint, is_warning=is_warning)
        else:
            finding = document.finding(where_of(target), message, hint, at_key=True, is_warning=is_warning)
        self._findings.append(finding)

    def _refuse(self, target: str, message: str, hint: str) -> None:
        self._note(target, message, hint, is_warning=False)

    def _add(self, command: int, *params: float | None, at: tuple[float, ...] | None = None, frame: int = 2) -> None:
        p1, p2, p3, p4 = (*params, *_NO_PARAMS[len(params) :])
        x, y, z = at if at is not None else (0.0, 0.0, 0.0)
        self._items.append(MavItem(command=command, frame=frame, params=(p1, p2, p3, p4), x=x, y=y, z=z))

    def _action(self, target: str, arguments: Arguments) -> None:
        match arguments:
            case TakeOff():
                self._items.append(
                    MavItem(command=22, frame=3, params=_NO_PARAMS, x=None, y=None, z=arguments.height_m)
                )
            case DriveOff():
                pass  # an autopilot that is told to fly a plan sets off by itself
            case Dive():
                hint = "the plan descends on the way to its first waypoint"
                self._note(target, f"{target} is left out: plans have no dive", hint, is_warning=True)
                return
            case Pattern():
                self._action(target, arguments.path(GeoPlacement(_EARTH, self._mission.height_above)))
            case FollowWaypoints() | GoTo() if missing := [
                option.unkept for _, option in given_options(arguments) if not option.is_in_plans
            ]:
                self._refuse(target, f"{target} cannot be expressed in a plan", f"a plan {missing[0]}")
            case FollowWaypoints(waypoints=waypoints) if waypoints is not None:
                self._fly(target, waypoints, arguments.speed_m_s, arguments.heading, rest_s(arguments))
            case GoTo(position=position) if position is not None:
                self._fly(target, (position,), arguments.speed_m_s, arguments.heading, rest_s(arguments))
            case Hold(duration_s=duration_s) if duration_s is not None:
                self._add(93, duration_s, -1.0, -1.0, -1.0)
            case Wait(duration_s=duration_s):
                self._add(93, duration_s, -1.0, -1.0, -1.0)
            case ReturnHome():
                self._add(20)
                self._returned = True
                return
            case Land(at=at):
                if not self._returned:
                    self._add(21, at=(*at, 0.0) if at is not None else None, frame=3)
            case RecordImages():
                self._note(target, "record_images is left out", "add it in QGroundControl", is_warning=True)
                return
            case _:
                self._refuse(target, f"{target} cannot be expressed in a plan", "plans have no such command")
        if self._returned and not isinstance(arguments, Land):
            self._refuse(target, f"{target} comes after return_home, which ends a plan with a landing", "put it before")

    def _fly(
        self,
        target: str,
        waypoints: tuple[tuple[float, float, float], ...],
        speed_m_s: float | None,
        heading: Heading,
        rest_s: float,
    ) -> None:
        if speed_m_s is not None and speed_m_s != self._speed_m_s:
            self._add(178, 1.0, speed_m_s, -1.0, 0.0)
            self._speed_m_s = speed_m_s
        frame = _FRAMES[self._mission.height_above]
        yaw_deg: float | None = None
        views = isinstance(heading, LookAt)
        if isinstance(heading, LookAt):
            self._add(195, 0.0, 0.0, 0.0, 0.0, at=heading.look_at, frame=frame)
        elif self._polls:
            self._add(197)
        if heading == "hold":
            self._note(target, "heading: hold becomes along", "give it in degrees", is_warning=True)
        elif isinstance(heading, float | int):
            yaw_deg = float(heading)
        self._polls = views
        for waypoint in waypoints:
            self._add(16, rest_s, 0.0, 0.0, yaw_deg, at=waypoint, frame=frame)

    def _fence(self) -> tuple[FenceArea, ...]:
        geofence = self._mission.geofence
        if geofence is None:
            return ()
        if geofence.ceiling_m is not None:
            self._note("", "a plan cannot hold the fence's ceiling", "set it in the autopilot", is_warning=True)
        return fence_areas(geofence)


def fence_on_earth(mission: Mission, frames: Mapping[str, FrameRow]) -> tuple[FenceArea, ...]:
    """The areas of a mission's fence that an autopilot can keep too; none where its frame has no place on Earth.

    Args:
        mission: what was read.
        frames: the platform's local frames.
    """
    if mission.geofence is None:
        return ()
    if mission.frame == GEO:
        return fence_areas(mission.geofence)
    row = frames.get(mission.frame)
    return _placed_areas(mission.geofence, row) if row is not None else ()


@lru_cache(maxsize=16)
def _placed_areas(geofence: GeofenceFile, row: FrameRow) -> tuple[FenceArea, ...]:
    return fence_areas(geofence_on_earth(geofence, row.frame()))


def fence_areas(geofence: GeofenceFile) -> tuple[FenceArea, ...]:
    """The areas of a fence in frame geo, as they are uploaded to an autopilot (see `ForeignPlan.fence_items`)."""
    areas = [_area(geofence, is_inclusion=True), *(_area(one, is_inclusion=False) for one in geofence.keep_out)]
    return tuple(area for area in areas if area is not None)


def _area(area: AreaFile, *, is_inclusion: bool) -> FenceArea | None:
    if area.circle is not None:
        return FenceArea(is_inclusion=is_inclusion, center=area.circle.center, radius_m=area.circle.radius_m)
    if area.polygon is not None:
        return FenceArea(is_inclusion=is_inclusion, polygon=area.polygon)
    return None
