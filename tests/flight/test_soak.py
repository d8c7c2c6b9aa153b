"""The soak of the page of evidence, for some minutes: missions one after another leave nothing behind."""

import msgspec
import pytest
from tests.flight.soaking import HOUR_S, Course, Sample, Soaked, slope_per_h, soak

from gloc3_sitl.flight.flight import Flight

pytestmark = pytest.mark.thorough

HOP = Course(mission="hop", platform="pelican_rtk", autopilot="px4")
WARM_H = 0.03
MOST_OBJECTS_H = 4_000.0
"""In the first minutes caches and stores are still being filled; a leak of one object a cycle would be 100 times as much."""
A_MISSION = 400
"""Objects of the planted leak in each mission."""


def test_missions_one_after_another_leave_nothing_behind_and_a_leak_would_be_seen() -> None:
    leaked: list[list[int]] = []

    def leak(flight: Flight) -> None:
        if flight.loop.time() > 0.085 * HOUR_S:
            leaked.extend([] for _ in range(A_MISSION))

    soaked = soak(HOP, 0.125, after_mission=leak, every_s=0.0)
    assert set(soaked.ends) == {"done"}, soaked.problems
    assert soaked.ends["done"] >= 14, "every disturbance came twice"
    before = [one for one in soaked.samples if one.t_s <= 0.085 * HOUR_S]
    assert slope_per_h(before, "objects", WARM_H) < MOST_OBJECTS_H
    assert slope_per_h(soaked.samples, "objects", 0.085) > 10 * MOST_OBJECTS_H
    for name in ("handles", "threads"):
        assert abs(slope_per_h(soaked.samples, name, 0.0)) < 0.01
    assert msgspec.convert(msgspec.to_builtins(soaked), Soaked) == soaked, "the page reads it from another process"


def test_a_slope_is_fitted_after_the_warm_up_alone() -> None:
    samples = [Sample(hour * HOUR_S, 10.0 * max(hour, 2.0), 0, 0, 0, 0) for hour in (0.0, 1.0, 2.0, 3.0, 4.0)]
    assert slope_per_h(samples, "resident_mb", 2.0) == pytest.approx(10.0)
    assert slope_per_h(samples[:3], "resident_mb", 0.0) == pytest.approx(0.0, abs=1e-9)
    assert slope_per_h(samples, "resident_mb", 3.5) != slope_per_h(samples, "resident_mb", 3.5), "too few for a slope"
