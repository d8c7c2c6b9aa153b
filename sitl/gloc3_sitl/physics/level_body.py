"""Base of bodies on the ground or on the water: horizontal position, heading and a small tilt."""

from math import cos, sin
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, IDENTITY, Quaternion, TangentPlane, Vector3, from_euler, to_euler
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import Wind


class LevelBody:
    """Position, heading and tilt, integrated by subclasses. The earth is the tangent plane at home.

    Args:
        situation: initial state.
        mass_kg: mass of the whole vehicle.
        standing_height_m: height of the reference point over the standing point.
    """

    def __init__(self, situation: Situation, mass_kg: float, standing_height_m: float) -> None:
        self.rate_hz: Final = situation.rate_hz
        self.steps = 0
        self.mass_kg: Final = mass_kg
        self.standing_height_m: Final = standing_height_m
        self.wind: Wind = situation.wind
        self._plane: Final = TangentPlane(situation.home)
        self._home_altitude_m: Final = situation.home.altitude_m
        self._dt_s: Final = 1.0 / situation.rate_hz
        self._ground_m = 0.0
        """Height of the ground (or of the still water) under the vehicle, over the home."""
        self._north_m = self._east_m = self._height_m = 0.0
        self._yaw_rad = self._roll_rad = self._pitch_rad = 0.0
        self._surge_m_s = self._sway_m_s = self._climb_m_s = 0.0
        """Velocity forward, to the right in the plane, and up."""
        self._rates: Vector3 = (0.0, 0.0, 0.0)
        self._force: Vector3 = (0.0, 0.0, -GRAVITY_M_S2)
        self._power_w = 0.0
        self._wheels_m: tuple[float, ...] = ()
        self._truth: Truth | None = None

    @property
    def now_s(self) -> float:
        """Seconds of simulated time since the start."""
        return self.steps / self.rate_hz

    def set_ground(self, altitude_m: float) -> None:
        """Raises or lowers the ground under the vehicle to this altitude above mean sea level."""
        self._ground_m = altitude_m - self._home_altitude_m

    def place(
        self,
        position_ned_m: Vector3,
        attitude_wxyz: Quaternion = IDENTITY,
        velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Places the vehicle in the plane; its height is that of the surface that carries it."""
        self._north_m, self._east_m, _ = position_ned_m
        self._roll_rad, self._pitch_rad, self._yaw_rad = to_euler(attitude_wxyz)
        vn, ve, _ = velocity_ned_m_s
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        self._surge_m_s, self._sway_m_s = vn * cosine + ve * sine, ve * cosine - vn * sine
        self._climb_m_s = 0.0
        self._rates = (0.0, 0.0, 0.0)
        self._truth = None

    def _air_m_s(self) -> Vector3:
        """Velocity of the air, NED."""
        return self.wind.velocity_ned_m_s

    def _measure_forces(self, ahead_m_s2: float, right_m_s2: float, up_m_s2: float) -> None:
        """Computes the accelerometer's specific force from accelerations along the heading, to its right, and up."""
        down = -up_m_s2 - GRAVITY_M_S2
        cp, sp, cr, sr = cos(self._pitch_rad), sin(self._pitch_rad), cos(self._roll_rad), sin(self._roll_rad)
        x = ahead_m_s2 * cp - down * sp
        z = ahead_m_s2 * sp + down * cp
        self._force = (x, right_m_s2 * cr + z * sr, z * cr - right_m_s2 * sr)

    def _moved(self) -> None:
        """One step is over."""
        self.steps += 1
        self._truth = None

    def imu(self) -> tuple[Vector3, Vector3]:
        """Specific force in m/s^2 and turn rate in rad/s, both FRD."""
        return self._force, self._rates

    def truth(self) -> Truth:
        """What the vehicle does now."""
        if self._truth is None:
            cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
            place = self._plane.geo_from_ned((self._north_m, self._east_m, -self._height_m))
            self._truth = Truth(
                t_s=self.now_s,
                position_ned_m=(self._north_m, self._east_m, -self._height_m),
                velocity_ned_m_s=(
                    self._surge_m_s * cosine - self._sway_m_s * sine,
                    self._surge_m_s * sine + self._sway_m_s * cosine,
                    -self._climb_m_s,
                ),
                attitude_wxyz=from_euler(self._roll_rad, self._pitch_rad, self._yaw_rad),
                rate_frd_rad_s=self._rates,
                specific_force_frd_m_s2=self._force,
                latitude_deg=place.latitude_deg,
                longitude_deg=place.longitude_deg,
                altitude_m=place.altitude_m,
                height_above_ground_m=self._height_m - self._ground_m,
                standing_height_m=self.standing_height_m,
                is_on_ground=True,
                power_w=self._power_w,
                wind_ned_m_s=self._air_m_s(),
                wheels_m=self._wheels_m,
            )
        return self._truth


def clipped(output: float) -> float:
    """Clips an output to -1..1; not-a-number becomes 0."""
    return 0.0 if output != output else max(-1.0, min(1.0, output))
