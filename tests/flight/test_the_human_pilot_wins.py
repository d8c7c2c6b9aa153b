"""DESIGN §7, "The human pilot wins": a change of mode or a disarm that we did not command; until an operator resumes."""

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission, platform

from gloc3.messages.command_interface import CommandComponent, Outcome, Preflight, RequestAction
from gloc3.messages.vehicle import FlightMode, LandedState
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author

HOME_M = 0.3
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"
COMMANDS = ("COMMAND_LONG", "COMMAND_INT", "SET_MODE")
SET_MODE, ARM, TAKE_OFF, LAND = 176, 400, 22, 21


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)


def sent(flight: Card, since_s: float) -> list[str]:
    """What of ours since then moved the vehicle, changed its mode or its arming."""
    moving = (SET_MODE, ARM, TAKE_OFF, LAND)
    return [
        f"{t_s:.2f} {message.name}"
        for t_s, message in flight.to_autopilot
        if t_s > since_s and (message.name == SETPOINT or (message.name in COMMANDS and message.command in moving))
    ]


def take_over(flight: Card, how: str = "pilot:position") -> float:
    """The pilot acts; returns when the driver knows it."""
    flight.fault(how)
    flight.until(lambda: flight.driver.has_pilot_control, 0.5, "the driver sees the pilot")
    return flight.now_s


@pytest.mark.parametrize("mode", ["position", "altitude", "hold", "return", "land"])
def test_any_mode_that_the_pilot_chooses_stops_our_setpoints_and_pauses_the_mission(flight: Card, mode: str) -> None:
    sweep(flight)
    begin_s = flight.now_s
    seen_s = take_over(flight, f"pilot:{mode}")
    assert seen_s - begin_s < 0.45
    flight.await_state("mission", "paused", 0.5)
    assert flight.mission.reason.startswith("pilot")
    flight.await_policy("pilot", 1.0)
    flight.wait(6.0)
    assert not sent(flight, seen_s + 0.05)
    assert not flight.driver.is_streaming


@pytest.mark.parametrize("is_back", [True, False])
def test_a_component_that_is_lost_under_the_pilot_is_answered_after_his_hand_back_unless_it_works_again(
    flight: Card, is_back: bool
) -> None:
    sweep(flight, on_failure="land")
    take_over(flight)
    flight.fault("crash:take_off", for_s=6.0 if is_back else 60.0)
    flight.until(lambda: flight.was_told("take_off is lost"), 15.0, "the loss is told")
    flight.await_policy("pilot")
    if is_back:
        flight.await_component("take_off", "working", 10.0)
        flight.wait(1.0)
    flight.command("resume")
    flight.await_policy("" if is_back else "land", 2.0)
    flight.await_state("mission", "running" if is_back else "failed", 1.0)


def test_nothing_of_ours_moves_the_vehicle_whatever_happens_until_an_operator_resumes(flight: Card) -> None:
    sweep(flight, on_link_loss="land", on_low_battery="return", on_pose_lost="land")
    seen_s = take_over(flight)
    flight.fault("battery=0.18")
    flight.fault("topic:autopilot_pose=lost", for_s=1.0)
    flight.wait(1.5)
    flight.emergency("hold")
    assert flight.request(RequestAction(capability="land")).outcome is Outcome.REFUSED
    flight.fault("crash:waypoints")
    flight.fault("link_loss", for_s=7.0)
    flight.wait(9.0)
    assert not sent(flight, seen_s + 0.05)
    assert flight.autopilot.mode is FlightMode.MANUAL


def test_after_the_pilot_hands_back_resume_goes_on_with_the_mission(flight: Card) -> None:
    sweep(flight)
    seen_s = take_over(flight)
    flight.wait(3.0)
    assert not sent(flight, seen_s + 0.05)
    flight.command("resume")
    flight.until(lambda: not flight.driver.has_pilot_control, 1.0, "we have control again")
    flight.await_mode(FlightMode.GUIDED, 3.0)
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


def test_what_arose_while_the_pilot_flew_is_answered_when_he_hands_back(flight: Card) -> None:
    sweep(flight, on_low_battery="land")
    take_over(flight)
    flight.fault("battery=0.18")
    flight.wait(2.0)
    flight.command("resume")
    flight.await_policy("land", 2.0)
    flight.await_landed()


def test_a_vehicle_that_hovers_with_nobody_in_charge_has_a_policy_and_a_time(flight: Card) -> None:
    sweep(flight, on_low_battery="land")
    autopilot = flight.flight.simulator.autopilot
    wanted = Behaviour.HOLD if flight.style == "px4" else Behaviour.BRAKE
    hold = next(mode.custom_mode for mode in autopilot.style.modes if mode.behaviour is wanted)
    autopilot.commander.set_mode(hold, Author.COMMAND)
    flight.until(lambda: flight.driver.has_pilot_control, 1.0, "the driver sees that somebody else chose a mode")
    flight.await_policy("pilot", 1.0)
    flight.fault("battery=0.18")
    flight.always(lambda: flight.mission.policy == "pilot", 25.0, "he may still be there")
    flight.await_policy("land", 6.0)
    assert flight.was_told("neither a transmitter nor another station was heard for 30 s")
    flight.await_landed()


