"""Whether the onboard computer's own sensors are alive and calibrated: cameras, scanners, inertial units."""

from collections.abc import Iterator
from typing import Final

from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import SensorCondition
from gloc3_onboard.checks.readings import Readings

GROUP: Final = Group.SENSORS
SILENT_S: Final = 1.5
"""A sensor that has brought nothing for so long is not alive; the slowest scanners turn five times a second."""
NOWHERE: Final = "none://"


def own_sensor_checks(readings: Readings) -> Iterator[Check]:
    """The lines about the sensors that samplers read."""
    for one in readings.computer.sensors if readings.computer is not None else ():
        yield _sensor(one, _is_required(readings, one.device))
        for camera in one.uncalibrated:
            advice = f"add it to the platform file: cameras: {{{camera}: FILE}}"
            yield Check(GROUP, f"calibration of {camera}", Verdict.WARNING, "none is given", advice)


def _sensor(one: SensorCondition, is_required: bool) -> Check:
    bad = Verdict.RED if is_required else Verdict.WARNING
    if one.problem:
        finding, _, advice = one.problem.removeprefix(f"{one.device}: ").partition("; ")
        return Check(GROUP, one.device, bad, finding, advice or "docs/sensors.md lists what a source may be")
    if one.source == NOWHERE:
        advice = f"give it with --device {one.device}=URL, or under devices: in the platform file"
        return Check(GROUP, one.device, bad if is_required else Verdict.UNKNOWN, "no source is given", advice)
    if not one.is_open:
        return Check(GROUP, one.device, Verdict.OK, f"{one.source}, not opened")
    if one.age_s < 0.0:
        return Check(GROUP, one.device, bad, f"nothing has come from {one.source}", "check its cable and power")
    if one.age_s > SILENT_S:
        finding = f"silent for {one.age_s:.1f} s, {one.source}"
        return Check(GROUP, one.device, bad, finding, "check its cable and power")
    return Check(GROUP, one.device, Verdict.OK, f"alive, {one.source}")


def _is_required(readings: Readings, device: str) -> bool:
    """Whether a component that the platform cannot do without reads the device."""
    return any(row.required and device in row.devices.values() for row in readings.platform.components)
