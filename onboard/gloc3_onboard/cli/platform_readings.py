"""Limits and battery of a vehicle from its autopilot's parameters, for a new platform file."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass

CENTI: Final = 0.01
"""Metres in a centimetre."""
GREATEST: Final = 1e6
"""What a platform file takes."""
ACCELERATION_M_S2: Final = (0.2, 3.0)
"""The least of which components take their shares, and the greatest that is planned with."""
CELL_V: Final = 3.7
"""Mean discharge voltage of a lithium polymer cell."""
RESTING_V: Final = 3.9
"""Of such a cell with an unknown charge."""
USUAL_MAH: Final = 3300.0
"""Factory default of BATT_CAPACITY."""
HEIGHT_FENCE: Final = 1
"""The bit of FENCE_TYPE for FENCE_ALT_MAX."""

SOURCES: Final[Mapping[tuple[Style, VehicleClass], Mapping[str, Mapping[str, float]]]] = {
    (Style.PX4, VehicleClass.COPTER): {
        "speed_m_s": {"MPC_XY_CRUISE": 1.0},
        "speed_max_m_s": {"MPC_XY_VEL_MAX": 1.0},
        "climb_m_s": {"MPC_Z_V_AUTO_UP": 1.0},
        "landing_m_s": {"MPC_LAND_SPEED": 1.0},
        "acceleration_m_s2": {"MPC_ACC_HOR": 1.0},
        "height_max_m": {"GF_MAX_VER_DIST": 1.0},
    },
    (Style.PX4, VehicleClass.PLANE): {
        "survey_speed_m_s": {"FW_AIRSPD_TRIM": 1.0},
        "speed_min_m_s": {"FW_AIRSPD_MIN": 1.0},
        "height_max_m": {"GF_MAX_VER_DIST": 1.0},
    },
    (Style.PX4, VehicleClass.VTOL): {
        "survey_speed_m_s": {"FW_AIRSPD_TRIM": 1.0},
        "speed_min_m_s": {"FW_AIRSPD_MIN": 1.0},
        "turn_radius_m": {"NAV_LOITER_RAD": 1.0},
        "rotors_speed_m_s": {"MPC_XY_CRUISE": 1.0},
        "climb_m_s": {"MPC_Z_V_AUTO_UP": 1.0},
        "landing_m_s": {"MPC_LAND_SPEED": 1.0},
        "height_max_m": {"GF_MAX_VER_DIST": 1.0},
    },
    (Style.ARDUPILOT, VehicleClass.COPTER): {
        "speed_m_s": {"WP_SPD": 1.0, "WPNAV_SPEED": CENTI},
        "climb_m_s": {"WP_SPD_UP": 1.0, "WPNAV_SPEED_UP": CENTI},
        "landing_m_s": {"LAND_SPD_MS": 1.0, "LAND_SPEED": CENTI},
        "acceleration_m_s2": {"WP_ACC": 1.0, "WPNAV_ACCEL": CENTI},
        "height_max_m": {"FENCE_ALT_MAX": 1.0},
    },
    (Style.ARDUPILOT, VehicleClass.ROVER): {"speed_m_s": {"CRUISE_SPEED": 1.0}},
    (Style.ARDUPILOT, VehicleClass.BOAT): {"speed_m_s": {"CRUISE_SPEED": 1.0}},
    (Style.ARDUPILOT, VehicleClass.PLANE): {
        "survey_speed_m_s": {"AIRSPEED_CRUISE": 1.0},
        "speed_min_m_s": {"AIRSPEED_MIN": 1.0},
        "approach_m": {"AUTOLAND_WP_DIST": 1.0},
        "height_max_m": {"FENCE_ALT_MAX": 1.0},
    },
    (Style.ARDUPILOT, VehicleClass.VTOL): {
        "survey_speed_m_s": {"AIRSPEED_CRUISE": 1.0},
        "speed_min_m_s": {"AIRSPEED_MIN": 1.0},
        "turn_radius_m": {"WP_LOITER_RAD": 1.0},
        "rotors_speed_m_s": {"Q_WP_SPEED": CENTI},
        "landing_m_s": {"Q_LAND_FINAL_SPD": 1.0},
        "height_max_m": {"FENCE_ALT_MAX": 1.0},
    },
}
"""Parameters of each limit, by their names in several versions, and their unit in SI. `speed_max_m_s` bounds
`speed_m_s`.

