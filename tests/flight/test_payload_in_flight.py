"""A mission with a gripper, a servo, a lamp and a winch: the autopilot carries them out, refuses them, or is silent."""

from typing import Any

import pytest
from tests.flight.card import Card

from gloc3.component.lci import State

PLATFORM = """
platform: carrier
extends: pelican_rtk
capabilities:
  set_servo: {arguments: set_servo, performed_by: tray, claims: [tray], needs: [autopilot], options: {servo: [tilt]}}
  grip: {arguments: grip, performed_by: bay, claims: [bay], needs: [autopilot], options: {gripper: [claw]}}
  winch: {arguments: winch, performed_by: bay, claims: [bay], needs: [autopilot], options: {winch: [hoist]}}
  switch: {arguments: switch, performed_by: lights, claims: [lights], options: {output: [lamp]}}
components:
  - {name: tray, class: "gloc3_onboard.components.drivers.payload:PayloadDriver", rate_hz: 10, devices: {device: autopilot}, ports: {action_status: action_status/tray}, settings: {outputs: {tilt: {kind: servo, number: SERVO, safe: 0.5}}}}
  - {name: bay, class: "gloc3_onboard.components.drivers.payload:PayloadDriver", rate_hz: 10, devices: {device: autopilot}, ports: {action_status: action_status/bay}, settings: {outputs: {claw: {kind: gripper, number: 1}, hoist: {kind: winch, number: 1}}}}
  - {name: lights, class: "gloc3_onboard.components.drivers.payload:PayloadDriver", rate_hz: 10, devices: {device: autopilot}, ports: {action_status: action_status/lights}, settings: {outputs: {lamp: {kind: relay, number: 0, safe: false}}}}
"""
DELIVERY = """
mission: delivery
frame: hold
tasks:
  out:
    actions:
      grab: {grip: {gripper: claw, action: grab}}
      up: {take_off: {height_m: 2.0}, after: [grab]}
      to: {go_to: {position_m: [2, 0, 2]}, after: [up]}
      light: {switch: {output: lamp, is_on: true, for_s: 60}, after: [up], until: back, on_failure: continue}
      aim: {set_servo: {servo: tilt, share: 0.75}, after: [to]}
      lower: {winch: {winch: hoist, length_m: 1.5, speed_m_s: 0.5}, after: [aim], on_failure: continue}
      drop: {grip: {gripper: claw, action: release}, after: [lower]}
      back: {go_to: {position_m: [0, 0, 2]}, after: [drop]}
      down: {land: {}, after: [back]}
"""
FITTED = {
    "px4": {"PD_GRIPPER_EN": 1.0},
    "ardupilot": {"GRIP_ENABLE": 1.0, "WINCH_TYPE": 1.0, "RELAY1_FUNCTION": 1.0},
}


def platform(style: str) -> str:
    return PLATFORM.replace("SERVO", "2" if style == "px4" else "9")


def payload(flight: Card) -> Any:
    return flight.flight.simulator.autopilot.payload


def commands(flight: Card, *numbers: int) -> list[tuple[int, float, float]]:
    """The commands of these kinds that went to the autopilot, with their first two parameters."""
    return [
        (message.command, message.param1, message.param2)
        for _, message in flight.to_autopilot
        if message.name == "COMMAND_LONG" and message.command in numbers
    ]


@pytest.mark.both_styles
def test_a_delivery_flies_and_the_autopilot_has_done_all_that_its_family_can(flight: Card) -> None:
    flight.begin(DELIVERY, platform=platform(flight.style), parameters=FITTED[flight.style])
    flight.await_state("out.grab", "done", 10.0)
    assert payload(flight).grabs is True
    flight.await_state("out.aim", "done", 30.0)
    autopilot = flight.flight.simulator.autopilot
    is_px4 = flight.style == "px4"
    if is_px4:
        assert payload(flight).actuators == {2: 0.5}
        assert flight.was_told("lamp: not supported"), flight.story("why the lamp is not switched")
    else:
        assert autopilot.servo_us[9] == 1750
        assert payload(flight).relays == {0: True}
    took_s = flight.await_state("out.lower", "failed" if is_px4 else "done", 10.0)
    if is_px4:
        assert flight.was_told("hoist: not supported")
    else:
        assert took_s > 2.5, "three metres a second and a half would be faster"
        assert payload(flight).line_m == 1.5
        assert len(commands(flight, 42600)) == 1
    flight.await_state("out.drop", "done", 5.0)
    assert payload(flight).grabs is False
    flight.await_state("mission", "done", 60.0)
    if not is_px4:
        assert payload(flight).relays == {0: False}, "its action ended early"


@pytest.mark.both_styles
def test_a_gripper_that_is_not_there_fails_the_action_with_the_autopilots_reason(flight: Card) -> None:
    flight.begin(DELIVERY, platform=platform(flight.style))
    flight.await_state("out.grab", "failed", 10.0)
    reason = "claw: not supported" if flight.style == "px4" else "claw: failed"
    assert flight.was_told(reason), flight.story("the reason")


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
def test_a_lost_command_is_repeated_and_a_broken_cable_is_told_as_a_missing_answer(flight: Card) -> None:
    flight.begin(DELIVERY, is_started=False, platform=platform(flight.style), parameters=FITTED[flight.style], seed=3)
    flight.fault("cable_loss=0.5", for_s=3.0)
    assert flight.action("grip", gripper="claw", action="grab").outcome == "accepted"
    flight.until(lambda: payload(flight).grabs is True, 6.0, "grabbed")
    flight.wait(5.0)
    assert flight.last("action_status/bay").state == "done"
    flight.fault("cable_loss=1.0", for_s=8.0)
    assert flight.action("switch", output="lamp", is_on=True).outcome == "accepted"
    assert flight.action("grip", gripper="claw", action="release").outcome == "accepted"
    status = flight.expect("action_status/lights", lambda status: status.state == "failed", 12.0)
    assert status.reason == "lamp: not answered"
    assert (payload(flight).grabs, payload(flight).relays) == (True, {})
    assert flight.last("action_status/bay").state == "aborted", "the executor ended what needs the autopilot"
    assert flight.lci("bay") is State.WORKING


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
def test_the_lamp_goes_off_when_its_driver_is_stopped_and_two_outputs_at_once_do_not_replace_each_other(
    flight: Card,
) -> None:
    twice = platform(flight.style) + PLATFORM.splitlines()[-1].replace("name: lights", "name: beacon").replace(
        "action_status/lights", "action_status/beacon"
    ).replace("lamp: {kind: relay, number: 0", "strobe: {kind: relay, number: 1")
    twice = twice.replace(
        "components:\n",
        "  strobe: {arguments: switch, performed_as: switch, performed_by: beacon, claims: [beacon]}\ncomponents:\n",
    )
    flight.begin(DELIVERY, is_started=False, platform=twice, parameters={**FITTED["ardupilot"], "RELAY2_FUNCTION": 1.0})
    for capability, name in (("switch", "lamp"), ("strobe", "strobe")):
        assert flight.action(capability, output=name, is_on=True).outcome == "accepted"
    flight.until(lambda: payload(flight).relays == {0: True, 1: True}, 3.0, "both are on")
    flight.wait(1.0)
    assert [flight.last(f"action_status/{name}").state for name in ("lights", "beacon")] == ["done", "done"]
    assert flight.component("lights", "stop").outcome == "accepted"
    flight.until(lambda: payload(flight).relays == {0: False, 1: True}, 3.0, "the lamp is off")
