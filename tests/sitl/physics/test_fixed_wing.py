"""The aircraft on JSBSim: at rest, in a glide and at full throttle as its coefficients say, and the same each time."""

from math import atan2, cos, hypot, pi, sin

import pytest

from gloc3.messages.frames import GeoPoint, from_euler, rotate_back, to_euler
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.fixed_wing import FixedWing
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import gusty
from gloc3_sitl.vehicles.aerosonde import AEROSONDE

HOME = GeoPoint(47.0, 8.0, 0.0)


def aircraft(**settings: object) -> FixedWing:
    return FixedWing(AEROSONDE, Situation(home=HOME, **settings))  # type: ignore[arg-type]


def flown(body: FixedWing, seconds: float, *outputs: float) -> Truth:
    for _ in range(round(seconds * body.rate_hz)):
        body.step(outputs)
    return body.truth()


def test_it_stands_on_its_wheels_with_its_motor_off() -> None:
    truth = flown(aircraft(), 3.0, 0.0, 0.0, -1.0, 0.0)
    assert truth.is_on_ground
    assert hypot(*truth.position_ned_m) < 0.01
    assert max(map(abs, to_euler(truth.attitude_wxyz))) < 0.01


def test_in_a_glide_lift_and_sink_are_those_of_its_coefficients() -> None:
    body, model = aircraft(), AEROSONDE
    body.place((0.0, 0.0, -1000.0), from_euler(0.0, -0.05, 0.0), (22.0, 0.0, 0.0))
    truth = flown(body, 15.0, 0.0, 0.45, -1.0, 0.0)
    ahead, aside, down = rotate_back(truth.attitude_wxyz, truth.velocity_ned_m_s)
    alpha, (_, elevator, _) = atan2(down, ahead), body.surfaces_rad
    x, _, z = truth.specific_force_frd_m_s2
    share_n = 0.5 * 1.22 * (ahead**2 + aside**2 + down**2) * model.wing_m2
    lift = body.mass_kg * (x * sin(alpha) - z * cos(alpha)) / share_n
    assert lift == pytest.approx(model.lift_0 + model.lift_alpha * alpha + model.lift_elevator * elevator, abs=0.02)
    trim = model.pitch_0 + model.pitch_alpha * alpha + model.pitch_elevator * elevator
    assert trim == pytest.approx(0.0, abs=0.04)  # it turns a little
    drag = -body.mass_kg * (x * cos(alpha) + z * sin(alpha)) / share_n
    aspect = model.span_m**2 / model.wing_m2
    assert drag > model.drag_parasitic + lift**2 / (pi * model.oswald * aspect)


def test_its_motor_pulls_hardest_at_rest_and_not_at_all_when_the_air_drives_the_propeller() -> None:
    body = aircraft()
    standing = flown(body, 1.0, 0.0, 0.0, 1.0, 0.0).specific_force_frd_m_s2[0]
    assert 4.0 < standing < 8.0
    assert 1000.0 < body.truth().power_w < 2500.0
    body.place((0.0, 0.0, -500.0), from_euler(0.0, 0.0, 0.0), (25.0, 0.0, 0.0))
    assert flown(body, 0.5, 0.0, 0.3, -1.0, 0.0).power_w == AEROSONDE.avionics_w


def test_the_same_situation_and_outputs_give_the_same_flight() -> None:
    wind = gusty(6.0, 270.0)
    one, two = (flown(aircraft(wind=wind, seed=4), 8.0, 0.01, 0.4, 1.0, 0.0) for _ in range(2))
    assert one == two
    assert one != flown(aircraft(wind=wind, seed=5), 8.0, 0.01, 0.4, 1.0, 0.0)
