"""Control of vehicles with a left and a right drive: turn rate and speed to two outputs, as in Rover."""

from math import hypot, sqrt
from typing import Final

from gloc3.errors import Misuse
from gloc3.messages.frames import Quaternion, from_yaw, wrap_pi
from gloc3_sitl.autopilot.control.drive_gains import DriveGains
from gloc3_sitl.autopilot.control.setpoint import LANDED, DriveSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.periods import OUTER_S

Pair = tuple[float, float]
"""Left and right, -1 to 1."""
_STOPPED: Final[Pair] = (0.0, 0.0)
_CRUMB_M: Final = 2.0
"""Spacing of the recorded track points, m."""
_MOST_TRACK_POINTS: Final = 500


class DriveControl:
    """Two drives, one on each side; a `Control`.

    A disarmed rover stands; a boat always drifts.
    """

    stopped: Pair = _STOPPED

    def __init__(self, craft: Craft) -> None:
        self.thrust = 0.0
        self._craft: Final = craft
        self._gains: Final[DriveGains] = craft.tuning.drive
        self._outputs = _STOPPED
        self._heading_rad = 0.0
        self._speed_m_s = self._speed_sum = 0.0
        self._rate_rad_s = self._rate_sum = 0.0

    @property
    def wanted_attitude(self) -> Quaternion:
        """The heading that is steered, level."""
        return from_yaw(self._heading_rad)

    def outputs(self) -> Pair:
        """Left and right for the next 5 ms."""
        return self._outputs

    def follow(self, setpoint: Setpoint) -> None:
        """Works out both outputs: as often as Rover does."""
        craft = self._craft
        craft.touchdown.is_landed = not (craft.is_armed or self._gains.loiters)
        if setpoint is LANDED or not craft.is_armed:
            self._remainder()
            craft.track_points.clear()
            return
        if not isinstance(setpoint, DriveSetpoint):
            raise Misuse(f"a driven vehicle does not accept {type(setpoint).__name__}")
        self._add_track_point()
        if setpoint.is_direct:
            self._remainder()
            self.thrust = setpoint.throttle
            self._outputs = self._mix(setpoint.throttle, setpoint.steering)
            return
        throttle = self._throttle(setpoint.speed_m_s)
        if setpoint.speed_m_s == 0.0 and setpoint.is_at_rest and abs(self._speed_m_s) < 0.05:
            self._remainder()
            return
        self.thrust = throttle
        self._outputs = self._mix(throttle, self._steering(setpoint))

    def _remainder(self) -> None:
        self.thrust = 0.0
        self._outputs = _STOPPED
        self._speed_m_s = self._ahead_m_s()
        self._speed_sum = self._rate_sum = self._rate_rad_s = 0.0
        self._heading_rad = self._craft.estimator.yaw_rad

    def _ahead_m_s(self) -> float:
        """Speed along the heading."""
        inertial = self._craft.estimator.inertial
        w, x, y, z = inertial.ned_from_frd
        vn, ve, _ = inertial.velocity_ned_m_s
        cosine, sine = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        size = hypot(cosine, sine) or 1.0
        return (vn * cosine + ve * sine) / size

    def _throttle(self, wanted_m_s: float) -> float:
        gains = self._gains
        change = gains.acceleration_m_s2 * OUTER_S
        self._speed_m_s += max(-change, min(change, wanted_m_s - self._speed_m_s))
        error = self._speed_m_s - self._ahead_m_s()
        base = self._speed_m_s * (gains.cruise_throttle / max(gains.cruise_speed_m_s, 0.1) + gains.speed_ff)
        throttle = base + gains.speed_p * error + self._speed_sum
        if abs(throttle) < 1.0 or throttle * error < 0.0:
            self._speed_sum += gains.speed_i * error * OUTER_S
            self._speed_sum = max(-1.0, min(1.0, self._speed_sum))
        return max(-1.0, min(1.0, throttle))

    def _steering(self, setpoint: DriveSetpoint) -> float:
        gains, inertial = self._gains, self._craft.estimator.inertial
        most = gains.rate_max_rad_s
        speed = abs(self._speed_m_s)
        if speed > 0.3:
            most = min(most, gains.turn_acceleration_m_s2 / speed)
        wanted = setpoint.turn_rate_rad_s
        if setpoint.heading_rad == setpoint.heading_rad:
            self._heading_rad = setpoint.heading_rad
            off = wrap_pi(setpoint.heading_rad - self._craft.estimator.yaw_rad)
            near = gains.rate_change_rad_s2 / gains.heading_p**2
            size = abs(off)
            turn = gains.heading_p * size if size < near else sqrt(2.0 * gains.rate_change_rad_s2 * (size - 0.5 * near))
            wanted += turn if off > 0.0 else -turn
        wanted = max(-most, min(most, wanted))
        change = gains.rate_change_rad_s2 * OUTER_S
        self._rate_rad_s += max(-change, min(change, wanted - self._rate_rad_s))
        error = self._rate_rad_s - inertial.rate_frd_rad_s[2]
        steering = gains.rate_ff * self._rate_rad_s + gains.rate_p * error + self._rate_sum
        if abs(steering) < 1.0 or steering * error < 0.0:
            self._rate_sum += gains.rate_i * error * OUTER_S
            self._rate_sum = max(-1.0, min(1.0, self._rate_sum))
        return max(-1.0, min(1.0, steering))

    def _mix(self, throttle: float, steering: float) -> Pair:
        """Left and right outputs; at a limit, steering has priority over speed."""
        share = max(self._gains.steering_share, 1.0 - abs(throttle))
        steering = max(-share, min(share, steering))
        room = 1.0 - abs(steering)
        throttle = max(-room, min(room, throttle))
        return (self._shaped(throttle + steering), self._shaped(throttle - steering))

    def _shaped(self, thrust: float) -> float:
        """The output for a share of the forward thrust."""
        gains = self._gains
        size = min(1.0, abs(thrust) * gains.astern) if thrust < 0.0 else thrust
        curve = gains.thrust_curve
        if curve > 0.01:
            size = (curve - 1.0 + sqrt((1.0 - curve) ** 2 + 4.0 * curve * size)) / (2.0 * curve)
        return -size if thrust < 0.0 else size

    def _add_track_point(self) -> None:
        """Records the track without loops, for the return along it."""
        craft = self._craft
        if not craft.estimator.is_position_good(craft.now_s) or not craft.records_track:
            return
        n, e, _ = here = craft.estimator.inertial.position_ned_m
        track_points = craft.track_points
        if track_points and hypot(track_points[-1][0] - n, track_points[-1][1] - e) < _CRUMB_M:
            return
        for index, (north, east, _) in enumerate(track_points[:-2]):
            if hypot(north - n, east - e) < _CRUMB_M:
                del track_points[index + 1 :]
                return
        if len(track_points) < _MOST_TRACK_POINTS:
            track_points.append(here)
