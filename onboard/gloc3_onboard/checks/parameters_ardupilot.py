"""ArduPilot parameters checked before a start, by class of vehicle.

Sources: the full parameter lists of Copter, Rover, Sub and Plane, 4.7, and "Failsafes" in the documentation of each;
older names are listed with the newer ones.
"""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.vehicle import VehicleClass
from gloc3_onboard.checks.parameters import (
    CONTINUE,
    DISARM,
    HOLD,
    LAND,
    PILOT,
    RETURN,
    TERMINATE,
    Failsafe,
    FenceLimit,
    FenceTable,
    ReturnTable,
    StyleTable,
    share_of,
    value_of,
)

_BATTERY_LIMIT: Final = share_of("BATT_LOW_MAH", "BATT_CAPACITY"), ("BATT_LOW_MAH", "BATT_CAPACITY")
_LOW_V: Final = "BATT_LOW_VOLT"
_CRITICAL_LIMIT: Final = share_of("BATT_CRT_MAH", "BATT_CAPACITY"), ("BATT_CRT_MAH", "BATT_CAPACITY")
_CRITICAL_V: Final = "BATT_CRT_VOLT"
_FIXED_STOP: Final = Failsafe("", {0: HOLD}, lambda _: 3.0)
"""Rover and Sub stop three seconds after the last setpoint, which cannot be changed."""

_NONE: Final = Failsafe("", {0: CONTINUE})
_CIRCLE: Final = FenceLimit("FENCE_RADIUS", "away", 2)
_TOP: Final = FenceLimit("FENCE_ALT_MAX", "up", 1)
_BOTTOM: Final = FenceLimit("FENCE_ALT_MIN", "down", 8)
_FENCE: Final = FenceTable(
    Failsafe("FENCE_ACTION", {0: CONTINUE, 1: RETURN, 2: LAND, 3: RETURN, 4: HOLD, 5: RETURN}),
    (_TOP, _CIRCLE),
    kinds="FENCE_TYPE",
    enabled_by="FENCE_ENABLE",
)

_COPTER_BATTERY: Final = {0: CONTINUE, 1: LAND, 2: RETURN, 3: RETURN, 4: LAND, 5: TERMINATE, 6: RETURN, 7: HOLD}
COPTER: Final = StyleTable(
    least_firmware=(4, 4, 0),
    link_loss=Failsafe(
        "FS_GCS_ENABLE",
        {0: CONTINUE, 1: RETURN, 2: CONTINUE, 3: RETURN, 4: LAND, 5: LAND, 6: RETURN, 7: HOLD},
        value_of("FS_GCS_TIMEOUT"),
        ("FS_GCS_TIMEOUT",),
    ),
    low_battery=Failsafe("BATT_FS_LOW_ACT", _COPTER_BATTERY, *_BATTERY_LIMIT, volts=_LOW_V),
    critical_battery=Failsafe("BATT_FS_CRT_ACT", _COPTER_BATTERY, *_CRITICAL_LIMIT, volts=_CRITICAL_V),
    transmitter_lost=Failsafe(
        "FS_THR_ENABLE",
        {0: CONTINUE, 1: RETURN, 2: RETURN, 3: LAND, 4: RETURN, 5: LAND, 6: RETURN, 7: HOLD},
        exempt=("FS_OPTIONS", 4),
    ),
    dead_reckoning=Failsafe(
        "FS_DR_ENABLE", {0: CONTINUE, 1: LAND, 2: RETURN, 3: RETURN, 4: LAND, 5: TERMINATE, 6: RETURN, 7: HOLD}
    ),
    pose_lost=Failsafe("FS_EKF_ACTION", {0: CONTINUE, 1: LAND, 2: PILOT, 3: LAND}),
    setpoints_lost=Failsafe("", {0: HOLD}, value_of("GUID_TIMEOUT"), ("GUID_TIMEOUT",)),
    fence=_FENCE,
    calibrated={},
    arming_checks={"ARMING_SKIPCHK": 0.0, "ARMING_CHECK": 1.0},
    own_return=ReturnTable(
        {"RTL_ALT_M": 1.0, "RTL_ALT": 0.01}, {"RTL_CLIMB_MIN_M": 1.0, "RTL_CLIMB_MIN": 0.01}, rally="RALLY_TOTAL"
    ),
)

