"""An operator's sticks for an autopilot: MANUAL_CONTROL in its axes and ranges, and the modes in which it obeys."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from gloc3.mavlink.codec import message
from gloc3.mavlink.flight_modes import ARDUPILOT, mode_numbers
from gloc3.mavlink.message import MavlinkMessage
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.joysticks.mapping import JoystickButton
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot

FULL: Final = 1000.0
MIDDLE: Final = 500.0
"""`z` of MANUAL_CONTROL for a centred stick, of all but ArduPilot's rovers: it is a throttle from 0 to 1000."""
ROVERS: Final = frozenset({10, 11})
MULTIROTORS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})
WITH_WINGS: Final = frozenset({1, 16, *range(19, 26)})
"""MAV_TYPE."""
HEIGHT_ONLY: Final = "height is kept; it drifts with the wind"
DEPTH_ONLY: Final = "depth and heading are kept; it drifts with the current"
NOTHING_KEPT: Final = "nothing is kept: it floats and drifts"


class StickFamily(NamedTuple):
    """How a kind of vehicle takes sticks."""

    modes: Mapping[str, str]
    """Modes in which released sticks are rest, the best first, and what is not kept in each, in words."""
    begins: tuple[str, ...]
    """Those that are tried one after the other where the present mode does not take sticks."""
    rests: frozenset[str]
    """Modes to which hold leads; sticks count for nothing there."""
    drives: bool = False
    """It goes ahead and turns, and does neither climb nor move to the side."""
    low: float = 0.0
    """`z` for the lowest throttle."""
    lost: tuple[str, Mapping[int, str]] = ("", {})
    """The parameter that says what follows when the sticks end, and its values in words."""
    buttons: Mapping[JoystickButton, int] = {}
    """Buttons that the autopilot takes itself, by their bit."""


_PX4_LOST: Final = (
    "NAV_RCL_ACT",
    {1: "it holds", 2: "it returns", 3: "it lands", 5: "its flight is TERMINATED", 6: "it is DISARMED"},
)
_COPTER_LOST: Final = (
    "FS_THR_ENABLE",
    {0: "nothing happens", 1: "it returns", 2: "it returns", 3: "it lands", 4: "it returns", 5: "it returns or lands"},
)
_PX4_RESTS: Final = frozenset({"AUTO.LOITER"})
PX4_FLYING: Final = StickFamily({"POSCTL": "", "ALTCTL": HEIGHT_ONLY}, ("POSCTL",), _PX4_RESTS, lost=_PX4_LOST)
PX4_DRIVING: Final = StickFamily(
    {"POSCTL": "", "MANUAL": ""}, ("POSCTL", "MANUAL"), _PX4_RESTS, drives=True, lost=_PX4_LOST
)
COPTER: Final = StickFamily(
    {"LOITER": "", "POSHOLD": "", "ALT_HOLD": HEIGHT_ONLY}, ("LOITER",), frozenset({"BRAKE"}), lost=_COPTER_LOST
)
ROVER: Final = StickFamily(
    {"STEERING": "", "ACRO": "", "MANUAL": ""},
    ("STEERING", "MANUAL"),
    frozenset({"HOLD"}),
    drives=True,
    low=-FULL,
    lost=("FS_THR_ENABLE", {0: "nothing happens", 1: "FS_ACTION applies", 2: "FS_ACTION applies, but in AUTO"}),
)
SUB: Final = StickFamily(
    {
        "POSHOLD": "",
        "ALT_HOLD": DEPTH_ONLY,
        "SURFTRAK": DEPTH_ONLY,
        "STABILIZE": NOTHING_KEPT,
        "MANUAL": NOTHING_KEPT,
    },
    ("POSHOLD", "ALT_HOLD"),
    frozenset(),
    lost=("FS_PILOT_INPUT", {0: "nothing happens", 1: "it is only told", 2: "it is DISARMED, and floats up"}),
    buttons={
        JoystickButton.GAIN_UP: 11,
        JoystickButton.GAIN_DOWN: 12,
        JoystickButton.LIGHTS_DOWN: 13,
        JoystickButton.LIGHTS_UP: 14,
    },
)
"""ArduSub; the bits are those that its parameters BTN11_FUNCTION to BTN14_FUNCTION have by default."""


def stick_family(snapshot: ServicesSnapshot) -> StickFamily | None:
    """How a vehicle takes sticks; None for one with wings, on which released sticks are no rest, and for unknown ones."""
    kind = snapshot.vehicle_type
    if snapshot.firmware is Firmware.PX4:
        return PX4_DRIVING if kind in ROVERS else PX4_FLYING if kind in MULTIROTORS else None
    if snapshot.firmware is not Firmware.ARDUPILOT or kind in WITH_WINGS:
        return None
    return {"COPTER": COPTER, "ROVER": ROVER, "SUB": SUB}.get(mode_numbers(ARDUPILOT, kind).family)


def manual_control(
    sticks: StickDemand, family: StickFamily, system: int, buttons: Iterable[JoystickButton] = ()
) -> MavlinkMessage:
    """MANUAL_CONTROL; `r` counts clockwise, as both firmwares take it, against MAVLink's description.

    Args:
        sticks: the demand.
        family: of the vehicle.
        system: the vehicle's MAVLink system.
        buttons: those that are held; others than the autopilot's own do nothing.
    """
    surge, sway, _, yaw = (round(part * FULL) for part in sticks)
    half = (FULL - family.low) / 2.0
    throttle = round(family.low + half + (sticks.surge if family.drives else sticks.heave) * half)
    bits = sum(1 << family.buttons[button] for button in set(buttons) if button in family.buttons)
    side = yaw if family.drives else sway
    return message("MANUAL_CONTROL", target=system, x=surge, y=side, z=throttle, r=yaw, buttons=bits)
