"""Base of drivers that have the autopilot fly paths by itself: plans uploaded, read back, started and followed."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from gloc3.component.action import ActionPerformer
from gloc3.component.ports import Actuation, Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S
from gloc3.messages.vehicle import (
    AutopilotPose,
    AutopilotState,
    DriverState,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    Pose,
)
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.states import ActionState
from gloc3.mission.model.waypoint_options import IN_PLANS, refuse_unkept
from gloc3_onboard.algorithms.paths.path_follower import next_ahead
from gloc3_onboard.components.drivers.file_flight import (
    FileControl,
    FileFlight,
    FileTimes,
    SendFile,
    refuse_unready,
)
from gloc3_onboard.sensors.devices import GeoPath

PROGRESS_M = 1.0
"""So far from a leg a vehicle that its autopilot leads may be."""
PAIRED_S = 0.2
"""Largest time difference of two estimates that relate their frames, s."""


class PlanSettings(Settings, frozen=True):
    """Settings of the driver for plans."""

    upload_s: Annotated[float, Bounds(1.0, 600.0)] = 30.0
    """Longest upload with its reading back, before the action fails."""
    repeat_s: Annotated[float, Bounds(0.2, 60.0)] = 2.0
    """Period at which the autopilot is commanded again to fly the plan, in seconds."""
    start_s: Annotated[float, Bounds(1.0, 120.0)] = 10.0
    """Longest wait for the autopilot to fly the plan, before the action fails."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 5.0
    """Time at the last position after which the path counts as flown without the autopilot's report, in seconds."""


S = TypeVar("S", bound=PlanSettings)


class PlanControl(FileControl, Protocol):
    """Interface for giving an autopilot a plan. Nothing blocks."""

    def command_plan(self, path: GeoPath) -> int:
        """Uploads a path as a plan and reads it back."""

    @property
    def places_reached(self) -> int:
        """Number of positions of the latest path that the autopilot has passed."""


class SendPlan(NamedTuple):
    """Write: upload the plan of a path."""

    path: GeoPath


