"""PX4: main and sub modes, offboard, take-off and landing as auto modes, and what differs between its vehicle classes."""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.vehicle import FlightMode, Style, VehicleClass, VtolForm
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    ESTIMATOR_STATUS,
    LOCAL_NED,
    NAN,
    NAV_LAND,
    NAV_TAKEOFF,
    SET_MODE,
    ClassProperties,
    Form,
    MavCommand,
    MessageStream,
    Modes,
    mode_by_number,
)
from gloc3_onboard.sensors.devices import AutopilotBehaviour, CommandAnswer

_LOSS_S: Final = 1.0
"""COM_OF_LOSS_T; setpoints must come at 2 Hz and more."""
_STREAM_S: Final = 1.0
"""The stream must have been there for at least a second before offboard mode is accepted."""

MODES: Final[Modes] = {
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
    10 << 16: (FlightMode.OTHER, "TERMINATION"),
}
_COMMANDED: Final = {
    FlightMode.HOLD: 4 << 16 | 3 << 24,
    FlightMode.MISSION: 4 << 16 | 4 << 24,
    FlightMode.RETURN: 4 << 16 | 5 << 24,
    FlightMode.GUIDED: 6 << 16,
}

COPTER: Final = ClassProperties(
    vehicle=VehicleClass.COPTER,
    modes=MODES,
    commanded=_COMMANDED,
    behaviour=AutopilotBehaviour(arm_in_mode=FlightMode.HOLD, stream_before_guided_s=_STREAM_S),
    form=Form.ACCELERATED,
    timeout_s=_LOSS_S,
)

ROVER: Final = ClassProperties(
    vehicle=VehicleClass.ROVER,
    modes=MODES,
    commanded={**_COMMANDED, FlightMode.LAND: _COMMANDED[FlightMode.HOLD]},
    behaviour=AutopilotBehaviour(
        vehicle=VehicleClass.ROVER,
        arm_in_mode=FlightMode.HOLD,
        stream_before_guided_s=_STREAM_S,
        climbs=False,
        land_mode=FlightMode.HOLD,
        disarms_itself=False,
        at_rest_s=1.0,
    ),
    form=Form.VELOCITY,
    reports_landed=False,
    timeout_s=_LOSS_S,
    why_no_take_off="a rover does not take off; its missions begin with drive_off",
)

PLANE: Final = ClassProperties(
    vehicle=VehicleClass.PLANE,
    modes=MODES,
    commanded=_COMMANDED,
    behaviour=AutopilotBehaviour(
        vehicle=VehicleClass.PLANE,
        arm_in_mode=FlightMode.HOLD,
        stream_before_guided_s=_STREAM_S,
        returns_to_land=True,
    ),
    timeout_s=_LOSS_S,
)
"""In offboard mode it flies to the position and circles there; in AUTO.LAND it circles down where it is."""

VTOL: Final = ClassProperties(
    vehicle=VehicleClass.VTOL,
    modes={**MODES, 4 << 16 | 10 << 24: (FlightMode.TAKE_OFF, "AUTO.VTOL_TAKEOFF")},
    commanded=_COMMANDED,
    behaviour=AutopilotBehaviour(vehicle=VehicleClass.VTOL, arm_in_mode=FlightMode.HOLD),
    timeout_s=float("inf"),
)
"""It holds, returns and lands in the form in which it flies; landings are on rotors (NAV_FORCE_VT)."""

CLASSES: Final[Mapping[VehicleClass, ClassProperties]] = {
    snapshot.vehicle: snapshot for snapshot in (COPTER, ROVER, PLANE, VTOL)
}


_CUSTOM_MODE_ENABLED: Final = 1.0
_MODE_BITS: Final = 0xFFFF0000


class Px4:
    """The PX4 family.

    Args:
        vehicle: its vehicle class.
    """

    style = Style.PX4
    streams = (*COMMON_STREAMS, MessageStream(ESTIMATOR_STATUS, 1.0))
    odometry_frame = LOCAL_NED
    fence_on_command = None
    """GF_ACTION decides; the checks before a start read it."""

    def __init__(self, vehicle: VehicleClass = VehicleClass.COPTER) -> None:
        self.class_properties = CLASSES[vehicle]

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(self.class_properties.modes, custom_mode & _MODE_BITS)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in PX4's own words."""
        return mode_by_number(self.class_properties.modes, custom_mode & _MODE_BITS)[1]

    def mode_command(self, mode: FlightMode, form: VtolForm | None = None) -> MavCommand | CommandAnswer:
        """The command for a mode."""
        del form
        number = self.class_properties.commanded.get(mode)
        if number is not None:
            main, sub = float(number >> 16 & 0xFF), float(number >> 24)
            return MavCommand(SET_MODE, (_CUSTOM_MODE_ENABLED, main, sub, 0.0, 0.0, 0.0, 0.0))
        if mode is FlightMode.LAND:
            return MavCommand(NAV_LAND, (0.0, 0.0, 0.0, NAN, NAN, NAN, NAN))
        return CommandAnswer(False, f"a {self.class_properties.vehicle} has no mode for {mode}")

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> MavCommand | CommandAnswer:
        """Take-off by altitude above mean sea level."""
        if not self.class_properties.behaviour.climbs:
            return CommandAnswer(False, self.class_properties.why_no_take_off)
        return MavCommand(NAV_TAKEOFF, (NAN, 0.0, 0.0, NAN, NAN, NAN, ground_altitude_m + height_m))
