"""DESIGN §7, "Motion has one owner": what the driver drops, clamps and counts, and what it does when nothing is left."""

import math
from itertools import pairwise
from typing import Any

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission

from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import FlightMode, Setpoint

HOME_M = 0.3


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep.out", "running")
    flight.wait(2.5)


def sent(flight: Card, since_s: float) -> list[Any]:
    """The setpoints that went out to the autopilot."""
    return [message for t_s, message in flight.to_autopilot if t_s >= since_s and message.name == SETPOINT]


IGNORED_PLACE = 7 | 64 | 128 | 256
"""Bits of a setpoint's mask: no position, no acceleration."""
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"


def test_the_driver_obeys_who_is_granted_motion_and_every_setpoint_names_its_action(flight: Card) -> None:
    sweep(flight)
    grant = flight.last("motion/grant")
    assert grant.component == "waypoints"
    assert grant.action_id.startswith("sweep.out#")
    assert flight.last("setpoint").action_id == grant.action_id
    assert flight.driver.action_id == grant.action_id
    flight.command("pause")
    flight.wait(1.0)
    assert flight.last("motion/grant").component == "hold"
    assert flight.last("setpoint").action_id == "hold"


def test_foreign_setpoints_are_dropped_and_counted_and_move_nothing(flight: Card) -> None:
    sweep(flight)
    flight.fault("foreign_setpoints", for_s=3.0)
    flight.wait(3.0)
    assert flight.driver.foreign > 20
    assert flight.driver.is_streaming
    assert abs(flight.position_m[1]) < 0.3
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


@pytest.mark.parametrize(("fault", "counter"), [("stale_setpoints", "stale"), ("nan_setpoints", "not_finite")])
def test_bad_setpoints_are_dropped_and_counted_until_the_stream_stops_and_hold_is_commanded(
    flight: Card, fault: str, counter: str
) -> None:
    sweep(flight)
    begin_s = flight.now_s
    bad = flight.fault(fault)
    flight.await_mode(FlightMode.HOLD, 2.0)
    assert flight.now_s - begin_s < 0.5 + 0.6  # half a second without a valid one, the command, and what tells of it
    assert getattr(flight.driver, counter) > 5
    assert flight.driver.expired == 1
    assert not flight.driver.is_streaming
    assert not sent(flight, begin_s + 0.6)
    flight.until(lambda: flight.speed_m_s < 0.1, 5.0, "it stands")
    bad.end()
    flight.await_mode(FlightMode.GUIDED, 3.0)
    flight.await_state("mission", "done", 30.0)
    assert not flight.was_told("pilot")


def test_a_stale_setpoint_is_one_of_more_than_a_quarter_of_a_second(flight: Card) -> None:
    sweep(flight)
    flight.fault("topic:setpoint=stale/0.15", for_s=2.0)
    flight.wait(2.0)
    assert flight.driver.stale == 0
    assert flight.driver.is_streaming
    flight.fault("topic:setpoint=stale/0.35", for_s=0.4)
    flight.wait(0.6)
    assert flight.driver.stale > 0


def test_no_setpoints_at_all_stop_the_stream_within_half_a_second_and_hold_is_commanded(flight: Card) -> None:
    sweep(flight)
    begin_s = flight.now_s
    flight.fault("no_setpoints", for_s=4.0)
    flight.await_mode(FlightMode.HOLD, 2.0)
    late = [(t_s, message) for t_s, message in flight.to_autopilot if message.name == SETPOINT and t_s - begin_s > 0.1]
    assert all(message.type_mask & IGNORED_PLACE == IGNORED_PLACE for _, message in late), "it is braked meanwhile"
    speeds = [math.hypot(message.vx, message.vy, message.vz) for _, message in late]
    assert speeds == sorted(speeds, reverse=True)
    assert late[-1][0] - begin_s < 0.55
    commands = [t_s for t_s, message in flight.to_autopilot if t_s > begin_s and message.name.startswith("COMMAND")]
    assert 0.45 < commands[0] - begin_s < 0.65
    flight.await_state("mission", "done", 30.0)


def test_setpoints_over_the_limits_are_clamped_and_counted_by_the_driver(flight: Card) -> None:
    sweep(flight)
    begin_s = flight.now_s
    flight.fault("far_setpoints", for_s=6.0)
    flight.wait(6.0)
    assert flight.driver.clamped > 20
    limits = flight.last("motion/limits")
    positions = [(message.x, message.y, message.z) for message in sent(flight, begin_s)]
    assert all(x <= 20.0 - limits.fence_margin_m + 0.01 for x, _, _ in positions)
    assert all(math.dist(a, b) <= limits.speed_m_s * 0.2 + 0.05 for a, b in pairwise(positions))
    speeds = [math.hypot(*truth.velocity_ned_m_s[:2]) for truth in flight.since(begin_s, "sim/truth")]
    assert max(speeds) < limits.speed_m_s + 0.8
    assert flight.position_m[0] < 20.0 - limits.fence_margin_m + 0.3


def test_the_limiter_drops_setpoints_of_others_before_the_driver_sees_them(flight: Card) -> None:
    sweep(flight)
    before = flight.driver.foreign  # one may have been on its way to the driver when the owner changed
    flight.fault("topic:setpoint_wanted/waypoints=foreign", for_s=2.0)
    flight.wait(2.0)
    assert flight.driver.foreign == before
    assert {setpoint.action_id for setpoint in flight.since(flight.now_s - 2.0, "setpoint")} == {
        flight.last("motion/grant").action_id
    }
    flight.await_state("mission", "done", 30.0)


def test_with_no_owner_the_hold_controller_owns(flight: Card) -> None:
    sweep(flight)
    flight.command("skip")
    flight.wait(1.0)
    assert flight.state("mission") == "skipped"
    assert flight.last("motion/grant").component == "hold"
    flight.until(lambda: flight.speed_m_s < 0.05, 6.0, "it stands")
    assert flight.driver.is_streaming
    assert flight.autopilot.mode is FlightMode.GUIDED


def test_nobody_owns_motion_on_the_ground(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    assert flight.last("motion/grant").component == ""
    stranger = Setpoint(action_id="", position_ned_m=(1.0, 1.0, -2.0))
    begin_s = flight.now_s
    for _ in range(20):
        envelope: Envelope[Any] = flight.envelope("setpoint", stranger)
        flight.flight.exchange.publish(envelope)
        flight.wait(0.05)
    assert not sent(flight, begin_s)
    assert flight.driver.foreign >= 20
