"""PX4: main and sub modes, offboard, take-off and landing as auto modes.

Mode numbers: PX4's `px4_custom_mode.h` as listed in the MAVLink guide; masks: MAVLink, POSITION_TARGET_TYPEMASK.
"""

from typing import Final

from gloc3.vehicle import FlightMode, Style
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    NAN,
    NAV_LAND,
    NAV_TAKEOFF,
    SET_MODE,
    Command,
    mode_by_number,
)

_CUSTOM_MODE_ENABLED: Final = 1.0

_MODES: Final = {
    1 << 16: (FlightMode.MANUAL, "MANUAL"),
    2 << 16: (FlightMode.MANUAL, "ALTCTL"),
    3 << 16: (FlightMode.MANUAL, "POSCTL"),
    4 << 16 | 1 << 24: (FlightMode.OTHER, "AUTO.READY"),
    4 << 16 | 2 << 24: (FlightMode.TAKE_OFF, "AUTO.TAKEOFF"),
    4 << 16 | 3 << 24: (FlightMode.HOLD, "AUTO.LOITER"),
    4 << 16 | 4 << 24: (FlightMode.MISSION, "AUTO.MISSION"),
    4 << 16 | 5 << 24: (FlightMode.RETURN, "AUTO.RTL"),
    4 << 16 | 6 << 24: (FlightMode.LAND, "AUTO.LAND"),
    4 << 16 | 8 << 24: (FlightMode.OTHER, "AUTO.FOLLOW"),
    4 << 16 | 9 << 24: (FlightMode.OTHER, "AUTO.PRECLAND"),
    5 << 16: (FlightMode.MANUAL, "ACRO"),
    6 << 16: (FlightMode.GUIDED, "OFFBOARD"),
    7 << 16: (FlightMode.MANUAL, "STABILIZED"),
    8 << 16: (FlightMode.MANUAL, "RATTITUDE"),
}
_NUMBERS: Final = {
    FlightMode.HOLD: (4.0, 3.0),
    FlightMode.MISSION: (4.0, 4.0),
    FlightMode.RETURN: (4.0, 5.0),
    FlightMode.GUIDED: (6.0, 0.0),
}


class Px4:
    """The PX4 family."""

    style = Style.PX4
    arm_in_mode = None
    stream_before_guided_s = 1.0
    """PX4 guide, "Offboard mode": the stream must have been there for at least a second."""
    position_mask = 0b0000_1001_1100_0000
    """Position, velocity as feed-forward, yaw; no acceleration, no yaw rate."""
    streams = COMMON_STREAMS

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(_MODES, custom_mode & 0xFFFF0000)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in PX4's own words."""
        return mode_by_number(_MODES, custom_mode & 0xFFFF0000)[1]

    def mode_command(self, mode: FlightMode) -> Command:
        """The command that asks for a mode."""
        if mode is FlightMode.LAND:
            return Command(NAV_LAND, (0.0, 0.0, 0.0, NAN, NAN, NAN, NAN))
        main, sub = _NUMBERS[mode]
        return Command(SET_MODE, (_CUSTOM_MODE_ENABLED, main, sub, 0.0, 0.0, 0.0, 0.0))

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> Command:
        """PX4 takes the altitude above mean sea level."""
        return Command(NAV_TAKEOFF, (NAN, 0.0, 0.0, NAN, NAN, NAN, ground_altitude_m + height_m))
