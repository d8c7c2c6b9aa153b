"""Motions put end to end, and what is supposed where an odometer could not tell one."""

from math import cos, degrees, sin

import pytest

from gloc3.messages.frames import from_yaw, yaw_of
from gloc3.messages.perception import Odometry, no_motion
from gloc3_onboard.algorithms.odometry.chain import OdometryChain

PERIOD_S, SPEED_M_S, TURN_RAD_S = 0.1, 0.5, 0.2


def step(t_s: float) -> Odometry:
    """What an odometer tells of the last 0.1 s of a bend."""
    turn = TURN_RAD_S * PERIOD_S
    way = SPEED_M_S * PERIOD_S
    return Odometry(
        source="stereo",
        reference_t_s=t_s - PERIOD_S,
        position_m=(way * cos(0.5 * turn), way * sin(0.5 * turn), 0.0),
        reference_from_frd=from_yaw(turn),
    )


def test_over_a_gap_the_body_goes_on_and_turns_as_before_but_not_for_ever() -> None:
    chain = OdometryChain()
    times = [round(PERIOD_S * n, 3) for n in range(1, 21)]
    for t_s in times:
        assert chain.add(step(t_s), t_s)
    before, heading = chain.position_m, yaw_of(chain.attitude)
    assert heading == pytest.approx(TURN_RAD_S * 2.0, abs=1e-6)
    assert not chain.add(no_motion("stereo", 3.5, "the picture is white"), 3.5)
    assert degrees(yaw_of(chain.attitude)) == pytest.approx(degrees(TURN_RAD_S * 3.5), abs=1.0)
    assert sum((a - b) ** 2 for a, b in zip(chain.position_m, before, strict=True)) == pytest.approx(0.75**2, rel=0.02)
    chain.add(step(3.6), 3.6)  # goes on from there
    assert degrees(yaw_of(chain.attitude)) == pytest.approx(degrees(TURN_RAD_S * 3.6), abs=1.0)
    chain.add(no_motion("stereo", 9.0, "the picture is white"), 9.0)
    assert degrees(yaw_of(chain.attitude)) == pytest.approx(degrees(TURN_RAD_S * 5.6), abs=1.5)
