"""The control loops alone: mixer, attitude, trajectory."""

from math import atan2, hypot, pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.messages.frames import from_euler, rotate, to_euler, wrap_pi
from gloc3_sitl.autopilot.airframe import PELICAN
from gloc3_sitl.autopilot.control.multirotor import Mixer
from gloc3_sitl.autopilot.control.position import PositionController, PositionGains
from gloc3_sitl.autopilot.control.rates import AttitudeController, RateController, attitude_for
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint
from gloc3_sitl.autopilot.control.trajectory import SmoothTrajectory, TrajectoryLimits

pytestmark = pytest.mark.thorough

SHARE = st.floats(-1.0, 1.0)
STILL = (0.0, 0.0, 0.0)


def torques(throttles: tuple[float, float, float, float]) -> tuple[float, float, float]:
    front_right, rear_left, front_left, rear_right = throttles
    return (
        rear_left + front_left - front_right - rear_right,
        front_right + front_left - rear_left - rear_right,
        front_right + rear_left - front_left - rear_right,
    )


@given(st.floats(0.0, 1.0), SHARE, SHARE, SHARE)
def test_throttles_are_always_between_stop_and_full(thrust: float, roll: float, pitch: float, yaw: float) -> None:
    throttles = Mixer(0.3).mix(thrust, roll, pitch, yaw)
    assert all(0.0 <= throttle <= 1.0 + 1e-9 for throttle in throttles)


@given(st.floats(0.0, 1.0), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.5, 0.5))
def test_yaw_and_lift_give_way_before_roll_and_pitch(thrust: float, roll: float, pitch: float, yaw: float) -> None:
    mixed = torques(Mixer(0.0).mix(thrust, roll, pitch, yaw))
    assert mixed[0] == pytest.approx(4.0 * roll, abs=1e-9)
    assert mixed[1] == pytest.approx(4.0 * pitch, abs=1e-9)
    assert abs(mixed[2]) <= 4.0 * abs(yaw) + 1e-9


def test_what_fits_is_mixed_as_it_is() -> None:
    mixer = Mixer(0.0)
    mixed = torques(mixer.mix(0.5, 0.05, -0.03, 0.02))
    assert mixed == pytest.approx((0.2, -0.12, 0.08))
    assert not mixer.is_saturated


def test_the_thrust_curve_is_undone() -> None:
    throttle = Mixer(0.3).mix(0.45, 0.0, 0.0, 0.0)[0]
    assert 0.3 * throttle**2 + 0.7 * throttle == pytest.approx(0.45)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-15.0, -4.0), st.floats(-pi, pi))
def test_the_attitude_for_a_force_points_the_thrust_along_it(x: float, y: float, z: float, yaw: float) -> None:
    attitude = attitude_for((x, y, z), yaw)
    down = rotate(attitude, (0.0, 0.0, 1.0))
    size = (x * x + y * y + z * z) ** 0.5
    assert down == pytest.approx((-x / size, -y / size, -z / size), abs=1e-9)
    lean = atan2(hypot(x, y), -z)
    assert abs(wrap_pi(to_euler(attitude)[2] - yaw)) <= lean * lean / 3.0 + 1e-6


def test_attitude_errors_turn_the_body_back_by_the_shorter_way() -> None:
    controller = AttitudeController((6.0, 6.0, 3.0))
    level = from_euler(0.0, 0.0, 0.0)
    p, q, r = controller.update(level, from_euler(0.1, -0.05, 0.0), 0.0)
    assert (p, q) == pytest.approx((0.6, -0.3), rel=0.02)
    assert r == pytest.approx(0.0, abs=0.02)
    _, _, r = controller.update(from_euler(0.0, 0.0, radians(170.0)), from_euler(0.0, 0.0, radians(-170.0)), 0.0)
    assert r > 0.0


def test_the_rate_loop_opposes_a_rate_and_its_integral_waits_while_saturated() -> None:
    controller = RateController(PELICAN, 0.004)
    assert controller.update(STILL, (0.5, 0.0, 0.0), is_saturated=True)[0] < 0.0
    for _ in range(100):
        held = controller.update((1.0, 0.0, 0.0), (1.0 - 0.1, 0.0, 0.0), is_saturated=True)[0]
    for _ in range(100):
        grown = controller.update((1.0, 0.0, 0.0), (1.0 - 0.1, 0.0, 0.0), is_saturated=False)[0]
    assert grown > held


def test_the_position_loop_respects_its_speed_lean_and_thrust() -> None:
    gains = PositionGains(tilt_rad=radians(20.0))
    controller = PositionController(gains)
    force = controller.update(MotionSetpoint(position_ned_m=(100.0, 0.0, -100.0)), STILL, STILL, STILL, 0.46, 0.02)
    assert atan2(hypot(force[0], force[1]), -force[2]) <= radians(20.0) + 1e-9
    wanted = controller.velocity_wanted_ned_m_s
    assert hypot(wanted[0], wanted[1]) <= gains.speed_xy_m_s + 1e-9
    assert wanted[2] >= -gains.speed_up_m_s
    assert -force[2] / 9.80665 * 0.46 <= gains.thrust_max


def test_an_axis_without_a_wish_is_left_to_the_acceleration() -> None:
    controller = PositionController(PositionGains())
    nothing = float("nan")
    setpoint = MotionSetpoint(
        position_ned_m=(nothing, nothing, -2.0), acceleration_ned_m_s2=(1.0, 0.0, 0.0), velocity_ned_m_s=(nothing,) * 3
    )
    force = controller.update(setpoint, (5.0, 5.0, -2.0), (3.0, 0.0, 0.0), STILL, 0.46, 0.02)
    assert force == pytest.approx((1.0, 0.0, -9.80665))


@given(
    st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-20.0, 20.0)),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0)),
)
def test_a_trajectory_arrives_within_its_limits_and_stays(
    target: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    limits = TrajectoryLimits()
    trajectory = SmoothTrajectory(limits, STILL, velocity)
    trajectory.go_to(target)
    for _ in range(50 * 60):
        before = trajectory.acceleration
        trajectory.advance(0.02)
        now = trajectory.acceleration
        assert hypot(now[0], now[1]) <= limits.acceleration_xy_m_s2 + 1e-6
        assert hypot(now[0] - before[0], now[1] - before[1]) <= limits.jerk_m_s3 * 0.02 + 1e-6
        if trajectory.distance_m < 0.005 and hypot(*trajectory.velocity) < 0.005:
            break
    assert trajectory.distance_m < 0.01


@pytest.mark.parametrize("distance", [0.1, 1.0, 3.0, 6.0, 30.0])
def test_a_trajectory_from_rest_does_not_overshoot(distance: float) -> None:
    trajectory = SmoothTrajectory(TrajectoryLimits(jerk_m_s3=6.0, acceleration_xy_m_s2=3.0), STILL)
    trajectory.go_to((distance, 0.0, 0.0))
    farthest = 0.0
    for _ in range(50 * 20):
        trajectory.advance(0.02)
        farthest = max(farthest, trajectory.position[0])
    assert farthest < distance + 0.01


def test_stopping_needs_no_way_back() -> None:
    trajectory = SmoothTrajectory(TrajectoryLimits(), STILL, (4.0, 3.0, 0.5))
    trajectory.stop()
    slowest = 0.0
    for _ in range(50 * 10):
        trajectory.advance(0.02)
        slowest = min(slowest, trajectory.velocity[0])
    assert slowest > -0.1
    assert trajectory.distance_m < 0.02
