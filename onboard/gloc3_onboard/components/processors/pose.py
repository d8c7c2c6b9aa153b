"""DP: the platform's pose, from the autopilot's own estimate, in the NED frame of the platform's local frame."""

import math
from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple

import msgspec

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import IDENTITY, GeoPoint, TangentPlane, Vector3
from gloc3.messages.perception import SatelliteFix
from gloc3.messages.vehicle import AutopilotPose, AutopilotState, LandedState, Pose

_NOWHERE: Final = Pose(
    position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=IDENTITY, sources=["autopilot"]
)


DOUBT_S: Final = 60.0
"""Time in which a displacement that the velocity did not explain is forgotten."""
COMPARED_S: Final = 1.0
"""Positions farther apart than this in time, as after a crash, are not compared: the velocity has changed in between."""


WORTHLESS_M: Final = 10.0
"""A position in as much doubt has no quality left."""


_OFF_THE_GROUND: Final = (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)
AT_REST_M_S: Final = 0.2
"""Slower, a vehicle that takes off or lands stands on the ground: no autopilot climbs or sinks so slowly. So does one that
drives or floats, which counts as off the ground as long as it is armed."""
FROZEN_FIXES: Final = 3
"""So many fixes of new times with all digits the same are no measurements: noise alone changes them."""
FROZEN_PLACES: Final = 10
"""So many with the same position alone: digits of a centimetre may repeat by chance at rest, for less long."""
FROZEN_M_S2: Final = 0.4
"""An autopilot that follows a frozen receiver, or has no height, drifts with up to this acceleration, m/s²: 0.16 were
seen."""
APART_SIGMA: Final = 4.0
ANTENNA_M: Final = 0.3
"""Distance of an antenna from the vehicle's origin, m, as far as nobody has measured it."""
FIX_LATE_S: Final = 0.3
"""Error of the time of a fix, s."""
FIX_EXPIRES_S: Final = 3.0
"""Age after which a fix says nothing about the present, s."""


class _Apart(NamedTuple):
    contradicts_m: float
    """The distance, where it is more than explains itself; else 0."""
    std_m: float
    """The least standard deviation with which both can be right; twice that as far as lateness does not explain it."""


def _apart(distance_m: float, std_m: float, speed_m_s: float) -> _Apart:
    late_m = FIX_LATE_S * speed_m_s
    allowed_m = APART_SIGMA * std_m + ANTENNA_M + late_m
    claimed_m = max(distance_m, 2.0 * (distance_m - late_m)) / APART_SIGMA
    return _Apart(distance_m if distance_m > allowed_m else 0.0, claimed_m)


class ReceiverDoubt(NamedTuple):
    """How far an estimate may be off by the satellite receiver."""

    level_m: float
    """Horizontally, where the receiver contradicts or is frozen; else 0."""
    level_std_m: float
    """The least standard deviation of the horizontal distance with which both can be right."""
    height_m: float
    """The least standard deviation of the height."""


NO_DOUBT: Final = ReceiverDoubt(0.0, 0.0, 0.0)


