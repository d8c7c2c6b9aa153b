"""Flights without physics: smooth, at rest at their ends, and felt by an inertial unit as they are flown."""

from itertools import pairwise
from math import dist, hypot, pi

import numpy as np
import pytest

from gloc3.messages.frames import conjugate, from_rotation_vector, multiply, rotate, to_rotation_vector, yaw_of
from gloc3_sitl.sequences.smooth_flight import SmoothFlight
from gloc3_sitl.world import World

GRAVITY_M_S2 = np.array([0.0, 0.0, 9.80665])
HOLD = World.load("hold")
CORNERS = [(1.0, 1.0, 1.5), (9.0, 1.0, 2.0), (9.0, 7.0, 2.5), (2.0, 7.0, 1.5)]


def test_it_begins_and_ends_at_rest_where_it_should_and_keeps_its_speed_between() -> None:
    flight = SmoothFlight(HOLD, CORNERS, 0.8)
    assert flight.place_m(0.0) == pytest.approx(CORNERS[0])
    assert flight.place_m(flight.duration_s + 5.0) == pytest.approx(CORNERS[-1], abs=1e-6)
    speeds = [hypot(*flight.truth(t_s).velocity_ned_m_s) for t_s in np.arange(0.0, flight.duration_s, 0.25)]
    assert speeds[0] == 0.0
    assert max(speeds) < 0.85
    assert np.median(speeds) == pytest.approx(0.78, abs=0.05)
    straight_m = sum(dist(a, b) for a, b in pairwise(CORNERS))
    assert 0.95 * straight_m < flight.length_m <= straight_m + 1e-6


@pytest.mark.thorough
def test_what_an_inertial_unit_feels_leads_back_to_the_same_way() -> None:
    """Strapdown integration at 250 Hz over 12 s with two corners: millimetres."""
    flight = SmoothFlight(HOLD, CORNERS, 1.2)
    step_s, start = 0.004, flight.truth(0.0)
    attitude, speed = start.attitude_wxyz, np.array(start.velocity_ned_m_s)
    place = np.array(HOLD.frame.to_ned(flight.place_m(0.0)))
    for number in range(3000):
        measured = flight.truth((number + 0.5) * step_s)
        half, whole = (tuple(rate * share * step_s for rate in measured.rate_frd_rad_s) for share in (0.5, 1.0))
        middle = multiply(attitude, from_rotation_vector((half[0], half[1], half[2])))
        acceleration = np.array(rotate(middle, measured.specific_force_frd_m_s2)) + GRAVITY_M_S2
        place += speed * step_s + acceleration * step_s**2 / 2.0
        speed += acceleration * step_s
        attitude = multiply(attitude, from_rotation_vector((whole[0], whole[1], whole[2])))
    end = flight.truth(12.0)
    assert place == pytest.approx(HOLD.frame.to_ned(flight.place_m(12.0)), abs=1e-3)
    assert speed == pytest.approx(end.velocity_ned_m_s, abs=1e-3)
    assert hypot(*to_rotation_vector(multiply(conjugate(attitude), end.attitude_wxyz))) < 1e-4


def test_it_heads_along_its_way_or_as_it_is_told() -> None:
    along, fixed = SmoothFlight(HOLD, CORNERS, 0.8), SmoothFlight(HOLD, CORNERS, 0.8, yaw_rad=pi / 4.0)
    assert yaw_of(along.truth(6.0).attitude_wxyz) == pytest.approx(0.0, abs=0.01)
    assert yaw_of(along.truth(15.0).attitude_wxyz) == pytest.approx(-pi / 2.0, abs=0.05), "y is to the left"
    assert [yaw_of(fixed.truth(t_s).attitude_wxyz) for t_s in (1.0, 9.0)] == pytest.approx([-pi / 4.0] * 2, abs=0.02)
