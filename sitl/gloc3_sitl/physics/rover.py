"""A skid-steered rover: wheels that turn at a speed, and tyres that slip over the ground."""

from collections.abc import Sequence
from math import atan, cos, hypot, pi, sin
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, IDENTITY, Quaternion, Vector3, wrap_pi
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.level_body import LevelBody, clipped
from gloc3_sitl.vehicles.ground_model import RoverModel

_SLOPE_STEP_M: Final = 0.05
"""Length of path over which the ground's slope is averaged, m."""
_SLOPE_MAX_RAD: Final = 0.5


class SkidRover(LevelBody):
    """A skid-steered rover: left and right wheels run at different speeds, and tyres slip sideways in turns.

    Coulomb friction acts on each wheel against the velocity of its contact patch, smoothed near rest (tyre creep). The
    vehicle therefore turns less than pure rolling would give, and slides when it is driven too hard (J. L. Martínez et
    al. 2005, "Approximating kinematics for tracked mobile robots", describe the same effect by centres of rotation
    outside the wheels).

    Args:
        model: the rover.
        situation: initial state.
    """

    def __init__(self, model: RoverModel, situation: Situation) -> None:
        super().__init__(situation, model.mass_kg, model.centre_height_m)
        self.model: Final = model
        self._rims = (0.0, 0.0)
        self._wheels_m = (0.0, 0.0)
        self._slope_rad = 0.0
        self._distance_m, self._ground_before_m = 0.0, 0.0
        self._lag: Final = self._dt_s / (model.drive_s + self._dt_s)
        self._change: Final = model.acceleration_max_m_s2 * self._dt_s
        arm_x, arm_y = 0.5 * model.wheelbase_m, 0.5 * model.track_m
        self._places: Final = ((arm_x, -arm_y, 0), (-arm_x, -arm_y, 0), (arm_x, arm_y, 1), (-arm_x, arm_y, 1))
        self._yaw_rad = wrap_pi(situation.heading_deg * pi / 180.0)
        self._measure_forces(0.0, 0.0, 0.0)
        self._power_w = model.avionics_w

    def set_ground(self, altitude_m: float) -> None:
        """Sets the altitude of the ground under the vehicle; its slope along the path tilts the vehicle."""
        super().set_ground(altitude_m)
        if abs(self._distance_m) >= _SLOPE_STEP_M:
            slope = atan((self._ground_m - self._ground_before_m) / self._distance_m)
            self._slope_rad = max(-_SLOPE_MAX_RAD, min(_SLOPE_MAX_RAD, slope))
            self._distance_m, self._ground_before_m = 0.0, self._ground_m

    def place(
        self,
        position_ned_m: Vector3,
        attitude_wxyz: Quaternion = IDENTITY,
        velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Places the vehicle on level ground with its wheels stopped."""
        super().place(position_ned_m, attitude_wxyz, velocity_ned_m_s)
        self._rims = (0.0, 0.0)
        self._slope_rad = self._pitch_rad = self._roll_rad = 0.0
        self._distance_m, self._ground_before_m = 0.0, self._ground_m

    def step(self, outputs: Sequence[float], /) -> None:
        """Advances by one period with the outputs of the left and the right side, -1 to 1."""
        model, dt = self.model, self._dt_s
        left, right = self._rims
        left += max(-self._change, min(self._change, self._lag * (clipped(outputs[0]) * model.speed_max_m_s - left)))
        right += max(-self._change, min(self._change, self._lag * (clipped(outputs[1]) * model.speed_max_m_s - right)))
        self._rims = rims = (left, right)
        u, v, r = self._surge_m_s, self._sway_m_s, self._rates[2]
        grip_n = 0.25 * model.mass_kg * GRAVITY_M_S2 * model.friction * cos(self._slope_rad)
        force_x = force_y = moment = work_w = 0.0
        for x, y, side in self._places:
            slip_x, slip_y = u - r * y - rims[side], v + r * x
            share = grip_n / hypot(slip_x, slip_y, model.slip_m_s)
            fx, fy = -share * slip_x, -share * slip_y
            force_x += fx
            force_y += fy
            moment += x * fy - y * fx
            work_w += max(0.0, fx * rims[side])
        rolling_n = model.rolling * model.mass_kg * GRAVITY_M_S2
        force_x -= rolling_n * u / hypot(u, model.slip_m_s) + model.mass_kg * GRAVITY_M_S2 * sin(self._slope_rad)
        ax, ay = force_x / model.mass_kg, force_y / model.mass_kg
        r += moment / model.inertia_z_kg_m2 * dt
        turn = r * dt
        # The body turns under its velocity.
        u, v = u + (ax + r * v) * dt, v + (ay - r * u) * dt
        self._surge_m_s, self._sway_m_s = u, v
        self._yaw_rad = wrap_pi(self._yaw_rad + turn)
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        self._north_m += (u * cosine - v * sine) * dt
        self._east_m += (u * sine + v * cosine) * dt
        self._distance_m += u * dt
        pitch_before, height_before = self._pitch_rad, self._height_m
        self._pitch_rad += 0.05 * (self._slope_rad - self._pitch_rad)
        self._height_m += 0.1 * (self._ground_m - self._height_m)
        self._climb_m_s = (self._height_m - height_before) * self.rate_hz
        self._rates = (0.0, (self._pitch_rad - pitch_before) * self.rate_hz, r)
        self._measure_forces(ax, ay, 0.0)
        was_left, was_right = self._wheels_m
        self._wheels_m = (was_left + left * dt, was_right + right * dt)
        rolled_w = rolling_n * 0.5 * (abs(left) + abs(right))
        self._power_w = model.avionics_w + (work_w + rolled_w) / model.drive_efficiency
        self._moved()
