"""Which of an autopilot's parameters matter before a start, and what their values mean: one table a style.

PX4: its parameter reference, v1.16, groups Commander, Battery Calibration, Geofence and Sensor Calibration. ArduPilot:
Copter's full parameter list, 4.7, and "Failsafes" in Copter's documentation; older names stand beside the newer ones.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gloc3.vehicle import Style

Ask = Callable[[str], float | None]
"""A parameter's value; None where it has not been read."""

CONTINUE, HOLD, RETURN, LAND = "continue", "hold", "return", "land"
"""What an autopilot may do by itself, as the platform file has it."""
DISARM, TERMINATE, PILOT = "disarm", "terminate", "give the pilot control"
"""What no platform file allows."""


class Failsafe(NamedTuple):
    """One of the autopilot's failsafes."""

    parameter: str
    """Chooses the action; empty where the style always does the same."""
    actions: Mapping[int, str]
    """Its values; with an empty parameter 0 is what is done."""
    limit: Callable[[Ask], float | None] = lambda _: None
    """When it acts: seconds, or share of the battery; None where that is not known or does not matter."""
    limit_parameters: tuple[str, ...] = ()
    """What the limit is made of."""
    exempt: tuple[str, int] | None = None
    """A parameter and the bit of it by which nothing is done while it follows our setpoints."""


class StyleTable(NamedTuple):
    """What is read of an autopilot, and how it is understood."""

    least_firmware: tuple[int, int, int]
    """The oldest version whose modes, commands and parameters are those that are used here."""
    link_loss: Failsafe
    low_battery: Failsafe
    pose_lost: Failsafe
    setpoints_lost: Failsafe
    calibrated: Mapping[str, str]
    """Parameters that are 0 until a sensor has been calibrated, and the sensor."""
    arming_checks: Mapping[str, float]
    """The parameter of the arming checks by the names of several versions, and its value while all are made."""

    def names(self) -> tuple[str, ...]:
        """Every parameter that is to be read."""
        found: dict[str, None] = {}
        for failsafe in (self.link_loss, self.low_battery, self.pose_lost, self.setpoints_lost):
            exempt = failsafe.exempt[0] if failsafe.exempt is not None else ""
            found |= dict.fromkeys((failsafe.parameter, *failsafe.limit_parameters, exempt))
        found |= dict.fromkeys((*self.calibrated, *self.arming_checks))
        return tuple(name for name in found if name)


def _share(part: str, whole: str) -> Callable[[Ask], float | None]:
    def share(ask: Ask) -> float | None:
        left, all_of_it = ask(part), ask(whole)
        return None if left is None or not all_of_it else left / all_of_it

    return share


def _value(name: str) -> Callable[[Ask], float | None]:
    return lambda ask: ask(name)


PX4: Final = StyleTable(
    least_firmware=(1, 14, 0),
    link_loss=Failsafe(
        "NAV_DLL_ACT",
        {0: CONTINUE, 1: HOLD, 2: RETURN, 3: LAND, 5: TERMINATE, 6: DISARM},
        _value("COM_DL_LOSS_T"),
        ("COM_DL_LOSS_T",),
        exempt=("COM_DLL_EXCEPT", 4),
    ),
    low_battery=Failsafe(
        "COM_LOW_BAT_ACT", {0: CONTINUE, 1: RETURN, 2: LAND, 3: RETURN}, _value("BAT_CRIT_THR"), ("BAT_CRIT_THR",)
    ),
    pose_lost=Failsafe("", {0: LAND}),
    setpoints_lost=Failsafe(
        "COM_OBL_RC_ACT",
        {0: PILOT, 1: PILOT, 2: PILOT, 3: RETURN, 4: LAND, 5: HOLD, 6: TERMINATE, 7: DISARM},
        _value("COM_OF_LOSS_T"),
        ("COM_OF_LOSS_T",),
    ),
    calibrated={"CAL_GYRO0_ID": "gyroscope", "CAL_ACC0_ID": "accelerometer", "CAL_MAG0_ID": "compass"},
    arming_checks={},
)

ARDUPILOT: Final = StyleTable(
    least_firmware=(4, 4, 0),
    link_loss=Failsafe(
        "FS_GCS_ENABLE",
        {0: CONTINUE, 1: RETURN, 2: CONTINUE, 3: RETURN, 4: LAND, 5: LAND, 6: RETURN, 7: HOLD},
        _value("FS_GCS_TIMEOUT"),
        ("FS_GCS_TIMEOUT",),
    ),
    low_battery=Failsafe(
        "BATT_FS_LOW_ACT",
        {0: CONTINUE, 1: LAND, 2: RETURN, 3: RETURN, 4: LAND, 5: TERMINATE, 6: RETURN, 7: HOLD},
        _share("BATT_LOW_MAH", "BATT_CAPACITY"),
        ("BATT_LOW_MAH", "BATT_CAPACITY"),
    ),
    pose_lost=Failsafe("FS_EKF_ACTION", {0: CONTINUE, 1: LAND, 2: PILOT, 3: LAND}),
    setpoints_lost=Failsafe("", {0: HOLD}, _value("GUID_TIMEOUT"), ("GUID_TIMEOUT",)),
    calibrated={},
    arming_checks={"ARMING_SKIPCHK": 0.0, "ARMING_CHECK": 1.0},
)

TABLES: Final[Mapping[Style, StyleTable]] = {Style.PX4: PX4, Style.ARDUPILOT: ARDUPILOT}
