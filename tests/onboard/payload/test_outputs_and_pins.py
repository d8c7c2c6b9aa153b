"""Commands of outputs as MAVLink expresses them for each family, and the computer's own pins."""

import sys
from math import isnan
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from gloc3.errors import Refused
from gloc3.messages.vehicle import Style
from gloc3_onboard.payload.outputs import (
    GripperWrite,
    OutputWrite,
    RelayWrite,
    ServoWrite,
    WinchWrite,
    output_command,
)
from gloc3_onboard.payload.pins import Pins


@pytest.mark.parametrize(
    ("write", "number", "parameters"),
    [
        (ServoWrite(9, 1300.0), 183, (9.0, 1300.0)),
        (GripperWrite(1, True), 211, (1.0, 1.0)),
        (GripperWrite(2, False), 211, (2.0, 0.0)),
        (RelayWrite(0, True), 181, (0.0, 1.0)),
        (WinchWrite(1, -2.5, 0.4), 42600, (1.0, 1.0, -2.5, 0.4)),
        (WinchWrite(1, 0.0, 0.0), 42600, (1.0, 2.0, 0.0, 0.0)),
    ],
)
def test_commands_of_mavlink(write: OutputWrite, number: int, parameters: tuple[float, ...]) -> None:
    command = output_command(write, Style.ARDUPILOT)
    assert (command.number, command.parameters[: len(parameters)]) == (number, parameters)
    assert not any(command.parameters[len(parameters) :])
    assert command.is_repeatable == (not isinstance(write, WinchWrite) or not write.length_m)


def test_px4_moves_actuators_of_a_set_and_leaves_the_others_alone() -> None:
    command = output_command(ServoWrite(2, 1750.0), Style.PX4)
    assert command.number == 187
    assert command.parameters[1] == 0.5
    assert [isnan(value) for value in command.parameters] == [True, False, True, True, True, True, False]
    with pytest.raises(Refused, match=r"actuators 1 to 6 .* not 9"):
        output_command(ServoWrite(9, 1500.0), Style.PX4)


def test_a_servo_on_the_kernels_files(tmp_path: Path) -> None:
    chip = tmp_path / "pwmchip0"
    (chip / "pwm1").mkdir(parents=True)
    pins = Pins()
    answer = pins.answer(pins.send_output(ServoWrite(1, 1300.0, str(chip))))
    assert answer is not None
    assert answer.is_accepted
    files = {name: (chip / "pwm1" / name).read_text() for name in ("period", "duty_cycle", "enable")}
    assert files == {"period": "20000000", "duty_cycle": "1300000", "enable": "1"}
    answer = pins.answer(pins.send_output(ServoWrite(0, 1300.0, str(chip))))
    assert answer is not None
    assert (chip / "export").read_text() == "0", "the kernel would make the channel's folder now"
    assert not answer.is_accepted
    assert "pwm0" in answer.reason


@pytest.mark.parametrize(
    ("write", "told"),
    [
        (ServoWrite(0, 1500.0, "/nowhere/pwmchip0"), "/nowhere/pwmchip0 is no PWM chip"),
        (RelayWrite(17, True, "/dev/null"), "/dev/null is no GPIO chip; gpiodetect lists them"),
        (GripperWrite(1, True), "switch relays and move servos only"),
    ],
)
def test_what_the_pins_cannot_do_is_answered_with_the_reason(write: OutputWrite, told: str) -> None:
    pins = Pins()
    answer = pins.answer(pins.send_output(write))
    assert answer is not None
    assert not answer.is_accepted
    assert told in answer.reason


def test_without_the_library_the_answer_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gpiod", None)
    pins = Pins()
    answer = pins.answer(pins.send_output(RelayWrite(17, True)))
    assert answer is not None
    assert answer.reason == "the package gpiod is missing: pip install 'gloc3[gpio]'"


def test_a_line_is_requested_once_as_an_output_and_then_switched(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the library's own settings and values; the kernel's part stands in, since no chip is here."""
    import gpiod
    from gpiod.line import Direction, Value

    calls: list[Any] = []

    class Request:
        def set_value(self, line: int, value: Value) -> None:
            calls.append((line, value))

    def request_lines(path: str, consumer: str, config: dict[int, gpiod.LineSettings]) -> Request:
        (line, settings), *rest = config.items()
        assert not rest
        calls.append((path, consumer, line, settings.direction, settings.output_value))
        return Request()

    assert isinstance(gpiod, ModuleType)
    monkeypatch.setattr(gpiod, "is_gpiochip_device", lambda path: path == "/dev/gpiochip4")
    monkeypatch.setattr(gpiod, "request_lines", request_lines)
    pins = Pins()
    for is_on in (True, False):
        answer = pins.answer(pins.send_output(RelayWrite(17, is_on, "/dev/gpiochip4")))
        assert answer is not None
        assert answer.is_accepted, answer.reason
    assert calls == [("/dev/gpiochip4", "gloc3", 17, Direction.OUTPUT, Value.ACTIVE), (17, Value.INACTIVE)]