_ROVER_ACTIONS: Final = {0: CONTINUE, 1: RETURN, 2: HOLD, 3: RETURN, 4: RETURN, 5: TERMINATE, 6: HOLD}
ROVER: Final = COPTER._replace(
    link_loss=Failsafe(
        "FS_ACTION", _ROVER_ACTIONS, value_of("FS_GCS_TIMEOUT"), ("FS_GCS_TIMEOUT",), enabled_by="FS_GCS_ENABLE"
    ),
    low_battery=Failsafe("BATT_FS_LOW_ACT", _ROVER_ACTIONS, *_BATTERY_LIMIT, volts=_LOW_V),
    critical_battery=Failsafe("BATT_FS_CRT_ACT", _ROVER_ACTIONS, *_CRITICAL_LIMIT, volts=_CRITICAL_V),
    transmitter_lost=Failsafe("FS_ACTION", _ROVER_ACTIONS, enabled_by="FS_THR_ENABLE"),
    dead_reckoning=_NONE,
    pose_lost=Failsafe("FS_EKF_ACTION", {0: CONTINUE, 1: HOLD, 2: CONTINUE}),
    setpoints_lost=_FIXED_STOP,
    fence=_FENCE._replace(
        breach=Failsafe("FENCE_ACTION", {0: CONTINUE, 1: RETURN, 2: HOLD, 3: RETURN, 4: RETURN}),
        limits=(_CIRCLE,),
    ),
    own_return=ReturnTable({}, rally="RALLY_TOTAL"),
)

SUB: Final = COPTER._replace(
    link_loss=Failsafe(
        "FS_GCS_ENABLE",
        {0: CONTINUE, 1: CONTINUE, 2: DISARM, 3: HOLD, 4: LAND},
        value_of("FS_GCS_TIMEOUT"),
        ("FS_GCS_TIMEOUT",),
    ),
    low_battery=Failsafe(
        "BATT_FS_LOW_ACT", {0: CONTINUE, 1: CONTINUE, 2: DISARM, 3: LAND}, *_BATTERY_LIMIT, volts=_LOW_V
    ),
    critical_battery=_NONE,
    transmitter_lost=_NONE,
    dead_reckoning=_NONE,
    pose_lost=Failsafe("FS_EKF_ACTION", {0: CONTINUE, 1: CONTINUE, 2: DISARM}),
    setpoints_lost=_FIXED_STOP,
    fence=_FENCE._replace(breach=Failsafe("", {0: CONTINUE}), limits=(_TOP, _CIRCLE, _BOTTOM)),
    own_return=ReturnTable({}),
    doubtful={"FS_PILOT_INPUT": (2.0, "disarms under way when a connected joystick stops sending")},
)
"""To *land* is to surface. At its fence it does nothing but record that it was left."""

_PLANE_LONG: Final = {0: CONTINUE, 1: RETURN, 2: TERMINATE, 3: TERMINATE, 4: "fly its own mission", 5: LAND}
_PLANE_BATTERY: Final = {0: CONTINUE, 1: RETURN, 2: LAND, 3: TERMINATE, 4: LAND, 5: TERMINATE, 6: LAND, 7: LAND}
PLANE: Final = COPTER._replace(
    link_loss=Failsafe(
        "FS_LONG_ACTN",
        _PLANE_LONG,
        value_of("FS_LONG_TIMEOUT"),
        ("FS_LONG_TIMEOUT",),
        enabled_by="FS_GCS_ENABL",
    ),
    low_battery=Failsafe("BATT_FS_LOW_ACT", _PLANE_BATTERY, *_BATTERY_LIMIT, volts=_LOW_V),
    critical_battery=Failsafe("BATT_FS_CRT_ACT", _PLANE_BATTERY, *_CRITICAL_LIMIT, volts=_CRITICAL_V),
    transmitter_lost=Failsafe("FS_LONG_ACTN", _PLANE_LONG, enabled_by="THR_FAILSAFE"),
    dead_reckoning=_NONE,
    pose_lost=_NONE,
    setpoints_lost=Failsafe("", {0: HOLD}),
    fence=_FENCE._replace(breach=Failsafe("FENCE_ACTION", {0: CONTINUE, 1: RETURN, 6: HOLD, 7: HOLD, 8: LAND})),
    own_return=ReturnTable(
        {"RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 0.01},
        radii=("RTL_RADIUS", "WP_LOITER_RAD"),
        circles=(
            "RTL_AUTOLAND",
            "have that failsafe land (6), or set RTL_AUTOLAND to 2 with a landing in the autopilot",
        ),
        rally="RALLY_TOTAL",
    ),
)
"""*Hold* means circling; without a position it continues by dead reckoning."""

VTOL: Final = PLANE._replace(
    own_return=PLANE.own_return._replace(hover_heights={"Q_RTL_ALT": 1.0}, circles=None),
    doubtful={
        "Q_RTL_MODE": (0.0, "has RTL circle over home instead of landing there"),
        "Q_TRANS_FAIL": (0.0, "tries a transition to wings without end"),
    },
    hindering={"Q_GUIDED_MODE": ((0.0,), "has GUIDED circle on wings, by which GLOC3 hovers", 1.0)},
)
"""To *hold* is to circle on wings, and to hover on rotors."""

CLASSES: Final[Mapping[VehicleClass, StyleTable]] = {
    VehicleClass.COPTER: COPTER,
    VehicleClass.ROVER: ROVER,
    VehicleClass.BOAT: ROVER,
    VehicleClass.SUB: SUB,
    VehicleClass.PLANE: PLANE,
    VehicleClass.VTOL: VTOL,
}
