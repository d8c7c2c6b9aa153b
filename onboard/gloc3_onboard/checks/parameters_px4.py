"""PX4's parameters that matter before a start, by class of vehicle.

Source: its parameter reference, v1.16, groups Commander, Battery Calibration, Geofence and Sensor Calibration.
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
    value_of,
)

COPTER: Final = StyleTable(
    least_firmware=(1, 14, 0),
    link_loss=Failsafe(
        "NAV_DLL_ACT",
        {0: CONTINUE, 1: HOLD, 2: RETURN, 3: LAND, 5: TERMINATE, 6: DISARM},
        value_of("COM_DL_LOSS_T"),
        ("COM_DL_LOSS_T",),
        exempt=("COM_DLL_EXCEPT", 4),
    ),
    low_battery=Failsafe(
        "COM_LOW_BAT_ACT", {0: CONTINUE, 1: RETURN, 2: LAND, 3: RETURN}, value_of("BAT_CRIT_THR"), ("BAT_CRIT_THR",)
    ),
    transmitter_lost=Failsafe(
        "NAV_RCL_ACT",
        {1: HOLD, 2: RETURN, 3: LAND, 5: TERMINATE, 6: DISARM},
        exempt=("COM_RCL_EXCEPT", 4),
    ),
    pose_lost=Failsafe("", {0: LAND}),
    setpoints_lost=Failsafe(
        "COM_OBL_RC_ACT",
        {0: PILOT, 1: PILOT, 2: PILOT, 3: RETURN, 4: LAND, 5: HOLD, 6: TERMINATE, 7: DISARM},
        value_of("COM_OF_LOSS_T"),
        ("COM_OF_LOSS_T",),
    ),
    fence=FenceTable(
        Failsafe("GF_ACTION", {0: CONTINUE, 1: CONTINUE, 2: HOLD, 3: RETURN, 4: TERMINATE, 5: LAND}),
        (FenceLimit("GF_MAX_HOR_DIST", "away"), FenceLimit("GF_MAX_VER_DIST", "up")),
    ),
    calibrated={"CAL_GYRO0_ID": "gyroscope", "CAL_ACC0_ID": "accelerometer", "CAL_MAG0_ID": "compass"},
    arming_checks={},
    ignoring_pilot={"COM_RC_IN_MODE": ((1.0, 4.0), "ignores the transmitter of the pilot who stands by", 0.0)},
    own_return=ReturnTable({"RTL_RETURN_ALT": 1.0}, lands="RTL_TYPE"),
)

ROVER: Final = COPTER._replace(pose_lost=Failsafe("", {0: HOLD}), own_return=ReturnTable({}))
"""What cannot land stops."""

PLANE: Final = COPTER._replace(
    hindering={
        "MIS_TKO_LAND_REQ": ((1.0, 2.0, 3.0, 4.0, 5.0), "refuses to fly paths without a take-off or landing", 0.0)
    }
)

VTOL: Final = PLANE._replace(
    doubtful={"NAV_FORCE_VT": (0.0, "lands on wings where it flies on wings")},
)

CLASSES: Final[Mapping[VehicleClass, StyleTable]] = {
    VehicleClass.COPTER: COPTER,
    VehicleClass.ROVER: ROVER,
    VehicleClass.PLANE: PLANE,
    VehicleClass.VTOL: VTOL,
}