class ReceiverCheck:
    """Second opinion on an autopilot's position, from the satellite receiver itself.

    The autopilot's estimate is made of the receiver's fixes, among others: it is no better than the receiver claims, it
    may reject fixes that are right, and follows a receiver that repeats its last fix: then it is not valid, and is claimed
    to be off the more, the longer that lasts. After a silence of the autopilot in flight it may be repeating itself
    already: until its second position it is not believed either.
    """

    def __init__(self) -> None:
        self._fix: SatelliteFix | None = None
        self._fix_s = self._changed_s = -math.inf
        self._same = 0
        """How many fixes have repeated the last position."""
        self._alike = 0
        """How many have repeated all that the last one reports."""
        self.is_awaited = False
        """Whether its second position after a silence of the autopilot in flight has not come."""
        self._speeds_m_s = (0.0, 0.0)
        """Of the estimate, level and vertical, before the receiver froze."""

    def silence(self) -> None:
        """The autopilot was silent, and with it the receiver."""
        self.is_awaited, self._fix = self.is_awaited or self._fix is not None, None

    def receive(self, fix: SatelliteFix, t_s: float, *, is_in_flight: bool, may_fly: bool) -> None:
        """Handles a fix, valid or not; at rest on the ground receivers may hold their position.

        A vehicle that sinks or climbs slowly may seem to rest in between: that takes back no repetition in flight.

        Args:
            fix: the fix.
            t_s: its time.
            is_in_flight: whether it is certain that the vehicle is off the ground.
            may_fly: whether it may be.
        """
        is_same = self._fix is not None and fix.place_geo == self._fix.place_geo and fix.is_valid
        self.is_awaited = self.is_awaited and may_fly and (is_same or self._fix is None)
        if is_same and (is_in_flight or self.is_frozen):
            self._same += 1
            self._alike = self._alike + 1 if fix == self._fix else 0
        elif not is_same:
            self._changed_s, self._same, self._alike = t_s, 0, 0
        elif not self._same:
            self._changed_s = t_s
        self._fix, self._fix_s = fix, t_s

    def std_m(self, t_s: float) -> float:
        """What the receiver claims, m; 0 without a recent fix."""
        fix = self._recent(t_s)
        return 0.0 if fix is None else fix.std_m

    @property
    def is_frozen(self) -> bool:
        """Whether the receiver repeats itself, or may do so."""
        return self.is_awaited or self._alike >= FROZEN_FIXES - 1 or self._same >= FROZEN_PLACES - 1

    def frozen_s(self, t_s: float) -> float:
        """Since when the position has not changed, s."""
        return max(t_s - self._changed_s, 0.0)

    def doubt(
        self, position_ned_m: Vector3, velocity_ned_m_s: Vector3, t_s: float, plane: TangentPlane
    ) -> ReceiverDoubt:
        """How far the estimate may be off: by a frozen receiver, or as far as both are apart."""
        fix = self._recent(t_s)
        if fix is None:
            return NO_DOUBT
        age_s, place = t_s - self._fix_s, plane.ned_from_geo(*fix.place_geo)
        north, east, down = (
            own - speed * age_s - other
            for own, speed, other in zip(position_ned_m, velocity_ned_m_s, place, strict=True)
        )
        level_m_s, upright_m_s = math.hypot(*velocity_ned_m_s[:2]), abs(velocity_ned_m_s[2])
        level = _apart(math.hypot(north, east), fix.std_m, level_m_s)
        height = _apart(abs(down), fix.height_std_m, upright_m_s)
        if not self.is_frozen:
            self._speeds_m_s = level_m_s, upright_m_s
            return ReceiverDoubt(level.contradicts_m, level.std_m, max(height.contradicts_m, height.std_m))
        frozen_s = self.frozen_s(t_s)
        drift_m = 0.5 * FROZEN_M_S2 * frozen_s**2
        level_m, upright_m = (speed * frozen_s + drift_m for speed in self._speeds_m_s)
        return ReceiverDoubt(
            max(level_m, level.contradicts_m), level.std_m, max(upright_m, height.contradicts_m, height.std_m)
        )

    def _recent(self, t_s: float) -> SatelliteFix | None:
        fix = self._fix
        return fix if fix is not None and fix.is_valid and t_s - self._fix_s <= FIX_EXPIRES_S else None


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
    """Least standard deviation that is claimed along each axis, while the position moves as its velocity says; where the
    satellite receiver claims a larger one, that is claimed."""
    lost_m: Annotated[float, Bounds(0.5, 1000.0)] = WORTHLESS_M
    """A position that the satellite receiver contradicts by as much is invalid."""
    is_level: bool = False
    """Whether the height is always 0: for vehicles on the ground or on the water, whose height estimate drifts and does
    not matter for the path."""


