"""The estimator against a vehicle that moves as it is told: accuracy, outages, jumps, sources."""

from math import atan, cos, degrees, dist, pi, radians, sin
from random import Random

import pytest

from gloc3.messages.frames import (
    GeoPoint,
    Quaternion,
    TangentPlane,
    Vector3,
    from_euler,
    rotate_back,
    to_euler,
    wrap_pi,
)
from gloc3_sitl.autopilot.estimator.axis import AxisFilter
from gloc3_sitl.autopilot.estimator.estimator import Estimator
from gloc3_sitl.autopilot.estimator.sources import DEFAULT_SOURCES, AidingSource, ExternalOdometry, Fix

pytestmark = pytest.mark.thorough

HOME = GeoPoint(47.0, 8.0, 400.0)
PLANE = TangentPlane(HOME)
FIELD_NED = (2.1e-5, 1.0e-6, 4.3e-5)
DECLINATION = 1.0 / 21.0
RADIUS_M, TURN_RAD_S = 4.0, 0.5


class Rig:
    """Feeds an estimator with the sensors of a vehicle that stands, then flies circles with its nose along the way."""

    def __init__(self, seed: int = 1, sources: int = DEFAULT_SOURCES) -> None:
        self.estimator = Estimator(declination_rad=DECLINATION, sources=sources)
        self.random = Random(seed)
        self.steps = 0
        self.has_fix = True
        self.fix_offset: Vector3 = (0.0, 0.0, 0.0)
        self.external: Vector3 | None = None
        self.resets = 0
        self.flight_s = 0.0
        self.bias = (0.01, -0.008, 0.005)

    @property
    def now_s(self) -> float:
        return self.steps * 0.004

    def truth(self, flight_s: float) -> tuple[Vector3, Vector3, Quaternion, Vector3, Vector3]:
        """Position, velocity, attitude, specific force in FRD, rate in FRD."""
        speed = min(1.0, flight_s / 4.0)
        angle = TURN_RAD_S * (flight_s - 2.0 if flight_s > 4.0 else flight_s * flight_s / 8.0)
        turn = TURN_RAD_S * speed
        grow = TURN_RAD_S / 4.0 if 0.0 < flight_s < 4.0 else 0.0
        position = (RADIUS_M * sin(angle), RADIUS_M * (1.0 - cos(angle)), -2.0 * sin(0.5 * angle) ** 2)
        down_rate, down_2 = -sin(angle), -cos(angle)
        velocity = (RADIUS_M * turn * cos(angle), RADIUS_M * turn * sin(angle), down_rate * turn)
        acceleration = (
            RADIUS_M * (grow * cos(angle) - turn * turn * sin(angle)),
            RADIUS_M * (grow * sin(angle) + turn * turn * cos(angle)),
            down_rate * grow + down_2 * turn * turn,
        )
        attitude = from_euler(0.05 * sin(angle), 0.1 * sin(2.0 * angle), angle)
        force = rotate_back(attitude, (acceleration[0], acceleration[1], acceleration[2] - 9.80665))
        return position, velocity, attitude, force, self.rate(flight_s)

    def rate(self, flight_s: float) -> Vector3:
        before, after = self.attitude(flight_s - 0.002), self.attitude(flight_s + 0.002)
        w, x, y, z = before
        bw, bx, by, bz = after
        return (
            2.0 * (w * bx - x * bw - y * bz + z * by) / 0.004,
            2.0 * (w * by + x * bz - y * bw - z * bx) / 0.004,
            2.0 * (w * bz - x * by + y * bx - z * bw) / 0.004,
        )

    def attitude(self, flight_s: float) -> Quaternion:
        flight_s = max(0.0, flight_s)
        angle = TURN_RAD_S * (flight_s - 2.0 if flight_s > 4.0 else flight_s * flight_s / 8.0)
        return from_euler(0.05 * sin(angle), 0.1 * sin(2.0 * angle), angle)

    def run(self, seconds: float, *, flies: bool = True) -> None:
        noise = self.random.gauss
        self.estimator.is_landed = not flies
        for _ in range(round(seconds / 0.004)):
            self.steps += 1
            if flies:
                self.flight_s += 0.004
            position, velocity, attitude, force, rate = self.truth(self.flight_s)
            noisy_force = tuple(value + noise(0.0, 0.05) for value in force)
            noisy_rate = tuple(value + bias + noise(0.0, 0.003) for value, bias in zip(rate, self.bias, strict=True))
            estimator, now_s = self.estimator, self.now_s
            estimator.imu(
                (noisy_force[0], noisy_force[1], noisy_force[2]),
                (noisy_rate[0], noisy_rate[1], noisy_rate[2]),
                now_s,
                0.004,
            )
            if self.steps % 5 == 0:
                estimator.tick(now_s)
                estimator.use_barometer(400.0 - position[2] + 7.0 + noise(0.0, 0.1), now_s)
                estimator.use_magnetometer(rotate_back(attitude, FIELD_NED), now_s)
            if self.steps % 25 == 0:
                self.measure(position, velocity, now_s)

    def measure(self, position: Vector3, velocity: Vector3, now_s: float) -> None:
        noise = self.random.gauss
        if self.has_fix:
            at = tuple(p + o + noise(0.0, 0.01) for p, o in zip(position, self.fix_offset, strict=True))
            self.estimator.use_fix(
                Fix(
                    t_s=now_s,
                    place=PLANE.geo_from_ned((at[0], at[1], at[2])),
                    velocity_ned_m_s=velocity,
                    horizontal_accuracy_m=0.01,
                    vertical_accuracy_m=0.02,
                    speed_accuracy_m_s=0.05,
                    fix_type=6,
                    satellites=20,
                ),
                now_s,
            )
        if self.external is not None:
            away = tuple(p + o for p, o in zip(position, self.external, strict=True))
            self.estimator.use_external(
                ExternalOdometry(
                    t_s=now_s,
                    position_ned_m=(away[0], away[1], away[2]),
                    velocity_ned_m_s=None,
                    yaw_rad=None,
                    position_deviation_m=0.05,
                    velocity_deviation_m_s=0.1,
                    reset_counter=self.resets,
                ),
                now_s,
            )

    @property
    def error_m(self) -> float:
        return dist(self.estimator.position_ned_m, self.truth(self.flight_s)[0])

    @property
    def attitude_error_deg(self) -> float:
        true = to_euler(self.truth(self.flight_s)[2])
        return max(abs(degrees(wrap_pi(a - b))) for a, b in zip(self.estimator.euler_rad, true, strict=True))


