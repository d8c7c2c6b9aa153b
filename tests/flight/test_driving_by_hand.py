"""An operator drives the rover by hand, as the ROV is steered: within the fence, and only while demands come."""

from math import degrees, hypot
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.messages.command_interface import Outcome
from gloc3.messages.frames import yaw_of
from gloc3.messages.teleoperation import EXPIRES_S
from gloc3_groundstation.desk.teleoperation import FullSpeed, HandControl
from gloc3_groundstation.joysticks.device import StickDemand

MISSION = """\
mission: by hand
frame: site
geofence: {polygon_m: [[-12, -12], [12, -12], [12, 12], [-12, 12]], ceiling_m: 3}
on_failure: hold
tasks:
  end: {actions: {stop: {land: {}}}}
"""


def test_a_rover_goes_ahead_turns_on_the_spot_stops_before_the_fence_and_when_demands_end(tmp_path: Path) -> None:
    card = Card("ardupilot", tmp_path)
    try:
        card.begin(MISSION, is_started=False, platform="rover", seed=3)
        assert card.action("drive_off").outcome is Outcome.ACCEPTED
        card.until(lambda: card.state("command-1") == "done", 30.0, "it is armed")
        assert card.action("teleoperate").outcome is Outcome.ACCEPTED
        card.until(lambda: card.driver.action_id not in ("", "hold"), 5.0, "motion is given")
        keys = HandControl(card.flight.station.client, card.flight.loop, "rover", FullSpeed(1.0, 0.3, 20.0))

        def speed() -> float:
            return hypot(*card.last("pose").velocity_ned_m_s)

        keys.move(StickDemand(surge=1.0))
        keys.hold_key(30.0)
        card.until(lambda: speed() > 0.9, 5.0, "it goes")
        card.until(lambda: speed() < 0.1, 20.0, "the fence is near")
        assert 8.0 < card.last("pose").position_ned_m[0] < 10.5, "2 m of margin"
        keys.move(StickDemand(yaw=1.0))
        card.until(lambda: degrees(yaw_of(card.last("pose").ned_from_frd)) > 85.0, 6.0, "it turns on the spot")
        keys.move(StickDemand(surge=0.5))
        card.until(lambda: speed() > 0.4, 5.0, "it goes along the fence")
        keys.release()
        card.until(lambda: not card.last("ci/teleoperation").is_live, EXPIRES_S + 0.3, "expired")
        card.until(lambda: speed() < 0.05, 4.0, "it stands")
        assert card.last("pose").position_ned_m[0] == pytest.approx(9.5, abs=1.0)
        card.command("abort", "command-3")
        card.until(lambda: card.driver.action_id == "hold", 1.0, "it keeps its place")
    finally:
        card.close()
    assert not card.failures, card.failures
