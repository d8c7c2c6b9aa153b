"""Keeps setpoints inside the limits of the platform and the fence of the mission (DESIGN §7).

The wanted position is first brought inside the fence and the band of heights, then approached no faster than the
platform may move: the position that comes out moves at most at the speed limit, with at most the acceleration limit,
and so slowly towards the fence that it can still stop before it.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.frames import Vector3
from gloc3.vehicle import MotionLimits, Setpoint

TOLERANCE_M: Final = 1e-6


class Limited(NamedTuple):
    """A setpoint inside the limits."""

    setpoint: Setpoint
    is_clamped: bool
    reason: str


class SetpointLimiter:
    """Limits a stream of setpoints; told the pose when the stream begins anew."""

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self._position_ned_m: Vector3 | None = None
        self._velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
        self._last_s = 0.0

    def restart(self, position_ned_m: Vector3, velocity_ned_m_s: Vector3, now_s: float) -> None:
        """Begins a new stream where the vehicle is."""
        self._position_ned_m = position_ned_m
        self._velocity_ned_m_s = velocity_ned_m_s
        self._last_s = now_s

    def limit(self, wanted: Setpoint, now_s: float) -> Limited:
        """The nearest setpoint that keeps all limits."""
        position = wanted.position_ned_m
        if position is None or self._position_ned_m is None:
            return self._limit_velocity(wanted)
        target, reason = self._inside(position)
        duration_s = max(now_s - self._last_s, 0.0)
        self._last_s = now_s
        reached = self._approach(target, wanted.velocity_ned_m_s or (0.0, 0.0, 0.0), duration_s)
        if not reason and math.dist(reached, target) > 0.02:
            reason = "faster than the platform may move"
        velocity = wanted.velocity_ned_m_s
        if velocity is not None:
            velocity = self._slow(velocity) if not reason else self._velocity_ned_m_s
        limited = Setpoint(
            action_id=wanted.action_id, position_ned_m=reached, velocity_ned_m_s=velocity, yaw_rad=wanted.yaw_rad
        )
        return Limited(limited, bool(reason), reason)

    def _limit_velocity(self, wanted: Setpoint) -> Limited:
        if wanted.velocity_ned_m_s is None:
            return Limited(wanted, False, "")
        slowed = self._slow(wanted.velocity_ned_m_s)
        is_clamped = math.dist(slowed, wanted.velocity_ned_m_s) > TOLERANCE_M
        limited = Setpoint(action_id=wanted.action_id, velocity_ned_m_s=slowed, yaw_rad=wanted.yaw_rad)
        return Limited(limited, is_clamped, "faster than the platform may move" if is_clamped else "")

    def _inside(self, position: Vector3) -> tuple[Vector3, str]:
        """The wanted position in the band of heights, and what is wrong with it."""
        north, east, down = position
        limits = self.limits
        highest = limits.height_max_m
        if limits.fence is not None and limits.fence.ceiling_m is not None:
            highest = min(highest, limits.fence.ceiling_m)
        height = min(max(-down, limits.height_min_m), highest)
        target = (north, east, -height)
        if abs(height + down) > TOLERANCE_M:
            return target, f"height {-down:.2f} m is outside {limits.height_min_m:g} to {highest:g} m"
        if self._clearance_m(target) < limits.fence_margin_m - TOLERANCE_M:
            return target, f"({north:.2f}, {east:.2f}) m is nearer to the fence than {limits.fence_margin_m:g} m"
        return target, ""

    def _clearance_m(self, position: Vector3) -> float:
        fence = self.limits.fence
        return math.inf if fence is None else fence.clearance_m((position[0], position[1], 0.0))

    def _approach(self, target: Vector3, feed_forward: Vector3, duration_s: float) -> Vector3:
        """Moves the output towards the target, within speed and acceleration, able to stop there."""
        assert self._position_ned_m is not None
        at, limits = self._position_ned_m, self.limits
        step = (target[0] - at[0], target[1] - at[1], target[2] - at[2])
        distance_m = math.hypot(*step)
        if duration_s <= 0.0:
            return at
        if distance_m < TOLERANCE_M:
            self._velocity_ned_m_s = feed_forward
            return target
        along = tuple(component / distance_m for component in step)
        # Fast enough to keep up with a moving target, slow enough to stop at a resting one.
        moving = max(0.0, sum(a * b for a, b in zip(along, feed_forward, strict=True)))
        limit_m_s = self._limit_along(along)
        stopping_m_s = math.sqrt(moving**2 + 2.0 * limits.acceleration_m_s2 * distance_m)
        speed_before = max(0.0, sum(a * b for a, b in zip(along, self._velocity_ned_m_s, strict=True)))
        speed_m_s = min(limit_m_s, stopping_m_s, speed_before + limits.acceleration_m_s2 * duration_s)
        speed_m_s = min(speed_m_s, distance_m / duration_s)
        velocity = self._before_fence(at, (along[0] * speed_m_s, along[1] * speed_m_s, along[2] * speed_m_s))
        reached = (
            at[0] + velocity[0] * duration_s,
            at[1] + velocity[1] * duration_s,
            at[2] + velocity[2] * duration_s,
        )
        self._velocity_ned_m_s, self._position_ned_m = velocity, reached
        return reached

    def _before_fence(self, at: Vector3, velocity: Vector3) -> Vector3:
        """Takes off what leads into the fence faster than it could be stopped; slides along it."""
        fence, limits = self.limits.fence, self.limits
        if fence is None:
            return velocity
        north, east, down = velocity
        if self._clearance_m(at) < 0.0:  # outside already: only what leads back
            ahead = (at[0] + 0.1 * north, at[1] + 0.1 * east, at[2])
            return velocity if self._clearance_m(ahead) > self._clearance_m(at) else (0.0, 0.0, down)
        for distance_m, (wall_n, wall_e) in fence.walls(at):
            room_m = max(0.0, distance_m - limits.fence_margin_m)
            allowed_m_s = math.sqrt(2.0 * limits.acceleration_m_s2 * room_m)
            towards_m_s = north * wall_n + east * wall_e
            if towards_m_s > allowed_m_s:
                north -= (towards_m_s - allowed_m_s) * wall_n
                east -= (towards_m_s - allowed_m_s) * wall_e
        return (north, east, down)

    def _limit_along(self, along: Sequence[float]) -> float:
        """The largest speed in a direction, of what the platform may do horizontally and vertically, in m/s."""
        horizontal, vertical = math.hypot(along[0], along[1]), abs(along[2])
        limit = math.inf
        if horizontal > TOLERANCE_M:
            limit = self.limits.speed_m_s / horizontal
        if vertical > TOLERANCE_M:
            limit = min(limit, self.limits.climb_m_s / vertical)
        return limit

    def _slow(self, velocity: Vector3) -> Vector3:
        speed = math.hypot(*velocity)
        if speed < TOLERANCE_M:
            return velocity
        factor = min(1.0, self._limit_along(tuple(component / speed for component in velocity)) / speed)
        return (velocity[0] * factor, velocity[1] * factor, velocity[2] * factor)


def is_finite(setpoint: Setpoint) -> bool:
    """Whether every number of a setpoint is finite."""
    numbers = [*(setpoint.position_ned_m or ()), *(setpoint.velocity_ned_m_s or ())]
    if setpoint.yaw_rad is not None:
        numbers.append(setpoint.yaw_rad)
    return all(math.isfinite(number) for number in numbers)
