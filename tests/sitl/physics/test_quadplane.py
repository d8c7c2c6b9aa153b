"""The quadplane on JSBSim: on its feet, carried by its rotors, carried by its wings, and the same each time."""

from math import hypot

import pytest

from gloc3.messages.frames import GRAVITY_M_S2, GeoPoint, from_euler, to_euler
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.lift_rotors import Quadplane
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import gusty
from gloc3_sitl.vehicles.quadplane import LIFT_ROTORS, QUADPLANE

HOME = GeoPoint(47.0, 8.0, 0.0)
OFF = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def aircraft(**settings: object) -> Quadplane:
    return Quadplane(QUADPLANE, LIFT_ROTORS, Situation(home=HOME, **settings))  # type: ignore[arg-type]


def flown(body: Quadplane, seconds: float, *outputs: float) -> Truth:
    for _ in range(round(seconds * body.rate_hz)):
        body.step(outputs)
    return body.truth()


def throttle_for(share: float) -> float:
    """The throttle that gives this share of a rotor's full thrust."""
    curve = LIFT_ROTORS.throttle_curve
    half = (1.0 - curve) / (2.0 * curve)
    return float((half * half + share / curve) ** 0.5 - half)


def test_it_stands_on_its_feet_with_its_motors_off() -> None:
    truth = flown(aircraft(), 3.0, *OFF)
    assert truth.is_on_ground
    assert hypot(*truth.position_ned_m) < 0.01
    assert max(map(abs, to_euler(truth.attitude_wxyz))) < 0.01


def test_rotors_at_half_of_their_thrust_carry_it_and_draw_the_power_of_their_momentum() -> None:
    body = aircraft()
    body.place((0.0, 0.0, -100.0))
    share = body.mass_kg * GRAVITY_M_S2 / (4.0 * LIFT_ROTORS.thrust_max_n)
    throttle = throttle_for(share)
    truth = flown(body, 0.8, 0.0, 0.0, -1.0, 0.0, *(4 * (throttle,)))
    assert truth.specific_force_frd_m_s2[2] == pytest.approx(-GRAVITY_M_S2, rel=0.1)
    assert 1_600.0 < truth.power_w < 2_300.0


def test_each_rotor_turns_it_to_its_own_side() -> None:
    # front right left down and nose up, rear left, front left, rear right; yaw against the turn of the rotor
    for rotor, (roll, pitch, yaw) in enumerate(((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1))):
        body = aircraft()
        body.place((0.0, 0.0, -100.0))
        throttles = [0.5] * 4
        throttles[rotor] += 0.1
        p, q, r = flown(body, 0.3, 0.0, 0.0, -1.0, 0.0, *throttles).rate_frd_rad_s
        assert p * roll > 0.05
        assert q * pitch > 0.05
        assert r * yaw > 0.005


def test_at_cruise_its_wings_carry_it_with_rotors_that_stand() -> None:
    body = aircraft()
    body.place((0.0, 0.0, -500.0), from_euler(0.0, 0.07, 0.0), (25.0, 0.0, 0.0))
    truth = flown(body, 4.0, 0.0, 0.45, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert abs(truth.velocity_ned_m_s[2]) < 5.0
    assert truth.velocity_ned_m_s[0] > 18.0
    assert truth.power_w < 1_200.0


def test_the_same_situation_and_outputs_give_the_same_flight() -> None:
    def end() -> tuple[float, ...]:
        body = aircraft(wind=gusty(5.0, 270.0), seed=3)
        return flown(body, 4.0, 0.1, 0.1, 0.2, 0.0, 0.6, 0.6, 0.6, 0.6).position_ned_m

    assert end() == end()
