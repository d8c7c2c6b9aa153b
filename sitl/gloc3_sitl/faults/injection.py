"""Failures that a ground station may ask for (MAV_CMD_INJECT_FAILURE), as faults of the simulated sensors."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.surroundings import Failure, Unit
from gloc3_sitl.autopilot.verdict import ACCEPTED, Verdict
from gloc3_sitl.sensors.sensor import FaultMode

if TYPE_CHECKING:
    from gloc3_sitl.vehicles.simulator import Simulator

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


def inject(simulator: "Simulator", unit: Unit, failure: Failure) -> Verdict:
    """Makes something fail, or repairs it; unsupported where there is no such fault."""
    if unit in _SENSORS:
        if failure is Failure.OK:
            simulator.sensors.repair(_SENSORS[unit])
        else:
            simulator.sensors.fail(_SENSORS[unit], _MODES[failure])
        return ACCEPTED
    is_off = failure is Failure.OFF
    if not is_off and failure is not Failure.OK:
        return _NOT_HERE
    match unit:
        case Unit.ODOMETRY:
            simulator.autopilot.takes_odometry = not is_off
        case Unit.BATTERY:
            simulator.sensors.battery.remaining = 0.0 if is_off else 1.0
        case Unit.RECEIVER:
            if is_off:
                simulator.pilot.switch_off()
            else:
                simulator.pilot.switch_on()
        case _:
            return _NOT_HERE
    return ACCEPTED
