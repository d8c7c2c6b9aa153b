"""What differs between PX4 and ArduPilot: mode numbers, and how arming, take-off and setpoints are asked for."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from gloc3.vehicle import FlightMode, Style


class Command(NamedTuple):
    """A MAVLink command with its parameters."""

    number: int
    parameters: tuple[float, float, float, float, float, float, float]


class Stream(NamedTuple):
    """A message that the autopilot is asked to send at a rate."""

    message_id: int
    rate_hz: float


class AutopilotStyle(Protocol):
    """One family of autopilots."""

    @property
    def style(self) -> Style:
        """Which family it is."""

    @property
    def arm_in_mode(self) -> FlightMode | None:
        """The mode in which it wants to be armed for a take-off; None for any."""

    @property
    def stream_before_guided_s(self) -> float:
        """How long setpoints must have been streamed before guided mode is accepted."""

    @property
    def position_mask(self) -> int:
        """`type_mask` of SET_POSITION_TARGET_LOCAL_NED for position, velocity and yaw."""

    @property
    def streams(self) -> Sequence[Stream]:
        """The messages that we need."""

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""

    def mode_name(self, custom_mode: int) -> str:
        """A mode in the autopilot's own words."""

    def mode_command(self, mode: FlightMode) -> Command:
        """The command that asks for a mode."""

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> Command:
        """The command that asks to climb.

        Args:
            height_m: above the place where the vehicle stands.
            ground_altitude_m: of that place, above mean sea level.
        """


NAN = math.nan

HEARTBEAT, SYS_STATUS, ATTITUDE_QUATERNION, LOCAL_POSITION_NED = 0, 1, 31, 32
GPS_GLOBAL_ORIGIN, DISTANCE_SENSOR, EXTENDED_SYS_STATE, GLOBAL_POSITION_INT = 49, 132, 245, 33
SET_MODE, NAV_LAND, NAV_TAKEOFF, NAV_RETURN, ARM_DISARM = 176, 21, 22, 20, 400

COMMON_STREAMS = (
    Stream(ATTITUDE_QUATERNION, 20.0),
    Stream(LOCAL_POSITION_NED, 20.0),
    Stream(SYS_STATUS, 2.0),
    Stream(EXTENDED_SYS_STATE, 5.0),
    Stream(DISTANCE_SENSOR, 20.0),
    Stream(GLOBAL_POSITION_INT, 2.0),
    Stream(GPS_GLOBAL_ORIGIN, 1.0),
)
"""Without the heartbeat, whose rate PX4 does not let anybody change."""


def mode_by_number(numbers: Mapping[int, tuple[FlightMode, str]], number: int) -> tuple[FlightMode, str]:
    """A mode from a table, or *other*."""
    return numbers.get(number, (FlightMode.OTHER, f"mode {number}"))
