"""Relays and servos on the computer's own pins: GPIO lines by libgpiod, PWM channels by the kernel's files."""

from pathlib import Path
from typing import Any, Final

from gloc3.errors import Gloc3Error
from gloc3_onboard.payload.outputs import OutputWrite, RelayWrite, ServoWrite
from gloc3_onboard.sensors.devices import CommandAnswer

DEFAULT_CHIP: Final = "/dev/gpiochip0"
DEFAULT_PWM: Final = "/sys/class/pwm/pwmchip0"
PERIOD_NS: Final = 20_000_000
"""Of a servo's pulses: 50 Hz."""
KEPT: Final = 64


class Pins:
    """The device `pins`: each command is carried out and answered at once.

    Lines and channels stay as they are when the process ends, as far as the kernel allows.
    """

    def __init__(self) -> None:
        self._lines: dict[tuple[str, int], Any] = {}
        self._answers: dict[int, CommandAnswer] = {}
        self._tickets = 0

    def send_output(self, write: OutputWrite) -> int:
        """Switches a line or sets a channel."""
        self._tickets += 1
        try:
            if isinstance(write, RelayWrite):
                self._switch(write)
            elif isinstance(write, ServoWrite):
                _set_pulse(write)
            else:
                raise Gloc3Error("the computer's pins switch relays and move servos only")
        except (OSError, Gloc3Error) as error:
            self._answers[self._tickets] = CommandAnswer(False, _words(error, write))
        else:
            self._answers[self._tickets] = CommandAnswer(True, "")
        self._answers.pop(self._tickets - KEPT, None)
        return self._tickets

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command."""
        return self._answers.get(ticket)

    def _switch(self, write: RelayWrite) -> None:
        try:
            import gpiod
            from gpiod.line import Direction, Value
        except ImportError as error:
            raise Gloc3Error("the package gpiod is missing: pip install 'gloc3[gpio]'") from error
        chip = write.chip or DEFAULT_CHIP
        value = Value.ACTIVE if write.is_on else Value.INACTIVE
        key = (chip, write.number)
        if key in self._lines:
            self._lines[key].set_value(write.number, value)
            return
        if not gpiod.is_gpiochip_device(chip):
            raise Gloc3Error(f"{chip} is no GPIO chip; gpiodetect lists them")
        settings = gpiod.LineSettings(direction=Direction.OUTPUT, output_value=value)
        self._lines[key] = gpiod.request_lines(chip, consumer="gloc3", config={write.number: settings})


def _set_pulse(write: ServoWrite) -> None:
    chip = Path(write.chip or DEFAULT_PWM)
    if not chip.is_dir():
        raise Gloc3Error(f"{chip} is no PWM chip; on a Raspberry Pi add dtoverlay=pwm to config.txt")
    channel = chip / f"pwm{write.number}"
    if not channel.is_dir():
        (chip / "export").write_text(str(write.number))
    (channel / "period").write_text(str(PERIOD_NS))
    (channel / "duty_cycle").write_text(str(round(write.pulse_us * 1e3)))
    (channel / "enable").write_text("1")


def _words(error: OSError | Gloc3Error, write: OutputWrite) -> str:
    if not isinstance(error, OSError):
        return str(error)
    where = error.filename or getattr(write, "chip", "") or DEFAULT_CHIP
    hint = "; may this user use it? sudo usermod -aG gpio $USER" if isinstance(error, PermissionError) else ""
    return f"{where}, output {write.number}: {error.strerror or error}{hint}"
