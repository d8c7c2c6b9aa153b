"""The autopilot's own return keeps below the mission's ceiling, or the mission does not start."""

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission

from gloc3.errors import Refused

HEIGHTS = {"px4": "RTL_RETURN_ALT", "ardupilot": "RTL_ALT_M"}
RETURNS = {"px4": {"COM_LOW_BAT_ACT": 3}, "ardupilot": {"BATT_FS_LOW_ACT": 2}}


@pytest.mark.both_styles
def test_a_mission_through_whose_ceiling_the_autopilot_would_return_does_not_start(flight: Card) -> None:
    name = HEIGHTS[flight.style]
    with pytest.raises(Refused, match=rf"climbs to 15 m above home.*\n.*set {name} to 7.1 or less"):
        flight.begin(mission(), parameters={name: 15, **RETURNS[flight.style]})


@pytest.mark.both_styles
def test_a_return_of_the_autopilot_s_own_stays_below_the_ceiling(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep.out", "running")
    flight.wait(4.0)
    flight.fault("pilot:return")
    flight.await_landed(90.0)
    assert max(-truth.position_ned_m[2] for truth in flight.since(0.0, "sim/truth")) < 4.0
    assert abs(flight.position_m[0]) < 1.0
