"""The quadrotor in the air: hover, free fall, controls, position on Earth and what it costs."""

import os
import threading
from collections.abc import Callable
from math import cosh, exp, log, pi, sqrt

import pytest

from gloc3.errors import Misuse
from gloc3.messages.frames import GeoPoint, TangentPlane, from_yaw, to_euler
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.vehicles import PELICAN

STOP = (0.0, 0.0, 0.0, 0.0)


def test_it_stands_at_rest_on_its_home_and_feels_gravity(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home, heading_deg=90.0)
    for _ in range(200):
        vehicle.step(STOP)
    truth = vehicle.truth()
    assert truth.t_s == 1.0
    assert truth.position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=2e-4)
    assert truth.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert truth.attitude_wxyz == pytest.approx(from_yaw(pi / 2), abs=1e-6)
    assert truth.specific_force_frd_m_s2 == pytest.approx((0.0, 0.0, -9.80), abs=0.01)
    assert (truth.latitude_deg, truth.longitude_deg) == pytest.approx(home[:2], abs=1e-8)
    assert truth.altitude_m == pytest.approx(home.altitude_m, abs=1e-3)
    assert truth.height_above_ground_m == pytest.approx(0.0, abs=1e-3)
    assert truth.is_on_ground
    assert truth.standing_height_m == vehicle.standing_height_m == pytest.approx(0.0973, abs=1e-3)
    assert vehicle.mass_kg == pytest.approx(1.65, abs=1e-6)


def test_it_hovers_at_about_half_throttle_as_thrust_and_weight_say(
    home: GeoPoint, pilot: Callable[..., object], fly: Callable[..., None]
) -> None:
    vehicle, hold = Quadrotor("pelican", home), pilot()
    fly(vehicle, hold, 12.0)
    throttles = hold(vehicle)  # type: ignore[operator]
    share = 1.65 * 9.80 / (4 * PELICAN.thrust_max_n)
    curve = PELICAN.throttle_curve
    expected = (sqrt((1 - curve) ** 2 + 4 * curve * share) - (1 - curve)) / (2 * curve)
    assert sum(throttles) / 4 == pytest.approx(expected, abs=0.003) == pytest.approx(0.524, abs=0.01)
    truth = vehicle.truth()
    assert truth.position_ned_m == pytest.approx((0.0, 0.0, -3.0), abs=0.05)
    assert truth.power_w == pytest.approx(250.0, abs=10.0), "16 minutes from 69 Wh at full load, says the data sheet"
    assert not truth.is_on_ground


def test_free_fall_is_that_of_gravity_less_drag(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -30.0))
    for _ in range(200):
        vehicle.step(STOP)
    truth = vehicle.truth()
    gravity, drag = 9.80, 0.5 * 1.225 * PELICAN.drag_area_top_m2 / 1.65
    terminal = sqrt(gravity / drag)
    expected = terminal * (1 - exp(-2 * gravity / terminal)) / (1 + exp(-2 * gravity / terminal))
    assert truth.velocity_ned_m_s[2] == pytest.approx(expected, rel=0.01)
    assert truth.position_ned_m[2] + 30.0 == pytest.approx(
        terminal**2 / gravity * log(cosh(gravity / terminal)), abs=0.01
    )
    assert -truth.specific_force_frd_m_s2[2] == pytest.approx(drag * expected**2, rel=0.05)


def test_each_control_turns_the_body_the_way_its_motors_say(home: GeoPoint) -> None:
    more, less = 0.55, 0.50
    mixes = {
        "roll right": ((less, more, more, less), 0),
        "nose up": ((more, less, more, less), 1),
        "turn right": ((more, more, less, less), 2),
    }
    for name, (throttles, axis) in mixes.items():
        vehicle = Quadrotor("pelican", home)
        vehicle.place((0.0, 0.0, -20.0))
        for _ in range(75):
            vehicle.step(throttles)
        rates = vehicle.truth().rate_frd_rad_s
        assert rates[axis] > 0.1, name
        assert all(abs(rate) < 0.01 for i, rate in enumerate(rates) if i != axis), name


def test_rotors_follow_the_throttle_with_their_lag(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -20.0))
    for _ in range(round(PELICAN.spin_up_s * 200)):
        vehicle.step((1.0, 1.0, 1.0, 1.0))
    expected = PELICAN.rotor_speed_max_rad_s * (1 - exp(-1))
    assert vehicle.rotor_speeds_rad_s == pytest.approx((expected,) * 4, rel=1e-6)
    for _ in range(500):
        vehicle.step((1.0, 1.0, 1.0, 1.0))
    climb_m_s = -vehicle.truth().velocity_ned_m_s[2]
    assert climb_m_s == pytest.approx(8.0, abs=1.0), "the data sheet's 8 m/s"


