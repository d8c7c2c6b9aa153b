"""A pose that is late is waited for in a hold; after 2 s it is lost, and the mission's policy acts."""

import re
from math import dist

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.vehicle import FlightMode

HOME_M = 0.3
AT_REST_M_S = 0.15


def silenced(flight: Card, for_s: float | None, *, policy: str = "land", topic: str = "pose") -> float:
    """In the middle of the sweep poses stay away for a time; the time at which that begins."""
    flight.begin(mission(on_pose_lost=policy))
    flight.await_state("sweep", "running")
    flight.wait(5.0)
    assert flight.speed_m_s > 0.8
    flight.fault(f"topic:{topic}=lost", for_s=for_s)
    return flight.now_s


def modes(flight: Card, since_s: float) -> list[FlightMode]:
    """The modes of the autopilot, each time that it changed."""
    seen = [one.mode for one in flight.since(since_s, "autopilot")]
    return [mode for index, mode in enumerate(seen) if index == 0 or mode is not seen[index - 1]]


@pytest.mark.parametrize("late_s", [0.6, 1.5])
@pytest.mark.parametrize("topic", ["pose", "autopilot_pose"])
def test_a_late_pose_is_waited_for_in_a_hold_and_the_mission_goes_on(flight: Card, late_s: float, topic: str) -> None:
    begin_s = silenced(flight, late_s, topic=topic)
    began_m = flight.position_m
    flight.wait(late_s - 0.05)
    if late_s > 1.0:
        assert flight.speed_m_s < AT_REST_M_S
    assert dist(flight.position_m, began_m) < 1.0  # 0.3 s until it brakes, and 0.4 m of braking from 1 m/s
    assert flight.was_told(": holding, waiting up to 2 s", begin_s)
    flight.until(lambda: flight.was_told("pose is back after ", begin_s), 0.5, "it is back")
    assert modes(flight, begin_s) == [FlightMode.GUIDED]
    assert flight.mission.tasks["sweep"] == "running"
    flight.await_state("sweep", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    flight.await_state("mission", "done", 30.0)
    assert not flight.was_told("pose lost", begin_s)
    assert not flight.was_told("policy", begin_s)


def test_a_pose_that_stays_away_for_two_seconds_is_lost(flight: Card) -> None:
    begin_s = silenced(flight, 3.0)
    flight.wait(1.7)
    assert flight.mission.policy == ""
    assert flight.speed_m_s < AT_REST_M_S
    flight.await_policy("land", 1.0)
    assert 1.95 < flight.now_s - begin_s < 2.4
    assert flight.was_told("pose lost: no pose for 2 s; policy: land", begin_s)
    assert not flight.was_told("pose is back", begin_s)
    flight.await_landed()


def test_a_mission_that_says_continue_holds_for_as_long_as_it_takes_and_goes_on(flight: Card) -> None:
    begin_s = silenced(flight, 6.0, policy="continue")
    flight.wait(4.0)
    assert flight.was_told("pose lost: no pose for 2 s; policy: continue", begin_s)
    assert flight.mission.tasks["sweep"] == "running"
    assert flight.autopilot.mode is FlightMode.HOLD
    held_m = flight.position_m
    flight.wait(1.9)
    assert dist(flight.position_m, held_m) < 0.3
    flight.until(lambda: flight.was_told("pose lost: over", begin_s), 1.0, "it is back")
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


@ONE_STYLE
def test_a_vehicle_beside_its_fence_stays_inside_while_it_waits(flight: Card) -> None:
    fence = "{polygon_m: [[-2, -2], [6.3, -2], [6.3, 12], [-2, 12]], ceiling_m: 8}"
    flight.begin(mission("{out: {follow_waypoints: {waypoints_m: [[5.4, 0, 1.5]], speed_m_s: 1.0}}}", fence=fence))
    flight.await_state("sweep", "running")
    flight.until(lambda: flight.position_m[0] > 4.4, 20.0, "near the fence")
    flight.fault("topic:pose=lost", for_s=1.8)
    flight.always(lambda: flight.position_m[0] < 5.5, 1.8, "0.8 m inside the fence")
    flight.await_state("mission", "done", 40.0)


@ONE_STYLE
def test_a_late_pose_at_the_start_is_waited_for(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"), is_started=False)
    flight.fault("topic:pose=lost", for_s=1.8)
    flight.wait(0.3)
    began_s = flight.now_s
    flight.command("start")
    assert flight.now_s > began_s + 1.4
    flight.await_state("mission", "done", 60.0)


@ONE_STYLE
def test_poses_that_never_come_in_time_are_late_and_not_absent(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"))
    flight.await_state("sweep", "running")
    flight.wait(3.0)
    begin_s = flight.now_s
    flight.fault("topic:autopilot_pose=stale/0.5")
    flight.always(lambda: flight.mission.policy == "", 9.0, "each is waited for, in a hold")
    assert flight.speed_m_s < 0.3
    flight.await_policy("land", 3.0)
    (text,) = [event.text for event in flight.events if event.t_s >= begin_s and "pose lost: poses" in event.text]
    assert re.fullmatch(r"pose lost: poses are 0\.[56] s late; policy: land", text)
    flight.await_landed()


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
def test_an_autopilot_that_lives_on_our_pose_coasts_for_a_second_too(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"), platform="hummingbird")
    flight.await_state("sweep", "running", 30.0)
    flight.wait(4.0)
    begin_s = flight.now_s
    flight.fault("topic:pose=lost", for_s=0.8)
    flight.until(lambda: flight.was_told("pose is back after ", begin_s), 1.5, "it is back")
    flight.await_state("sweep", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


@pytest.mark.both_styles
def test_setpoints_that_are_missed_again_and_again_cause_no_chain_of_mode_changes(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"))
    flight.await_state("sweep", "running")
    flight.wait(3.0)
    begin_s = flight.now_s
    for _ in range(10):
        flight.fault("topic:setpoint=lost", for_s=0.7)
        flight.wait(1.5)
    assert modes(flight, begin_s) == [FlightMode.GUIDED, FlightMode.HOLD]
    flight.await_state("mission", "done", 40.0)
    assert modes(flight, begin_s)[:3] == [FlightMode.GUIDED, FlightMode.HOLD, FlightMode.GUIDED]
    assert len([one for one in flight.events if "no setpoint for 0.5 s" in one.text]) == 1
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
