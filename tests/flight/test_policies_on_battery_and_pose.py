"""DESIGN §6, on_low_battery and on_pose_lost: the vehicle's own conditions, and what then happens."""

from typing import Any

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission, platform

from gloc3.errors import InputError
from gloc3.messages.command_interface import Steer, Verb
from gloc3.messages.vehicle import FlightMode

HOME_M = 0.3
NO_FAILSAFE = {"  low_battery: {action: return, at: 0.1}": "  {}"}
"""A platform whose autopilot does nothing by itself when the battery is low."""
HOLDS_BLINDLY = {"needs: [pose, limiter, autopilot_driver]}\n  return": "needs: [limiter, autopilot_driver]}\n  return"}
"""A platform that can hold without the pose: in the autopilot's own hold."""


def sweep(flight: Card, changes: dict[str, str] | None = None, **policies: str) -> None:
    """On the way, three seconds into the sweep; with changes in the platform's file."""
    plan: dict[str, Any] = {"platform": platform(changes)} if changes else {}
    if changes is NO_FAILSAFE:
        plan["parameters"] = {"COM_LOW_BAT_ACT" if flight.style == "px4" else "BATT_FS_LOW_ACT": 0.0}
    flight.begin(mission(**policies), **plan)
    flight.await_state("sweep", "running")
    flight.wait(3.0)


# --- low battery: less than the reserve of the platform's file is left ---


def test_a_low_battery_returns_the_vehicle_and_lands_it_at_home(flight: Card) -> None:
    sweep(flight, on_low_battery="return")
    flight.fault("battery=0.18")
    flight.await_policy("return", 2.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_a_low_battery_lands_the_vehicle_here(flight: Card) -> None:
    sweep(flight, on_low_battery="land")
    flight.fault("battery=0.18")
    flight.await_policy("land", 2.0)
    flight.await_landed()
    assert flight.position_m[0] > 1.5


def test_a_low_battery_holds_the_vehicle(flight: Card) -> None:
    sweep(flight, NO_FAILSAFE, on_low_battery="hold", hold_s="3")
    flight.fault("battery=0.18")
    flight.await_policy("hold", 2.0)
    flight.await_policy("land", 5.0)
    flight.await_landed()


def test_a_low_battery_aborts_into_what_the_mission_does_on_failure(flight: Card) -> None:
    sweep(flight, on_low_battery="abort", on_failure="land")
    flight.fault("battery=0.18")
    flight.await_policy("land", 2.0)
    flight.await_landed()


def test_a_low_battery_changes_nothing_where_the_mission_says_continue(flight: Card) -> None:
    sweep(flight, NO_FAILSAFE, on_low_battery="continue")
    flight.fault("battery=0.18")
    flight.until(lambda: flight.was_told("low battery"), 2.0, "told")
    flight.await_state("mission", "done", 30.0)


@ONE_STYLE
def test_no_mission_starts_on_a_low_battery(flight: Card) -> None:
    flight.begin(mission(), is_started=False, battery=0.18)
    assert "battery (18 %, " in flight.refused_steer("start")
    overridden = Steer(verb=Verb.START, override="it is a short hop", author="ana")
    assert "low battery" in flight.refused(overridden)  # nobody overrides the mission's own policy


# --- pose lost: nothing for two seconds, or nothing valid for half of one; before that it is late (test_late_poses) ---


def test_a_lost_pose_lands_the_vehicle(flight: Card) -> None:
    sweep(flight, on_pose_lost="land")
    begin_s = flight.now_s
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("land", 2.5)
    assert 1.95 < flight.now_s - begin_s < 2.4  # the last pose is up to a period old when the fault begins
    flight.await_landed()


def test_a_lost_pose_holds_the_vehicle_in_the_autopilots_own_hold(flight: Card) -> None:
    sweep(flight, HOLDS_BLINDLY, on_pose_lost="hold", hold_s="4")
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("hold", 2.5)
    flight.await_mode(FlightMode.HOLD, 2.0)
    flight.until(lambda: flight.speed_m_s < 0.1, 3.0, "it stands")
    flight.await_policy("land", 5.0)
    flight.await_landed()


def test_a_mission_goes_on_after_a_lost_pose_has_come_back(flight: Card) -> None:
    sweep(flight, HOLDS_BLINDLY, on_pose_lost="hold")
    flight.fault("topic:autopilot_pose=lost", for_s=4.0)
    flight.await_policy("hold", 2.5)
    flight.until(lambda: flight.was_told("pose lost: over"), 4.0, "it is back")
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


def test_a_return_that_loses_the_pose_becomes_a_landing_here(flight: Card) -> None:
    sweep(flight, on_low_battery="return", on_pose_lost="continue")
    flight.fault("battery=0.18")
    flight.await_policy("return", 2.0)
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("land", 8.0)
    flight.await_landed()


@ONE_STYLE
@pytest.mark.parametrize("policy", ["hold", "return"])
def test_the_check_refuses_what_cannot_be_flown_without_a_pose(flight: Card, policy: str) -> None:
    with pytest.raises(InputError, match="needs the pose and cannot be flown without it"):
        flight.begin(mission(on_pose_lost=policy))


def test_a_lost_pose_aborts_into_what_the_mission_does_on_failure(flight: Card) -> None:
    sweep(flight, on_pose_lost="abort", on_failure="land")
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("land", 2.5)
    flight.await_landed()


def test_a_long_gap_in_the_pose_changes_nothing_where_the_mission_says_continue(flight: Card) -> None:
    sweep(flight, on_pose_lost="continue")
    flight.fault("topic:autopilot_pose=lost", for_s=2.5)
    flight.until(lambda: flight.was_told("pose lost"), 2.5, "told")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


@pytest.mark.parametrize("gap_s", [0.2, 0.45])
def test_a_gap_in_the_pose_of_some_frames_brakes_the_vehicle_and_does_not_land_it(flight: Card, gap_s: float) -> None:
    sweep(flight, on_pose_lost="land")
    begin_s = flight.now_s
    for _ in range(3):
        gap_begin_s = flight.now_s
        flight.fault("topic:autopilot_pose=lost", for_s=gap_s)
        flight.wait(gap_s)
        late = flight.since(gap_begin_s + 0.16, "setpoint")
        assert all(one.position_ned_m is None for one in late)  # nothing was flown by an old pose
        flight.wait(0.5)
    flight.await_state("mission", "done", 30.0)
    assert not flight.was_told("pose lost", begin_s)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


@pytest.mark.parametrize("topic", ["autopilot_pose", "pose"])
def test_a_pose_that_is_not_finite_is_a_lost_pose(flight: Card, topic: str) -> None:
    sweep(flight, on_pose_lost="land")
    begin_s = flight.now_s
    flight.fault(f"topic:{topic}=nan")
    flight.await_policy("land", 1.0 if topic == "autopilot_pose" else 2.5)  # what is no number is no pose: it is late
    flight.await_landed()
    assert all(status.errors == 0 for status in flight.since(begin_s, "components/command_server/status"))
