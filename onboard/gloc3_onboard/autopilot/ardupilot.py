"""ArduPilot Copter: mode numbers, guided, take-off from guided.

Mode numbers: ArduPilot's Copter documentation, "Flight modes"; masks: its "Copter commands in guided mode".
"""

from typing import Final

from gloc3.vehicle import FlightMode, Style
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    HEARTBEAT,
    NAV_TAKEOFF,
    SET_MODE,
    Command,
    Stream,
    mode_by_number,
)

_CUSTOM_MODE_ENABLED: Final = 1.0

_MODES: Final = {
    0: (FlightMode.MANUAL, "STABILIZE"),
    1: (FlightMode.MANUAL, "ACRO"),
    2: (FlightMode.MANUAL, "ALT_HOLD"),
    3: (FlightMode.MISSION, "AUTO"),
    4: (FlightMode.GUIDED, "GUIDED"),
    5: (FlightMode.MANUAL, "LOITER"),
    6: (FlightMode.RETURN, "RTL"),
    7: (FlightMode.MANUAL, "CIRCLE"),
    9: (FlightMode.LAND, "LAND"),
    11: (FlightMode.MANUAL, "DRIFT"),
    13: (FlightMode.MANUAL, "SPORT"),
    16: (FlightMode.MANUAL, "POSHOLD"),
    17: (FlightMode.HOLD, "BRAKE"),
    20: (FlightMode.OTHER, "GUIDED_NOGPS"),
    21: (FlightMode.RETURN, "SMART_RTL"),
}
"""LOITER is flown with the sticks; the mode that holds by itself is BRAKE."""
_NUMBERS: Final = {
    FlightMode.HOLD: 17.0,
    FlightMode.MISSION: 3.0,
    FlightMode.RETURN: 6.0,
    FlightMode.GUIDED: 4.0,
    FlightMode.LAND: 9.0,
}


class ArduPilot:
    """The ArduPilot family."""

    style = Style.ARDUPILOT
    arm_in_mode = FlightMode.GUIDED
    stream_before_guided_s = 0.0
    position_mask = 0b0000_1001_1100_0000
    """Position, velocity as feed-forward, yaw; no acceleration, no yaw rate."""
    streams = (Stream(HEARTBEAT, 5.0), *COMMON_STREAMS)
    """The state comes at 5 Hz, so that a pilot's change of mode is seen within 0.2 s."""

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(_MODES, custom_mode)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in ArduPilot's own words."""
        return mode_by_number(_MODES, custom_mode)[1]

    def mode_command(self, mode: FlightMode) -> Command:
        """The command that asks for a mode."""
        return Command(SET_MODE, (_CUSTOM_MODE_ENABLED, _NUMBERS[mode], 0.0, 0.0, 0.0, 0.0, 0.0))

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> Command:
        """ArduPilot takes the height above home."""
        return Command(NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))
