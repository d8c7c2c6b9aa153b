"""Failures that a ground station may ask for (MAV_CMD_INJECT_FAILURE), as faults of the simulated sensors."""

from collections.abc import Mapping
from typing import Final

from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.surroundings import Failure, Unit
from gloc3_sitl.autopilot.verdict import ACCEPTED, Verdict
from gloc3_sitl.sensors.sensor import FaultMode
from gloc3_sitl.sensors.suite import SensorSuite

_SENSORS: Final[Mapping[Unit, str]] = {
    Unit.MAGNETOMETER: "magnetometer",
    Unit.BAROMETER: "barometer",
    Unit.GPS: "fix",
    Unit.RANGE_FINDER: "height",
}
_MODES: Final[Mapping[Failure, FaultMode]] = {
    Failure.OFF: FaultMode.LOST,
    Failure.STUCK: FaultMode.STUCK,
    Failure.GARBAGE: FaultMode.NOISY,
    Failure.WRONG: FaultMode.BIASED,
    Failure.DELAYED: FaultMode.LATE,
}
_NOT_HERE: Final = Verdict(Result.UNSUPPORTED, "this failure is not simulated")


def inject(sensors: SensorSuite, autopilot: Autopilot, unit: Unit, failure: Failure) -> Verdict:
    """Makes something fail, or repairs it; unsupported where there is no such fault."""
    if unit in _SENSORS:
        if failure is Failure.OK:
            sensors.repair(_SENSORS[unit])
        else:
            sensors.fail(_SENSORS[unit], _MODES[failure])
        return ACCEPTED
    is_off = failure is Failure.OFF
    if not is_off and failure is not Failure.OK:
        return _NOT_HERE
    match unit:
        case Unit.ODOMETRY:
            autopilot.takes_odometry = not is_off
        case Unit.BATTERY:
            sensors.battery.remaining = 0.0 if is_off else 1.0
        case Unit.RECEIVER:
            if is_off:
                autopilot.pilot.switch_off()
            else:
                autopilot.pilot.switch_on()
        case _:
            return _NOT_HERE
    return ACCEPTED
