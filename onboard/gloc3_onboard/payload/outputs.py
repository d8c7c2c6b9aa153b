"""Commands to payload outputs, and how MAVLink expresses them."""

from math import nan
from typing import Final, NamedTuple, Protocol

from gloc3.errors import Refused
from gloc3.messages.vehicle import Style
from gloc3_onboard.sensors.devices import CommandAnswer

DO_SET_RELAY: Final = 181
DO_SET_SERVO: Final = 183
DO_SET_ACTUATOR: Final = 187
DO_GRIPPER: Final = 211
DO_WINCH: Final = 42600
_RELATIVE_LENGTH, _RATE = 1.0, 2.0
"""WINCH_ACTIONS."""
_PX4_ACTUATORS: Final = 6
CENTER_US: Final = 1500.0
_SPAN_US: Final = 500.0


class ServoWrite(NamedTuple):
    """Write: a servo moves."""

    number: int
    """Output of the autopilot, from 1; for PX4 the actuator of a set, 1 to 6; of the computer the channel of the PWM chip."""
    pulse_us: float
    chip: str = ""
    """Of the computer: the folder of the PWM chip."""


class GripperWrite(NamedTuple):
    """Write: a gripper grabs or releases."""

    number: int
    """Instance, from 1."""
    grabs: bool


class RelayWrite(NamedTuple):
    """Write: a relay, lamp or pump is switched."""

    number: int
    """Instance of the autopilot, from 0; of the computer the line of the GPIO chip."""
    is_on: bool
    chip: str = ""
    """Of the computer: the device file of the GPIO chip."""


class WinchWrite(NamedTuple):
    """Write: a winch releases a length of line, or winds it in if negative; with a length of 0 it stops."""

    number: int
    """Instance, from 1."""
    length_m: float
    speed_m_s: float


OutputWrite = ServoWrite | GripperWrite | RelayWrite | WinchWrite
Parameters = tuple[float, float, float, float, float, float, float]


class OutputDevice(Protocol):
    """Interface of a device with payload outputs. Nothing blocks; answers are polled with the command's ticket."""

    def send_output(self, write: OutputWrite) -> int:
        """Commands an output; commands of one kind are sent one after the other."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""


class OutputCommand(NamedTuple):
    """A MAVLink command to an output."""

    number: int
    """MAV_CMD."""
    parameters: Parameters
    is_repeatable: bool = True
    """Whether it may be sent again if its answer stays away: a winch would run twice."""


def output_command(write: OutputWrite, style: Style) -> OutputCommand:
    """The command of an autopilot's family.

    Raises:
        Refused: this family cannot do it.
    """
    match write:
        case ServoWrite(number, pulse_us) if style is Style.PX4:
            if not 1 <= number <= _PX4_ACTUATORS:
                raise Refused(f"PX4 has actuators 1 to {_PX4_ACTUATORS} (Peripheral via Actuator Set), not {number}")
            values = [nan] * _PX4_ACTUATORS
            values[number - 1] = min(max((pulse_us - CENTER_US) / _SPAN_US, -1.0), 1.0)
            return OutputCommand(
                DO_SET_ACTUATOR, (values[0], values[1], values[2], values[3], values[4], values[5], 0.0)
            )
        case ServoWrite(number, pulse_us):
            return OutputCommand(DO_SET_SERVO, (float(number), pulse_us, 0.0, 0.0, 0.0, 0.0, 0.0))
        case GripperWrite(number, grabs):
            return OutputCommand(DO_GRIPPER, (float(number), float(grabs), 0.0, 0.0, 0.0, 0.0, 0.0))
        case RelayWrite(number, is_on):
            return OutputCommand(DO_SET_RELAY, (float(number), float(is_on), 0.0, 0.0, 0.0, 0.0, 0.0))
        case WinchWrite(number, length_m, speed_m_s) if length_m:
            parameters = (float(number), _RELATIVE_LENGTH, length_m, speed_m_s, 0.0, 0.0, 0.0)
            return OutputCommand(DO_WINCH, parameters, is_repeatable=False)
        case WinchWrite(number):
            return OutputCommand(DO_WINCH, (float(number), _RATE, 0.0, 0.0, 0.0, 0.0, 0.0))
