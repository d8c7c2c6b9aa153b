"""CC: automatic landing (paper §VI), flown by the autopilot in its own mode."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

from gloc3.action import ActionPerformer
from gloc3.component import Controller
from gloc3.errors import Refused
from gloc3.frames import yaw_of
from gloc3.mission.arguments import LandOrder
from gloc3.mission.states import ActionState
from gloc3.ports import Inbox, Input, Output, Result
from gloc3.settings import Bounds, Settings
from gloc3.vehicle import AutopilotState, DriverState, Manoeuvre, ManoeuvreKind, ManoeuvreState, Pose, Setpoint
from gloc3_onboard.path_follower import PathFollower


class LandingSettings(Settings, frozen=True):
    """Settings of the landing controller."""

    timeout_s: Annotated[float, Bounds(1.0, 3600.0)] = 180.0
    """The landing fails after this time."""
    speed_m_s: Annotated[float, Bounds(0.1, 20.0)] = 1.0
    """Speed of the way to a landing place that is elsewhere."""
    repeat_s: Annotated[float, Bounds(0.2, 60.0)] = 2.0
    """The manoeuvre is asked for again after this time while the autopilot has not begun it."""


class LandingController(ActionPerformer, Controller[LandingSettings]):
    """Flies to the place if one is given, asks for the manoeuvre, and watches until the vehicle is disarmed."""

    settings_type = LandingSettings
    performs: ClassVar = {"land": LandOrder}

    pose = Input(Pose)
    autopilot = Input(AutopilotState)
    driver = Input(DriverState)
    setpoint_wanted = Output(Setpoint, frame="ned")
    manoeuvre_wanted = Output(Manoeuvre)

    def __init__(self) -> None:
        self._settings = LandingSettings()
        self._pose: Pose | None = None
        self._follower: PathFollower | None = None
        self._place_ned_m: tuple[float, float, float] | None = None
        self._yaw_rad = 0.0
        self._since_s = 0.0
        self._last_s = 0.0
        self._asked_s = -math.inf

    def initialize(self, settings: LandingSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: LandOrder, now_s: float) -> None:
        """Lays the way to the place, if one is given. Landing here works without a pose."""
        self._follower = self._place_ned_m = None
        self._since_s = self._last_s = now_s
        self._asked_s = -math.inf
        if arguments.at_ned_m is None:
            return
        if self._pose is None or not self._pose.is_valid:
            raise Refused("there is no valid pose to fly to a landing place with")
        north, east, _ = arguments.at_ned_m
        self._place_ned_m = (north, east, self._pose.position_ned_m[2])
        self._yaw_rad = yaw_of(self._pose.ned_from_frd)
        self._follower = PathFollower(
            self._pose.position_ned_m, [self._place_ned_m], self._settings.speed_m_s, acceleration_m_s2=1.0
        )

    def resume_action(self, now_s: float) -> None:
        """Asks for the manoeuvre again."""
        self._asked_s = -math.inf
        self._last_s = now_s

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Flies to the place, then lands."""
        pose, autopilot, driver = inbox.latest(self.pose), inbox.latest(self.autopilot), inbox.latest(self.driver)
        self._pose = pose.payload if pose is not None else None
        results: list[Result] = []
        if self.is_running:
            if self._follower is not None and self._place_ned_m is not None:
                results += self._approach(self._follower, self._place_ned_m, now_s)
            else:
                results += self._descend(
                    now_s, autopilot.payload if autopilot else None, driver.payload if driver else None
                )
            self._last_s = now_s
        return [*results, *self.action_reports(now_s)]

    def _approach(self, follower: PathFollower, place: tuple[float, float, float], now_s: float) -> list[Result]:
        if self._pose is None or not self._pose.is_valid:
            return []
        target = follower.advance(now_s - self._last_s, self._pose.position_ned_m)
        if follower.is_at_end and math.dist(self._pose.position_ned_m, place) < 0.3:
            self._follower = None
        self.advance(now_s, 0.3 * follower.travelled_m / max(follower.length_m, 0.1))
        return [
            Setpoint(
                action_id=self.action_id,
                position_ned_m=target.position_ned_m,
                velocity_ned_m_s=target.velocity_ned_m_s,
                yaw_rad=self._yaw_rad,
            )
        ]

    def _descend(self, now_s: float, autopilot: AutopilotState | None, driver: DriverState | None) -> list[Result]:
        action_id = self.action_id
        is_ours = driver is not None and driver.manoeuvre_id == action_id
        if driver is not None and is_ours and driver.manoeuvre_state is ManoeuvreState.FAILED:
            self.advance(now_s, 0.0, ActionState.FAILED, driver.manoeuvre_reason)
        elif autopilot is not None and autopilot.is_connected and not autopilot.is_armed:
            self.advance(now_s, 1.0, ActionState.DONE)
        elif now_s - self._since_s > self._settings.timeout_s:
            self.advance(now_s, 0.0, ActionState.FAILED, f"not landed after {self._settings.timeout_s:g} s")
        elif not is_ours and now_s - self._asked_s >= self._settings.repeat_s:
            self._asked_s = now_s
            return [Manoeuvre(action_id=action_id, kind=ManoeuvreKind.LAND)]
        return []