class PoseProcessor(DataProcessor[PoseSettings]):
    """Moves the autopilot's estimate into the platform's frame and counts its jumps.

    The position has a second opinion in the velocity: what that does not explain, a jump or a drift, is claimed as standard
    deviation until it is taken back or forgotten, because nothing tells which of the two is right. Where there is a
    sampler of the satellite receiver, that is a third: see `ReceiverCheck`.
    """

    loggable = ("reset_counter", "reason", "doubt_m")

    autopilot_pose = Input(AutopilotPose)
    satellites = Input(SatelliteFix, Keep.ALL, is_optional=True)
    autopilot = Input(AutopilotState)
    pose = Output(Pose, frame="ned")

    def __init__(self) -> None:
        self.reset_counter = 0
        self.reason = ""
        self.doubt_m = 0.0
        """Horizontal displacement of late that the velocity does not explain, or that the receiver contradicts."""
        self._receiver = ReceiverCheck()
        self._contradiction = NO_DOUBT
        """How far the receiver contradicts."""
        self._has_risen = False
        """Whether it has moved in the take-off that is under way: it is not at rest then, however slowly it climbs."""
        self._height_s = math.inf
        """When anything has measured the height."""
        self._on_earth: tuple[tuple[float, float, float], TangentPlane] | None = None
        """The autopilot's origin."""
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

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """One pose for each of the autopilot's."""
        state = inbox.latest(self.autopilot)
        landed = LandedState.UNKNOWN if state is None else state.payload.landed
        is_in_flight = self._is_off_the_ground(landed)
        may_fly = is_in_flight or (landed in _OFF_THE_GROUND and not self.settings.is_level)
        given = inbox.new(self.autopilot_pose)
        if may_fly and given and self._last is not None and given[0].t_s - self._last_s > FIX_EXPIRES_S:
            self._receiver.silence()
        for fix in inbox.new(self.satellites):
            self._receiver.receive(fix.payload, fix.t_s, is_in_flight=is_in_flight, may_fly=may_fly)
        return [self.pose.report(self._place(envelope.payload, envelope.t_s), t_s=envelope.t_s) for envelope in given]

    def _is_off_the_ground(self, landed: LandedState) -> bool:
        """Whether the vehicle is in motion, or hovers: an autopilot reports for seconds after the touchdown that it lands."""
        if landed is LandedState.IN_AIR and not self.settings.is_level:
            return True
        is_moving = self._last is not None and math.hypot(*self._last.velocity_ned_m_s) > AT_REST_M_S
        has_risen = landed is LandedState.TAKING_OFF and self._has_risen
        self._has_risen = has_risen or (is_moving and landed is LandedState.TAKING_OFF)
        return has_risen or (is_moving and landed in _OFF_THE_GROUND)

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
        self._contradiction = self._contradicted(given, t_s)
        self._height_s = t_s if given.has_height else min(self._height_s, t_s)
        std_m = self._std_m(t_s)
        if not self.reason and (self._receiver.is_frozen or self._contradiction.level_m >= self.settings.lost_m):
            self.reason = self._why_lost(t_s)
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
        duration_s, last = t_s - self._last_s, self._last
        step = [0.0, 0.0, 0.0]
        if last is not None and duration_s <= COMPARED_S:
            step = [
                now - before - 0.5 * (v_now + v_before) * duration_s
                for now, before, v_now, v_before in zip(
                    position, last.position_ned_m, velocity, last.velocity_ned_m_s, strict=True
                )
            ]
        size_m = math.hypot(*step)
        kept = math.exp(-max(duration_s, 0.0) / DOUBT_S)
        n, e, d = (kept * drift + now for drift, now in zip(self._drift_ned_m, step, strict=True))
        self._drift_ned_m, self._jump_m = (n, e, d), kept * self._jump_m
        if size_m > self.settings.jump_m:
            self.reset_counter += 1
            self._jump_m = max(self._jump_m, size_m)

    def _contradicted(self, given: AutopilotPose, t_s: float) -> ReceiverDoubt:
        if given.origin_geo is None:
            return NO_DOUBT
        if self._on_earth is None or self._on_earth[0] != given.origin_geo:
            self._on_earth = given.origin_geo, TangentPlane(GeoPoint(*given.origin_geo))
        return self._receiver.doubt(given.position_ned_m, given.velocity_ned_m_s, t_s, self._on_earth[1])

    def _why_lost(self, t_s: float) -> str:
        if self._receiver.is_awaited:
            return "the autopilot was silent: the satellite receiver's second position is awaited"
        if self._receiver.is_frozen:
            return f"the satellite receiver has been repeating one position for {self._receiver.frozen_s(t_s):.0f} s"
        return f"the autopilot's position is {self._contradiction.level_m:.0f} m from its satellite receiver's"

    def _quality(self) -> float:
        return 1.0 if self.doubt_m <= self.settings.jump_m else max(0.05, 1.0 - self.doubt_m / WORTHLESS_M)

    def _std_m(self, t_s: float) -> Vector3:
        """What is claimed: no less than what is in doubt. A jump that was taken back still shows how much may be wrong."""
        north, east, down = self._drift_ned_m
        receiver = self._contradiction
        self.doubt_m = max(math.hypot(north, east), self._jump_m, receiver.level_m)
        own_m = max(self.settings.std_m, self._receiver.std_m(t_s))
        level_m = math.hypot(own_m, max(self.doubt_m, receiver.level_std_m) / math.sqrt(2.0))
        unseen_m = 0.5 * FROZEN_M_S2 * (t_s - self._height_s) ** 2
        height_m = 0.0 if self.settings.is_level else max(receiver.height_m, unseen_m)
        return level_m, level_m, math.hypot(self.settings.std_m, down, height_m)