def test_throttles_out_of_range_or_not_numbers_are_clipped(home: GeoPoint) -> None:
    odd, plain = Quadrotor("pelican", home), Quadrotor("pelican", home)
    for _ in range(50):
        odd.step((float("nan"), -3.0, 7.0, float("inf")))
        plain.step((0.0, 0.0, 1.0, 1.0))
    assert odd.truth() == plain.truth()


@pytest.mark.parametrize("latitude_deg", [-65.0, 0.0, 39.5528, 78.0])
def test_positions_hundreds_of_metres_away_agree_with_wgs84_to_a_millimetre(latitude_deg: float) -> None:
    home = GeoPoint(latitude_deg, 11.0, 120.0)
    plane = TangentPlane(home)
    vehicle = Quadrotor("pelican", home)
    for position in ((500.0, -400.0, -40.0), (-300.0, 700.0, -2.0), (0.0, 0.0, -100.0)):
        vehicle.place(position)
        truth = vehicle.truth()
        assert truth.position_ned_m == pytest.approx(position, abs=1e-3)
        assert plane.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m) == pytest.approx(
            truth.position_ned_m, abs=1e-3
        )
        fall_m = (position[0] ** 2 + position[1] ** 2) / (2 * 6.371e6)
        assert truth.height_above_ground_m + position[2] == pytest.approx(fall_m, abs=2e-3), "the Earth curves away"


def test_velocity_adds_up_to_the_way_flown(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -200.0), from_yaw(0.4), (12.0, -9.0, 0.0))
    north = east = down = 0.0
    was = vehicle.truth()
    for _ in range(1000):
        vehicle.step((0.5, 0.5, 0.5, 0.5))
        now = vehicle.truth()
        north += (was.velocity_ned_m_s[0] + now.velocity_ned_m_s[0]) / 400
        east += (was.velocity_ned_m_s[1] + now.velocity_ned_m_s[1]) / 400
        down += (was.velocity_ned_m_s[2] + now.velocity_ned_m_s[2]) / 400
        was = now
    assert now.position_ned_m == pytest.approx((north, east, down - 200.0), abs=0.03)


def test_the_specific_force_carries_the_velocity_from_one_step_to_the_next(
    home: GeoPoint, pilot: Callable[..., Callable[[Quadrotor], tuple[float, float, float, float]]]
) -> None:
    from gloc3.messages.frames import rotate

    vehicle, hold = Quadrotor("pelican", home), pilot(5.0)
    vehicle.place((4.0, -3.0, -5.0))
    was, error_m_s = vehicle.truth(), [0.0, 0.0, 0.0]
    for _ in range(500):
        vehicle.step(hold(vehicle))
        now = vehicle.truth()
        force_ned = rotate(was.attitude_wxyz, now.specific_force_frd_m_s2)
        for i, gravity in enumerate((0.0, 0.0, 9.8013)):
            error_m_s[i] += now.velocity_ned_m_s[i] - was.velocity_ned_m_s[i] - (force_ned[i] + gravity) / 200
        was = now
    assert error_m_s == pytest.approx((0.0, 0.0, 0.0), abs=0.005), "what a strapdown estimator would be off after 2 s"


def test_truth_is_computed_once_a_step(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    assert vehicle.truth() is vehicle.truth()
    assert vehicle.truth().truth() is vehicle.truth()
    assert vehicle.truth().imu() == vehicle.imu()
    before = vehicle.truth()
    vehicle.step(STOP)
    assert vehicle.truth() is not before


def test_it_is_silent_even_in_another_thread(home: GeoPoint, capfd: pytest.CaptureFixture[str]) -> None:
    before = dict(os.environ)
    thread = threading.Thread(target=lambda: Quadrotor("pelican", home).step(STOP))
    thread.start()
    thread.join()
    Quadrotor("pelican", home).step(STOP)
    assert capfd.readouterr() == ("", "")
    assert dict(os.environ) == before


def test_unknown_vehicles_and_slow_rates_are_refused(home: GeoPoint) -> None:
    with pytest.raises(Misuse, match="pelican"):
        Quadrotor("pelikan", home)
    with pytest.raises(Misuse, match="120"):
        Quadrotor("pelican", home, rate_hz=50)


def test_another_rate_gives_nearly_the_same_flight(
    home: GeoPoint, pilot: Callable[..., object], fly: Callable[..., None]
) -> None:
    slow, fast = Quadrotor("pelican", home, rate_hz=200), Quadrotor("pelican", home, rate_hz=400)
    for vehicle in (slow, fast):
        vehicle.place((2.0, 1.0, -3.0), from_yaw(0.3))
        fly(vehicle, pilot(), 4.0)
    assert slow.truth().position_ned_m == pytest.approx(fast.truth().position_ned_m, abs=0.05)
    assert to_euler(slow.truth().attitude_wxyz) == pytest.approx(to_euler(fast.truth().attitude_wxyz), abs=0.02)
