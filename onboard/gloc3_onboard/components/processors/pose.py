"""DP: the platform's pose, from the autopilot's own estimate, in the NED frame of the platform's local frame."""

import math
from collections.abc import Sequence
from typing import Annotated, Final

import msgspec

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import IDENTITY, GeoPoint, TangentPlane, Vector3
from gloc3.messages.vehicle import AutopilotPose, Pose

_NOWHERE: Final = Pose(
    position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=IDENTITY, sources=["autopilot"]
)


class PoseSettings(Settings, frozen=True):
    """Settings of the pose processor."""

    origin_geo: tuple[float, float, float] | None = None
    """Origin of the local frame: latitude and longitude in degrees, altitude above mean sea level in metres. None, or
    a place farther than `reach_m` away, takes the origin of the autopilot's estimator."""
    reach_m: Annotated[float, Bounds(1.0, 100_000.0)] = 5_000.0
    """Farthest distance at which a local frame is used."""
    jump_m: Annotated[float, Bounds(0.05, 100.0)] = 0.5
    """A step of the position that its velocity does not explain by more than this is a jump."""
    std_m: Annotated[float, Bounds(0.001, 100.0)] = 0.05
    """Standard deviation that is claimed along each axis."""
    is_level: bool = False
    """Takes the height for 0 at all times: for vehicles that stay on the ground or on the water, whose estimate of it
    drifts, and whose way does not depend on it."""


class PoseProcessor(DataProcessor[PoseSettings]):
    """Moves the autopilot's estimate into the platform's frame and counts its jumps."""

    loggable = ("reset_counter", "reason")

    autopilot_pose = Input(AutopilotPose)
    pose = Output(Pose, frame="ned")

    def __init__(self) -> None:
        self.reset_counter = 0
        self.reason = ""
        self._plane: TangentPlane | None = None
        self._offset_of: tuple[float, float, float] | None = None
        self._offset_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._origin_geo: tuple[float, float, float] | None = None
        self._last: Pose | None = None
        self._shown = _NOWHERE
        self._last_s = 0.0

    def initialize(self, settings: PoseSettings) -> None:
        """Adopts the origin."""
        self.settings = settings
        self._plane = TangentPlane(GeoPoint(*settings.origin_geo)) if settings.origin_geo else None
        self._offset_of = None

    def start(self) -> None:
        """Begins without a past."""
        self._last = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One pose for each of the autopilot's."""
        return [
            self.pose.report(self._place(envelope.payload, envelope.t_s), t_s=envelope.t_s)
            for envelope in inbox.new(self.autopilot_pose)
        ]

    def _place(self, given: AutopilotPose, t_s: float) -> Pose:
        self.reason = ""
        if not all(
            map(
                math.isfinite,
                (*given.position_ned_m, *given.velocity_ned_m_s, *given.ned_from_frd, *given.rate_frd_rad_s),
            )
        ):
            return self._lost("the autopilot's estimate is not finite")
        if self._plane is not None:
            if given.origin_geo is None:
                self.reason = "the autopilot has not sent its origin"
            elif given.origin_geo != self._offset_of:
                self._move_to(given.origin_geo, self._plane)
        n, e, d = given.position_ned_m
        offset = self._offset_ned_m
        north_m_s, east_m_s, down_m_s = given.velocity_ned_m_s
        is_level = self.settings.is_level
        position = (n + offset[0], e + offset[1], 0.0 if is_level else d + offset[2])
        velocity = (north_m_s, east_m_s, 0.0 if is_level else down_m_s)
        self._count_jump(position, velocity, t_s)
        pose = Pose(
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            ned_from_frd=given.ned_from_frd,
            rate_frd_rad_s=given.rate_frd_rad_s,
            position_std_m=(self.settings.std_m,) * 3,
            is_valid=not self.reason,
            reason=self.reason,
            quality=0.0 if self.reason else 1.0,
            reset_counter=self.reset_counter,
            sources=["autopilot"],
            origin_geo=self._origin_geo or given.origin_geo,
        )
        self._last, self._last_s = pose, t_s
        return pose

    def _lost(self, reason: str) -> Pose:
        """The last pose again, which is not valid; what comes after it is compared with nothing."""
        self.reason = reason
        if self._last is not None:
            self._shown, self._last = self._last, None
            self.reset_counter += 1
        return msgspec.structs.replace(
            self._shown, is_valid=False, reason=reason, quality=0.0, reset_counter=self.reset_counter
        )

    def _move_to(self, autopilot_origin: tuple[float, float, float], plane: TangentPlane) -> None:
        self._offset_of = autopilot_origin
        offset = plane.ned_from_geo(*autopilot_origin)
        is_near = math.hypot(offset[0], offset[1]) <= self.settings.reach_m
        self._offset_ned_m = offset if is_near else (0.0, 0.0, 0.0)
        self._origin_geo = self.settings.origin_geo if is_near else autopilot_origin

    def _count_jump(self, position: Vector3, velocity: Vector3, t_s: float) -> None:
        if self._last is None:
            return
        duration_s = t_s - self._last_s
        step = [
            now - before - 0.5 * (v_now + v_before) * duration_s
            for now, before, v_now, v_before in zip(
                position, self._last.position_ned_m, velocity, self._last.velocity_ned_m_s, strict=True
            )
        ]
        if sum(component * component for component in step) > self.settings.jump_m**2:
            self.reset_counter += 1
