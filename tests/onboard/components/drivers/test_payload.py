"""The payload driver: commands by name, answers, refusals and missing answers, pauses, and safe states."""

from typing import Any

import pytest
from tests.onboard.stage import Stage

from gloc3.component.settings import load_settings
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3_onboard.components.drivers.payload import ANSWER_S, PayloadDriver, PayloadSettings
from gloc3_onboard.payload.outputs import GripperWrite, OutputWrite, RelayWrite, ServoWrite, WinchWrite
from gloc3_onboard.sensors.devices import CommandAnswer

OUTPUTS: dict[str, Any] = {
    "tilt": {"kind": "servo", "number": 9, "min_us": 1100, "max_us": 1900, "safe": 0.5},
    "claw": {"kind": "gripper", "number": 1},
    "lamp": {"kind": "relay", "number": 2, "chip": "/dev/gpiochip4", "safe": False},
    "pump": {"kind": "relay", "number": 3},
    "hoist": {"kind": "winch", "number": 1},
}


class Device:
    """Accepts commands, unless it refuses or is silent."""

    def __init__(self) -> None:
        self.writes: list[OutputWrite] = []
        self.refusal = ""
        self.is_silent = False

    def send_output(self, write: OutputWrite) -> int:
        self.writes.append(write)
        return len(self.writes)

    def answer(self, ticket: int) -> CommandAnswer | None:
        return None if self.is_silent else CommandAnswer(not self.refusal, self.refusal)


class Bay:
    """A driver with all outputs."""

    def __init__(self) -> None:
        self.device = Device()
        settings = load_settings(PayloadSettings, {"outputs": OUTPUTS, "settle_s": 0.5}, "payload")
        self.driver = PayloadDriver(self.device)
        self.stage = Stage(self.driver, settings)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.stage.step(0.1)

    @property
    def state(self) -> str:
        return str(self.stage.status.state)


@pytest.mark.parametrize(
    ("capability", "arguments", "write"),
    [
        ("set_servo", {"servo": "tilt", "share": 0.25}, ServoWrite(9, 1300.0)),
        ("set_servo", {"servo": "tilt", "pulse_us": 1850.0}, ServoWrite(9, 1850.0)),
        ("grip", {"gripper": "claw", "action": "grab"}, GripperWrite(1, True)),
        ("grip", {"gripper": "claw", "action": "release"}, GripperWrite(1, False)),
        ("switch", {"output": "lamp", "is_on": True}, RelayWrite(2, True, "/dev/gpiochip4")),
    ],
)
def test_a_command_goes_out_by_name_and_is_done_when_accepted_and_settled(
    capability: str, arguments: dict[str, Any], write: OutputWrite
) -> None:
    bay = Bay()
    bay.stage.begin(capability, **arguments)
    bay.run(0.2)
    assert bay.device.writes == [write]
    assert bay.state == ("done" if capability == "switch" else "running")
    bay.run(0.6)
    assert bay.state == "done"
    assert bay.device.writes == [write]


