"""Gusts: as strong and as long as their model says at a height over the ground, wherever the sea is."""

from statistics import fmean, stdev

import pytest

from gloc3.messages.frames import GeoPoint, Vector3
from gloc3_sitl.physics.gusts import Gusts
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.wind import gusty

PERIOD_S = 0.05


def blown(height_m: float, seconds: float) -> list[Vector3]:
    gusts = Gusts(seed=1)
    wind = gusty(6.0, from_deg=270.0)
    return [gusts.step(wind, height_m, 7.0, PERIOD_S) for _ in range(int(seconds / PERIOD_S))]


@pytest.mark.parametrize(("height_m", "along", "down"), [(1.5, 1.18, 0.6), (150.0, 0.73, 0.6)])
def test_gusts_have_the_deviations_of_their_model(height_m: float, along: float, down: float) -> None:
    # MIL-F-8785C, 6 m/s at 20 ft: 0.6 / (0.177 + 0.000823 h)^0.4 along and across, at 10 and at 492 ft; 0.6 down.
    north, east, vertical = zip(*blown(height_m, 3000.0), strict=True)
    assert stdev(east) == pytest.approx(along, rel=0.25)
    assert stdev(north) == pytest.approx(along, rel=0.25)
    assert stdev(vertical) == pytest.approx(down, rel=0.25)


def test_near_the_ground_an_updraught_is_over_in_a_second() -> None:
    down = [gust[2] for gust in blown(1.5, 600.0)]
    later = int(2.0 / PERIOD_S)
    likeness = fmean(a * b for a, b in zip(down, down[later:], strict=False)) / fmean(a * a for a in down)
    assert abs(likeness) < 0.1


def test_the_same_wind_blows_on_a_hill_as_at_the_sea() -> None:
    def wind(altitude_m: float) -> list[Vector3]:
        vehicle = Quadrotor("pelican", GeoPoint(63.44, 10.4, altitude_m), gusty(6.0, 270.0), seed=2)
        measured = []
        for _ in range(100):
            vehicle.step((0.0, 0.0, 0.0, 0.0))
            measured.append(vehicle.truth().wind_ned_m_s)
        return measured

    for low, high in zip(wind(2.0), wind(488.0), strict=True):
        assert low == pytest.approx(high, abs=0.01)