class Wing(Rig):
    """Circles as a fixed-wing aircraft does, banked, at 24 m/s."""

    speed_m_s, turn_rad_s = 24.0, 0.31

    def heading(self, flight_s: float) -> float:
        return self.turn_rad_s * (flight_s - 2.0 if flight_s > 4.0 else flight_s * flight_s / 8.0)

    def attitude(self, flight_s: float) -> Quaternion:
        share = max(0.0, min(1.0, flight_s / 4.0))
        bank = atan(self.speed_m_s * self.turn_rad_s / 9.80665) * share * share * (3.0 - 2.0 * share)
        return from_euler(bank, 0.0, self.heading(max(0.0, flight_s)))

    def truth(self, flight_s: float) -> tuple[Vector3, Vector3, Quaternion, Vector3, Vector3]:
        angle, radius_m = self.heading(flight_s), self.speed_m_s / self.turn_rad_s
        speed = self.speed_m_s * min(1.0, flight_s / 4.0)
        forward = self.speed_m_s / 4.0 if 0.0 < flight_s < 4.0 else 0.0
        inward = speed * speed / radius_m
        attitude = self.attitude(flight_s)
        force = rotate_back(
            attitude,
            (
                forward * cos(angle) - inward * sin(angle),
                forward * sin(angle) + inward * cos(angle),
                -9.80665,
            ),
        )
        position = (radius_m * sin(angle), radius_m * (1.0 - cos(angle)), 0.0)
        return position, (speed * cos(angle), speed * sin(angle), 0.0), attitude, force, self.rate(flight_s)