@pytest.mark.parametrize(
    ("capability", "arguments", "told"),
    [
        ("grip", {"gripper": "clow", "action": "grab"}, "there is no gripper 'clow'; .*claw"),
        ("grip", {"gripper": "lamp", "action": "grab"}, "there is no gripper 'lamp'"),
        ("set_servo", {"servo": "tilt", "pulse_us": 2000.0}, "2000 us is outside 1100 to 1900 us"),
        ("set_servo", {"servo": "tilt"}, "share or pulse_us must be given"),
        ("winch", {"winch": "hoist", "length_m": 0.0}, "length_m must not be 0"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(capability: str, arguments: dict[str, Any], told: str) -> None:
    bay = Bay()
    with pytest.raises(Refused, match=told):
        bay.stage.begin(capability, **arguments)
    bay.run(0.5)
    assert bay.device.writes == []


def test_a_refusal_of_the_device_fails_the_action_with_its_reason() -> None:
    bay = Bay()
    bay.device.refusal = "failed: no gripper"
    bay.stage.begin("grip", gripper="claw", action="grab")
    bay.run(0.5)
    assert (bay.state, bay.stage.status.reason) == ("failed", "claw: failed: no gripper")
    assert bay.driver.failures == 1


def test_a_missing_answer_fails_the_action_and_a_quiet_driver_says_that_it_is_quiet() -> None:
    for is_quiet, reason in ((False, f"no answer within {ANSWER_S:g} s"), (True, "this component is quiet")):
        bay = Bay()
        bay.device.is_silent, bay.stage.is_quiet = True, is_quiet
        bay.stage.begin("switch", output="lamp", is_on=True, for_s=30.0)
        bay.run(ANSWER_S - 0.5)
        assert bay.state == "running"
        bay.run(1.0)
        assert bay.state == "failed"
        assert reason in bay.stage.status.reason
        assert len(bay.device.writes) == (0 if is_quiet else 1)


def test_a_lamp_for_a_time_goes_off_at_its_end_and_when_the_action_is_cancelled() -> None:
    for is_cancelled in (False, True):
        bay = Bay()
        bay.stage.begin("switch", output="pump", is_on=True, for_s=2.0)
        bay.run(1.2)
        assert bay.stage.component.latest == "pump"  # type: ignore[attr-defined]
        assert bay.device.writes == [RelayWrite(3, True)]
        if is_cancelled:
            bay.stage.call("action.cancel", action_id="go")
            bay.run(0.3)
        else:
            bay.run(1.2)
        assert bay.device.writes == [RelayWrite(3, True), RelayWrite(3, False)]
        assert bay.state == ("aborted" if is_cancelled else "done")


@pytest.mark.parametrize("is_silent", [False, True])
@pytest.mark.parametrize(
    ("capability", "arguments", "writes"),
    [
        ("switch", {"output": "pump", "is_on": True, "for_s": 60.0}, [RelayWrite(3, True), RelayWrite(3, False)]),
        ("winch", {"winch": "hoist", "length_m": 40.0}, [WinchWrite(1, 40.0, 0.25), WinchWrite(1, 0.0, 0.0)]),
    ],
)
def test_a_cancelled_action_is_undone_before_the_next_one_that_starts_at_once(
    capability: str, arguments: dict[str, Any], writes: list[OutputWrite], is_silent: bool
) -> None:
    bay = Bay()
    bay.device.is_silent = is_silent
    bay.stage.begin(capability, action_id="first", **arguments)
    bay.run(2.0)
    bay.stage.call("action.cancel", action_id="first")
    with pytest.raises(Refused):
        bay.stage.begin("grip", action_id="wrong", gripper="clow", action="grab")
    bay.stage.begin("grip", action_id="next", gripper="claw", action="release")
    bay.run(1.0)
    bay.device.is_silent = False
    bay.run(1.2)
    assert bay.device.writes == [*writes, GripperWrite(1, False)]
    assert (bay.stage.status.action_id, bay.state) == ("next", "done")


def test_an_answer_to_the_command_of_an_ended_action_is_not_taken_for_that_of_the_next() -> None:
    bay = Bay()
    bay.device.is_silent = True
    bay.stage.begin("set_servo", action_id="first", servo="tilt", share=0.0)
    bay.run(1.0)
    bay.stage.call("action.cancel", action_id="first")
    bay.stage.begin("switch", action_id="next", output="pump", is_on=True, for_s=1.0)
    bay.run(0.5)
    bay.device.refusal, bay.device.is_silent = "denied", False
    bay.stage.step(0.1)
    bay.device.refusal = ""
    bay.run(2.0)
    assert bay.state == "done"
    assert bay.device.writes[1:] == [RelayWrite(3, True), RelayWrite(3, False)]


def test_a_command_that_was_not_sent_before_its_action_was_cancelled_is_never_sent() -> None:
    bay = Bay()
    bay.stage.begin("grip", gripper="claw", action="release")
    bay.stage.call("action.cancel", action_id="go")
    bay.stage.begin("switch", output="pump", is_on=True, for_s=5.0)
    bay.stage.call("action.cancel", action_id="go")
    bay.run(1.0)
    assert bay.device.writes == []


def test_a_driver_that_stops_before_it_has_undone_a_cancelled_action_undoes_it_as_it_stops() -> None:
    bay = Bay()
    bay.stage.begin("switch", output="pump", is_on=True, for_s=60.0)
    bay.run(1.0)
    bay.stage.call("action.cancel", action_id="go")
    bay.driver.make_safe()
    bay.driver.stop()
    assert bay.device.writes == [RelayWrite(3, True), RelayWrite(3, False)]


def test_a_lamp_whose_action_is_cancelled_while_it_goes_off_goes_off() -> None:
    for cancelled_after_s in (1.0, 1.1, 1.2, 1.3):
        bay = Bay()
        bay.stage.begin("switch", output="pump", is_on=True, for_s=1.0)
        bay.run(cancelled_after_s)
        if bay.state == "running":
            bay.stage.call("action.cancel", action_id="go")
        bay.run(1.0)
        assert bay.device.writes[1] == RelayWrite(3, False)


def test_what_cannot_be_switched_back_after_its_action_makes_the_driver_faulty() -> None:
    bay = Bay()
    bay.stage.begin("switch", output="pump", is_on=True, for_s=5.0)
    bay.run(1.0)
    bay.device.refusal = "denied"
    bay.stage.call("action.cancel", action_id="go")
    with pytest.raises(Gloc3Error, match="pump could not be reset after its action: denied"):
        bay.run(0.5)


def test_a_winch_whose_stop_is_refused_fails_its_action_and_is_stopped_once_more() -> None:
    bay = Bay()
    bay.stage.begin("winch", winch="hoist", length_m=4.0)
    bay.run(1.0)
    bay.device.refusal = "busy"
    bay.stage.call("action.pause", action_id="go")
    bay.run(0.2)
    bay.device.refusal = ""
    bay.run(0.3)
    assert (bay.state, bay.stage.status.reason) == ("failed", "hoist: busy")
    assert bay.device.writes[1:] == [WinchWrite(1, 0.0, 0.0)] * 2


def test_a_winch_stops_in_a_pause_runs_the_rest_after_it_and_stops_when_cancelled() -> None:
    bay = Bay()
    bay.stage.begin("winch", winch="hoist", length_m=4.0, speed_m_s=0.5)
    bay.run(4.2)
    assert bay.device.writes == [WinchWrite(1, 4.0, 0.5)]
    bay.stage.call("action.pause", action_id="go")
    bay.run(5.0)
    assert bay.device.writes[1:] == [WinchWrite(1, 0.0, 0.0)]
    bay.stage.call("action.resume", action_id="go")
    bay.run(0.3)
    rest = bay.device.writes[2]
    assert isinstance(rest, WinchWrite)
    assert rest.length_m == pytest.approx(2.0, abs=0.1)
    bay.stage.call("action.cancel", action_id="go")
    bay.run(0.3)
    assert bay.device.writes[3:] == [WinchWrite(1, 0.0, 0.0)]
    bay.stage.begin("winch", winch="hoist", length_m=-1.0, speed_m_s=1.0)
    bay.run(1.5)
    assert bay.state == "done"
    assert bay.device.writes[4:] == [WinchWrite(1, -1.0, 1.0)], "it ends by itself"


def test_a_restart_in_flight_runs_what_is_left() -> None:
    bay = Bay()
    bay.stage.begin("winch", winch="hoist", length_m=4.0, speed_m_s=0.5, progress=0.75)
    bay.run(0.3)
    assert bay.device.writes == [WinchWrite(1, 1.0, 0.5)]
    bay.run(2.1)
    assert bay.state == "done"


def test_what_was_used_becomes_safe_and_a_gripper_keeps_its_load() -> None:
    bay = Bay()
    for capability, arguments in (
        ("set_servo", {"servo": "tilt", "share": 1.0}),
        ("grip", {"gripper": "claw", "action": "grab"}),
        ("switch", {"output": "lamp", "is_on": True}),
        ("switch", {"output": "pump", "is_on": True}),
    ):
        bay.stage.begin(capability, **arguments)
        bay.run(1.0)
    bay.stage.begin("winch", winch="hoist", length_m=4.0)
    bay.run(0.5)
    before = len(bay.device.writes)
    bay.driver.stop()
    bay.driver.make_safe()
    assert bay.device.writes[before:] == [
        ServoWrite(9, 1500.0),
        RelayWrite(2, False, "/dev/gpiochip4"),
        WinchWrite(1, 0.0, 0.0),
    ]
    bay.driver.make_safe()
    assert len(bay.device.writes) == before + 3


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="kind"):
        load_settings(PayloadSettings, {"outputs": {"tilt": {"kind": "motor", "number": 1}}}, "payload")
