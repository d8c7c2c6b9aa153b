"""Names of autopilots, vehicle types and flight modes, from a heartbeat's numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from gloc3.mavlink.codec import enum_name, enums

ARDUPILOT: Final = 3
PX4: Final = 12
"""MAV_AUTOPILOT."""

_PX4_MODES: Final = {
    (1, 0): "MANUAL",
    (2, 0): "ALTCTL",
    (3, 0): "POSCTL",
    (4, 1): "AUTO.READY",
    (4, 2): "AUTO.TAKEOFF",
    (4, 3): "AUTO.LOITER",
    (4, 4): "AUTO.MISSION",
    (4, 5): "AUTO.RTL",
    (4, 6): "AUTO.LAND",
    (4, 8): "AUTO.FOLLOW",
    (4, 9): "AUTO.PRECLAND",
    (5, 0): "ACRO",
    (6, 0): "OFFBOARD",
    (7, 0): "STABILIZED",
    (8, 0): "RATTITUDE",
    (10, 0): "TERMINATION",
}
"""Main and sub mode (`px4_custom_mode.h`); a sub mode that is not listed has its main mode's name."""
PX4_MODE_WORDS: Final[Mapping[str, str]] = {
    "MANUAL": "Manual",
    "ALTCTL": "Altitude",
    "POSCTL": "Position",
    "AUTO.READY": "Ready",
    "AUTO.TAKEOFF": "Takeoff",
    "AUTO.LOITER": "Hold",
    "AUTO.MISSION": "Mission",
    "AUTO.RTL": "Return",
    "AUTO.LAND": "Land",
    "AUTO.FOLLOW": "Follow Me",
    "AUTO.PRECLAND": "Precision Land",
    "AUTO.VTOL_TAKEOFF": "VTOL Takeoff",
    "ACRO": "Acro",
    "OFFBOARD": "Offboard",
    "STABILIZED": "Stabilized",
    "RATTITUDE": "Rattitude",
    "TERMINATION": "Termination",
}
"""PX4's modes by the names of its own documents."""
_AMBIGUOUS: Final = frozenset({"MANUAL", "ACRO"})
"""Names that ArduPilot has, too."""
_PLANES: Final = frozenset({1, 16, *range(19, 26)})
_ROVERS: Final = frozenset({10, 11})
_SUBMARINE: Final = 12
_MOST_MODES: Final = 64
_NOT_COPTERS: Final = frozenset({0, 5, 7, 8, 9})


def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """A mode in the autopilot's own words; `mode 7` where they are not known.

    Args:
        autopilot: MAV_AUTOPILOT.
        vehicle_type: MAV_TYPE; ArduPilot numbers its modes by it.
        custom_mode: as in the heartbeat.
    """
    unknown = f"mode {custom_mode}"
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        return _PX4_MODES.get((main, sub)) or _PX4_MODES.get((main, 0)) or unknown
    if autopilot != ARDUPILOT or vehicle_type in _NOT_COPTERS:
        return unknown
    family = _family(vehicle_type)
    name, prefix = enum_name(f"{family}_MODE", custom_mode), f"{family}_MODE_"
    return name.removeprefix(prefix) if name.startswith(prefix) and not name.endswith("_END") else unknown


def mode_words(name: str, autopilot: str = "") -> str:
    """A mode as people read it: PX4's by the names of its documents, ArduPilot's by its own; `Mission, on wings`.

    Args:
        name: as `mode_name` gives it, perhaps with what carries a VTOL.
        autopilot: as `autopilot_name` gives it; empty where it is not known.
    """
    mode, comma, rest = name.partition(",")
    if autopilot == "ArduPilot" or (mode in _AMBIGUOUS and autopilot != "PX4"):
        return name
    return PX4_MODE_WORDS.get(mode, mode) + comma + rest


def _family(vehicle_type: int) -> str:
    if vehicle_type in _PLANES:
        return "PLANE"
    if vehicle_type in _ROVERS:
        return "ROVER"
    return "SUB" if vehicle_type == _SUBMARINE else "COPTER"


class ModeNumbers(NamedTuple):
    """The modes of an autopilot."""

    family: str
    """ArduPilot's, as in the names of its enumerations; empty of others."""
    numbers: Mapping[str, int]
    """Custom modes by the autopilot's own names."""


def mode_numbers(autopilot: int, vehicle_type: int) -> ModeNumbers:
    """The modes that can be set by name; none where the autopilot or the vehicle is not known.

    Args:
        autopilot: MAV_AUTOPILOT.
        vehicle_type: MAV_TYPE.
    """
    if autopilot == PX4:
        return ModeNumbers("", {name: main << 16 | sub << 24 for (main, sub), name in _PX4_MODES.items()})
    if autopilot != ARDUPILOT or vehicle_type in _NOT_COPTERS:
        return ModeNumbers("", {})
    family = _family(vehicle_type)
    found = {mode_name(autopilot, vehicle_type, number): number for number in range(_MOST_MODES)}
    return ModeNumbers(family, {name: number for name, number in found.items() if not name.startswith("mode ")})


def autopilot_name(autopilot: int) -> str:
    """What an autopilot is called, as `PX4`, `ArduPilot`, `smartap`."""
    if autopilot == ARDUPILOT:
        return "ArduPilot"
    if autopilot == PX4:
        return "PX4"
    name = enum_name("MAV_AUTOPILOT", autopilot)
    return name.removeprefix("MAV_AUTOPILOT_").lower().replace("_", " ") if not name.isdigit() else f"number {name}"


_LIFT_ROTORS: Final = 22
"""MAV_TYPE_VTOL_FIXEDROTOR, which older dialects call reserved."""


def type_name(vehicle_type: int) -> str:
    """What a vehicle is, as `quadrotor`; empty where it does not say."""
    if vehicle_type == enums.MAV_TYPE_GENERIC:
        return ""
    if vehicle_type == _LIFT_ROTORS:
        return "vtol with lift rotors"
    name = enum_name("MAV_TYPE", vehicle_type)
    return name.removeprefix("MAV_TYPE_").lower().replace("_", " ") if not name.isdigit() else f"type {name}"
