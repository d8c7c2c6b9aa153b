"""A Jackal rolls, slips and turns as its makers publish it."""

from math import hypot, pi

import pytest

from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.rover import SkidRover
from gloc3_sitl.vehicles.jackal import JACKAL

HOME = GeoPoint(47.0, 8.0, 400.0)


def rover(heading_deg: float = 0.0) -> SkidRover:
    return SkidRover(JACKAL, Situation(home=HOME, heading_deg=heading_deg))


def drive(vehicle: SkidRover, left: float, right: float, seconds: float) -> SkidRover:
    for _ in range(round(seconds * 200)):
        vehicle.step((left, right))
    return vehicle


def test_at_full_output_it_drives_at_the_speed_of_its_data_sheet_and_its_wheels_count_that_way() -> None:
    truth = drive(rover(90.0), 1.0, 1.0, 5.0).truth()
    assert truth.velocity_ned_m_s[1] == pytest.approx(2.0, abs=0.02)
    assert truth.position_ned_m[0] == pytest.approx(0.0, abs=0.01), "straight on"
    assert truth.wheels_m == pytest.approx((truth.position_ned_m[1],) * 2, rel=0.03), "it slips a little"


def test_turned_on_the_spot_it_turns_by_two_thirds_of_what_rolling_would_give() -> None:
    vehicle = drive(rover(), 0.25, -0.25, 3.0)
    rolling = 2.0 * 0.5 / JACKAL.track_m
    _, rate = vehicle.imu()
    by_geometry = 1.0 + (JACKAL.wheelbase_m / JACKAL.track_m) ** 2
    assert rolling / rate[2] == pytest.approx(by_geometry, abs=0.01)
    assert by_geometry == pytest.approx(1.5, abs=0.02), "wheel_separation_multiplier"
    assert hypot(*vehicle.truth().position_ned_m[:2]) < 0.02


def test_it_stands_where_it_is_left_and_feels_gravity_alone() -> None:
    vehicle = drive(drive(rover(), 1.0, 0.2, 2.0), 0.0, 0.0, 3.0)
    place = vehicle.truth().position_ned_m
    drive(vehicle, 0.0, float("nan"), 5.0)
    assert vehicle.truth().position_ned_m == pytest.approx(place, abs=1e-3)
    force, rate = vehicle.imu()
    assert force == pytest.approx((0.0, 0.0, -9.80665), abs=0.01)
    assert rate == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_what_its_accelerometer_feels_adds_up_to_its_speed() -> None:
    vehicle, speed = rover(), 0.0
    for _ in range(300):
        vehicle.step((0.8, 0.8))
        speed += vehicle.imu()[0][0] / 200.0
    assert speed == pytest.approx(vehicle.truth().velocity_ned_m_s[0], rel=0.01)


def test_up_a_slope_it_is_slower_draws_more_power_and_leans_back() -> None:
    level, climbing = rover(), rover()
    for count in range(1200):
        level.step((0.5, 0.5))
        climbing.step((0.5, 0.5))
        if count % 10 == 0:
            climbing.set_ground(HOME.altitude_m + 0.2 * climbing.truth().position_ned_m[0])
    up, flat = climbing.truth(), level.truth()
    assert up.velocity_ned_m_s[0] < flat.velocity_ned_m_s[0] - 0.03
    assert up.power_w > flat.power_w + 15.0
    assert climbing.imu()[0][0] == pytest.approx(9.81 * 0.196, abs=0.2)
    assert -up.position_ned_m[2] == pytest.approx(0.2 * up.position_ned_m[0], abs=0.1)


def test_the_same_outputs_give_the_same_way_bit_for_bit() -> None:
    one, other = (drive(drive(rover(), 0.9, 0.3, 2.0), -0.2, 0.7, 2.0).truth() for _ in range(2))
    assert one == other
    assert abs(one.rate_frd_rad_s[2]) < 2.0 * pi
