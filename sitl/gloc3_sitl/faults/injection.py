"""Failures that a ground station injects (MAV_CMD_INJECT_FAILURE), as faults of the simulated sensors."""

from collections.abc import Mapping
from typing import Final

from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.surroundings import FailureKind, FailureUnit
from gloc3_sitl.autopilot.verdict import ACCEPTED, RequestVerdict
from gloc3_sitl.sensors.sensor import FaultMode
from gloc3_sitl.sensors.suite import SensorSuite

_SENSORS: Final[Mapping[FailureUnit, str]] = {
    FailureUnit.MAGNETOMETER: "magnetometer",
    FailureUnit.BAROMETER: "barometer",
    FailureUnit.GPS: "fix",
    FailureUnit.RANGE_FINDER: "height",
}
_MODES: Final[Mapping[FailureKind, FaultMode]] = {
    FailureKind.OFF: FaultMode.LOST,
    FailureKind.STUCK: FaultMode.STUCK,
    FailureKind.GARBAGE: FaultMode.NOISY,
    FailureKind.WRONG: FaultMode.BIASED,
    FailureKind.DELAYED: FaultMode.LATE,
}
_NOT_HERE: Final = RequestVerdict(Result.UNSUPPORTED, "this failure is not simulated")


def inject(sensors: SensorSuite, autopilot: Autopilot, unit: FailureUnit, failure: FailureKind) -> RequestVerdict:
    """Injects a failure or repairs it; unsupported if the failure is not simulated."""
    if unit in _SENSORS:
        if failure is FailureKind.OK:
            sensors.repair(_SENSORS[unit])
        else:
            sensors.fail(_SENSORS[unit], _MODES[failure])
        return ACCEPTED
    is_off = failure is FailureKind.OFF
    if not is_off and failure is not FailureKind.OK:
        return _NOT_HERE
    match unit:
        case FailureUnit.ODOMETRY:
            autopilot.accepts_odometry = not is_off
        case FailureUnit.BATTERY:
            sensors.battery.remaining = 0.0 if is_off else 1.0
        case FailureUnit.RECEIVER:
            if is_off:
                autopilot.pilot.switch_off()
            else:
                autopilot.pilot.switch_on()
        case _:
            return _NOT_HERE
    return ACCEPTED
