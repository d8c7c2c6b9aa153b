"""`flown_by: autopilot`: a task's ways are plans of the autopilot's own, and all that operators may do holds."""

import pytest
from tests.flight.card import Card

from gloc3.vehicle import FlightMode

MISSION = """mission: by the autopilot
frame: hold
on_failure: land
on_link_loss: continue
tasks:
  depart: {actions: {climb: {take_off: {height_m: 2}}}}
  sweep:
    after: [depart]
    flown_by: autopilot
    actions:
      out:  {follow_waypoints: {waypoints_m: [[6, 2, 2], [6, 6, 2], [2, 6, 3]], speed_m_s: 1.0}}
      back: {go_to: {position_m: [2, 2, 2], speed_m_s: 2.0}, after: [out]}
  recover: {after: [sweep], actions: {down: {land: {}}}}
"""


def test_a_task_is_flown_by_plans_of_the_autopilot_paused_and_gone_on_with(flight: Card) -> None:
    flight.begin(MISSION)
    flight.await_mode(FlightMode.MISSION, 20.0)
    flight.until(lambda: flight.position_m[1] > 3.0, 20.0, "it is on the second leg")
    flight.command("pause")
    flight.await_mode(FlightMode.HOLD, 5.0)
    flight.wait(2.0)
    assert flight.speed_m_s < 0.2
    flight.command("resume")
    flight.await_mode(FlightMode.MISSION, 8.0)
    held = flight.flight.simulator.autopilot.plans.mission
    assert len(held) == 2 + 1 + (flight.autopilot.style == "ardupilot")
    flight.await_state("sweep.out", "done", 30.0)
    assert flight.position_m == pytest.approx((2.0, 6.0, 3.0), abs=0.6)
    flight.await_state("mission", "done", 60.0)
    assert not flight.driver.has_pilot_control
    assert flight.position_m[:2] == pytest.approx((2.0, 2.0), abs=0.7)
