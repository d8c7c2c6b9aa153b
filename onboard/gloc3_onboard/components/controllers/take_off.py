"""CC: automatic take-off (paper §VI), and its counterparts: driving off, and diving.

The autopilot arms, climbs in its own mode if it has one, and then changes to following setpoints.
"""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, yaw_of
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S, POSE_LATE_S, POSE_LOST_S
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    Pose,
    Setpoint,
)
from gloc3.mission.model.arguments import Dive, DriveOff, SetOff, TakeOff
from gloc3.mission.model.states import ActionState

REPORT_S: Final = 0.5
"""Time after a request within which the driver's report may concern the previous manoeuvre, s."""
IN_AIR: Final = (LandedState.IN_AIR, LandedState.TAKING_OFF)


class TakeOffSettings(Settings, frozen=True):
    """Settings of the take-off controller."""

    arm: bool = False
    """Whether it may arm the vehicle; the platform file's `arm` sets it."""
    tolerance_m: Annotated[float, Bounds(0.02, 5.0)] = 0.15
    """Height error within which the take-off is done, in metres."""
    settled_m_s: Annotated[float, Bounds(0.02, 5.0)] = 0.3
    """… when it climbs no faster than this …"""
    timeout_s: Annotated[float, Bounds(1.0, 600.0)] = 60.0
    """The take-off fails after this time."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class TakeOffController(ActionPerformer, Controller[TakeOffSettings]):
    """Requests the manoeuvre, monitors the height, and ends with the vehicle following our setpoints.

    The next action thus finds an autopilot that follows. A take-off paused in the air continues with setpoints.
    """

    performs: ClassVar = {"take_off": TakeOff, "drive_off": DriveOff, "dive": Dive}
    loggable = ("height_m",)

    pose = Input(Pose)
    autopilot = Input(AutopilotState)
    driver = Input(DriverState)
    manoeuvre_wanted = Output(Manoeuvre)
    setpoint_wanted = Output(Setpoint, frame="ned")

    def __init__(self) -> None:
        self.height_m = math.nan
        self._autopilot: AutopilotState | None = None
        self._pose: Pose | None = None
        self._begin_pose: Pose | None = None
        """Latest valid pose, late or not, but not lost: on the ground the vehicle stands."""
        self._kind = ManoeuvreKind.TAKE_OFF
        self._target_m = 0.0
        """Height to reach above the place where it stood; negative for a dive."""
        self._ground_down_m = 0.0
        self._since_s = 0.0
        self._requested_s: float | None = None
        self._has_flown = False
        self._top: tuple[Vector3, float] | None = None
        """Where the vehicle is kept at the end: position and heading."""

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: SetOff, now_s: float) -> None:
        """Notes the ground and the height to reach, or the depth."""
        autopilot, pose = self._autopilot, self._begin_pose
        if pose is None:
            raise Refused("there is no valid pose")
        if autopilot is None:
            raise Refused("no state is received from the autopilot")
        if not autopilot.is_connected:
            raise Refused("the autopilot does not answer")
        if autopilot.landed in (*IN_AIR, LandedState.LANDING):
            at = "in the air" if isinstance(arguments, TakeOff) else "under way"
            raise Refused(f"the vehicle is {at} already")
        if not autopilot.is_armed and not self.settings.arm:
            raise Refused("the vehicle is not armed, and the platform file does not allow arming")
        if not autopilot.is_armed and not autopilot.is_armable:
            raise Refused("the autopilot would not arm: " + _why(autopilot))
        self._ground_down_m = pose.position_ned_m[2]
        match arguments:
            case TakeOff(height_m=height_m):
                self._kind, self._target_m = ManoeuvreKind.TAKE_OFF, height_m
            case Dive(depth_m=depth_m):
                self._kind, self._target_m = ManoeuvreKind.SET_OFF, -depth_m
            case _:
                self._kind, self._target_m = ManoeuvreKind.SET_OFF, 0.0
        self._since_s = now_s
        self._requested_s, self._top, self._has_flown = None, None, False

    def pause_action(self, now_s: float) -> None:
        """Stops the remaining time."""
        self._since_s -= now_s

    def resume_action(self, now_s: float) -> None:
        """Requests the manoeuvre again, or climbs on from the present height."""
        self._since_s += now_s
        self._requested_s, self._top = None, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Asks once, watches, and takes over at the top."""
        autopilot = inbox.latest(self.autopilot)
        is_known = inbox.is_fresh(self.autopilot, now_s, AUTOPILOT_SILENT_S)
        self._autopilot = autopilot.payload if autopilot is not None and is_known else None
        pose = inbox.latest(self.pose)
        is_fresh = inbox.is_fresh(self.pose, now_s, self.settings.pose_limit_s)
        is_waited_for = inbox.is_fresh(self.pose, now_s, POSE_LOST_S)
        self._begin_pose = pose.payload if pose is not None and is_waited_for and pose.payload.is_valid else None
        self._pose = self._begin_pose if is_fresh else None
        if self._pose is not None:
            self.height_m = self._ground_down_m - self._pose.position_ned_m[2]
        results = self._fly(now_s, inbox.latest(self.driver)) if self.is_running else []
        return [*results, *self.action_reports(now_s)]

    def _fly(self, now_s: float, driver: Envelope[DriverState] | None) -> list[Result]:
        if self._is_forgotten(driver):
            self._requested_s = None
        state, reason = self._manoeuvre(driver)
        autopilot = self._autopilot
        is_up = autopilot is not None and autopilot.is_armed and autopilot.landed in IN_AIR
        was_up, self._has_flown = self._has_flown, self._has_flown or is_up
        if was_up and autopilot is not None and not autopilot.is_armed:
            return self._fail(now_s, "the vehicle was disarmed")
        if now_s - self._since_s > self.settings.timeout_s:
            at = f"after {self.settings.timeout_s:g} s it is at {self.height_m:.1f} m of {self._target_m:.1f} m"
            return self._fail(now_s, at + (f": {driver.payload.refusal}" if driver and driver.payload.refusal else ""))
        may_lead = state is not ManoeuvreState.RUNNING or (self._kind is ManoeuvreKind.TAKE_OFF and self._is_there)
        if is_up and (self._top or may_lead):
            return self._hang(now_s, driver)
        if state is ManoeuvreState.FAILED:
            return self._fail(now_s, reason)
        self.advance(now_s, self._progress)
        if self._requested_s is not None or self._pose is None:
            return []  # asked for already, or the pose is late: it stands until the next comes
        self._requested_s = now_s
        height_m, may_arm = max(self._target_m, 0.0), self.settings.arm
        return [Manoeuvre(action_id=self.action_id, kind=self._kind, height_m=height_m, may_arm=may_arm)]

    @property
    def _progress(self) -> float:
        return min(max(self.height_m / self._target_m, 0.0), 1.0) if self._target_m else 0.5

    def _is_forgotten(self, driver: Envelope[DriverState] | None) -> bool:
        """Whether the driver, which has failed and works again, knows nothing of the manoeuvre that it was asked for."""
        if self._requested_s is None or driver is None or driver.t_s < self._requested_s + REPORT_S:
            return False
        known = driver.payload
        return known.action_id == self.action_id and known.manoeuvre_id != self.action_id

    def _manoeuvre(self, driver: Envelope[DriverState] | None) -> tuple[ManoeuvreState | None, str]:
        """State of the manoeuvre; running until the driver can have received the request."""
        if self._requested_s is None:
            return None, ""
        if driver is None or driver.payload.manoeuvre_id != self.action_id or driver.t_s < self._requested_s + REPORT_S:
            return ManoeuvreState.RUNNING, ""
        return driver.payload.manoeuvre_state, driver.payload.manoeuvre_reason

    @property
    def _is_there(self) -> bool:
        if self._pose is None:
            return False
        is_slow = abs(self._pose.velocity_ned_m_s[2]) <= self.settings.settled_m_s
        return is_slow and abs(self.height_m - self._target_m) <= self.settings.tolerance_m

    def _hang(self, now_s: float, driver: Envelope[DriverState] | None) -> list[Result]:
        """In the air, and the autopilot's climb is over: ours now, straight up to the height and no farther."""
        action_id, pose = self.action_id, self._pose
        if pose is None:
            return []
        if self._top is None:
            north, east, _ = pose.position_ned_m
            self._top = (north, east, self._ground_down_m - self._target_m), yaw_of(pose.ned_from_frd)
        is_guided = driver is not None and driver.payload.is_guided and driver.payload.action_id == action_id
        is_done = is_guided and self._is_there
        self.advance(now_s, self._progress, ActionState.DONE if is_done else ActionState.RUNNING)
        position, yaw_rad = self._top
        return [Setpoint(action_id=action_id, position_ned_m=position, yaw_rad=yaw_rad)]

    def _fail(self, now_s: float, reason: str) -> list[Result]:
        self.advance(now_s, 0.0, ActionState.FAILED, reason)
        return []


def _why(autopilot: AutopilotState) -> str:
    """Why the vehicle does not arm: the autopilot's reasons, then its sensors and estimator."""
    return "; ".join([*autopilot.reasons, *autopilot.doubts]) or "it gives no reason"
