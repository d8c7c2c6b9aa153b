"""Plans of other programs are flown as they are, by the autopilot, under our supervision and policies."""

import json
import math
from math import dist
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.messages.vehicle import FlightMode

HOME = (39.5528, 2.6285)
M_NORTH, M_EAST = 1 / 111_030.0, 1 / 85_960.0
"""Degrees a metre there."""


def row(
    index: int, command: int, *, north_m: float = 0.0, east_m: float = 0.0, up_m: float = 0.0, **params: float
) -> str:
    """An item of a file of waypoints, in metres from home."""
    p = [params.get(f"p{number}", 0.0) for number in (1, 2, 3, 4)]
    is_placed = bool(north_m or east_m)
    x, y = (HOME[0] + north_m * M_NORTH, HOME[1] + east_m * M_EAST) if is_placed else (0.0, 0.0)
    return f"{index} 0 3 {command} {p[0]} {p[1]} {p[2]} {p[3]} {x:.7f} {y:.7f} {up_m} 1\n"


LOOPS = (
    "QGC WPL 110\n"
    f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 2 1\n"
    + row(1, 22, up_m=4)
    + row(2, 16, north_m=8, up_m=4)
    + row(3, 82, north_m=8, east_m=8, up_m=5)
    + row(4, 183, p1=9, p2=1500)
    + row(5, 177, p1=2, p2=1)
    + row(6, 115, p1=90)
    + row(7, 19, north_m=2, east_m=8, up_m=5, p1=3)
    + row(8, 20)
)


FOR_PX4 = (
    LOOPS.replace(" 82 ", " 16 ").replace(" 183 ", " 187 ").replace(" 115 ", " 112 ").replace(" 112 90.0", " 112 1.0")
)
"""The same with items that PX4 has: a waypoint, an actuator and a delay."""


def loops(flight: Card) -> str:
    return FOR_PX4 if flight.style == "px4" else LOOPS


def mission(content: str, **policies: str) -> str:
    tops = "".join(f"{key}: {value}\n" for key, value in policies.items())
    carried = json.dumps({"field.waypoints": content})
    return f"mission: as it is\nframe: geo\n{tops}tasks:\n  fly:\n    flown_by: autopilot\n    plan: {carried}\n"


def passes(flight: Card, north_m: float, east_m: float) -> int:
    """How often the vehicle came to a place."""
    times, was_near = 0, False
    for sample in flight.flight.truth.samples:
        is_near = dist(sample.position_ned_m[:2], (north_m, east_m)) < 1.5
        times += is_near and not was_near
        was_near = is_near
    return times


@pytest.mark.both_styles
def test_a_plan_with_a_jump_a_spline_and_a_servo_is_flown_from_take_off_to_landing(flight: Card) -> None:
    flight.begin(mission(loops(flight)), platform="pelican_rtk")
    flight.await_mode(FlightMode.MISSION, 30.0)
    flight.await_state("mission", "done", 200.0)
    assert passes(flight, 8.0, 0.0) == 2
    assert passes(flight, 8.0, 8.0) == 2
    assert not flight.driver.has_pilot_control
    assert not flight.autopilot.is_armed
    assert dist(flight.position_m[:2], (0.0, 0.0)) < 1.5
    held = flight.flight.simulator.autopilot.plans.mission
    of_px4, of_ardupilot = [22, 16, 16, 187, 177, 112, 19, 20], [16, 22, 16, 82, 183, 177, 115, 19, 20]
    assert [item.command for item in held] == (of_px4 if flight.style == "px4" else of_ardupilot)


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_an_item_that_the_autopilot_does_not_know_is_named(flight: Card) -> None:
    flight.begin(mission(LOOPS), platform="pelican_rtk")
    flight.await_state("fly", "failed", 10.0)
    (reason,) = {event.text for event in flight.events if event.text.startswith("fly.plan failed")}
    assert "the plan could not be uploaded: item 3, NAV_SPLINE_WAYPOINT: an item's command" in reason


def on_the_way(flight: Card, **policies: str) -> None:
    """The autopilot flies item 3 for the first time."""
    flight.begin(mission(loops(flight), **policies), platform="pelican_rtk")
    flight.await_mode(FlightMode.MISSION, 30.0)
    flight.until(lambda: flight.position_m[0] > 7.0 and flight.position_m[2] > 3.0, 60.0, "it has come to item 2")
    flight.until(
        lambda: flight.flight.simulator.autopilot.craft.mission.current >= 3 - (flight.style == "px4"), 20.0, ""
    )


@pytest.mark.both_styles
def test_after_a_pause_it_goes_on_at_the_item_where_it_was_without_another_upload(flight: Card) -> None:
    on_the_way(flight)
    uploads = flight.flight.simulator.autopilot.plans.mission_count
    flight.command("pause")
    flight.until(lambda: flight.autopilot.mode is not FlightMode.MISSION, 2.0, "it leaves the plan")
    flight.wait(4.0)
    flight.command("resume")
    flight.await_mode(FlightMode.MISSION, 10.0)
    flight.await_state("mission", "done", 200.0)
    assert flight.flight.simulator.autopilot.plans.mission_count == uploads
    assert (passes(flight, 8.0, 0.0), passes(flight, 8.0, 8.0)) == (2, 2)


