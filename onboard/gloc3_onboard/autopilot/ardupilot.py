"""ArduPilot: what all its vehicles have in common; what differs stands in the tables of facts."""

from typing import Final

from gloc3.messages.vehicle import FlightMode, Style, VehicleClass
from gloc3_onboard.autopilot.ardupilot_facts import CLASSES
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    EKF_STATUS_REPORT,
    HEARTBEAT,
    NAV_TAKEOFF,
    SET_MODE,
    Command,
    Stream,
    mode_by_number,
)
from gloc3_onboard.sensors.devices import Answer

_CUSTOM_MODE_ENABLED: Final = 1.0


class ArduPilot:
    """The ArduPilot family.

    Args:
        vehicle: what it steers.
    """

    style = Style.ARDUPILOT
    streams = (Stream(HEARTBEAT, 5.0), *COMMON_STREAMS, Stream(EKF_STATUS_REPORT, 1.0))
    """The state comes at 5 Hz, so that a pilot's change of mode is seen within 0.2 s."""

    def __init__(self, vehicle: VehicleClass = VehicleClass.COPTER) -> None:
        self.facts = CLASSES[vehicle]

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(self.facts.modes, custom_mode)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in ArduPilot's own words."""
        return mode_by_number(self.facts.modes, custom_mode)[1]

    def mode_command(self, mode: FlightMode) -> Command | Answer:
        """The command that asks for a mode."""
        number = self.facts.commanded.get(mode)
        if number is None:
            return Answer(False, f"a {self.facts.vehicle} has no mode for {mode}")
        return Command(SET_MODE, (_CUSTOM_MODE_ENABLED, float(number), 0.0, 0.0, 0.0, 0.0, 0.0))

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> Command | Answer:
        """ArduPilot takes the height above home; planes take off in a mode, to a height that is set in them."""
        if not self.facts.manners.climbs:
            return Answer(False, self.facts.why_no_take_off)
        if FlightMode.TAKE_OFF in self.facts.commanded:
            return self.mode_command(FlightMode.TAKE_OFF)
        return Command(NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))
