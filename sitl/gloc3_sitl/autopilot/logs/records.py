"""What a log of the autopilot holds, whichever format it has."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from gloc3.messages.frames import Quaternion, Vector3


class LogHeader(NamedTuple):
    """What is known when a log begins."""

    boot_s: float
    """Seconds since boot."""
    parameters: Mapping[str, float]
    """All parameters."""
    whole: frozenset[str]
    """Names of the parameters that are integers."""
    version: tuple[int, int, int]
    """Of the emulated firmware."""
    mav_type: int
    """MAV_TYPE of the vehicle."""
    output_numbers: tuple[int, ...]
    """Number of the autopilot's output for each actuator, from 1."""
    neutral_us: int
    """Pulse length of an actuator's 0."""
    span_us: int
    """Microseconds from there to its 1."""

    def pulses_us(self, outputs: Sequence[float], count: int) -> list[int]:
        """The pulses of the first outputs, 0 for those that are not used.

        Args:
            outputs: of the actuators, -1 or 0 to 1.
            count: how many outputs.
        """
        pulses = [0] * count
        for number, output in zip(self.output_numbers, outputs, strict=False):
            if number <= count:
                pulses[number - 1] = round(self.neutral_us + self.span_us * output)
        return pulses


class LogRecord(NamedTuple):
    """The state at one moment."""

    boot_s: float
    mode: str
    custom_mode: int
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    outputs: tuple[float, ...]
    """Of the actuators, -1 or 0 to 1."""
    is_armed: bool
    is_landed: bool
    failsafe: str
    """Its cause; empty for none."""
    battery: float
    """Remaining charge, 0 to 1."""
    texts: Sequence[str]
    """Status texts since the previous record."""


class LogFormat(Protocol):
    """A format, for the duration of one log."""

    suffix: str
    """Of the file's name."""

    def begin(self, header: LogHeader) -> bytes:
        """What a file begins with."""

    def add(self, record: LogRecord) -> bytes:
        """What a record adds to it."""