def test_while_this_computer_is_away_the_plan_goes_on_and_is_found_where_it_is(flight: Card) -> None:
    on_the_way(flight, on_restart="continue")
    uploads = flight.flight.simulator.autopilot.plans.mission_count
    flight.fault("restart", for_s=1.5)
    flight.wait(1.0)
    assert flight.flight.simulator.autopilot.commander.mode.behaviour == "mission"
    flight.await_state("mission", "done", 200.0)
    assert flight.flight.simulator.autopilot.plans.mission_count == uploads
    assert passes(flight, 8.0, 8.0) == 2
    assert not flight.autopilot.is_armed


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_a_lost_link_has_its_policy_while_a_plan_is_flown_as_it_is(flight: Card) -> None:
    on_the_way(flight, on_link_loss="hold", link_loss_after_s="2")
    flight.fault("link_loss")
    flight.await_policy("hold", 4.0)
    flight.until(lambda: flight.autopilot.mode is not FlightMode.MISSION, 2.0, "it leaves the plan")


def test_a_pilot_takes_over_from_a_plan_and_gives_it_back(flight: Card) -> None:
    on_the_way(flight)
    flight.fault("pilot:position")
    flight.await_state("mission", "paused", 1.0)
    flight.always(lambda: flight.autopilot.mode is FlightMode.MANUAL, 3.0, "nobody takes it from him")
    flight.command("resume")
    flight.await_state("mission", "done", 200.0)
    assert passes(flight, 8.0, 8.0) == 2


def test_a_return_that_a_pilot_chooses_in_the_middle_of_a_plan_is_his(flight: Card) -> None:
    on_the_way(flight)
    flight.fault("pilot:return")
    flight.await_state("mission", "paused", 1.0)
    assert flight.driver.has_pilot_control


DRIVE = (
    "QGC WPL 110\n"
    f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 2 1\n"
    + row(1, 16, north_m=10, up_m=30)
    + row(2, 93, p1=3)
    + row(3, 16, north_m=10, east_m=8, up_m=30)
)


def test_a_plan_for_a_vehicle_that_drives_needs_no_take_off(tmp_path: Path) -> None:
    card = Card("ardupilot", tmp_path)
    try:
        card.begin(mission(DRIVE), platform="rover")
        card.await_mode(FlightMode.MISSION, 20.0)
        card.await_state("mission", "done", 120.0)
        assert min(dist(one.position_ned_m[:2], (10.0, 0.0)) for one in card.flight.truth.samples) < 2.5
        assert dist(card.flight.truth.samples[-1].position_ned_m[:2], (10.0, 8.0)) < 3.5
    finally:
        card.close()


CIRCLES = (
    "QGC WPL 110\n"
    f"0 1 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 2 1\n"
    + row(1, 22, up_m=4)
    + row(2, 600, p1=7)
    + row(3, 18, north_m=12, up_m=4, p1=2, p3=5)
    + row(4, 211, p1=1)
    + row(5, 601, p1=7, p2=1)
    + row(6, 20)
)


def turns(flight: Card, north_m: float, east_m: float) -> float:
    """How often the vehicle went round a place, within 7 m of it."""
    total_rad, before = 0.0, None
    for sample in flight.flight.truth.samples:
        north, east = sample.position_ned_m[0] - north_m, sample.position_ned_m[1] - east_m
        angle = math.atan2(east, north) if 3.0 < math.hypot(north, east) < 7.0 else None
        if angle is not None and before is not None:
            total_rad += math.remainder(angle - before, math.tau)
        before = angle
    return abs(total_rad) / math.tau


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
def test_turns_a_gripper_and_a_jump_to_a_tag_are_flown_as_ardupilot_does(flight: Card) -> None:
    flight.begin(mission(CIRCLES), platform="pelican_rtk")
    flight.await_state("mission", "done", 300.0)
    assert turns(flight, 12.0, 0.0) == pytest.approx(4.0, abs=0.6)


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_what_px4_does_not_know_is_refused_by_it_and_the_reason_is_told(flight: Card) -> None:
    flight.begin(mission(CIRCLES), platform="pelican_rtk")
    flight.await_state("fly.plan", "failed", 30.0)
    assert any("the plan could not be uploaded" in event.text for event in flight.events)
    assert not flight.autopilot.is_armed


def test_a_plan_that_drives_home_is_done_there_although_nothing_disarms(tmp_path: Path) -> None:
    card = Card("ardupilot", tmp_path)
    try:
        card.begin(mission(DRIVE + row(4, 20)), platform="rover")
        card.await_state("mission", "done", 160.0)
        assert dist(card.flight.truth.samples[-1].position_ned_m[:2], (0.0, 0.0)) < 3.5
    finally:
        card.close()