def test_ten_minutes_of_circling_leave_attitude_and_gyro_bias_as_they_were() -> None:
    rig = Wing()
    rig.run(3.0, flies=False)
    for _ in range(10):
        rig.run(60.0)
        assert rig.attitude_error_deg < 0.7
        assert rig.error_m < 0.08
        assert rig.estimator.inertial.gyro_bias_rad_s == pytest.approx(rig.bias, abs=5e-4)


def test_it_is_good_to_centimetres_and_half_a_degree_in_turning_flight() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    worst_m = worst_deg = 0.0
    for _ in range(40):
        rig.run(0.5)
        worst_m, worst_deg = max(worst_m, rig.error_m), max(worst_deg, rig.attitude_error_deg)
    assert worst_m < 0.08
    assert worst_deg < 1.0
    assert rig.estimator.is_position_good(rig.now_s)


def test_it_finds_the_gyro_bias_while_it_stands() -> None:
    rig = Rig()
    rig.run(2.0, flies=False)
    assert rig.estimator.inertial.gyro_bias_rad_s == pytest.approx(rig.bias, abs=1e-3)


def test_it_is_not_aligned_while_it_is_turned_by_hand() -> None:
    estimator = Estimator()
    for step in range(1000):
        estimator.imu((0.0, 0.0, -9.8), (0.3, 0.0, 0.0), step * 0.004, 0.004)
    assert not estimator.is_aligned


def test_without_fixes_the_position_is_not_good_for_long_but_the_attitude_is() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    rig.run(8.0)
    rig.has_fix = False
    rig.run(0.8)
    assert rig.estimator.is_position_good(rig.now_s)
    rig.run(0.5)
    assert not rig.estimator.is_position_good(rig.now_s)
    assert rig.estimator.is_height_good(rig.now_s)
    rig.run(2.0)
    assert rig.error_m < 1.0
    assert rig.attitude_error_deg < 5.0


def test_a_fix_that_jumps_is_refused_first_and_believed_when_it_stays() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    rig.run(5.0)
    rig.fix_offset = (20.0, 0.0, 0.0)
    rig.run(1.0)
    assert rig.error_m < 0.5
    assert rig.estimator.reset_count == 0
    rig.run(2.0)
    assert rig.estimator.reset_count == 1
    assert 19.0 < rig.error_m < 21.0


def test_a_late_fix_is_compared_with_the_past() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    rig.run(6.0)
    past = rig.truth(rig.flight_s - 0.1)[0]
    assert dist(rig.estimator.inertial.at(rig.now_s - 0.1).position_ned_m, past) < 0.08


def test_external_odometry_carries_it_indoors() -> None:
    sources = (
        AidingSource.EXTERNAL_POSITION
        | AidingSource.EXTERNAL_HEIGHT
        | AidingSource.BAROMETER
        | AidingSource.MAGNETOMETER
    )
    rig = Rig(sources=sources)
    rig.has_fix = False
    rig.external = (0.0, 0.0, 0.0)
    rig.run(3.0, flies=False)
    rig.run(10.0)
    assert rig.estimator.is_position_good(rig.now_s)
    assert rig.error_m < 0.15
    assert rig.estimator.place is None
    rig.estimator.set_origin(HOME)
    assert rig.estimator.place is not None


def test_a_reset_of_external_odometry_moves_the_position_at_once() -> None:
    sources = (
        AidingSource.EXTERNAL_POSITION
        | AidingSource.EXTERNAL_HEIGHT
        | AidingSource.BAROMETER
        | AidingSource.MAGNETOMETER
    )
    rig = Rig(sources=sources)
    rig.has_fix = False
    rig.external = (0.0, 0.0, 0.0)
    rig.run(3.0, flies=False)
    rig.run(4.0)
    before = rig.estimator.reset_count
    rig.external, rig.resets = (2.0, 0.0, 0.0), 1
    rig.run(0.5)
    assert rig.estimator.reset_count > before
    assert 1.8 < rig.error_m < 2.2


