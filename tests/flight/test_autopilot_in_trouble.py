"""What the autopilot's own troubles lead to: a cable that is cut, a fix that is lost, stuck or late, its own failsafe."""

import math

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission, platform

from gloc3.messages.command_interface import Outcome
from gloc3.messages.vehicle import FlightMode

HOME_M = 0.3


def sweep(flight: Card, **policies: str) -> None:
    """On the way, three seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep.out", "running")
    flight.wait(3.0)


def test_while_the_cable_is_cut_the_autopilot_holds_and_then_a_mission_that_continues_goes_on(flight: Card) -> None:
    sweep(flight, on_pose_lost="continue")
    flight.fault("cable_loss", for_s=5.0)
    flight.wait(4.0)
    flight.always(lambda: flight.speed_m_s < 0.15, 1.0, "it stands")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    assert not any(state.has_pilot_control for state in flight.since(0.0, "driver"))


def test_a_cable_that_is_cut_is_a_lost_pose_whose_policy_waits_until_the_cable_is_back(flight: Card) -> None:
    sweep(flight, on_pose_lost="land")
    flight.fault("cable_loss", for_s=4.0)
    flight.await_policy("land", 2.5)
    flight.await_landed()


def test_a_cable_that_loses_every_twentieth_frame_changes_nothing(flight: Card) -> None:
    flight.begin(mission())
    flight.fault("cable_loss=0.05")
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    assert not any(state.has_pilot_control for state in flight.since(0.0, "driver"))


def test_a_cable_that_loses_every_fourth_frame_lands_nobody(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"))
    flight.await_state("sweep", "running")
    flight.fault("cable_loss=0.25")
    flight.await_state("mission", "done", 60.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    assert not flight.was_told("pose lost")


def test_a_lost_fix_ends_on_the_ground_inside_the_fence(flight: Card) -> None:
    sweep(flight)
    flight.fault("sensor:fix=lost")
    flight.await_landed(40.0)
    x, y, _ = flight.position_m
    assert -2.0 < x < 20.0
    assert -2.0 < y < 12.0


@pytest.mark.parametrize("fault", ["sensor:fix=late/0.3", "sensor:fix=noisy/0.03", "sensor:barometer=biased/2"])
def test_a_fix_that_is_late_or_noisy_and_a_biased_barometer_leave_the_mission_done(flight: Card, fault: str) -> None:
    sweep(flight)
    flight.fault(fault, for_s=3.0)
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=0.8)


@pytest.mark.both_styles
def test_a_failsafe_of_the_autopilot_counts_as_somebody_elses_and_is_left_alone(flight: Card) -> None:
    low = "COM_LOW_BAT_ACT" if flight.style == "px4" else "BATT_FS_LOW_ACT"
    alone = platform({"  low_battery: {action: return, at: 0.1}": "  {}"})
    flight.begin(mission(on_low_battery="continue", on_failure="land"), platform=alone, parameters={low: 0.0})
    flight.await_state("sweep.out", "running")
    flight.wait(3.0)
    flight.flight.simulator.autopilot.parameters.set(low, 2)
    flight.fault("battery=0.06")
    flight.until(lambda: flight.driver.has_pilot_control, 8.0, "the autopilot acts by itself")
    assert "the autopilot (failsafe)" in flight.driver.pilot_reason
    flight.await_state("mission", "paused", 1.0)
    assert flight.autopilot.mode in (FlightMode.LAND, FlightMode.RETURN, FlightMode.HOLD)
    flight.await_landed(60.0)
    controlled = [vehicle for vehicle in flight.since(0.0, "ci/vehicle") if vehicle.has_pilot_control]
    assert controlled
    assert all(vehicle.is_failsafe for vehicle in controlled), "no pilot was there"


@pytest.mark.parametrize("fault", ["sensor:fix=biased/2", "sensor:fix=stuck"])
def test_a_fix_that_jumps_or_sticks_never_leads_the_vehicle_away(flight: Card, fault: str) -> None:
    sweep(flight)
    begin_s = flight.now_s
    flight.fault(fault)
    flight.until(lambda: not flight.autopilot.is_armed, 60.0, "it has landed, by the mission or by a failsafe")
    places = [truth.position_ned_m for truth in flight.since(begin_s, "sim/truth")]
    assert all(-2.0 < north < 12.0 and abs(east) < 2.0 for north, east, _ in places)
    speeds = [math.hypot(*truth.velocity_ned_m_s[:2]) for truth in flight.since(begin_s, "sim/truth")]
    assert max(speeds) < 3.0


@ONE_STYLE
def test_a_landing_that_the_autopilot_sees_and_does_not_end_is_ended_by_disarming(flight: Card) -> None:
    flight.begin(mission(), parameters={"COM_DISARM_LAND": -1.0})
    flight.await_state("recover.down", "running", 60.0)
    flight.await_state("mission", "done", 60.0)
    assert not flight.autopilot.is_armed
    assert not flight.last("driver").has_pilot_control


@ONE_STYLE
def test_a_landing_that_the_autopilot_never_ends_fails_soon_and_the_operator_is_told_what_to_do(flight: Card) -> None:
    flight.begin(
        mission(),
        parameters={"MPC_THR_MIN": 0.3},  # too much to look like lying on the ground
    )
    flight.await_state("recover.down", "running", 60.0)
    flight.await_state("mission", "failed", 60.0)
    assert flight.was_told("it has stood still for 30 s, but is armed in mode Land")
    assert flight.was_told("disarm it")
    assert flight.emergency_reply("disarm", flight.flight.name).outcome is Outcome.ACCEPTED
    flight.until(lambda: not flight.autopilot.is_armed, 5.0, "the operator disarms it")
