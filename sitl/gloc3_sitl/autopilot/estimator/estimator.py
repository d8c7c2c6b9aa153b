"""State estimator: an inertial solution, corrected by all enabled sources that pass their gates."""

from dataclasses import dataclass, field
from math import atan2, nan, sqrt
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, GeoPoint, TangentPlane, Vector3, rotate, to_euler, wrap_pi
from gloc3_sitl.autopilot.estimator.alignment import InertialAlignment
from gloc3_sitl.autopilot.estimator.axis import AxisFilter, Gains
from gloc3_sitl.autopilot.estimator.inertial import InertialSolution
from gloc3_sitl.autopilot.estimator.sources import DEFAULT_SOURCES, AidingSource, AidingState, ExternalOdometry, Fix

_GATE_SIGMA: Final = 5.0
_FIRST_MEASUREMENTS: Final = 10
"""Accepted positions before the estimate may be used in flight."""
_STUCK: Final = 10
"""So many equal readings of a magnetometer in a row: a working one has noise."""
_FIX_LOST_S: Final = 0.5
_FIX_LATE_S: Final = 0.5
"""Age of a fix from which it says nothing about the present: PX4 keeps no states that are older than EKF2_DELAY_MAX."""
_IMU_LOST_S: Final = 0.1
"""Age of the newest inertial sample from which there is no estimate of the present."""
_BAROMETER_M2, _DEPTH_M2 = 0.25, 0.0025
"""Variance of a height by the pressure of air, and of a depth by that of water, which is a thousand times steeper."""
_CLIMB_M2_S2: Final = 0.2
"""Least variance of a climb that satellites measure: PX4's EKF2_GPS_V_NOISE by 1.5, or a stuck receiver lifts it again."""
_GYRO_ALONE_S: Final = 3.0
"""So long the gyro alone keeps the attitude better than a level found from gravity and the vehicle's own accelerations."""
_BIAS_SHARE: Final = 0.04
"""Part of each tilt correction that goes to the gyro bias: a time constant of 25 s."""


