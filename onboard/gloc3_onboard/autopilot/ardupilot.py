"""ArduPilot: what all its vehicles have in common, and tables of what differs between their classes."""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.vehicle import FlightMode, Style, VehicleClass, VtolForm
from gloc3_onboard.autopilot.style import (
    COMMON_STREAMS,
    DO_FENCE_ENABLE,
    EKF_STATUS_REPORT,
    GPS_GLOBAL_ORIGIN,
    HEARTBEAT,
    LOCAL_FRD,
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

_TIMEOUT_S: Final = 3.0
"""GUID_TIMEOUT of Copter; in Rover and Sub it cannot be changed."""
_MANUAL, _HOLD, _GUIDED, _OTHER = FlightMode.MANUAL, FlightMode.HOLD, FlightMode.GUIDED, FlightMode.OTHER
_MISSION, _RETURN, _LAND, _TAKE_OFF = FlightMode.MISSION, FlightMode.RETURN, FlightMode.LAND, FlightMode.TAKE_OFF

COPTER: Final = ClassProperties(
    vehicle=VehicleClass.COPTER,
    modes={
        0: (_MANUAL, "STABILIZE"),
        1: (_MANUAL, "ACRO"),
        2: (_MANUAL, "ALT_HOLD"),
        3: (_MISSION, "AUTO"),
        4: (_GUIDED, "GUIDED"),
        5: (_MANUAL, "LOITER"),  # flown with the sticks; the mode that holds by itself is BRAKE
        6: (_RETURN, "RTL"),
        7: (_MANUAL, "CIRCLE"),
        9: (_LAND, "LAND"),
        11: (_MANUAL, "DRIFT"),
        13: (_MANUAL, "SPORT"),
        16: (_MANUAL, "POSHOLD"),
        17: (_HOLD, "BRAKE"),
        20: (_OTHER, "GUIDED_NOGPS"),
        21: (_RETURN, "SMART_RTL"),
        27: (_RETURN, "AUTO_RTL"),
    },
    commanded={_HOLD: 17, _MISSION: 3, _RETURN: 6, _GUIDED: 4, _LAND: 9},
    behaviour=AutopilotBehaviour(arm_in_mode=_GUIDED),
    form=Form.ACCELERATED,
    timeout_s=_TIMEOUT_S,
)

_ROVER_MODES: Final[Modes] = {
    0: (_MANUAL, "MANUAL"),
    1: (_MANUAL, "ACRO"),
    3: (_MANUAL, "STEERING"),
    4: (_HOLD, "HOLD"),
    5: (_HOLD, "LOITER"),
    6: (_OTHER, "FOLLOW"),
    7: (_MANUAL, "SIMPLE"),
    8: (_OTHER, "DOCK"),
    9: (_OTHER, "CIRCLE"),
    10: (_MISSION, "AUTO"),
    11: (_RETURN, "RTL"),
    12: (_RETURN, "SMART_RTL"),
    15: (_GUIDED, "GUIDED"),
    16: (_OTHER, "INITIALISING"),
}
"""HOLD stops, with the motors off; LOITER goes back to the place where it stopped, which a boat needs."""
_LED: Final = AutopilotBehaviour(
    arm_in_mode=_GUIDED, climbs=False, land_mode=_HOLD, disarms_itself=False, at_rest_s=1.0
)
_NO_CLIMB: Final = "a {} does not take off; its missions begin with {}"

ROVER: Final = ClassProperties(
    vehicle=VehicleClass.ROVER,
    modes=_ROVER_MODES,
    commanded={_HOLD: 4, _MISSION: 10, _RETURN: 11, _GUIDED: 15, _LAND: 4},
    behaviour=_LED._replace(vehicle=VehicleClass.ROVER),
    form=Form.VELOCITY,
    reports_landed=False,
    timeout_s=_TIMEOUT_S,
    why_no_take_off=_NO_CLIMB.format("rover", "drive_off"),
)

BOAT: Final = ClassProperties(
    vehicle=VehicleClass.BOAT,
    modes=_ROVER_MODES,
    commanded={_HOLD: 5, _MISSION: 10, _RETURN: 11, _GUIDED: 15, _LAND: 4},
    behaviour=_LED._replace(vehicle=VehicleClass.BOAT, at_rest_s=3.0),
    form=Form.VELOCITY,
    reports_landed=False,
    hold_unplaced=4,
    timeout_s=_TIMEOUT_S,
    why_no_take_off=_NO_CLIMB.format("boat", "drive_off"),
)

SUB: Final = ClassProperties(
    vehicle=VehicleClass.SUB,
    modes={
        0: (_MANUAL, "STABILIZE"),
        1: (_MANUAL, "ACRO"),
        2: (_MANUAL, "ALT_HOLD"),
        3: (_MISSION, "AUTO"),
        4: (_GUIDED, "GUIDED"),
        7: (_OTHER, "CIRCLE"),
        9: (_LAND, "SURFACE"),
        16: (_HOLD, "POSHOLD"),
        19: (_MANUAL, "MANUAL"),
        20: (_OTHER, "MOTOR_DETECT"),
        21: (_MANUAL, "SURFTRAK"),
    },
    commanded={_HOLD: 16, _MISSION: 3, _GUIDED: 4, _LAND: 9},
    behaviour=_LED._replace(
        vehicle=VehicleClass.SUB, land_mode=_LAND, at_rest_s=8.0, floats=True, lands_into=("ALT_HOLD",)
    ),
    form=Form.MOVING,
    reports_landed=False,
    timeout_s=_TIMEOUT_S,
    why_no_take_off=_NO_CLIMB.format("submarine", "dive or drive_off"),
)
"""At the surface SURFACE goes over to ALT_HOLD; there is no mode that returns."""

PLANE: Final = ClassProperties(
    vehicle=VehicleClass.PLANE,
    modes={
        0: (_MANUAL, "MANUAL"),
        1: (_OTHER, "CIRCLE"),
        2: (_MANUAL, "STABILIZE"),
        3: (_MANUAL, "TRAINING"),
        4: (_MANUAL, "ACRO"),
        5: (_MANUAL, "FBWA"),
        6: (_MANUAL, "FBWB"),
        7: (_MANUAL, "CRUISE"),
        8: (_MANUAL, "AUTOTUNE"),
        10: (_MISSION, "AUTO"),
        11: (_RETURN, "RTL"),
        12: (_HOLD, "LOITER"),
        13: (_TAKE_OFF, "TAKEOFF"),
        14: (_OTHER, "AVOID_ADSB"),
        15: (_GUIDED, "GUIDED"),
        16: (_OTHER, "INITIALISING"),
        17: (_MANUAL, "QSTABILIZE"),
        18: (_MANUAL, "QHOVER"),
        19: (_MANUAL, "QLOITER"),
        20: (_LAND, "QLAND"),
        21: (_RETURN, "QRTL"),
        24: (_OTHER, "THERMAL"),
        26: (_LAND, "AUTOLAND"),
    },
    commanded={_HOLD: 12, _MISSION: 10, _RETURN: 11, _GUIDED: 15, _LAND: 26, _TAKE_OFF: 13},
    behaviour=AutopilotBehaviour(vehicle=VehicleClass.PLANE),
    form=Form.REPOSITION,
    timeout_s=float("inf"),
)
"""AUTOLAND exists from 4.6 on; take-off uses the TAKEOFF mode, to the height TKOFF_ALT."""

VTOL: Final = ClassProperties(
    vehicle=VehicleClass.VTOL,
    modes={
        **PLANE.modes,
        15: (_HOLD, "GUIDED"),
        22: (_MANUAL, "QAUTOTUNE"),
        23: (_MANUAL, "QACRO"),
        25: (_LAND, "LOITER2QLAND"),
    },
    commanded={_HOLD: 12, _MISSION: 10, _RETURN: 11, _LAND: 20},
    behaviour=AutopilotBehaviour(vehicle=VehicleClass.VTOL),
    hold_on_rotors=15,
    timeout_s=float("inf"),
)
"""LOITER circles on wings, and GUIDED hovers where Q_GUIDED_MODE is 1; both hold. QLAND lands on rotors."""

CLASSES: Final[Mapping[VehicleClass, ClassProperties]] = {
    snapshot.vehicle: snapshot for snapshot in (COPTER, ROVER, BOAT, SUB, PLANE, VTOL)
}


_CUSTOM_MODE_ENABLED: Final = 1.0


def _mode_command(number: int) -> MavCommand:
    return MavCommand(SET_MODE, (_CUSTOM_MODE_ENABLED, float(number), 0.0, 0.0, 0.0, 0.0, 0.0))


class ArduPilot:
    """The ArduPilot family.

    Args:
        vehicle: its vehicle class.
    """

    style = Style.ARDUPILOT
    streams = (
        *(MessageStream(HEARTBEAT, 5.0), *COMMON_STREAMS),
        *(MessageStream(GPS_GLOBAL_ORIGIN, 1.0), MessageStream(EKF_STATUS_REPORT, 1.0)),
    )
    odometry_frame = LOCAL_FRD
    """The state comes at 5 Hz, so that a pilot's change of mode is seen within 0.2 s."""
    fence_on_command = MavCommand(DO_FENCE_ENABLE, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    """All kinds of fences that FENCE_TYPE selects; until the autopilot restarts."""

    def __init__(self, vehicle: VehicleClass = VehicleClass.COPTER) -> None:
        self.class_properties = CLASSES[vehicle]

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""
        return mode_by_number(self.class_properties.modes, custom_mode)[0]

    def mode_name(self, custom_mode: int) -> str:
        """A mode in ArduPilot's own words."""
        return mode_by_number(self.class_properties.modes, custom_mode)[1]

    def mode_command(self, mode: FlightMode, form: VtolForm | None = None) -> MavCommand | CommandAnswer:
        """The command for a mode."""
        number = self.class_properties.commanded.get(mode)
        on_rotors = self.class_properties.hold_on_rotors
        if on_rotors is not None and mode is FlightMode.HOLD and form in (VtolForm.ROTORS, VtolForm.TO_ROTORS):
            number = on_rotors
        if number is None:
            return CommandAnswer(False, f"a {self.class_properties.vehicle} has no mode for {mode}")
        other = self.class_properties.hold_unplaced if mode is FlightMode.HOLD else None
        return _mode_command(number)._replace(instead=None if other is None else _mode_command(other))

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> MavCommand | CommandAnswer:
        """Take-off by height above home; planes take off in a mode, to a height set in parameters."""
        if not self.class_properties.behaviour.climbs:
            return CommandAnswer(False, self.class_properties.why_no_take_off)
        if FlightMode.TAKE_OFF in self.class_properties.commanded:
            return self.mode_command(FlightMode.TAKE_OFF)
        return MavCommand(NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))
