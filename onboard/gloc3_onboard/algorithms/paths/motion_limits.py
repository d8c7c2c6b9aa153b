"""Keeps setpoints inside the limits of the platform and the fence of the mission (DESIGN §7).

The output is a moving point: within the platform's speed and acceleration, and always able to stop inside the fence and
the height limits. A wanted position that meets all of this passes unchanged; any other is moved inside and approached.
The rule for the fence: the straight braking path from the point's present state keeps the margin (or, from outside,
does not lead farther out). Braking preserves this, so a permitted motion always exists, whatever the shape of the
fence.
"""

import math
from typing import Final, NamedTuple

from gloc3.amounts import beside
from gloc3.errors import Misuse
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import MotionLimits, Setpoint
from gloc3.mission.model.fence import Fence
from gloc3_onboard.algorithms.mapping.obstacle_field import SLACK_M, Detour, ObstacleField

TOLERANCE_M: Final = 1e-6
ROUNDING_M: Final = 1e-9
"""So little that it does not add up while the point slides along a fence."""
GAP_S: Final = 0.5
"""Gap between setpoints after which the stream restarts at the vehicle's position, s."""
LONGEST_STEP_S: Final = 0.1
"""Longest time step of the point between setpoints, s."""
APPROACH_SHARE: Final = 0.7
"""Part of the acceleration that braking is planned with; the rest is for turning."""
OUT_M: Final = 1e-3
"""So much nearer to the fence than the margin is outside, and more than a rounding."""
SEEN_M: Final = 0.02
"""A difference that is worth counting."""
REACTION_S: Final = 0.4
"""Delay of the vehicle behind the point, s; the vehicle, not only the point, keeps to the fence."""
GENTLE_M_S2: Final = 0.8
"""Braking before an obstacle is planned with no more than this, which the vehicle can follow without overshooting."""
EASING_HZ: Final = 1.5
"""Rate at which a fast point loses speed when its limit drops at once; a slow one brakes gently. Otherwise the vehicle
would overshoot, and return just when it can no longer be told to stay."""
AMONG_M_S: Final = 0.6
AMONG_HZ: Final = 0.7
"""Where an obstacle is as near as it may be the point is no faster than the first; with each metre more by the second."""
AHEAD_S: Final = 0.4
"""Time ahead for which the vehicle's predicted position is kept clear of obstacles, too, s."""
FENCE_AHEAD: Final = "an obstacle blocks the path"
_AT_REST: Final = (0.0, 0.0, 0.0)


def careful_speed_m_s(quality: float, full_quality: float, hold_quality: float, careful_m_s: float) -> float:
    """Speed limit for a pose quality: infinite from `full_quality` on, zero at `hold_quality`.

    Args:
        quality: of the pose, 0 to 1.
        full_quality: quality from which there is no limit.
        hold_quality: quality up to which the vehicle holds.
        careful_m_s: speed just below `full_quality`; below that it decreases in proportion.
    """
    if quality >= full_quality:
        return math.inf
    return careful_m_s * max(quality - hold_quality, 0.0) / (full_quality - hold_quality)


class Limited(NamedTuple):
    """A setpoint inside the limits."""

    setpoint: Setpoint
    is_clamped: bool
    reason: str