def test_the_range_finder_tells_the_ground_below() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    rig.estimator.use_range(0.5, rig.now_s)
    assert rig.estimator.height_above_ground_m == pytest.approx(0.5, abs=0.01)
    rig.estimator.use_range(None, rig.now_s)
    assert rig.estimator.height_above_ground_m != rig.estimator.height_above_ground_m


def test_variances_grow_without_measurements_and_never_become_negative() -> None:
    axis = AxisFilter(0.02, 4e-4)
    for _ in range(100):
        axis.predict(0.1)
        axis.measure_position(1e-4)
        axis.measure_velocity(2.5e-3)
    settled = axis.position_variance_m2
    assert 0.0 < settled < 1e-3
    axis.predict(2.0)
    assert axis.position_variance_m2 > settled
    assert axis.velocity_variance_m2_s2 > 0.0


def test_headings_are_right_all_round() -> None:
    for heading in (-pi, -1.0, 0.0, 2.0, 3.1):
        estimator = Estimator(declination_rad=DECLINATION)
        attitude = from_euler(0.02, -0.03, heading)
        estimator.use_magnetometer(rotate_back(attitude, FIELD_NED), 0.0)
        for step in range(250):
            estimator.imu(rotate_back(attitude, (0.0, 0.0, -9.80665)), (0.0, 0.0, 0.0), step * 0.004, 0.004)
        assert abs(wrap_pi(estimator.yaw_rad - heading)) < radians(0.5)


@pytest.mark.parametrize(("floats", "bias_rad_s"), [(True, 0.0), (False, 0.06)])
def test_what_rocks_gently_on_the_water_does_not_take_that_for_a_gyro_bias(*, floats: bool, bias_rad_s: float) -> None:
    estimator = Estimator(declination_rad=DECLINATION, floats=floats)
    steps = 0
    while not estimator.is_aligned:
        roll, rate = 0.05 * sin(1.5 * steps * 0.004), 0.075 * cos(1.5 * steps * 0.004)
        attitude = from_euler(roll, 0.0, 0.0)
        estimator.imu(rotate_back(attitude, (0.0, 0.0, -9.80665)), (rate, 0.0, 0.0), steps * 0.004, 0.004)
        steps += 1
    assert estimator.inertial.gyro_bias_rad_s[0] == pytest.approx(bias_rad_s, abs=0.015)


def test_without_inertial_samples_there_is_no_position_of_the_present() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    rig.run(8.0)
    assert rig.estimator.is_position_good(rig.now_s)
    assert not rig.estimator.is_position_good(rig.now_s + 0.2)


@pytest.mark.parametrize(("sources", "is_moved"), [(DEFAULT_SOURCES, False), (AidingSource.DEPTH, True)])
def test_a_depth_that_is_back_is_believed_and_the_pressure_of_the_air_is_not(sources: int, *, is_moved: bool) -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    estimator = rig.estimator
    estimator.sources = sources | AidingSource.BAROMETER
    down_m, altitude_m = estimator.position_ned_m[2], estimator.barometer_altitude_m
    for step in range(60):
        estimator.use_barometer(altitude_m - 30.0, rig.now_s + 1.0 + 0.04 * step)
    assert estimator.position_ned_m[2] - down_m == pytest.approx(30.0 if is_moved else 0.0, abs=0.5)


def test_the_first_reading_of_a_depth_is_that_of_a_vehicle_that_has_not_dived_yet() -> None:
    rig = Rig()
    rig.run(3.0, flies=False)
    estimator = rig.estimator
    estimator.sources = AidingSource.DEPTH | AidingSource.BAROMETER
    estimator._barometer_offset_m = float("nan")
    estimator.inertial.place((0.0, 0.0, -2.0), (0.0, 0.0, 0.0))
    estimator.use_barometer(0.0, rig.now_s)
    assert estimator.position_ned_m[2] == pytest.approx(estimator.boot_down_m)
