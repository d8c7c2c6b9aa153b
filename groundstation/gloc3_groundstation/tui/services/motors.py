"""The motor test: one motor of a disarmed vehicle turns, weakly and shortly, after a typed confirmation."""

from collections.abc import Sequence
from typing import ClassVar, Final

from textual.binding import Binding, BindingType

from gloc3.errors import Refused
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import Firmware, VehicleDesk
from gloc3_groundstation.services.motor_test import MotorTestSettings, motor_count
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.panel import Row

WARNING: Final = (
    "The motor turns although the vehicle is disarmed. Take the propellers off, and hold the vehicle down. A test can "
    "be stopped (s), but a lost link delays that; the vehicle itself ends it after the time."
)
ORDER: Final = {
    Firmware.PX4: "PX4 counts its motors as in its geometry (CA_ROTOR): 1 is at the front right of a quad in X form.",
    Firmware.ARDUPILOT: "ArduPilot counts in its test order: 1 is motor A, at the front right, then clockwise.",
}


class MotorsPane(ServicePane):
    """The pane of the motor test."""

    service = ServiceKind.MOTORS
    detail_lines = 1
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "test", "Test", tooltip="turns the motor under the cursor; also enter"),
        Binding("s", "stop", "Stop", tooltip="stops the motor at once; also esc"),
        Binding("p", "power", "Power", tooltip="throttle and time of a test"),
    ]

    def fill(self, vehicle: VehicleDesk) -> None:
        """The motors, and how they are tested."""
        settings, outcomes = vehicle.motors.settings, vehicle.motors.outcomes
        rows = [
            Row(
                (Span(f" motor {number:<4}", Tone.STRONG), Span(outcomes.get(number, ""), Tone.TEXT)),
                str(number),
            )
            for number in range(1, motor_count(vehicle.snapshot) + 1)
        ]
        header = (Span(f" each test: {settings.percent:g} % of throttle, {settings.seconds:g} s", Tone.DIM),)
        self.show(header, rows, "motors of a disarmed vehicle, propellers off")
        order = ORDER.get(vehicle.snapshot.firmware, "")
        self.show_detail(lambda width: _lines(order, width))

    def choose(self, key: str) -> None:
        """Tests a motor, after the confirmation."""
        vehicle = self.vehicle
        if vehicle is None or not key:
            return
        motor = int(key)
        if vehicle.motors.is_confirmed:
            vehicle.motors.test(motor)
            self.show_again()
            return
        self.prompt(
            f"turn motor {motor} of {vehicle.name}?",
            lambda _: vehicle.motors.test(motor),
            lines=lambda width: _lines(ORDER.get(vehicle.snapshot.firmware, ""), width),
            hint=f"type {vehicle.name} or props off",
            check=lambda text: vehicle.motors.confirm(text, vehicle.name),
        )

    def action_test(self) -> None:
        """Tests the motor under the cursor."""
        self.choose(self.list.chosen)

    def action_stop(self) -> None:
        """Stops the test."""
        if self.vehicle is not None:
            self.vehicle.jobs.cancel(self.service)

    def action_power(self) -> None:
        """Asks for throttle and time."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        now = vehicle.motors.settings

        def work(text: str) -> None:
            vehicle.motors.settings = _settings(text)

        value = f"{now.percent:g} {now.seconds:g}"
        self.prompt("throttle in %, time in s", work, value=value, hint="10 2", check=_wrong)


def _lines(order: str, width: int) -> Sequence[Line]:
    warning = [(Span(f" {text}", Tone.WARN),) for text in wrapped(WARNING, width - 2)]
    return [*warning, *((Span(f" {text}", Tone.DIM),) for text in wrapped(order, width - 2))]


def _settings(text: str) -> MotorTestSettings:
    """Throttle and time as they were typed.

    Raises:
        Refused: they are no numbers, or beyond the bounds.
    """
    try:
        percent, seconds = map(float, text.replace(",", " ").split())
    except ValueError:
        raise Refused(f"{text!r}: two numbers are expected, as 10 2 for 10 % and 2 s") from None
    settings = MotorTestSettings(percent=percent, seconds=seconds)
    settings.check()
    return settings


def _wrong(text: str) -> str:
    try:
        _settings(text)
    except Refused as error:
        return str(error)
    return ""