A Sub's WPNAV_SPEED is left out: its default is far beyond the reach of such vehicles.
"""
BATTERY: Final = {Style.PX4: ("BAT1_CAPACITY", "BAT1_N_CELLS"), Style.ARDUPILOT: ("BATT_CAPACITY",)}


class Reading(NamedTuple):
    """A value for the platform file."""

    value: float
    source: str
    """The parameter and its value; `assumed` without one."""


def names_of(style: Style, vehicle: VehicleClass) -> tuple[str, ...]:
    """The parameters that are read for a new platform file, beside those of the pre-flight checks."""
    limits = SOURCES.get((style, vehicle), {})
    return (*(name for names in limits.values() for name in names), *BATTERY[style])


def read_limits(setup: AutopilotSetup, battery_v: float) -> dict[str, Reading]:
    """The limits by name, and `battery_wh`, as far as they are known.

    Args:
        setup: with the parameters that were read.
        battery_v: the battery's voltage; 0 where it is not measured.
    """
    if setup.style is None or setup.vehicle is None:
        return {}
    found: dict[str, Reading] = {}
    for limit, names in SOURCES.get((setup.style, setup.vehicle), {}).items():
        known = [(name, value) for name in names if (value := _positive(setup, name))]
        if known:
            name, value = known[0]
            found[limit] = Reading(value * names[name], f"{name} {value:g}")
    most = found.pop("speed_max_m_s", None)
    if most is not None and "speed_m_s" in found:
        found["speed_m_s"] = min(found["speed_m_s"], most)
    if (read := found.get("acceleration_m_s2")) is not None:
        least, greatest = ACCELERATION_M_S2
        if not least <= read.value <= greatest:
            value = min(max(read.value, least), greatest)
            found["acceleration_m_s2"] = Reading(value, f"{read.source}, limited to {value:g}")
    if setup.style is Style.ARDUPILOT and not _keeps_height(setup):
        found.pop("height_max_m", None)
    if (battery := _battery(setup, battery_v)) is not None:
        found["battery_wh"] = battery
    return found


def _positive(setup: AutopilotSetup, name: str) -> float:
    """A parameter's value; 0 where it is unknown, or nothing that a limit can be."""
    value = setup.parameters.get(name, 0.0)
    return value if 0.0 < value <= GREATEST else 0.0


def _keeps_height(setup: AutopilotSetup) -> bool:
    return setup.parameters.get("FENCE_ENABLE") == 1.0 and bool(int(_positive(setup, "FENCE_TYPE")) & HEIGHT_FENCE)


def _battery(setup: AutopilotSetup, battery_v: float) -> Reading | None:
    if setup.style is Style.PX4:
        capacity_mah, cells = _positive(setup, "BAT1_CAPACITY"), round(_positive(setup, "BAT1_N_CELLS"))
        source = f"BAT1_CAPACITY {capacity_mah:g}, BAT1_N_CELLS {cells}"
    else:
        capacity_mah, cells = _positive(setup, "BATT_CAPACITY"), round(battery_v / RESTING_V)
        doubt = " (ArduPilot's default: check it)" if capacity_mah == USUAL_MAH else ""
        source = f"BATT_CAPACITY {capacity_mah:g}{doubt}, {cells} cells estimated from {battery_v:.1f} V"
    energy_wh = round(capacity_mah * 1e-3 * cells * CELL_V, 1)
    return Reading(energy_wh, f"{source}, {CELL_V:g} V a cell") if energy_wh > 0.0 else None
