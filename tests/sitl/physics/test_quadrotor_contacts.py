"""The quadrotor on the ground: drops from any height and attitude, slopes of energy, other grounds."""

from math import sqrt

import pytest

from gloc3.messages.frames import GeoPoint, Vector3, from_euler
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.wind import Wind

pytestmark = pytest.mark.thorough

STOP = (0.0, 0.0, 0.0, 0.0)
ATTITUDES = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.3, 0.2), (1.57, 0.0, 0.0), (0.0, 1.57, 0.0), (3.14, 0.0, 0.0)]


def energy_j(vehicle: Quadrotor) -> float:
    truth = vehicle.truth()
    p, q, r = truth.rate_frd_rad_s
    turning = 0.5 * (0.0123 * p * p + 0.0123 * q * q + 0.0216 * r * r)
    moving = 0.5 * 1.65 * sum(v * v for v in truth.velocity_ned_m_s)
    return turning + moving + 1.65 * 9.80 * truth.height_above_ground_m


@pytest.mark.parametrize("height_m", [0.5, 2.0, 5.0])
@pytest.mark.parametrize("attitude", ATTITUDES)
def test_a_drop_in_any_attitude_settles_near_by_without_gaining_energy(
    home: GeoPoint, height_m: float, attitude: Vector3
) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -height_m), from_euler(*attitude))
    most_j = energy_j(vehicle) + 0.05
    for step in range(4 * 200):
        vehicle.step(STOP)
        force, _ = vehicle.imu()
        assert all(abs(axis) <= 157.0 for axis in force), "peaks are held within 16 g"
        if step % 5 == 0:
            assert energy_j(vehicle) <= most_j
    truth = vehicle.truth()
    assert truth.is_on_ground
    assert sqrt(sum(v * v for v in truth.velocity_ned_m_s)) < 0.01
    assert sqrt(sum(w * w for w in truth.rate_frd_rad_s)) < 0.05
    north, east, down = truth.position_ned_m
    assert abs(north) < 1.0
    assert abs(east) < 1.0
    assert -0.08 < down < 0.08


def test_it_stays_put_in_wind(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home, Wind(velocity_ned_m_s=(8.0, 0.0, 0.0)))
    for _ in range(10 * 200):
        vehicle.step(STOP)
    assert vehicle.truth().position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=0.001)


def test_friction_stops_a_landing_with_sideways_speed(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -0.02), velocity_ned_m_s=(0.6, 0.0, 0.0))
    for _ in range(500):
        vehicle.step(STOP)
    truth = vehicle.truth()
    assert abs(truth.velocity_ned_m_s[0]) < 0.01
    assert 0.0 < truth.position_ned_m[0] < 0.3


def test_ground_can_be_raised_under_the_vehicle(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    vehicle.place((0.0, 0.0, -3.0))
    vehicle.set_ground(home.altitude_m + 1.5)
    for _ in range(750):
        vehicle.step(STOP)
    truth = vehicle.truth()
    assert truth.is_on_ground
    assert truth.position_ned_m[2] == pytest.approx(-1.5, abs=0.01)
    assert truth.height_above_ground_m == pytest.approx(0.0, abs=0.01)


def test_a_home_high_above_the_sea_is_on_the_ground_too() -> None:
    vehicle = Quadrotor("pelican", GeoPoint(-33.9, 18.4, 1085.0))
    for _ in range(100):
        vehicle.step(STOP)
    truth = vehicle.truth()
    assert truth.altitude_m == pytest.approx(1085.0, abs=1e-3)
    assert truth.position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
