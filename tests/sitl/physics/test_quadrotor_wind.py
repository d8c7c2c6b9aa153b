"""Wind and turbulence: how they push, how strong they are, and that seeds decide."""

import os
import subprocess
import sys
from collections.abc import Callable
from math import atan
from pathlib import Path
from statistics import fmean, stdev

import pytest

from gloc3.messages.frames import GeoPoint, Vector3, to_euler
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.wind import CALM, Wind, gusty
from gloc3_sitl.vehicles import PELICAN

pytestmark = pytest.mark.thorough

SCRIPT = """
import hashlib, struct, sys
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.wind import gusty
vehicle = Quadrotor("pelican", GeoPoint(39.5528, 2.6285, 2.0), gusty(6.0, 30.0), seed=int(sys.argv[1]))
digest = hashlib.sha256()
for i in range(1000):
    lift = 0.53 + 0.01 * (i % 7)
    vehicle.step((lift, lift, lift, lift - 0.001))
    truth = vehicle.truth()
    values = (*truth.position_ned_m, *truth.attitude_wxyz, *truth.specific_force_frd_m_s2, *truth.wind_ned_m_s)
    digest.update(struct.pack("<13d", *values))
print(digest.hexdigest())
"""


def trajectory_digest(seed: int, hash_seed: str) -> str:
    root = Path(__file__).parents[3]
    environment = os.environ | {"PYTHONPATH": f"{root}/common:{root}/sitl", "PYTHONHASHSEED": hash_seed}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(seed)], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout


def test_a_seed_gives_one_trajectory_in_any_process_and_another_seed_another() -> None:
    first = trajectory_digest(5, "1")
    assert len(first.splitlines()) == 1
    assert trajectory_digest(5, "2") == first
    assert trajectory_digest(6, "1") != first


def test_two_vehicles_that_are_stepped_in_turn_do_not_disturb_each_other(home: GeoPoint) -> None:
    def track(vehicles: list[Quadrotor]) -> list[Vector3]:
        places = []
        for _ in range(300):
            for vehicle in vehicles:
                vehicle.step((0.55, 0.55, 0.55, 0.55))
            places.append(vehicles[0].truth().position_ned_m)
        return places

    wind = gusty(6.0, 0.0)
    alone = track([Quadrotor("pelican", home, wind, seed=3)])
    beside = track([Quadrotor("pelican", home, wind, seed=3), Quadrotor("pelican", home, wind, seed=4)])
    assert alone == beside


def test_a_level_vehicle_drifts_until_it_moves_with_the_wind(
    home: GeoPoint, pilot: Callable[..., object], fly: Callable[..., None]
) -> None:
    vehicle = Quadrotor("pelican", home, Wind(velocity_ned_m_s=(6.0, -2.0, 0.0)))
    vehicle.place((0.0, 0.0, -20.0))
    hold = pilot(20.0, holds_place=False)
    fly(vehicle, hold, 2.0)
    assert 0.4 < vehicle.truth().velocity_ned_m_s[0] < 3.0, "it takes seconds: rotors and airframe push with about 2 N"
    fly(vehicle, hold, 40.0)
    assert vehicle.truth().velocity_ned_m_s == pytest.approx((6.0, -2.0, 0.0), abs=0.05)


def test_holding_against_6_m_s_takes_the_tilt_that_the_drag_says(
    home: GeoPoint, pilot: Callable[..., object], fly: Callable[..., None]
) -> None:
    vehicle = Quadrotor("pelican", home, Wind(velocity_ned_m_s=(6.0, 0.0, 0.0)))
    fly(vehicle, pilot(), 25.0)
    truth = vehicle.truth()
    assert truth.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    rotors = PELICAN.rotor_drag_n_s2_m_rad * sum(vehicle.rotor_speeds_rad_s) * 6.0
    body = 0.5 * 1.225 * PELICAN.drag_area_side_m2 * 36.0
    assert to_euler(truth.attitude_wxyz)[1] == pytest.approx(atan((rotors + body) / (1.65 * 9.8)), abs=0.005)


def test_gusts_have_the_strength_that_their_model_states(
    home: GeoPoint, pilot: Callable[..., object], fly: Callable[..., None]
) -> None:
    along, upward = [], []
    for seed in (1, 2, 3):
        vehicle, hold = Quadrotor("pelican", home, gusty(6.0, 0.0), seed=seed), pilot()
        fly(vehicle, hold, 3.0)
        for _ in range(200):
            fly(vehicle, hold, 0.1)
            wind = vehicle.truth().wind_ned_m_s
            along.append(wind[0])
            upward.append(wind[2])
    assert fmean(along) == pytest.approx(-6.0, abs=0.8), "wind from the north blows south"
    assert stdev(along) == pytest.approx(1.2, abs=0.4)
    assert stdev(upward) == pytest.approx(0.6, abs=0.2)


def test_wind_can_change_in_flight(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home, Wind(velocity_ned_m_s=(0.0, 5.0, -1.0)))
    vehicle.step((0.0, 0.0, 0.0, 0.0))
    assert vehicle.truth().wind_ned_m_s == pytest.approx((0.0, 5.0, -1.0))
    vehicle.wind = CALM
    vehicle.step((0.0, 0.0, 0.0, 0.0))
    assert vehicle.truth().wind_ned_m_s == pytest.approx((0.0, 0.0, 0.0))
    assert vehicle.wind is CALM


def test_calm_air_is_the_same_for_every_seed(home: GeoPoint) -> None:
    a, b = Quadrotor("pelican", home, seed=1), Quadrotor("pelican", home, seed=2)
    for vehicle in (a, b):
        for _ in range(200):
            vehicle.step((0.6, 0.6, 0.6, 0.6))
    assert a.truth() == b.truth()
