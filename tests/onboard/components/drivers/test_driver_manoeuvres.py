"""Manoeuvres that the autopilot flies by itself, in both styles: the order of the steps, refusals and time-outs."""

from itertools import pairwise

import pytest
from msgspec.structs import replace
from tests.onboard.driver_rig import DriverRig
from tests.onboard.messages import autopilot_pose, pose, setpoint
from tests.onboard.scripted_autopilot import ScriptedAutopilot

from gloc3.messages.vehicle import FlightMode, LandedState, Manoeuvre, ManoeuvreKind, VehicleClass

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
TAKE_OFF, LAND, HOLD = ManoeuvreKind.TAKE_OFF, ManoeuvreKind.LAND, ManoeuvreKind.HOLD


def requested(rig: DriverRig) -> list[str]:
    return rig.autopilot.commands


@pytest.mark.parametrize(
    ("style", "steps"),
    [("px4", ["arm", "take off to 1.5"]), ("ardupilot", ["mode guided", "arm", "take off to 1.5"])],
)
def test_a_take_off_step_by_step_and_nothing_is_streamed_on_the_ground(style: str, steps: list[str]) -> None:
    rig = DriverRig(style)
    rig.hold()
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(0.6)
    assert requested(rig) == steps
    assert rig.autopilot.setpoints == []
    assert rig.state.manoeuvre_state == "running"


def test_px4_has_climbed_when_it_holds() -> None:
    rig = DriverRig("px4")
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(1.0)
    rig.at = (0.0, 0.0, 1.5)
    rig.step()
    rig.autopilot.fly(FlightMode.HOLD)
    rig.run(0.3)
    assert rig.state.manoeuvre_state == "done"
    assert not rig.state.has_pilot_control


@STYLES
def test_the_owners_setpoints_end_a_climb(style: str) -> None:
    rig = DriverRig(style)
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(1.0)
    rig.at = (0.0, 0.0, 1.2)
    rig.autopilot.reported = replace(rig.autopilot.reported, landed=LandedState.IN_AIR)
    rig.run(0.5)
    assert rig.state.manoeuvre_state == "running"
    rig.hold()
    rig.run(2.0)
    assert rig.state.manoeuvre_state == "done"
    assert rig.state.is_guided
    assert not rig.state.has_pilot_control


@STYLES
def test_who_may_not_arm_does_not(style: str) -> None:
    rig = DriverRig(style)
    rig.autopilot.refuses["take off"] = "not armed"
    rig.request(TAKE_OFF, height_m=1.5, may_arm=False)
    rig.run(1.0)
    assert not [words for words in requested(rig) if "arm" in words]
    assert (rig.state.manoeuvre_state, rig.state.manoeuvre_reason) == ("failed", "not armed")


@STYLES
def test_a_vehicle_that_is_armed_already_is_not_armed_again(style: str) -> None:
    rig = DriverRig(style)
    rig.step()
    rig.autopilot.reported = replace(rig.autopilot.reported, is_armed=True)
    rig.see()
    rig.driver._watch.yield_back()
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(1.0)
    assert requested(rig)[-1] == "take off to 1.5"
    assert "arm" not in requested(rig)


@STYLES
def test_a_refused_arming_ends_it_with_the_autopilots_reason(style: str) -> None:
    rig = DriverRig(style)
    rig.autopilot.refuses["arm"] = "compass not calibrated"
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(1.0)
    assert (rig.state.manoeuvre_state, rig.state.manoeuvre_reason) == ("failed", "compass not calibrated")
    assert requested(rig)[-1] == "arm"


@STYLES
def test_what_it_has_armed_for_nothing_it_disarms_and_that_is_no_pilot(style: str) -> None:
    rig = DriverRig(style)
    rig.autopilot.refuses["take off"] = "no position"
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    rig.run(1.5)
    assert requested(rig)[-1] == "disarm"
    assert not rig.autopilot.reported.is_armed
    assert rig.state.manoeuvre_reason == "no position"
    assert not rig.state.has_pilot_control


@STYLES
def test_a_take_off_that_fails_in_the_air_disarms_nothing(style: str) -> None:
    rig = DriverRig(style)
    rig.autopilot.refuses["take off"] = "odd"
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    while requested(rig)[-1] != "take off to 1.5":
        rig.step()
    rig.autopilot.fly(rig.autopilot.reported.mode)
    rig.see()
    rig.run(1.0)
    assert requested(rig)[-1] == "take off to 1.5"


