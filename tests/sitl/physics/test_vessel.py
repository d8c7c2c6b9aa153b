"""An Otter floats, runs and turns as its published model does, in current, wind and waves."""

from collections.abc import Callable
from math import degrees, hypot
from statistics import pstdev

import pytest

from gloc3.messages.frames import GeoPoint, to_euler
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.vessel import Vessel, hydrodynamics
from gloc3_sitl.physics.water import STILL, Water, Waves
from gloc3_sitl.physics.wind import CALM, Wind, gusty
from gloc3_sitl.vehicles.otter import OTTER

HOME = GeoPoint(63.4, 10.4, 0.0)


def vessel(water: Water = STILL, wind: Wind = CALM, seed: int = 0, heading_deg: float = 0.0) -> Vessel:
    return Vessel(OTTER, Situation(home=HOME, water=water, wind=wind, seed=seed, heading_deg=heading_deg))


def run(vehicle: Vessel, left: float, right: float, seconds: float, see: Callable[[], None] = lambda: None) -> Vessel:
    for _ in range(round(seconds * 200)):
        vehicle.step((left, right))
        see()
    return vehicle


def test_its_masses_and_draught_are_those_of_the_marine_systems_simulator() -> None:
    snapshot = hydrodynamics(OTTER)
    assert snapshot.draught_m == pytest.approx(0.195, abs=0.001)
    assert (snapshot.surge_kg, snapshot.sway_kg) == pytest.approx((85.5, 162.5))
    assert snapshot.yaw_kg_m2 == pytest.approx(42.65, abs=0.05)


def test_at_full_thrust_it_runs_six_knots_and_comes_to_rest_when_its_propellers_stop() -> None:
    vehicle = run(vessel(), 1.0, 1.0, 15.0)
    assert vehicle.truth().velocity_ned_m_s[0] == pytest.approx(6.0 * 0.5144, abs=0.03)
    run(vehicle, 0.0, 0.0, 10.0)
    assert vehicle.truth().velocity_ned_m_s[0] < 0.01


def test_a_small_difference_of_thrust_settles_at_the_turn_rate_that_damping_allows() -> None:
    vehicle = run(vessel(), 0.2, -0.2, 20.0)
    rate = vehicle.imu()[1][2]
    moment = OTTER.pontoon_arm_m * 0.04 * (OTTER.thrust_ahead_n + OTTER.thrust_astern_n)
    yaw = hydrodynamics(OTTER).yaw_kg_m2
    assert yaw * (1.0 + 10.0 * rate) * rate == pytest.approx(moment, rel=0.05)


def test_the_current_carries_it_and_a_wind_blows_it_downwind_broadside_on() -> None:
    drifting = run(vessel(Water(current_ned_m_s=(0.3, -0.4, 0.0))), 0.0, 0.0, 30.0).truth()
    assert drifting.velocity_ned_m_s[:2] == pytest.approx((0.3, -0.4), abs=0.01)
    blown = run(vessel(wind=Wind(velocity_ned_m_s=(0.0, 10.0, 0.0)), heading_deg=20.0), 0.0, 0.0, 120.0).truth()
    assert 0.05 < blown.velocity_ned_m_s[1] < 1.0
    assert abs(abs(degrees(to_euler(blown.attitude_wxyz)[2])) % 180.0) < 60.0


def test_waves_heave_it_as_high_as_they_are_and_roll_and_pitch_it() -> None:
    heights: list[float] = []
    leans: list[float] = []
    vehicle = vessel(Water(waves=Waves(height_m=0.4, period_s=4.0, from_deg=90.0)), seed=3)

    def see() -> None:
        if vehicle.steps % 20 == 0:
            truth = vehicle.truth()
            heights.append(-truth.position_ned_m[2])
            leans.append(hypot(*to_euler(truth.attitude_wxyz)[:2]))

    run(vehicle, 0.0, 0.0, 120.0, see)
    assert 4.0 * pstdev(heights) == pytest.approx(0.4, rel=0.25), "significant height is four deviations"
    assert 2.0 < degrees(max(leans)) < 25.0


def test_what_its_accelerometer_feels_adds_up_to_its_speed() -> None:
    vehicle, speed = vessel(), 0.0
    for _ in range(600):
        vehicle.step((0.7, 0.7))
        speed += vehicle.imu()[0][0] / 200.0
    assert speed == pytest.approx(vehicle.truth().velocity_ned_m_s[0], rel=0.01)


def test_the_same_seed_gives_the_same_voyage_and_another_one_another() -> None:
    sea = Water(waves=Waves(height_m=0.3))
    one, same, other = (run(vessel(sea, gusty(6.0, 0.0), seed), 0.5, 0.4, 4.0).truth() for seed in (1, 1, 2))
    assert one == same
    assert one != other
