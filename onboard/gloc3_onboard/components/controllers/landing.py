"""CC: automatic landing (paper §VI), flown by the autopilot in its own mode."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import yaw_of
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S, POSE_LATE_S
from gloc3.messages.vehicle import AutopilotState, DriverState, Manoeuvre, ManoeuvreKind, ManoeuvreState, Pose, Setpoint
from gloc3.mission.model.arguments import LandOrder
from gloc3.mission.model.states import ActionState
from gloc3_onboard.algorithms.paths.path_follower import PathFollower
from gloc3_onboard.algorithms.paths.path_reference import PathReference

ACCEPTANCE_M: Final = 0.25
"""So near the vehicle comes to a landing place before it goes down."""

STILL_S: Final = 30.0
"""A vehicle in its landing that has stood still for so long stands on the ground, s, although it is still armed."""
STILL_M_S: Final = 0.3
"""Speed below which it stands still, in m/s: estimates drift."""


class LandingSettings(Settings, frozen=True):
    """Settings of the landing controller."""

    timeout_s: Annotated[float, Bounds(1.0, 3600.0)] = 180.0
    """The landing fails after this time."""
    speed_m_s: Annotated[float, Bounds(0.1, 20.0)] = 1.0
    """Speed on the way to a remote landing place, in m/s."""
    may_approach: bool = True
    """Whether the vehicle can be led to a remote landing place; false for wings, which land at home."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 10.0
    """Longest wait for the vehicle to come to the landing place."""
    repeat_s: Annotated[float, Bounds(0.2, 60.0)] = 2.0
    """Period at which the manoeuvre is requested again until the autopilot lands, in seconds."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class LandingController(ActionPerformer, Controller[LandingSettings]):
    """Flies to the landing place if one is given, requests the manoeuvre until it is flown, and waits for disarming."""

    performs: ClassVar = {"land": LandOrder}

    pose = Input(Pose)
    autopilot = Input(AutopilotState)
    driver = Input(DriverState)
    setpoint_wanted = Output(Setpoint, frame="ned")
    manoeuvre_wanted = Output(Manoeuvre)

    def __init__(self) -> None:
        self._pose: Pose | None = None
        self._reference: PathReference | None = None
        self._yaw_rad = 0.0
        self._since_s = 0.0
        self._requested_s = -math.inf
        self._stands_since_s: float | None = None
        """Since when it has stood still in the autopilot's landing; None where it moves, or its speed is not known."""

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: LandOrder, now_s: float) -> None:
        """Plans the path to the landing place, if one is given. Landing here works without a pose."""
        self._reference = self._stands_since_s = None
        self._since_s, self._requested_s = now_s, -math.inf
        if arguments.at_ned_m is None:
            return
        if not self.settings.may_approach:
            raise Refused("the autopilot chooses where this vehicle lands: land without a place")
        pose = self._pose
        if pose is None:
            raise Refused("there is no valid pose to fly to a landing place with")
        north, east, _ = arguments.at_ned_m
        place = (north, east, pose.position_ned_m[2])
        follower = PathFollower(pose.position_ned_m, [place], self.settings.speed_m_s, acceleration_m_s2=1.0)
        self._yaw_rad = yaw_of(pose.ned_from_frd)
        self._reference = PathReference(follower, now_s)

    def pause_action(self, now_s: float) -> None:
        """Stops the remaining time."""
        self._since_s -= now_s

    def resume_action(self, now_s: float) -> None:
        """Asks for the manoeuvre again."""
        self._since_s += now_s
        self._requested_s = -math.inf

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Flies to the place, then lands."""
        pose, driver, autopilot = inbox.latest(self.pose), inbox.latest(self.driver), inbox.latest(self.autopilot)
        is_fresh = inbox.is_fresh(self.pose, now_s, self.settings.pose_limit_s)
        self._pose = pose.payload if pose is not None and is_fresh and pose.payload.is_valid else None
        results: list[Result] = []
        if self.is_running:
            is_known = inbox.is_fresh(self.autopilot, now_s, AUTOPILOT_SILENT_S)
            state = autopilot.payload if autopilot is not None and is_known else None
            if state is not None and state.is_connected and not state.is_armed:
                self.advance(now_s, 1.0, ActionState.DONE)
            elif reason := self._problem(state, driver, now_s):
                self.advance(now_s, 0.0, ActionState.FAILED, reason)
            elif self._reference is not None:
                results += self._approach(self._reference, driver, now_s)
            else:
                results += self._descend(driver, now_s)
        return [*results, *self.action_reports(now_s)]

    def _problem(self, state: AutopilotState | None, driver: Envelope[DriverState] | None, now_s: float) -> str:
        """Why the landing does not end; empty while it may."""
        if self._pose is None or not self._is_flown(driver) or math.hypot(*self._pose.velocity_ned_m_s) > STILL_M_S:
            self._stands_since_s = None
        elif self._stands_since_s is None:
            self._stands_since_s = now_s
        seen = "not heard: the autopilot is silent"
        if state is not None and state.is_connected:
            landed = state.landed.replace("_", " ")
            seen = f"armed in mode {mode_words(state.mode_name) or state.mode}, and the autopilot reports {landed}"
        if self._stands_since_s is not None and now_s - self._stands_since_s >= STILL_S:
            undetected = ": it does not detect that it has landed; if it stands on the ground, disarm it"
            return f"it has stood still for {STILL_S:g} s, but is {seen}{undetected}"
        if now_s - self._since_s > self.settings.timeout_s:
            return f"not landed after {self.settings.timeout_s:g} s: it is {seen}"
        return ""

    def _is_flown(self, driver: Envelope[DriverState] | None) -> bool:
        """Whether the autopilot flies this landing."""
        if driver is None or driver.payload.manoeuvre_id != self.action_id:
            return False
        return driver.payload.manoeuvre_state is ManoeuvreState.RUNNING

    def _approach(self, reference: PathReference, driver: Envelope[DriverState] | None, now_s: float) -> list[Result]:
        if self._pose is None:
            return []
        action_id = self.action_id
        target = reference.advance(self._pose, driver, now_s)
        problem = reference.problem(self.settings.settle_s)
        if problem:
            self.advance(now_s, 0.0, ActionState.FAILED, f"the landing place is not reached: {problem}")
            return []
        if reference.is_there(ACCEPTANCE_M):
            self._reference = None
        self.advance(now_s, 0.3 * reference.follower.progress)
        setpoint = Setpoint(
            action_id=action_id,
            position_ned_m=target.position_ned_m,
            velocity_ned_m_s=target.velocity_ned_m_s,
            yaw_rad=self._yaw_rad,
        )
        return [setpoint]

    def _descend(self, driver: Envelope[DriverState] | None, now_s: float) -> list[Result]:
        """Requests a refused, lost or interrupted landing again: there is no better alternative."""
        is_ours = driver is not None and driver.payload.manoeuvre_id == self.action_id
        is_flown = self._is_flown(driver)
        if is_flown:
            self.advance(now_s, 0.5)
        elif driver is not None and is_ours and driver.payload.manoeuvre_state is ManoeuvreState.FAILED:
            self.advance(now_s, 0.3, reason=driver.payload.manoeuvre_reason)
        if is_flown or now_s - self._requested_s < self.settings.repeat_s:
            return []
        self._requested_s = now_s
        return [Manoeuvre(action_id=self.action_id, kind=ManoeuvreKind.LAND)]
