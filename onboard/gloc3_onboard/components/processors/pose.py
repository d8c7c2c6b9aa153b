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


DOUBT_S: Final = 60.0
"""Time in which a displacement that the velocity did not explain is forgotten."""


WORTHLESS_M: Final = 10.0
"""A position in as much doubt has no quality left."""


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
    """Standard deviation that is claimed along each axis, while the position moves as its velocity says."""
    is_level: bool = False
    """Whether the height is always 0: for vehicles on the ground or on the water, whose height estimate drifts and does
    not matter for the path."""


class PoseProcessor(DataProcessor[PoseSettings]):
    """Moves the autopilot's estimate into the platform's frame and counts its jumps.

    The position has a second opinion in the velocity: what that does not explain, a jump or a drift, is claimed as standard
    deviation until it is taken back or forgotten, because nothing tells which of the two is right.
    """

    loggable = ("reset_counter", "reason", "doubt_m")

    autopilot_pose = Input(AutopilotPose)
    pose = Output(Pose, frame="ned")

    def __init__(self) -> None:
        self.reset_counter = 0
        self.reason = ""
        self.doubt_m = 0.0
        """Horizontal displacement of late that the velocity does not explain."""
        self._plane: TangentPlane | None = None
        self._offset_of: tuple[float, float, float] | None = None
        self._offset_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._origin_geo: tuple[float, float, float] | None = None
        self._last: Pose | None = None
        self._shown = _NOWHERE
        self._last_s = 0.0
        self._drift_ned_m: Vector3 = (0.0, 0.0, 0.0)
        """Sum of the displacements that the velocity does not explain, older ones fading."""
        self._jump_m = 0.0
        """Largest of them in one step, fading."""

    def initialize(self, settings: PoseSettings) -> None:
        """Adopts the origin."""
        self.settings = settings
        self._plane = TangentPlane(GeoPoint(*settings.origin_geo)) if settings.origin_geo else None
        self._offset_of = None

    def start(self) -> None:
        """Begins without a past."""
        self._last = None
        self._drift_ned_m, self._jump_m = (0.0, 0.0, 0.0), 0.0

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
        std_m = self._std_m()
        pose = Pose(
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            ned_from_frd=given.ned_from_frd,
            rate_frd_rad_s=given.rate_frd_rad_s,
            position_std_m=std_m,
            is_valid=not self.reason,
            reason=self.reason,
            quality=0.0 if self.reason else self._quality(),
            reset_counter=self.reset_counter,
            sources=["autopilot"],
            origin_geo=self._origin_geo or given.origin_geo,
        )
        self._last, self._last_s = pose, t_s
        return pose

    def _lost(self, reason: str) -> Pose:
        """The last pose, marked invalid; the next one is compared with none."""
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
        size_m = math.hypot(*step)
        kept = math.exp(-max(duration_s, 0.0) / DOUBT_S)
        n, e, d = (kept * drift + now for drift, now in zip(self._drift_ned_m, step, strict=True))
        self._drift_ned_m, self._jump_m = (n, e, d), kept * self._jump_m
        if size_m > self.settings.jump_m:
            self.reset_counter += 1
            self._jump_m = max(self._jump_m, size_m)

    def _quality(self) -> float:
        return 1.0 if self.doubt_m <= self.settings.jump_m else max(0.05, 1.0 - self.doubt_m / WORTHLESS_M)

    def _std_m(self) -> Vector3:
        """What is claimed: no less than what is in doubt. A jump that was taken back still shows how much may be wrong."""
        north, east, down = self._drift_ned_m
        self.doubt_m = max(math.hypot(north, east), self._jump_m)
        level_m = math.hypot(self.settings.std_m, self.doubt_m / math.sqrt(2.0))
        return level_m, level_m, math.hypot(self.settings.std_m, down)
