"""A pose that is valid is as good as it claims, also where the autopilot's own position is wrong."""

from bisect import bisect
from math import hypot
from pathlib import Path

import pytest
from tests.flight.card import ONE_STYLE, Card

SIGMA = 4.0
MOST_S = 0.3
"""So long a valid pose may be worse than it claims."""
HOVER = """\
mission: hover
frame: hold
tasks:
  up: {actions: {off: {take_off: {height_m: 3}}}}
  wait: {after: [up], actions: {there: {go_to: {position_m: [4, 2, 3], speed_m_s: 0.5, hold_s: 40}}}}
  down: {after: [wait], actions: {end: {land: {}}}}
"""


def dishonest_s(card: Card) -> float:
    """The longest time for which a valid pose was more than four of its standard deviations off."""
    samples = list(card.flight.truth.samples)
    times = [sample.t_s for sample in samples]
    longest_s, since_s = 0.0, None
    for envelope in card.received["pose"]:
        after = bisect(times, envelope.t_s)
        if not 0 < after < len(samples):
            continue
        before, then = samples[after - 1], samples[after]
        share = (envelope.t_s - before.t_s) / (then.t_s - before.t_s)
        north, east = (
            told - (one + share * (other - one))
            for told, one, other in zip(
                envelope.payload.position_ned_m[:2], before.position_ned_m[:2], then.position_ned_m[:2], strict=True
            )
        )
        is_off = hypot(north, east) > SIGMA * hypot(*envelope.payload.position_std_m[:2])
        since_s = (since_s or envelope.t_s) if is_off and envelope.payload.is_valid else None
        longest_s = max(longest_s, 0.0 if since_s is None else envelope.t_s - since_s)
    return longest_s


@pytest.mark.parametrize(
    "fault",
    [
        "sensor:fix=stuck@25..",
        "sensor:fix=stuck@12..",
        "sensor:fix=biased/2@25..",
        "topic:autopilot_pose=jump/2@25..32",
    ],
)
@ONE_STYLE
def test_a_position_has_a_second_opinion(flight: Card, fault: str) -> None:
    flight.begin(HOVER, platform="pelican_rtk", faults=(fault,), seed=1)
    flight.wait(34.0)
    assert dishonest_s(flight) <= MOST_S
    assert max(pose.position_std_m[0] for pose in flight.since(20.0, "pose")) > 0.5


@ONE_STYLE
def test_an_autopilot_that_follows_a_frozen_receiver_is_not_led_any_further(flight: Card) -> None:
    flight.begin(HOVER, platform="pelican_rtk", faults=("sensor:fix=stuck@25..",), seed=1)
    flight.until(lambda: not flight.last("pose").is_valid, 40.0, "the pose is invalid")
    assert "the satellite receiver has been repeating one position for" in flight.last("pose").reason
    flight.await_policy("land", 8.0)


@ONE_STYLE
def test_a_receiver_of_metres_is_no_better_than_it_claims(flight: Card) -> None:
    flight.begin(HOVER, platform="pelican_rtk", is_plain_gps=True, seed=1)
    flight.wait(25.0)
    assert dishonest_s(flight) <= MOST_S
    assert flight.last("pose").position_std_m[0] > 0.5


@pytest.mark.both_styles
def test_a_receiver_that_is_metres_off_is_no_certain_position(flight: Card) -> None:
    flight.begin(HOVER, platform="pelican_rtk", faults=("sensor:fix=biased@25..32",), seed=1)
    flight.wait(30.0)
    assert dishonest_s(flight) <= MOST_S
    assert flight.last("pose").position_std_m[0] > 1.0


def test_a_boat_without_its_inertial_unit_does_not_claim_centimetres(tmp_path: Path) -> None:
    card = Card("ardupilot", tmp_path)
    try:
        card.begin("survey", platform="boat", faults=("sensor:imu=lost@30..60",), seed=1)
        card.wait(70.0)
        assert dishonest_s(card) <= MOST_S
    finally:
        card.close()
