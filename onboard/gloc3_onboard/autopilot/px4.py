"""PX4: main and sub modes, offboard, take-off and landing as auto modes; what differs stands in the tables of facts."""

from typing import Final

from gloc3.messages.vehicle import FlightMode, Style, VehicleClass
from gloc3_onboard.autopilot.px4_facts import CLASSES
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    ESTIMATOR_STATUS,
    NAN,
    NAV_LAND,
    NAV_TAKEOFF,
    SET_MODE,
    Command,
    Stream,
    mode_by_number,
)
from gloc3_onboard.sensors.devices import Answer

_CUSTOM_MODE_ENABLED: Final = 1.0
_MODE_BITS: Final = 0xFFFF0000


class Px4:
    """The PX4 family.

    Args:
        vehicle: what it steers.
    """

    style = Style.PX4
    streams = (*COMMON_STREAMS, Stream(ESTIMATOR_STATUS, 1.0))

    def __init__(self, vehicle: VehicleClass = VehicleClass.COPTER) -> None:
        self.facts = CLASSES[vehicle]

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(self.facts.modes, custom_mode & _MODE_BITS)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in PX4's own words."""
        return mode_by_number(self.facts.modes, custom_mode & _MODE_BITS)[1]

    def mode_command(self, mode: FlightMode) -> Command | Answer:
        """The command that asks for a mode."""
        number = self.facts.commanded.get(mode)
        if number is not None:
            main, sub = float(number >> 16 & 0xFF), float(number >> 24)
            return Command(SET_MODE, (_CUSTOM_MODE_ENABLED, main, sub, 0.0, 0.0, 0.0, 0.0))
        if mode is FlightMode.LAND:
            return Command(NAV_LAND, (0.0, 0.0, 0.0, NAN, NAN, NAN, NAN))
        return Answer(False, f"a {self.facts.vehicle} has no mode for {mode}")

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> Command | Answer:
        """PX4 takes the altitude above mean sea level."""
        if not self.facts.manners.climbs:
            return Answer(False, self.facts.why_no_take_off)
        return Command(NAV_TAKEOFF, (NAN, 0.0, 0.0, NAN, NAN, NAN, ground_altitude_m + height_m))