class PlanFlier(ActionPerformer, Generic[S]):
    """Mix-in of drivers that fly plans; the autopilot continues one with or without this computer.

    Each start, also after a pause or a restart in flight, uploads the rest of the path, so that the autopilot's plan
    always equals the request.
    """

    keeps: ClassVar[frozenset[str]] = IN_PLANS
    """Waypoint options that it supports; missions with others are refused."""

    pose = Input(Pose)
    autopilot_pose = Input(AutopilotPose)
    driver = Input(DriverState)
    autopilot = Input(AutopilotState)
    manoeuvre_wanted = Output(Manoeuvre)

    def __init__(self, device: PlanControl) -> None:
        self.uploads = self.waypoint = 0
        self._control = device
        self.settings: S
        self._order: FollowWaypointsOrder | None = None
        self._autopilot: AutopilotState | None = None
        self._file: FileFlight | None = None
        """Another program's plan that is flown as it is."""
        self._pose: Pose | None = None
        self._passed = 0
        """Waypoints passed before the upload of the rest."""
        self._ticket: int | None = None
        self._is_sent = self._is_held = False
        self._since_s = 0.0
        self._requested_s = -math.inf
        self._near_since_s: float | None = None

    def stop(self) -> None:
        """Forgets the action."""
        self._file = None
        self.drop_action()

    def begin_file(self, order: FlyFileOrder, now_s: float) -> None:
        """Takes up another program's plan at the item where an earlier attempt was.

        Raises:
            Refused: it cannot begin where the vehicle is.
        """
        done = round(self.earlier_progress * order.last_item)
        if not done:
            refuse_unready(order, self._autopilot)
        times = FileTimes(self.settings.upload_s, self.settings.repeat_s, self.settings.start_s)
        self._file = FileFlight(self._control, order, done, now_s, times)
        self.waypoint = done

    def begin_action(self, capability: str, arguments: FollowWaypointsOrder | FlyFileOrder, now_s: float) -> None:
        """Takes up the waypoints that no earlier attempt has passed."""
        self._file = None
        if isinstance(arguments, FlyFileOrder):
            self.begin_file(arguments, now_s)
            return
        count = len(arguments.waypoints_ned_m)
        if not count:
            raise Refused("there is no waypoint")
        refuse_unkept(arguments, self.keeps, "a plan")
        self._order = arguments
        self.waypoint = min(int(self.earlier_progress * count + 1e-6), count - 1)
        if self.waypoint and not arguments.rest_s and self._pose is not None:  # it has flown on meanwhile
            within_m = max(arguments.acceptance_m, PROGRESS_M)
            places = arguments.waypoints_ned_m
            self.waypoint = next_ahead(self._pose.position_ned_m, places, self.waypoint, within_m)
        self._restart(now_s)

    def resume_action(self, now_s: float) -> None:
        """Uploads the rest of the path."""
        if self._file is not None:
            self._file.restart(now_s)
        else:
            self._restart(now_s)

    def path(self, order: FollowWaypointsOrder, places: tuple[GeoPoint, ...]) -> GeoPath:
        """What the autopilot is to fly, through the places of an order that are left."""
        heading = order.heading
        heading_deg = math.degrees(heading.heading_rad) if heading.mode == "fixed" else None
        return GeoPath(places, order.speed_m_s, order.acceptance_m, order.rest_s, heading_deg)

    def manoeuvre(self, order: FollowWaypointsOrder) -> Manoeuvre:
        """The manoeuvre requested from the autopilot driver once the plan is uploaded."""
        return Manoeuvre(action_id=self.action_id, kind=ManoeuvreKind.PLAN, end_ned_m=order.waypoints_ned_m[-1])

    def _restart(self, now_s: float) -> None:
        self._passed, self._ticket, self._is_sent, self._is_held = self.waypoint, None, False, False
        self._since_s, self._requested_s, self._near_since_s = now_s, -math.inf, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Uploads, starts, and follows the plan."""
        results: list[Result] = []
        latest = inbox.latest(self.pose)
        self._pose = latest.payload if latest is not None and latest.payload.is_valid else None
        self._autopilot = self._known_autopilot(inbox, now_s)
        if self.is_running and self._file is not None:
            results += self._fly_file(self._file, inbox, now_s)
        elif self.is_running and self._order is not None:
            driver = inbox.latest(self.driver)
            if not self._is_held:
                results += self._upload(self._order, inbox, now_s)
            else:
                results += self._fly(self._order, driver.payload if driver is not None else None, now_s)
        return [*results, *self.action_reports(now_s)]

    def _known_autopilot(self, inbox: Inbox, now_s: float) -> AutopilotState | None:
        latest = inbox.latest(self.autopilot)
        is_known = inbox.is_fresh(self.autopilot, now_s, AUTOPILOT_SILENT_S)
        return latest.payload if latest is not None and is_known else None

    def _fly_file(self, file: FileFlight, inbox: Inbox, now_s: float) -> list[Result]:
        """One cycle of another program's plan."""
        driver = inbox.latest(self.driver)
        outcome = file.update(self.action_id, self._autopilot, driver.payload if driver is not None else None, now_s)
        self.waypoint = outcome.achieved
        if outcome.failure:
            self.advance(now_s, outcome.progress, ActionState.FAILED, outcome.failure)
        elif outcome.is_done:
            self.advance(now_s, 1.0, ActionState.DONE, achieved=outcome.achieved)
        else:
            self.advance(now_s, outcome.progress, reason=outcome.reason, achieved=outcome.achieved)
        wanted = [outcome.manoeuvre] if outcome.manoeuvre is not None else []
        return [*wanted, *([Actuation(outcome.upload)] if outcome.upload is not None else [])]

    # --- the upload ---

    def _upload(self, order: FollowWaypointsOrder, inbox: Inbox, now_s: float) -> list[Result]:
        answer = self._control.answer(self._ticket) if self._ticket is not None else None
        if answer is not None and answer.is_accepted:
            self._is_held, self._since_s = True, now_s
        elif answer is not None:
            self._fail(answer.reason, now_s)
        elif now_s - self._since_s > self.settings.upload_s:
            self._fail(f"the plan was not accepted within {self.settings.upload_s:g} s", now_s)
        elif not self._is_sent:
            places = self._places(order, inbox.latest(self.pose), inbox.latest(self.autopilot_pose))
            if places is None:
                self._report(now_s, "the position of the autopilot's frame on Earth is not known yet")
                return []
            self._is_sent = True
            self._report(now_s)
            return [Actuation(SendPlan(self.path(order, places)))]
        return []

    def _places(
        self, order: FollowWaypointsOrder, ours: Envelope[Pose] | None, theirs: Envelope[AutopilotPose] | None
    ) -> tuple[GeoPoint, ...] | None:
        """The rest of the path, in the autopilot's estimate of it."""
        if ours is None or theirs is None or not ours.payload.is_valid or abs(ours.t_s - theirs.t_s) > PAIRED_S:
            return None
        if theirs.payload.origin_geo is None:
            return None
        plane = TangentPlane(GeoPoint(*theirs.payload.origin_geo))
        gap_s, pose, own = theirs.t_s - ours.t_s, ours.payload, theirs.payload.position_ned_m
        north, east, down = (
            own[axis] - pose.position_ned_m[axis] - gap_s * pose.velocity_ned_m_s[axis] for axis in range(3)
        )
        left: Sequence[Vector3] = order.waypoints_ned_m[self._passed :]
        places = []
        for n, e, d in left:
            place = plane.geo_from_ned((n + north, e + east, d + down))
            places.append(place._replace(altitude_m=plane.origin.altitude_m - d - down))
        return tuple(places)

    # --- the flight ---

    def _fly(self, order: FollowWaypointsOrder, driver: DriverState | None, now_s: float) -> list[Result]:
        count = len(order.waypoints_ned_m)
        self.waypoint = max(self.waypoint, min(self._passed + self._control.places_reached, count))
        is_ours = driver is not None and driver.manoeuvre_id == self.action_id
        state = driver.manoeuvre_state if driver is not None and is_ours and self._requested_s > -math.inf else None
        if state is ManoeuvreState.DONE and self.waypoint >= count - 1:
            self.waypoint = count
        if self.waypoint >= count or self._rests_at_the_end(order, now_s):
            self.advance(now_s, 1.0, ActionState.DONE, achieved=count)
            return []
        self._report(now_s)
        if state is ManoeuvreState.RUNNING:
            self._since_s = now_s
            return []
        if state is ManoeuvreState.DONE:
            self._fail(f"the autopilot ended its plan after waypoint {self.waypoint} of {count}", now_s)
            return []
        if now_s - self._since_s > self.settings.start_s:
            why = driver.manoeuvre_reason if driver is not None and is_ours else ""
            self._fail(f"the autopilot does not fly the plan{': ' + why if why else ''}", now_s)
            return []
        if now_s - self._requested_s < self.settings.repeat_s:
            return []
        self._requested_s = now_s
        return [self.manoeuvre(order)]

    def _rests_at_the_end(self, order: FollowWaypointsOrder, now_s: float) -> bool:
        """Whether it has been at the last position so long that the autopilot's report must be lost."""
        last, pose = order.waypoints_ned_m[-1], self._pose
        is_last = self.waypoint >= len(order.waypoints_ned_m) - 1
        if pose is None or not is_last or math.dist(pose.position_ned_m, last) > order.acceptance_m:
            self._near_since_s = None
        elif self._near_since_s is None:
            self._near_since_s = now_s
        return self._near_since_s is not None and now_s - self._near_since_s > order.rest_s + self.settings.settle_s

    def _report(self, now_s: float, reason: str = "") -> None:
        assert self._order is not None
        progress = self.waypoint / len(self._order.waypoints_ned_m)
        self.advance(now_s, progress, reason=reason, achieved=self.waypoint)

    def _fail(self, reason: str, now_s: float) -> None:
        assert self._order is not None
        progress = self.waypoint / len(self._order.waypoints_ned_m)
        self.advance(now_s, progress, ActionState.FAILED, reason)

    def actuate(self, write: Any) -> None:
        """Begins an upload."""
        if isinstance(write, SendFile):
            if self._file is not None:
                self._file.ticket = self._control.command_file(write.order, continue_at=write.continue_at)
        else:
            self._ticket = self._control.command_plan(write.path)
        self.uploads += 1

    def make_safe(self) -> None:
        """Does nothing: a plan that is not started moves nothing, and the autopilot driver stops one in flight."""