@STYLES
@pytest.mark.parametrize(
    ("deaf_to", "reason"), [("arm", "the autopilot did not arm in time"), ("take", "the autopilot did not take off in")]
)
def test_a_step_that_is_never_answered_fails_in_time(style: str, deaf_to: str, reason: str) -> None:
    rig = DriverRig(style, step_timeout_s=2.0)
    rig.autopilot.refuses[deaf_to] = ""
    rig.request(TAKE_OFF, height_m=1.5, may_arm=True)
    for _ in range(200):
        rig.autopilot.is_deaf = bool(requested(rig)) and requested(rig)[-1].startswith(deaf_to)
        rig.step()
        if rig.state.manoeuvre_state == "failed":
            break
    assert rig.state.manoeuvre_reason.startswith(reason)
    assert rig.now_s < 4.0
    rig.autopilot.is_deaf = False
    rig.run(1.0)
    assert not rig.state.has_pilot_control


@STYLES
def test_a_landing_is_over_when_the_vehicle_is_disarmed_and_that_is_no_pilot(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(LAND)
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert (rig.state.manoeuvre_state, rig.state.is_streaming) == ("running", False)
    rig.autopilot.touch_down()
    rig.run(0.5)
    assert rig.state.manoeuvre_state == "done"
    assert not rig.state.has_pilot_control
    assert requested(rig)[-1] == "mode land"
    assert rig.state.expired == 0, "a stream that ends on purpose has not run dry"


@STYLES
def test_setpoints_that_are_still_on_their_way_do_not_break_off_a_landing(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.request(LAND)
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert rig.state.manoeuvre_state == "running"


@STYLES
def test_a_new_owner_takes_over_from_a_landing(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(LAND)
    rig.run(1.0)
    rig.own("hold")
    rig.hold("hold")
    rig.run(2.0)
    assert rig.state.is_guided
    assert rig.state.manoeuvre_reason == "motion was granted to another owner"
    assert not rig.state.has_pilot_control


@STYLES
def test_the_same_landing_can_be_asked_for_again(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.autopilot.refuses["mode land"] = "not now"
    rig.request(LAND)
    rig.run(1.0)
    assert rig.state.manoeuvre_state == "failed"
    rig.autopilot.refuses.clear()
    rig.request(LAND)
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert rig.state.manoeuvre_state == "running"


@STYLES
def test_a_landing_that_the_server_asks_for_is_not_broken_off_by_the_hold_in_whose_name_it_flies(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.step(direct_landing=Manoeuvre(action_id="go", kind=LAND))
    rig.request(HOLD)
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert (rig.state.manoeuvre, rig.state.manoeuvre_state) == (LAND, "running")
    rig.own("hold")
    rig.request(HOLD, "hold")
    rig.run(0.5)
    assert (rig.autopilot.reported.mode, rig.state.manoeuvre) == (FlightMode.HOLD, HOLD)


@STYLES
def test_a_landing_that_the_server_asks_for_is_broken_off_by_the_hold_that_it_asks_for(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.step(direct_landing=Manoeuvre(action_id="go", kind=LAND))
    rig.run(0.5)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    rig.step(direct_landing=Manoeuvre(action_id="go", kind=HOLD))
    rig.run(0.5)
    assert (rig.autopilot.reported.mode, rig.state.manoeuvre) == (FlightMode.HOLD, HOLD)


@STYLES
def test_hold_as_a_manoeuvre(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(HOLD)
    rig.run(0.5)
    assert (rig.autopilot.reported.mode, rig.state.manoeuvre_state) == (FlightMode.HOLD, "done")


def test_only_the_owner_is_obeyed() -> None:
    rig = DriverRig().in_flight()
    rig.request(LAND, owner="thief")
    rig.run(0.5)
    assert rig.state.foreign == 1
    assert "mode land" not in requested(rig)
    rig.own("")
    rig.request(LAND, owner="")
    rig.run(0.5)
    assert "mode land" not in requested(rig)


def test_a_manoeuvre_waits_until_the_autopilot_is_heard() -> None:
    rig = DriverRig()
    silent = replace(rig.autopilot.reported, is_connected=False)
    for _ in range(10):
        rig.step(autopilot=silent)
    assert requested(rig) == []
    rig.stage.put(setpoint=setpoint())
    rig.run(0.2)
    assert requested(rig) == []


@STYLES
def test_until_the_autopilot_has_taken_over_it_is_told_to_stand_still(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.autopilot.delay_s = 2.0  # the command's first frames are lost; a stream that ended would mean a failsafe
    rig.request(LAND)
    requested_s = rig.now_s
    rig.run(4.0)
    braking = [sent for sent in rig.autopilot.setpoints if sent[0] >= requested_s]
    assert all(place is None for _, place, _ in braking)
    assert {speed for t_s, _, speed in braking if t_s > requested_s + 0.5} == {(0.0, 0.0, 0.0)}
    assert braking[-1][0] == pytest.approx(requested_s + 2.0, abs=0.1)
    assert max(b[0] - a[0] for a, b in pairwise(braking)) < 0.1
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert not rig.state.has_pilot_control


# --- the autopilot's state falls silent: its sampler has died, or its link, too ---


def silence(rig: DriverRig, seconds: float, *, is_heard: bool = False) -> None:
    """Lets time pass in which nobody samples the autopilot's state, and the link may be silent, too."""
    rig.autopilot.is_heard = is_heard
    for _ in range(round(seconds / 0.05)):
        rig.autopilot.tick(rig.now_s)
        message = rig.wants()
        rig.stage.step(0.05, pose=pose(), autopilot_pose=autopilot_pose(), **({"setpoint": message} if message else {}))


def test_without_its_sampler_the_autopilots_state_is_read_from_the_device() -> None:
    rig = DriverRig().in_flight()
    rig.wants = lambda: None
    silence(rig, 3.0, is_heard=True)
    rig.stage.put(manoeuvre=Manoeuvre(action_id="go", kind=LAND))
    silence(rig, 5.0, is_heard=True)
    assert rig.state.manoeuvre_state == "running"
    rig.autopilot.enter(FlightMode.MANUAL)
    silence(rig, 1.0, is_heard=True)
    assert rig.state.has_pilot_control


def test_without_the_autopilots_state_a_landing_is_asked_for_once_and_its_answer_believed() -> None:
    rig = DriverRig().in_flight()
    rig.wants = lambda: None
    silence(rig, 3.0)
    rig.autopilot.commands.clear()
    rig.stage.put(manoeuvre=Manoeuvre(action_id="go", kind=LAND))
    silence(rig, 20.0)
    assert requested(rig) == ["mode land"]
    assert rig.state.manoeuvre_state == "running"
    rig.autopilot.enter(FlightMode.MANUAL)  # a pilot, unseen
    silence(rig, 20.0)
    assert requested(rig) == ["mode land"]


def test_without_the_autopilots_state_a_landing_that_is_not_answered_or_refused_fails_and_nothing_takes_off() -> None:
    rig = DriverRig().in_flight()
    rig.wants = lambda: None
    silence(rig, 3.0)
    rig.autopilot.is_deaf = True
    rig.stage.put(manoeuvre=Manoeuvre(action_id="go", kind=LAND))
    silence(rig, 9.0)
    assert rig.state.manoeuvre_reason == "the autopilot did not enter mode land in time"
    rig.autopilot.is_deaf, rig.autopilot.refuses = False, {"mode": "no"}
    rig.stage.put(manoeuvre=Manoeuvre(action_id="go", kind=LAND))
    silence(rig, 1.0)
    assert (rig.state.manoeuvre_state, rig.state.manoeuvre_reason) == ("failed", "no")
    rig.autopilot.commands.clear()
    rig.stage.put(manoeuvre=Manoeuvre(action_id="go", kind=TAKE_OFF, height_m=2.0, may_arm=True))
    silence(rig, 3.0)
    assert requested(rig) == []


def test_without_the_autopilots_state_the_hold_at_the_end_of_a_stream_is_asked_for_until_it_is_obeyed() -> None:
    rig = DriverRig().in_flight()
    silence(rig, 3.0)
    rig.wants = lambda: None
    rig.autopilot.commands.clear()
    rig.autopilot.is_deaf = True
    silence(rig, 3.2)
    assert requested(rig)[:2] == ["mode hold", "mode hold"]
    rig.autopilot.is_deaf = False
    silence(rig, 1.5)
    rig.autopilot.commands.clear()
    silence(rig, 10.0)
    assert requested(rig) == []


@STYLES
def test_what_stays_armed_on_the_ground_after_a_landing_is_asked_to_disarm_again_and_again(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.autopilot.refuses["disarm"] = "not landed"
    rig.request(LAND)
    rig.run(40.0)
    assert "disarm" not in requested(rig), "in the air"
    rig.autopilot.reported = replace(rig.autopilot.reported, landed=LandedState.ON_GROUND)
    rig.run(24.0)
    assert "disarm" not in requested(rig), "the autopilot does it"
    rig.run(2.0)
    assert requested(rig).count("disarm") == 1
    assert rig.autopilot.reported.is_armed
    rig.autopilot.refuses.clear()
    rig.run(25.0)
    assert requested(rig).count("disarm") == 2
    assert rig.state.manoeuvre_state == "done"
    assert not rig.state.has_pilot_control
    assert "disarm, forced" not in requested(rig)


def test_a_plane_that_does_not_fly_is_disarmed_although_it_refuses_its_landing() -> None:
    rig = DriverRig(autopilot=ScriptedAutopilot("ardupilot", VehicleClass.PLANE))
    rig.step()
    rig.autopilot.refuses["mode land"] = "it does not fly"
    rig.autopilot.reported = replace(rig.autopilot.reported, is_armed=True, landed=LandedState.ON_GROUND)
    rig.see()
    rig.driver._watch.yield_back()
    for _ in range(14):  # as the landing controller repeats itself
        rig.request(LAND)
        rig.run(2.0)
    assert requested(rig).count("disarm") == 1
    assert not rig.autopilot.reported.is_armed