def test_another_station_that_leaves_is_waited_for_once_and_not_twice(flight: Card) -> None:
    sweep(flight, on_low_battery="land")
    autopilot = flight.flight.simulator.autopilot
    wanted = Behaviour.HOLD if flight.style == "px4" else Behaviour.BRAKE
    hold = next(mode.custom_mode for mode in autopilot.style.modes if mode.behaviour is wanted)
    autopilot.commander.set_mode(hold, Author.COMMAND)
    flight.await_policy("pilot", 2.0)
    flight.fault("battery=0.18")
    flight.wait(10.0)
    assert flight.as_station("7", Preflight()).outcome is Outcome.ACCEPTED, "it is there, and leaves"
    flight.always(lambda: flight.mission.policy == "pilot", 28.0, "it may come back")
    flight.await_policy("land", 4.0)
    assert flight.was_told("neither a transmitter nor another station was heard for 30 s")


def test_a_disarm_that_we_did_not_command_pauses_and_we_never_arm_again_by_ourselves(flight: Card) -> None:
    sweep(flight)
    flight.fault("pilot:kill")
    flight.until(lambda: not flight.autopilot.is_armed, 1.0, "disarmed")
    seen_s = flight.now_s
    flight.until(lambda: flight.driver.has_pilot_control, 1.0, "the driver sees it")
    flight.await_state("mission", "paused", 1.0)
    flight.wait(5.0)
    assert not sent(flight, seen_s + 0.05)
    assert not flight.autopilot.is_armed


def test_a_pilot_during_take_off_keeps_the_vehicle(flight: Card) -> None:
    flight.begin(mission())
    flight.until(lambda: flight.height_m > 0.5, 10.0, "it climbs")
    seen_s = take_over(flight)
    flight.await_state("mission", "paused", 1.0)
    flight.wait(4.0)
    assert not sent(flight, seen_s + 0.05)
    assert flight.autopilot.mode is FlightMode.MANUAL


def test_a_pilot_who_lands_by_himself_leaves_the_mission_paused_on_the_ground(flight: Card) -> None:
    sweep(flight)
    take_over(flight, "pilot:land")
    flight.await_landed()
    flight.wait(3.0)
    assert flight.state("mission") == "paused"
    reason = flight.refused_steer("resume")
    assert "on the ground" in reason
    assert not flight.autopilot.is_armed


def test_somebody_elses_arming_is_the_pilots_too(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    flight.fault("pilot:arm")
    flight.until(lambda: flight.driver.has_pilot_control, 2.0, "the driver sees it")
    assert "pilot has control" in flight.refused_steer("start")


def test_our_own_changes_of_mode_are_not_taken_for_the_pilots(flight: Card) -> None:
    sweep(flight)
    flight.command("pause")
    flight.wait(2.0)
    flight.command("resume")
    flight.fault("no_setpoints", for_s=2.0)
    flight.await_mode(FlightMode.HOLD, 3.0)
    flight.await_state("mission", "done", 40.0)
    assert not any(state.has_pilot_control for state in flight.since(0.0, "driver"))


def test_take_off_arms_only_where_the_platform_file_says_so(flight: Card) -> None:
    changes = {"\narm: true": "\narm: false", "settings: {arm: true}, ": ""}
    flight.begin(mission(), is_started=False, platform=platform(changes))
    flight.command("start")
    flight.until(lambda: flight.state("depart.climb") == "failed", 3.0, "refused")
    assert flight.was_told("does not allow arming")
    flight.wait(3.0)
    assert not flight.autopilot.is_armed


def test_a_vehicle_is_never_disarmed_in_flight_by_an_emergency(flight: Card) -> None:
    sweep(flight)
    reply = flight.emergency_reply("disarm", confirmation="")
    assert reply.outcome is Outcome.REFUSED
    assert "type the platform's name" in reply.reason
    flight.wait(1.0)
    assert flight.autopilot.is_armed
    assert flight.autopilot.landed is not LandedState.ON_GROUND


def test_the_driver_that_goes_quiet_leaves_the_vehicle_in_the_autopilots_hold(flight: Card) -> None:
    sweep(flight)
    command = CommandComponent(component="autopilot_driver", command="goquiet", is_forced=True)
    for _ in range(4):
        if flight.request(command).outcome is Outcome.ACCEPTED:
            break
        flight.wait(0.5)
    flight.await_mode(FlightMode.HOLD, 3.0)
    seen_s = flight.now_s
    flight.until(lambda: flight.speed_m_s < 0.1, 6.0, "it stands")
    assert not sent(flight, seen_s + 0.3)


def test_a_pilot_who_is_not_heard_any_more_leaves_the_vehicle_to_the_safety_policies(flight: Card) -> None:
    lost = {"COM_RCL_EXCEPT": 7.0} if flight.style == "px4" else {"FS_THR_ENABLE": 0.0}
    flight.begin(mission(on_low_battery="land"), parameters=lost)
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    seen_s = take_over(flight, "pilot:hold")
    flight.fault("battery=0.18")
    flight.wait(20.0)
    assert not sent(flight, seen_s + 0.05), "the pilot is there"
    flight.fault("pilot:off")
    flight.wait(25.0)
    assert not sent(flight, seen_s + 0.05), "he may come back"
    flight.await_policy("land", 15.0)
    flight.await_landed()
