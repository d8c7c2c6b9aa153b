"""An operator steers the ROV by hand: over the command link, in virtual time, with the limits that hold for every motion."""

from collections.abc import Iterator
from math import dist, hypot
from pathlib import Path
from typing import Any

import pytest
from tests.flight.card import Card

from gloc3.messages.command_interface import Control, ControlVerb, Outcome
from gloc3.messages.teleoperation import EXPIRES_S, VelocityDemand
from gloc3.messages.vehicle import Pose
from gloc3_groundstation.desk.teleoperation import FullSpeed, HandControl
from gloc3_groundstation.joysticks.device import StickDemand

MISSION = """\
mission: by hand
frame: bay
geofence: {polygon_m: [[-40, -40], [60, -40], [60, 40], [-40, 40]], ceiling_m: 3}
on_failure: hold
tasks:
  up: {actions: {surface: {land: {}}}}
"""
STOPS_WITHIN_M = 1.5
"""From 0.4 m/s, after the key is let go."""


@pytest.fixture
def rov(tmp_path: Path) -> Iterator[Card]:
    """The ROV at 2 m depth, being steered by hand."""
    card = Card("ardupilot", tmp_path)
    card.begin(MISSION, is_started=False, platform="rov", world="bay", seed=3)
    assert card.action("dive", depth_m=2).outcome is Outcome.ACCEPTED
    card.until(lambda: card.state("command-1") == "done", 60.0, "down")
    assert card.action("teleoperate").outcome is Outcome.ACCEPTED
    card.until(lambda: card.driver.action_id not in ("", "hold"), 5.0, "motion is given")
    card.wait(2.0)
    yield card
    card.close()
    assert not card.failures, card.failures


def hand(rov: Card) -> HandControl:
    return HandControl(rov.flight.station.client, rov.flight.loop, "rov", FullSpeed(0.4, 0.2, 20.0))


def place(rov: Card) -> tuple[float, float, float]:
    pose: Pose = rov.last("pose")
    return pose.position_ned_m


def speed(rov: Card) -> float:
    return hypot(*rov.last("pose").velocity_ned_m_s)


def state(rov: Card) -> Any:
    return rov.last("ci/teleoperation")


def test_it_goes_where_it_is_steered_and_stops_when_the_key_is_let_go(rov: Card) -> None:
    keys, began = hand(rov), place(rov)
    keys.move(StickDemand(surge=1.0))
    keys.hold_key(10.0)
    rov.until(lambda: speed(rov) > 0.35, 8.0, "it goes")
    assert state(rov).is_live
    assert state(rov).velocity_cm_s == (40, 0, 0)
    assert state(rov).measured_cm_s[0] > 30
    assert abs(place(rov)[2] - began[2]) < 0.3, "depth is kept"
    let_go = place(rov)
    keys.release()
    rov.until(lambda: speed(rov) < 0.05, 8.0, "it stands")
    assert 0.2 < dist(let_go, place(rov)) < STOPS_WITHIN_M
    assert not rov.until(lambda: not state(rov).is_live, 1.0, "expired") > EXPIRES_S
    rested = place(rov)
    rov.always(lambda: dist(rested, place(rov)) < 0.4, 10.0, "it keeps its place")

    keys.move(StickDemand(heave=-1.0, yaw=1.0))
    keys.hold_key(5.0)
    rov.wait(5.5)
    assert place(rov)[2] - rested[2] == pytest.approx(0.9, abs=0.4)
    yaw_rates = [one.measured_yaw_rate_cdeg_s for one in rov.since(rov.now_s - 3.0, "ci/teleoperation")]
    assert max(yaw_rates) == pytest.approx(2000, abs=500)

    keys.move(StickDemand(surge=-1.0))
    keys.hold_key(3.0)
    rov.wait(2.5)
    rov.command("abort", "command-3")
    rov.until(lambda: rov.driver.action_id == "hold", 1.0, "it keeps its place")
    rov.until(lambda: speed(rov) < 0.05, 8.0, "it stands")
    assert rov.mission.policy == "hold"


def test_a_link_that_falls_silent_stops_it_at_once_and_the_policy_of_a_lost_link_ends_it(rov: Card) -> None:
    keys = hand(rov)
    keys.move(StickDemand(sway=1.0))
    keys.hold_key(60.0)
    rov.until(lambda: speed(rov) > 0.3, 8.0, "it goes")
    at, lost_s = place(rov), rov.now_s
    rov.fault("link_loss", for_s=30.0)
    rov.until(lambda: not state(rov).is_live, EXPIRES_S + 0.5, "expired")
    rov.until(lambda: speed(rov) < 0.1, 6.0, "it stands")
    assert dist(at, place(rov)) < STOPS_WITHIN_M + 0.4 * EXPIRES_S
    rov.await_policy("hold", 15.0)
    assert rov.now_s - lost_s > 4.0


def test_only_the_holder_of_control_steers(rov: Card) -> None:
    began = place(rov)
    flight = rov.flight

    def demand(sequence: int) -> None:
        body = VelocityDemand(sender="254", session=9, sequence=sequence, velocity_cm_s=(40, 0, 0))
        flight.exchange.publish(rov.envelope("velocity_demand", body))

    for sequence in range(20):
        demand(sequence)
        rov.wait(0.1)
    assert dist(began, place(rov)) < 0.3
    assert not state(rov).is_live
    assert rov.was_told("velocities of station 254 are ignored: station 255 holds control")
    rov.as_station("254", Control(verb=ControlVerb.TAKE_OVER))
    for sequence in range(20, 60):
        demand(sequence)
        rov.wait(0.1)
    assert state(rov).is_live
    assert dist(began, place(rov)) > 0.5


def test_the_pilot_takes_the_sticks_and_what_is_demanded_moves_nothing_any_more(rov: Card) -> None:
    keys = hand(rov)
    keys.move(StickDemand(surge=1.0))
    keys.hold_key(30.0)
    rov.until(lambda: speed(rov) > 0.3, 8.0, "it goes")
    rov.fault("pilot:poshold")
    rov.await_policy("pilot", 3.0)
    rov.wait(1.0)
    assert not rov.driver.is_streaming
    assert rov.driver.has_pilot_control
    used = state(rov).sequence
    rov.wait(2.0)
    assert state(rov).sequence == used, "the action has ended"