class SetpointLimiter:
    """Limits a stream of setpoints; call `set_vehicle` with the vehicle's pose before each."""

    def __init__(self, limits: MotionLimits) -> None:
        self._at: Vector3 | None = None
        self._velocity: Vector3 = _AT_REST
        self._target: Vector3 | None = None
        self._last_s = -math.inf
        self._vehicle_ned_m: Vector3 = _AT_REST
        self._ahead_ned_m: Vector3 = _AT_REST
        self._among_m_s = math.inf
        self._seen_s = -math.inf
        self._resets: int | None = None
        self.obstacles: ObstacleField | None = None
        """Obstacles around the vehicle; may be replaced at any time. None without a scanner."""
        self._flees = False
        self._detour = Detour()
        self.careful_m_s = math.inf
        """No faster than that for now, in any direction."""
        self._eased_m_s = math.inf
        """As it is slowing down to that."""
        self.highest_m = math.inf
        """Greatest height above the origin of NED; infinite while nothing limits it."""
        self.limits = limits

    @property
    def limits(self) -> MotionLimits:
        """The limits in force; may be replaced at any time without interrupting the stream."""
        return self._limits

    @limits.setter
    def limits(self, limits: MotionLimits) -> None:
        self._limits = limits
        fence = limits.fence
        self._flat = None if fence is None else Fence(area=fence.area, keep_out=fence.keep_out)
        home = limits.home_ned_m
        home_m = 0.0 if home is None else -home[2]
        self._lowest_m = -math.inf if home is None else home_m + limits.height_min_m
        self.highest_m = math.inf if home is None else home_m + limits.height_max_m
        if fence is not None and fence.ceiling_m is not None:
            self.highest_m = min(self.highest_m, fence.ceiling_m - limits.fence_margin_m)
        self._lowest_m = min(self._lowest_m, self.highest_m)
        self._room: tuple[Vector3 | None, float] = (None, math.inf)

    def restart(self, position_ned_m: Vector3, velocity_ned_m_s: Vector3, now_s: float) -> None:
        """Starts a new stream at a place."""
        self._at = self._vehicle_ned_m = self._ahead_ned_m = position_ned_m
        self._velocity = velocity_ned_m_s
        self._target = None
        self._last_s = now_s

    def set_vehicle(self, position_ned_m: Vector3, velocity_ned_m_s: Vector3, now_s: float, resets: int = 0) -> None:
        """Sets position and velocity of the vehicle.

        A stream that has paused restarts there. When the estimate has jumped, the point jumps with it, so that the
        vehicle is not affected.

        Args:
            position_ned_m: the estimate's position.
            velocity_ned_m_s: the estimate's velocity.
            now_s: time of validity.
            resets: number of jumps of the estimate.
        """
        if self._at is None or now_s - self._last_s > GAP_S:
            self.restart(position_ned_m, velocity_ned_m_s, now_s)
        elif self._resets not in (None, resets):
            expected = _plus(self._vehicle_ned_m, velocity_ned_m_s, now_s - self._seen_s)
            self._at = _plus(self._at, _minus(position_ned_m, expected), 1.0)
        self._vehicle_ned_m, self._seen_s, self._resets = position_ned_m, now_s, resets
        self._ahead_ned_m = _plus(position_ned_m, velocity_ned_m_s, AHEAD_S)

    def limit(self, wanted: Setpoint, now_s: float) -> Limited:
        """The nearest setpoint that keeps all limits.

        Raises:
            Misuse: the vehicle's position has not been set.
        """
        if self._at is None:
            raise Misuse("the limiter has no pose of the vehicle")
        duration_s = min(max(now_s - self._last_s, 0.0), LONGEST_STEP_S)
        self._last_s = max(now_s, self._last_s)
        self._among_m_s, self._flees = math.inf, False
        self._ease(duration_s)
        if wanted.position_ned_m is None:
            return self._limit_velocity(wanted, duration_s)
        target, reason = self._inside(wanted.position_ned_m)
        target, reason = self._clear_of_obstacles(target, reason)
        feed_forward = wanted.velocity_ned_m_s
        self._approach(target, self._motion_of(target, feed_forward, duration_s), duration_s)
        if not reason and math.dist(self._at, target) > SEEN_M:
            is_blocked = self._is_blocked(target)
            reason = (
                FENCE_AHEAD if is_blocked else "it asks for more than the platform may do, or the fence blocks the path"
            )
        if reason or (feed_forward is not None and not self._agree(feed_forward, self._velocity)):
            feed_forward = self._velocity
        return Limited(_with(wanted, self._at, feed_forward), bool(reason), reason)

    def _limit_velocity(self, wanted: Setpoint, duration_s: float) -> Limited:
        """Without a position the point is the vehicle itself."""
        requested = wanted.velocity_ned_m_s or _AT_REST
        self._at, self._target = self._vehicle_ned_m, None
        north, east, down = self._slowed(requested)
        if duration_s > 0.0:
            braking, height_m = APPROACH_SHARE * self._limits.acceleration_m_s2, -self._at[2]
            climb_m_s = _speed_to_stop(max(0.0, self.highest_m - height_m), braking, duration_s)
            descent_m_s = _speed_to_stop(max(0.0, height_m - self._lowest_m), braking, duration_s)
            down = min(max(down, -climb_m_s), descent_m_s)
        self._velocity = self._next((north, east, down), duration_s)
        is_clamped = math.dist(self._velocity, requested) > SEEN_M
        reason = "it asks for more than the platform may do, or the fence blocks the path" if is_clamped else ""
        return Limited(_with(wanted, None, self._velocity), is_clamped, reason)

    # --- the place that is aimed at ---

    def _inside(self, position: Vector3) -> tuple[Vector3, str]:
        """The nearest permitted position, and the reason if the wanted one is not permitted."""
        assert self._at is not None
        room_m, margin_m = self._room_m(), self._limits.fence_margin_m
        is_out = room_m < margin_m - OUT_M
        north, east, down = self._at if is_out else position
        height_m = min(max(-down, self._lowest_m), self.highest_m)
        reason = "it is too near to the fence, or outside, and goes straight back in" if is_out else ""
        if not is_out and abs(height_m + down) > TOLERANCE_M:
            height = beside(-down, height_m, 2)
            reason = f"height {height} m is outside {self._lowest_m:.2f} to {self.highest_m:.2f} m"
        target = (north, east, -height_m)
        if self._flat is None or room_m - math.dist(self._at, target) >= margin_m:
            return target, reason
        if self._flat.clearance_m(target) >= margin_m - ROUNDING_M:
            return target, reason
        if not is_out:
            reason = f"({north:.2f}, {east:.2f}) m is nearer to the fence than {margin_m:g} m"
        return self._pushed_in(self._flat, target), reason

    def _room_m(self) -> float:
        """How far inside the fence the point is."""
        assert self._at is not None
        if self._room[0] is not self._at:
            self._room = (self._at, math.inf if self._flat is None else self._flat.clearance_m(self._at))
        return self._room[1]

    def _pushed_in(self, fence: Fence, place: Vector3) -> Vector3:
        """Moves a position away from the fence's margin; keeps the point's own position where that fails."""
        assert self._at is not None
        margin_m, small_m = self._limits.fence_margin_m, 1e-3
        north, east, down = place
        for _ in range(12):
            missing_m = margin_m - fence.clearance_m((north, east, down))
            if missing_m <= ROUNDING_M:
                return (north, east, down)
            slope_n = fence.clearance_m((north + small_m, east, down)) - fence.clearance_m(
                (north - small_m, east, down)
            )
            slope_e = fence.clearance_m((north, east + small_m, down)) - fence.clearance_m(
                (north, east - small_m, down)
            )
            slope = math.hypot(slope_n, slope_e)
            if slope < 1e-3 * small_m:
                break
            north += (missing_m + TOLERANCE_M) * slope_n / slope
            east += (missing_m + TOLERANCE_M) * slope_e / slope
        return (self._at[0], self._at[1], down)

    def _motion_of(self, target: Vector3, reported: Vector3 | None, duration_s: float) -> Vector3:
        """Velocity of a target: the reported one if it matches the observed motion; zero after a jump."""
        before, self._target = self._target, target
        if before is None or duration_s <= 0.0:
            return _AT_REST
        seen = _plus(_AT_REST, _minus(target, before), 1.0 / duration_s)
        usual = (self._limits.speed_m_s, self._limits.climb_m_s)  # it may well be faster than what is followed now
        if reported is not None and self._agree(reported, seen, usual):
            return reported
        return seen if self._is_slow(seen, usual) else _AT_REST

    # --- obstacles ---

    def _clear_of_obstacles(self, target: Vector3, reason: str) -> tuple[Vector3, str]:
        """The target, not too near to anything; away from here first, where something has come too near."""
        assert self._at is not None
        field, at = self.obstacles, self._at
        if field is None or field.is_empty:
            return target, reason
        nearest_m, place = min((field.clearance_m(place), place) for place in (at, self._ahead_ned_m))
        self._flees = nearest_m < field.keep_m - SLACK_M
        if self._flees:
            north, east, _ = field.refuge(place)
            return self._kept_inside((north, east, target[2])), "an obstacle is too near"
        self._among_m_s = AMONG_M_S + AMONG_HZ * max(0.0, nearest_m - field.keep_m)
        if field.clearance_m(target) >= field.keep_m:
            return target, reason
        return self._kept_inside(field.pushed_out(target, at)), FENCE_AHEAD

    @property
    def _blocked(self) -> ObstacleField | None:
        """Obstacles that may stop it; while it moves away from one, predicted obstacles do not."""
        return self.obstacles.present if self.obstacles is not None and self._flees else self.obstacles

    def _kept_inside(self, place: Vector3) -> Vector3:
        """A place to flee to, not beyond the fence."""
        if self._flat is None or self._flat.clearance_m(place) >= self._limits.fence_margin_m:
            return place
        return self._pushed_in(self._flat, place)

    def _around(self, wanted: Vector3, distance_m: float) -> Vector3:
        """The wanted velocity, turned aside where an obstacle blocks the path."""
        assert self._at is not None
        field, across = self._blocked, math.hypot(wanted[0], wanted[1])
        if field is None or field.is_empty or across < TOLERANCE_M:
            return wanted
        wanted_rad = math.atan2(wanted[1], wanted[0])
        heading, free_m = self._detour.heading(field, self._at, wanted_rad, distance_m, self._last_s)
        free_m = min(free_m, *field.free_m(self._ahead_ned_m, (heading,)))
        # So fast that reacting and braking together take the way that is free.
        braking = min(GENTLE_M_S2, APPROACH_SHARE * self._limits.acceleration_m_s2)
        lost = braking * REACTION_S
        speed = min(across, math.sqrt(lost * lost + 2.0 * braking * free_m) - lost)
        return (speed * math.cos(heading), speed * math.sin(heading), wanted[2])

    def _is_clear(self, stop: Vector3, distance_m: float) -> bool:
        """Whether the path to a stop gets no nearer to an obstacle than permitted, or than now."""
        assert self._at is not None
        field = self._blocked
        if field is None or field.is_empty:
            return True
        now_m, least_m = field.clearance_m(self._at), field.keep_m - SLACK_M
        if now_m - least_m >= distance_m:
            return True
        return field.leg_clearance_m(self._at, stop) >= min(now_m, least_m) - ROUNDING_M

    def _is_blocked(self, target: Vector3) -> bool:
        assert self._at is not None
        return self.obstacles is not None and self.obstacles.leg_clearance_m(self._at, target) < self.obstacles.keep_m

    # --- the way there ---

    def _approach(self, target: Vector3, moving: Vector3, duration_s: float) -> None:
        """Moves the point: onto the target where permitted, else towards it."""
        assert self._at is not None
        if duration_s <= 0.0:
            return
        at = self._at
        shift = _minus(target, at)
        straight = (shift[0] / duration_s, shift[1] / duration_s, shift[2] / duration_s)
        change = math.dist(straight, self._velocity)
        most = self._limits.acceleration_m_s2 * duration_s * 1.001 + 1e-3
        is_near = change <= most and math.dist(straight, moving) <= most
        if is_near and self._is_slow(straight) and self._may_go(straight, duration_s):
            self._at, self._velocity = target, straight
            return
        # It keeps up with a moving target, and comes nearer to it no faster than it could stop there.
        moving = self._slowed(moving)
        behind = _plus(shift, moving, -duration_s)
        distance_m = math.hypot(*behind)
        closing_m_s = _speed_to_stop(distance_m, APPROACH_SHARE * self._limits.acceleration_m_s2, duration_s)
        wanted = self._slowed(_plus(moving, behind, closing_m_s / max(distance_m, TOLERANCE_M)))
        self._velocity = self._next(self._around(wanted, distance_m), duration_s)
        self._at = _plus(at, self._velocity, duration_s)

    def _next(self, wanted: Vector3, duration_s: float) -> Vector3:
        """The velocity for the next step: as near to the wish as acceleration and fence allow."""
        assert self._at is not None
        most = self._limits.acceleration_m_s2 * duration_s
        now = self._velocity
        change = math.dist(wanted, now)
        turned = wanted if change <= most else _plus(now, _minus(wanted, now), most / change)
        if self._may_go(turned, duration_s):
            return turned
        speed = math.hypot(*now)
        braked = _plus(_AT_REST, now, max(0.0, 1.0 - most / speed) if speed > 0.0 else 0.0)
        for share in (0.5, 0.25, 0.1):
            mixed = _plus(braked, _minus(turned, braked), share)
            if self._may_go(mixed, duration_s):
                return mixed
        return braked

    def _may_go(self, velocity: Vector3, duration_s: float) -> bool:
        """Whether, after a step with this velocity, the point can still stop inside."""
        assert self._at is not None
        at = self._at
        speed = math.hypot(*velocity)
        if speed == 0.0:
            return True
        reach_s = duration_s + 0.5 * speed / self._limits.acceleration_m_s2
        stop = _plus(at, velocity, reach_s)
        height_m, stop_m = -at[2], -stop[2]
        if stop_m > max(self.highest_m, height_m) + TOLERANCE_M or stop_m < min(self._lowest_m, height_m) - TOLERANCE_M:
            return False
        reach_s += REACTION_S
        stop = _plus(at, velocity, reach_s)
        if not self._is_clear(stop, speed * reach_s):
            return False
        if self._flat is None:
            return True
        room_m, margin_m = self._room_m(), self._limits.fence_margin_m
        if room_m - margin_m >= speed * reach_s:
            return True
        needed_m = min(room_m, margin_m) - ROUNDING_M
        # A very short leg is taken for its begin, therefore the end is looked at as well.
        return self._flat.clearance_m(stop) >= needed_m and self._flat.leg_clearance_m(at, stop) >= needed_m

    # --- speeds ---

    def _agree(self, reported: Vector3, seen: Vector3, most: tuple[float, float] | None = None) -> bool:
        """Whether a reported velocity matches the motion between setpoints."""
        near_m_s = 0.05 + 0.5 * self._limits.acceleration_m_s2 * LONGEST_STEP_S
        return math.dist(reported, seen) <= near_m_s and self._is_slow(reported, most)

    def _is_slow(self, velocity: Vector3, most: tuple[float, float] | None = None) -> bool:
        """Whether a velocity is within horizontal and vertical limits; by default the present ones."""
        most_m_s, most_climb_m_s = most or self._speeds
        across = math.hypot(velocity[0], velocity[1])
        return across <= most_m_s * 1.001 + 1e-3 and abs(velocity[2]) <= most_climb_m_s * 1.001 + 1e-3

    def _ease(self, duration_s: float) -> None:
        """Slows down to `careful_m_s` as fast as the vehicle can follow."""
        speed = math.hypot(*self._velocity)
        braking = max(GENTLE_M_S2, EASING_HZ * speed)
        self._eased_m_s = max(self.careful_m_s, speed - braking * duration_s)

    @property
    def _speeds(self) -> tuple[float, float]:
        """How fast it may go now, across and up or down."""
        return min(self._limits.speed_m_s, self._eased_m_s, self._among_m_s), min(
            self._limits.climb_m_s, self._eased_m_s
        )

    def _slowed(self, velocity: Vector3) -> Vector3:
        """The same direction, no faster than the platform may move across and up or down."""
        across, along = math.hypot(velocity[0], velocity[1]), abs(velocity[2])
        most_m_s, most_climb_m_s = self._speeds
        share = min(
            1.0,
            most_m_s / across if across > 0.0 else 1.0,
            most_climb_m_s / along if along > 0.0 else 1.0,
        )
        return (velocity[0] * share, velocity[1] * share, velocity[2] * share)


def _speed_to_stop(distance_m: float, braking_m_s2: float, duration_s: float) -> float:
    """The largest speed for the next step after which braking still ends before a distance, in m/s."""
    lost = braking_m_s2 * duration_s
    return min(math.sqrt(lost * lost + 2.0 * braking_m_s2 * distance_m) - lost, distance_m / duration_s)


def _plus(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (a[0] + b[0] * share, a[1] + b[1] * share, a[2] + b[2] * share)


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _with(wanted: Setpoint, position: Vector3 | None, velocity: Vector3 | None) -> Setpoint:
    return Setpoint(
        action_id=wanted.action_id, position_ned_m=position, velocity_ned_m_s=velocity, yaw_rad=wanted.yaw_rad
    )


def is_finite(setpoint: Setpoint) -> bool:
    """Whether every number of a setpoint is finite."""
    numbers = (*(setpoint.position_ned_m or ()), *(setpoint.velocity_ned_m_s or ()), setpoint.yaw_rad or 0.0)
    return all(map(math.isfinite, numbers))
