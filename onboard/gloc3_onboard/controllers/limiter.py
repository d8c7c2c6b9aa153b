"""CC: the limiter between the controllers and the driver: one owner of motion, inside the limits and the fence."""

from collections.abc import Sequence
from typing import Annotated

from gloc3.component import Controller
from gloc3.ports import Inbox, Input, Keep, Output, Result
from gloc3.settings import Bounds, Settings
from gloc3.vehicle import Manoeuvre, ManoeuvreKind, MotionGrant, MotionLimits, Pose, Setpoint
from gloc3_onboard.motion_limits import SetpointLimiter, is_finite


class LimiterSettings(Settings, frozen=True):
    """Settings of the limiter."""

    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.15
    """Without a pose younger than this nothing passes: the fence could not be kept."""


class Limiter(Controller[LimiterSettings]):
    """Passes the owner's setpoints and manoeuvres on, within the limits; drops everybody else's."""

    settings_type = LimiterSettings
    loggable = ("clamped", "foreign", "reason")

    setpoint_wanted = Input(Setpoint, Keep.ALL)
    manoeuvre_wanted = Input(Manoeuvre, Keep.ALL)
    grant = Input(MotionGrant)
    limits = Input(MotionLimits)
    pose = Input(Pose)
    setpoint = Output(Setpoint, frame="ned")
    manoeuvre = Output(Manoeuvre)

    def __init__(self) -> None:
        self.clamped = 0
        self.foreign = 0
        self.reason = ""
        self._settings = LimiterSettings()
        self._limiter: SetpointLimiter | None = None
        self._owner = ""

    def initialize(self, settings: LimiterSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def start(self) -> None:
        """Waits for the limits."""
        self._limiter, self._owner = None, ""

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Limits what the owner of motion wants."""
        for limits in inbox.new(self.limits):
            if self._limiter is None:
                self._limiter = SetpointLimiter(limits.payload)
            self._limiter.limits = limits.payload
        grant = inbox.latest(self.grant)
        owner = grant.payload.action_id if grant is not None else ""
        results: list[Result] = [
            self._limit_manoeuvre(manoeuvre.payload)
            for manoeuvre in inbox.new(self.manoeuvre_wanted)
            if self._is_owner(manoeuvre.payload.action_id, owner)
        ]
        wanted = None
        for envelope in inbox.new(self.setpoint_wanted):
            if self._is_owner(envelope.payload.action_id, owner):
                wanted = envelope
        if wanted is None or self._limiter is None or not is_finite(wanted.payload):
            return results
        pose = inbox.latest(self.pose)
        if pose is None or not pose.payload.is_valid or now_s - pose.t_s > self._settings.pose_limit_s:
            self.reason = "no valid pose to keep the fence with"
            return results
        if owner != self._owner:
            self._owner = owner
            self._limiter.restart(pose.payload.position_ned_m, pose.payload.velocity_ned_m_s, now_s)
        limited = self._limiter.limit(wanted.payload, now_s)
        self.clamped += limited.is_clamped
        self.reason = limited.reason
        return [*results, self.setpoint.report(limited.setpoint, t_s=wanted.t_s)]

    def _is_owner(self, action_id: str, owner: str) -> bool:
        if action_id == owner and owner:
            return True
        self.foreign += 1
        return False

    def _limit_manoeuvre(self, manoeuvre: Manoeuvre) -> Manoeuvre:
        if manoeuvre.kind is not ManoeuvreKind.TAKE_OFF or self._limiter is None:
            return manoeuvre
        highest_m = self._limiter.limits.height_max_m
        if manoeuvre.height_m <= highest_m:
            return manoeuvre
        self.clamped += 1
        return Manoeuvre(
            action_id=manoeuvre.action_id, kind=manoeuvre.kind, height_m=highest_m, may_arm=manoeuvre.may_arm
        )
