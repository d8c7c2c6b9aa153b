"""`flown_by: autopilot`: a task's ways are plans of the autopilot's own, and all that operators may do holds."""

from math import dist
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.messages.vehicle import FlightMode

MISSION = """mission: by the autopilot
frame: hold
on_failure: land
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

DRIVE = """mission: driven by the autopilot
frame: site
tasks:
  away: {actions: {off: {depart: {}}}}
  box:
    after: [away]
    flown_by: autopilot
    actions: {way: {follow_waypoints: {waypoints_m: [[14, 0, 0], [14, -9, 0]], speed_m_s: 1.5, acceptance_m: 2.5}}}
  end: {after: [box], actions: {stop: {land: {}}}}
"""


def on_the_second_leg(flight: Card, **policies: str) -> None:
    """The autopilot has passed the first waypoint by itself."""
    tops = "".join(f"{key}: {value}\n" for key, value in policies.items())
    flight.begin(tops + MISSION)
    flight.await_mode(FlightMode.MISSION, 20.0)
    flight.until(lambda: flight.position_m[1] > 3.0, 20.0, "it is on the second leg")


def leaves(flight: Card) -> None:
    """It does not fly the plan any more, and stands."""
    flight.until(lambda: flight.autopilot.mode is not FlightMode.MISSION, 2.0, "it leaves the plan")
    flight.until(lambda: flight.speed_m_s < 0.1, 4.0, "it stands")


@pytest.mark.both_styles
def test_a_task_is_flown_by_plans_of_the_autopilot_paused_and_gone_on_with(flight: Card) -> None:
    on_the_second_leg(flight)
    flight.command("pause")
    leaves(flight)
    flight.command("resume")
    flight.await_mode(FlightMode.MISSION, 8.0)
    held = flight.flight.simulator.autopilot.plans.mission
    assert len(held) == 2 + 1 + (flight.style == "ardupilot"), "a speed, and the two places that are left"
    flight.await_state("sweep.out", "done", 30.0)
    assert flight.position_m == pytest.approx((2.0, 6.0, 3.0), abs=0.6)
    flight.await_state("mission", "done", 60.0)
    assert not flight.driver.has_pilot_control
    assert flight.position_m[:2] == pytest.approx((2.0, 2.0), abs=0.7)


def test_what_is_skipped_of_it_is_followed_by_the_next_plan_and_an_abort_ends_it(flight: Card) -> None:
    on_the_second_leg(flight)
    flight.command("skip", "sweep.out")
    flight.await_state("sweep.back", "running", 2.0)
    flight.until(lambda: flight.position_m[0] < 4.0, 20.0, "it is on its way back")
    assert flight.autopilot.mode is FlightMode.MISSION
    flight.command("abort")
    flight.until(lambda: flight.autopilot.mode is not FlightMode.MISSION, 2.0, "it leaves the plan")
    flight.await_landed()
    assert flight.state("sweep.back") == "aborted"


def test_a_pilot_takes_over_from_the_plan_and_gives_it_back(flight: Card) -> None:
    on_the_second_leg(flight)
    flight.fault("pilot:position")
    flight.until(lambda: flight.driver.has_pilot_control, 0.5, "the driver sees the pilot")
    flight.await_state("mission", "paused", 0.5)
    flight.always(lambda: flight.autopilot.mode is FlightMode.MANUAL, 4.0, "nobody takes it from him")
    flight.command("resume")
    flight.await_state("mission", "done", 80.0)
    assert flight.position_m[:2] == pytest.approx((2.0, 2.0), abs=0.7)


def test_while_this_computer_is_away_the_autopilot_flies_on_and_is_found_where_it_is(flight: Card) -> None:
    on_the_second_leg(flight, on_restart="continue")
    flight.fault("restart", for_s=1.5)
    flight.wait(1.0)
    assert flight.flight.simulator.autopilot.commander.mode.behaviour == "mission"
    assert flight.speed_m_s > 0.7
    flight.await_state("mission", "done", 80.0)
    assert len([one for one in flight.events if "sweep.out done" in one.text]) == 1
    assert flight.position_m[:2] == pytest.approx((2.0, 2.0), abs=0.7)


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_a_lost_link_has_its_policy_while_a_plan_is_flown(flight: Card) -> None:
    on_the_second_leg(flight, on_link_loss="hold", link_loss_after_s="2")
    flight.fault("link_loss")
    flight.await_policy("hold", 4.0)
    leaves(flight)


@pytest.mark.parametrize(("vehicle", "near_m"), [("rover", 2.5), ("boat", 3.5)])
def test_vehicles_that_drive_are_given_plans_too(vehicle: str, near_m: float, tmp_path: Path) -> None:
    card = Card("ardupilot", tmp_path)
    try:
        card.begin(DRIVE, platform=vehicle)
        card.await_mode(FlightMode.MISSION, 20.0)
        card.await_state("mission", "done", 120.0)
        way = [sample.position_ned_m[:2] for sample in card.flight.truth.samples]
        assert min(dist(at, (14.0, 0.0)) for at in way) < near_m
        assert min(dist(at, (14.0, 9.0)) for at in way) < near_m
        assert not card.flight.simulator.autopilot.craft.is_armed
    finally:
        card.close()
