"""CC: automatic take-off (paper §VI), flown by the autopilot in its own mode."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

from gloc3.action import ActionPerformer
from gloc3.component import Controller
from gloc3.errors import Refused
from gloc3.messages import Envelope
from gloc3.mission.arguments import TakeOff
from gloc3.mission.states import ActionState
from gloc3.ports import Inbox, Input, Output, Result
from gloc3.settings import Bounds, Settings
from gloc3.vehicle import (
    AutopilotState,
    DriverState,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    Pose,
)


class TakeOffSettings(Settings, frozen=True):
    """Settings of the take-off controller."""

    arm: bool = False
    """Whether it may arm the vehicle; the platform file's `arm` sets it."""
    tolerance_m: Annotated[float, Bounds(0.02, 5.0)] = 0.15
    """The take-off is done within this distance of the height asked for."""
    settled_m_s: Annotated[float, Bounds(0.02, 5.0)] = 0.3
    """… and when it climbs no faster than this."""
    timeout_s: Annotated[float, Bounds(1.0, 600.0)] = 60.0
    """The take-off fails after this time."""


class TakeOffController(ActionPerformer, Controller[TakeOffSettings]):
    """Asks for the manoeuvre and watches the height."""

    settings_type = TakeOffSettings
    performs: ClassVar = {"take_off": TakeOff}
    loggable = ("height_m",)

    pose = Input(Pose)
    autopilot = Input(AutopilotState)
    driver = Input(DriverState)
    manoeuvre_wanted = Output(Manoeuvre)

    def __init__(self) -> None:
        self.height_m = math.nan
        self._settings = TakeOffSettings()
        self._autopilot: AutopilotState | None = None
        self._pose: Pose | None = None
        self._target_m = 0.0
        self._ground_down_m = 0.0
        self._since_s = 0.0
        self._is_asked = False

    def initialize(self, settings: TakeOffSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: TakeOff, now_s: float) -> None:
        """Notes the ground and the height to reach."""
        if self._pose is None or not self._pose.is_valid:
            raise Refused("there is no valid pose")
        if self._autopilot is None or not self._autopilot.is_connected:
            raise Refused("the autopilot does not answer")
        if self._autopilot.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING):
            raise Refused("the vehicle is in the air already")
        if not self._autopilot.is_armed and not self._settings.arm:
            raise Refused("the vehicle is not armed, and the platform file does not allow arming")
        if not self._autopilot.is_armed and not self._autopilot.is_armable:
            raise Refused(
                "the autopilot would not arm: " + ("; ".join(self._autopilot.reasons) or "it gives no reason")
            )
        self._ground_down_m = self._pose.position_ned_m[2]
        self._target_m = arguments.height_m
        self._since_s = now_s
        self._is_asked = False

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Asks once, then watches."""
        if (autopilot := inbox.latest(self.autopilot)) is not None:
            self._autopilot = autopilot.payload
        if (pose := inbox.latest(self.pose)) is not None:
            self._pose = pose.payload
            self.height_m = self._ground_down_m - pose.payload.position_ned_m[2]
        results: list[Result] = []
        if self.is_running:
            if not self._is_asked:
                self._is_asked = True
                results.append(
                    Manoeuvre(
                        action_id=self.action_id,
                        kind=ManoeuvreKind.TAKE_OFF,
                        height_m=self._target_m,
                        may_arm=self._settings.arm,
                    )
                )
            else:
                self._watch(now_s, inbox.latest(self.driver))
        return [*results, *self.action_reports(now_s)]

    def _watch(self, now_s: float, driver: Envelope[DriverState] | None) -> None:
        assert self._pose is not None
        is_ours = driver is not None and driver.payload.manoeuvre_id == self.action_id
        if driver is not None and is_ours and driver.payload.manoeuvre_state is ManoeuvreState.FAILED:
            self.advance(now_s, 0.0, ActionState.FAILED, driver.payload.manoeuvre_reason)
            return
        is_there = abs(self.height_m - self._target_m) <= self._settings.tolerance_m
        is_settled = abs(self._pose.velocity_ned_m_s[2]) <= self._settings.settled_m_s
        if is_there and is_settled:
            self.advance(now_s, 1.0, ActionState.DONE)
        elif now_s - self._since_s > self._settings.timeout_s:
            reason = f"after {self._settings.timeout_s:g} s it is at {self.height_m:.1f} m of {self._target_m:.1f} m"
            self.advance(now_s, 0.0, ActionState.FAILED, reason)
        else:
            self.advance(now_s, self.height_m / self._target_m)