@dataclass(slots=True)
class Estimator:
    """Attitude, velocity, position, height above ground, and how far each can be trusted."""

    declination_rad: float = 0.0
    floats: bool = False
    """The vehicle rocks on the water at rest."""
    sources: int = DEFAULT_SOURCES
    """Bits of `AidingSource`."""
    inertial: InertialSolution = field(default_factory=InertialSolution)
    origin: TangentPlane | None = None
    """Where NED is tangent to the Earth; None until the first good fix or until it is set."""
    is_aligned: bool = False
    is_landed: bool = True
    """Set by the autopilot: on the ground and at rest."""
    ground_down_m: float = 0.0
    """NED down of the ground below, by the range finder."""
    height_above_ground_m: float = nan
    """By the range finder; NaN without an echo."""
    range_t_s: float = -1e9
    fix: Fix | None = None
    fix_state: AidingState = field(default_factory=AidingState)
    height_state: AidingState = field(default_factory=AidingState)
    barometer_state: AidingState = field(default_factory=AidingState)
    heading_state: AidingState = field(default_factory=AidingState)
    external_state: AidingState = field(default_factory=AidingState)
    reset_count: int = 0
    """How often the position has jumped."""
    jump_ned_m: Vector3 = (0.0, 0.0, 0.0)
    """By how much it has jumped in all."""
    barometer_altitude_m: float = nan
    boot_down_m: float = 0.0
    """NED down of the boot position: the draught of a diving vehicle, m."""
    _horizontal: AxisFilter = field(default_factory=lambda: AxisFilter(0.02, 4e-4))
    _vertical: AxisFilter = field(default_factory=lambda: AxisFilter(0.02, 1e-3))
    _alignment: InertialAlignment = field(default_factory=InertialAlignment)
    _field_repeats: int = 0
    _horizontal_s: float = 0.0
    _vertical_s: float = 0.0
    _barometer_offset_m: float = nan
    external_resets: int = -1
    """Reset counter of the newest external odometry; -1 before the first."""
    _yaw_is_from_north: bool = True
    _rest_s: float = 0.0
    _external_shift: tuple[float, float] = (0.0, 0.0)

    # -- inputs -------------------------------------------------------------------------------------------------

    def imu(self, force_frd_m_s2: Vector3, rate_frd_rad_s: Vector3, t_s: float, dt_s: float) -> None:
        """One IMU sample, valid for the last `dt_s`."""
        if self.is_aligned:
            self.inertial.predict(force_frd_m_s2, rate_frd_rad_s, t_s, dt_s)
            return
        inertial = self.inertial
        inertial.t_s = t_s
        if self._alignment.add(force_frd_m_s2, rate_frd_rad_s, floats=self.floats):
            inertial.ned_from_frd = self._alignment.attitude(self.declination_rad)
            inertial.gyro_bias_rad_s = self._alignment.gyro_bias_rad_s
            self._horizontal_s = self._vertical_s = inertial.aligned_s = t_s
            self.is_aligned = True

    def tick(self, now_s: float) -> None:
        """Handles the lack of corrections, 50 times a second."""
        if not self.is_aligned:
            return
        inertial = self.inertial
        if now_s - max(self.fix_state.accepted_s, self.external_state.accepted_s) > _GYRO_ALONE_S:
            # Gravity is the only reference of level; believe it while the vehicle hardly accelerates.
            an, ae, ad = inertial.acceleration_ned_m_s2
            if abs(ad) < 2.0 and an * an + ae * ae < 9.0:
                share = 0.2 * 0.02 / GRAVITY_M_S2
                inertial.turn((-ae * share, an * share, 0.0), 0.02)
        if self.is_landed and now_s - self._rest_s >= 0.1:
            self._rest_s = now_s
            self._stand_still(now_s)

    def _stand_still(self, now_s: float) -> None:
        """On the ground the velocity is zero."""
        vn, ve, vd = self.inertial.velocity_ned_m_s
        self._grow_horizontal(now_s)
        self._grow_vertical(now_s)
        gains = self._horizontal.measure_velocity(4e-4)
        self._correct_horizontal(gains, -vn, -ve)
        self._correct_vertical(self._vertical.measure_velocity(4e-4), -vd)

    def use_fix(self, fix: Fix, now_s: float) -> None:
        """A satellite fix."""
        self.fix = fix
        if not self.is_aligned or fix.fix_type < 3 or fix.horizontal_accuracy_m > 5.0:
            return
        if now_s - fix.t_s > _FIX_LATE_S:
            return
        if self.origin is None:
            d = self.inertial.position_ned_m[2]
            self.set_origin(fix.place)
            self.inertial.place((0.0, 0.0, self.boot_down_m), self.inertial.velocity_ned_m_s)
            if self._barometer_offset_m == self._barometer_offset_m:
                self._barometer_offset_m += d
            self._horizontal.reset(fix.horizontal_accuracy_m**2, 0.04)
            self._vertical.reset(fix.vertical_accuracy_m**2, 0.04)
            self._horizontal_s = self._vertical_s = now_s
        if not self.sources & AidingSource.FIX:
            return
        assert self.origin is not None
        measured = self.origin.ned_from_geo(*fix.place)
        believed = self.inertial.at(fix.t_s)
        accuracy = max(fix.horizontal_accuracy_m, 0.01) ** 2
        speed_accuracy = max(fix.speed_accuracy_m_s, 0.02) ** 2
        self._use_horizontal(self.fix_state, measured, believed.position_ned_m, accuracy, now_s)
        if self.fix_state.accepted_s == now_s:
            vn, ve, vd = believed.velocity_ned_m_s
            un, ue, ud = fix.velocity_ned_m_s
            self._correct_horizontal(self._horizontal.measure_velocity(speed_accuracy), un - vn, ue - ve)
            if not self.sources & (AidingSource.EXTERNAL_HEIGHT | AidingSource.RANGE_HEIGHT | AidingSource.DEPTH):
                height_accuracy = max(fix.vertical_accuracy_m, 0.01) ** 2
                self._use_height(self.height_state, measured[2], believed.position_ned_m[2], height_accuracy, now_s)
                self._correct_vertical(
                    self._vertical.measure_velocity(max(2.0 * speed_accuracy, _CLIMB_M2_S2)), ud - vd
                )

    def use_external(self, pose: ExternalOdometry, now_s: float) -> None:
        """External odometry (vision, laser, motion capture)."""
        if not self.is_aligned:
            return
        believed = self.inertial.at(pose.t_s)
        position, velocity = pose.position_ned_m, pose.velocity_ned_m_s
        has_jumped = pose.reset_counter != self.external_resets
        self.external_resets = pose.reset_counter
        if position is not None and self.sources & AidingSource.EXTERNAL_POSITION:
            self._use_external_position(pose, position, has_jumped, now_s)
            believed = self.inertial.at(pose.t_s)
        if position is not None and self.sources & AidingSource.EXTERNAL_HEIGHT:
            if has_jumped:
                self._place_vertical(position[2], now_s, pose.position_deviation_m**2)
                believed = self.inertial.at(pose.t_s)
            variance = max(pose.position_deviation_m, 0.01) ** 2
            self._use_height(self.height_state, position[2], believed.position_ned_m[2], variance, now_s)
        if velocity is not None and self.sources & AidingSource.EXTERNAL_VELOCITY:
            variance = max(pose.velocity_deviation_m_s, 0.02) ** 2
            vn, ve, vd = believed.velocity_ned_m_s
            self._correct_horizontal(self._horizontal.measure_velocity(variance), velocity[0] - vn, velocity[1] - ve)
            if not self.sources & AidingSource.DEPTH:  # what dives is told its own climb
                self._correct_vertical(self._vertical.measure_velocity(variance), velocity[2] - vd)
        if pose.yaw_rad is not None and self.sources & AidingSource.EXTERNAL_YAW:
            self._yaw_is_from_north = pose.yaw_is_from_north
            self._use_heading(wrap_pi(pose.yaw_rad - self.yaw_rad), 0.05, now_s)

    def _use_external_position(self, pose: ExternalOdometry, position: Vector3, has_jumped: bool, now_s: float) -> None:
        """Horizontal position from outside; beside a good fix it only learns where it lies, and then takes over."""
        believed = self.inertial.at(pose.t_s).position_ned_m
        if self.sources & AidingSource.FIX and now_s - self.fix_state.accepted_s < _FIX_LOST_S:
            self._external_shift = (believed[0] - position[0], believed[1] - position[1])
            self.external_state.judge(0.0, now_s)
            return
        north, east = self._external_shift
        measured = (position[0] + north, position[1] + east, position[2])
        variance = max(pose.position_deviation_m, 0.01) ** 2
        if has_jumped or now_s - self.external_state.accepted_s > 1.0:
            self._place_horizontal(measured, now_s, variance)
            believed = self.inertial.at(pose.t_s).position_ned_m
        self._use_horizontal(self.external_state, measured, believed, variance, now_s)

    def use_barometer(self, altitude_m: float, now_s: float) -> None:
        """Pressure altitude; only its changes count."""
        self.barometer_altitude_m = altitude_m
        if not self.is_aligned or not self.sources & AidingSource.BAROMETER:
            return
        if self._barometer_offset_m != self._barometer_offset_m:
            if self.sources & AidingSource.DEPTH:  # it has not dived yet: nothing does without a depth
                self._place_vertical(self.boot_down_m, now_s, _DEPTH_M2)
            self._barometer_offset_m = altitude_m + self.inertial.position_ned_m[2]
        down = self.inertial.position_ned_m[2]
        innovation = self._barometer_offset_m - altitude_m - down
        if now_s - self.height_state.accepted_s < 1.0 and self._vertical.position_variance_m2 < 0.09:
            # A better source carries the height: the barometer only learns its drift.
            self._barometer_offset_m -= 0.002 * innovation
            self.barometer_state.accepted_s = now_s
            return
        self._grow_vertical(now_s)
        variance = _DEPTH_M2 if self.sources & AidingSource.DEPTH else _BAROMETER_M2
        ratio = innovation * innovation / (_GATE_SIGMA**2 * (self._vertical.position_variance_m2 + variance))
        if self.barometer_state.judge(ratio, now_s):
            self._correct_vertical(self._vertical.measure_position(variance), innovation)
        elif self.barometer_state.is_stuck(now_s):
            if self.sources & AidingSource.DEPTH:  # the pressure of water is the depth itself
                self._place_vertical(down + innovation, now_s, variance)
                self._barometer_offset_m -= innovation
            else:
                self._barometer_offset_m = altitude_m + down

    def use_magnetometer(self, field_frd: Vector3, now_s: float) -> None:
        """Magnetic field in the body, in any unit; one that stays the same to the last bit is stuck, and left out."""
        self._field_repeats = self._field_repeats + 1 if field_frd == self._alignment.field_frd else 0
        self._alignment.field_frd = field_frd
        if (
            not self.is_aligned
            or not self.sources & AidingSource.MAGNETOMETER
            or self.sources & AidingSource.EXTERNAL_YAW
        ):
            return
        if self._field_repeats >= _STUCK:
            return
        north, east, _ = rotate(self.inertial.ned_from_frd, field_frd)
        self._use_heading(wrap_pi(self.declination_rad - atan2(east, north)), 0.02, now_s)

    def use_range(self, distance_m: float | None, now_s: float) -> None:
        """Distance along the body's down axis, or None without an echo."""
        _, x, y, _ = self.inertial.ned_from_frd
        upright = 1.0 - 2.0 * (x * x + y * y)
        if distance_m is None or upright < 0.7:
            self.height_above_ground_m = nan
            return
        self.range_t_s = now_s
        height = distance_m * upright
        self.height_above_ground_m = height
        self.ground_down_m = self.inertial.position_ned_m[2] + height
        if self.sources & AidingSource.RANGE_HEIGHT and self.is_aligned:
            self._use_height(self.height_state, -height, self.inertial.position_ned_m[2], 0.0009, now_s)

    def set_origin(self, place: GeoPoint) -> None:
        """Fixes NED to the Earth; the vehicle's own NED position stays as it is."""
        self.origin = TangentPlane(place)

    # -- what others ask ----------------------------------------------------------------------------------------

    @property
    def position_ned_m(self) -> Vector3:
        """From the origin."""
        return self.inertial.position_ned_m

    @property
    def velocity_ned_m_s(self) -> Vector3:
        """Over ground."""
        return self.inertial.velocity_ned_m_s

    @property
    def euler_rad(self) -> Vector3:
        """Roll, pitch and yaw."""
        return to_euler(self.inertial.ned_from_frd)

    @property
    def yaw_rad(self) -> float:
        """Heading clockwise from north."""
        w, x, y, z = self.inertial.ned_from_frd
        return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def is_yaw_aligned(self) -> bool:
        """Whether the heading is relative to north, so that the position is one on Earth."""
        return self._yaw_is_from_north or not self.sources & AidingSource.EXTERNAL_YAW

    @property
    def place(self) -> GeoPoint | None:
        """Position on Earth; None without origin and north."""
        return (
            None
            if self.origin is None or not self.is_yaw_aligned
            else self.origin.geo_from_ned(self.inertial.position_ned_m)
        )

    def is_position_good(self, now_s: float) -> bool:
        """Whether the horizontal position may be flown by: of the present, aided within the last second, and converged."""
        age = now_s - max(self.fix_state.accepted_s, self.external_state.accepted_s)
        enough = max(self.fix_state.accepted, self.external_state.accepted) >= _FIRST_MEASUREMENTS
        is_present = now_s - self.inertial.t_s < _IMU_LOST_S
        return is_present and enough and age < 1.0 and self._horizontal.position_variance_m2 < 9.0

    def is_height_good(self, now_s: float) -> bool:
        """Whether a height source was accepted within the last second."""
        return now_s - max(self.height_state.accepted_s, self.barometer_state.accepted_s) < 1.0

    def is_climb_good(self, now_s: float) -> bool:
        """Whether no height has contradicted the climb within the last two seconds."""
        return now_s - self.height_state.refused_s > 2.0

    def is_heading_good(self, now_s: float) -> bool:
        """Whether a heading source was accepted within the last two seconds."""
        return now_s - self.heading_state.accepted_s < 2.0

    @property
    def horizontal_deviation_m(self) -> float:
        """Standard deviation of the position in each horizontal axis."""
        return sqrt(max(self._horizontal.position_variance_m2, 0.0))

    @property
    def vertical_deviation_m(self) -> float:
        """Standard deviation of the height."""
        return sqrt(max(self._vertical.position_variance_m2, 0.0))

    @property
    def velocity_deviation_m_s(self) -> float:
        """Standard deviation of the velocity in each horizontal axis."""
        return sqrt(max(self._horizontal.velocity_variance_m2_s2, 0.0))

    # -- corrections --------------------------------------------------------------------------------------------

    def _grow_horizontal(self, now_s: float) -> None:
        if now_s > self._horizontal_s:
            self._horizontal.predict(now_s - self._horizontal_s)
            self._horizontal_s = now_s

    def _grow_vertical(self, now_s: float) -> None:
        if now_s > self._vertical_s:
            self._vertical.predict(now_s - self._vertical_s)
            self._vertical_s = now_s

    def _use_horizontal(
        self, state: AidingState, measured: Vector3, believed: Vector3, variance_m2: float, now_s: float
    ) -> None:
        self._grow_horizontal(now_s)
        dn, de = measured[0] - believed[0], measured[1] - believed[1]
        spread = self._horizontal.position_variance_m2 + variance_m2
        if state.judge((dn * dn + de * de) / (_GATE_SIGMA**2 * spread), now_s):
            self._correct_horizontal(self._horizontal.measure_position(variance_m2), dn, de)
        elif state.is_stuck(now_s):
            self._place_horizontal(measured, now_s, variance_m2)
            state.refused_since_s = None
            state.accepted_s = now_s

    def _use_height(
        self, state: AidingState, measured_down: float, believed_down: float, variance_m2: float, now_s: float
    ) -> None:
        self._grow_vertical(now_s)
        innovation = measured_down - believed_down
        spread = self._vertical.position_variance_m2 + variance_m2
        if state.judge(innovation * innovation / (_GATE_SIGMA**2 * spread), now_s):
            self._correct_vertical(self._vertical.measure_position(variance_m2), innovation)
        elif state.is_stuck(now_s):
            self._place_vertical(measured_down, now_s, variance_m2)
            state.refused_since_s = None
            state.accepted_s = now_s

    def _use_heading(self, innovation_rad: float, share: float, now_s: float) -> None:
        ratio = (innovation_rad / 0.6) ** 2
        if self.heading_state.judge(ratio, now_s):
            self.inertial.turn((0.0, 0.0, innovation_rad * share), _BIAS_SHARE)
        elif self.heading_state.is_stuck(now_s):
            self.inertial.turn((0.0, 0.0, innovation_rad * 0.5))

    def _correct_horizontal(self, gains: Gains, north: float, east: float) -> None:
        kp, kv, ka = gains
        self.inertial.correct_motion((kp * north, kp * east, 0.0), (kv * north, kv * east, 0.0))
        # An acceleration error is a tilt error: turn the estimate so that its thrust points where the vehicle went.
        tilt = ka / GRAVITY_M_S2
        self.inertial.turn((tilt * east, -tilt * north, 0.0), _BIAS_SHARE)

    def _correct_vertical(self, gains: Gains, down: float) -> None:
        kp, kv, ka = gains
        self.inertial.correct_motion((0.0, 0.0, kp * down), (0.0, 0.0, kv * down))
        bias = self.inertial.down_bias_m_s2 + ka * down
        self.inertial.down_bias_m_s2 = max(-1.0, min(1.0, bias))

    def _place_horizontal(self, position: Vector3, now_s: float, variance_m2: float) -> None:
        n, e, _ = position
        was_n, was_e, _ = self.inertial.position_ned_m
        north, east, down = self.jump_ned_m
        self.jump_ned_m = (north + n - was_n, east + e - was_e, down)
        self.inertial.place((n, e, self.inertial.position_ned_m[2]), self.inertial.velocity_ned_m_s)
        self._horizontal.reset(variance_m2, 0.25)
        self._horizontal_s = now_s
        self.reset_count += 1

    def _place_vertical(self, down: float, now_s: float, variance_m2: float) -> None:
        n, e, was = self.inertial.position_ned_m
        self.inertial.place((n, e, down), self.inertial.velocity_ned_m_s)
        self._barometer_offset_m += down - was
        north, east, so_far = self.jump_ned_m
        self.jump_ned_m = (north, east, so_far + down - was)
        self._vertical.reset(variance_m2, 0.25)
        self._vertical_s = now_s
        self.reset_count += 1
