"""The complete pre-flight list of a platform."""

from collections.abc import Iterator
from typing import Final

from gloc3.messages.hosts import HostStatus
from gloc3.messages.preflight import Check, Group, Verdict, in_order
from gloc3.messages.readiness import SensorCondition
from gloc3.messages.software import Software, compared
from gloc3.messages.summaries import WELL, Health
from gloc3.platform.places import clock_host, host_names, place_of
from gloc3_onboard.checks.autopilot import autopilot_checks
from gloc3_onboard.checks.computer import computer_checks
from gloc3_onboard.checks.failsafes import failsafe_checks
from gloc3_onboard.checks.fence import fence_checks
from gloc3_onboard.checks.own_return import own_return_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.sensors import sensor_checks


def checklist(readings: Readings) -> list[Check]:
    """Every line, group by group."""
    return in_order(
        [
            *autopilot_checks(readings),
            *failsafe_checks(readings),
            *fence_checks(readings),
            *own_return_checks(readings),
            *sensor_checks(readings),
            *own_sensor_checks(readings),
            *component_checks(readings),
            *host_checks(readings),
            *mission_checks(readings),
            *computer_checks(readings),
            *(compared(f"station {name}", other, "there") for name, other in readings.stations.items()),
        ]
    )


UNSURE_S: Final = 0.02
"""Uncertainty of time above which data cannot be judged fresh or stale, s."""
FORGOTTEN_S: Final = 30.0
"""Time for which a host may rely on its last answer from the clock host, s."""


def host_checks(readings: Readings) -> Iterator[Check]:
    """A line for each host beside the clock host, and one for its time."""
    platform = readings.platform
    if readings.components is None:
        return
    for host in host_names(platform):
        if host == clock_host(platform):
            continue
        title, found = f"host {host}", readings.hosts.get(host)
        if found is None or not found.is_here:
            rows = [row for row in platform.components if place_of(platform, row).host == host]
            verdict = Verdict.RED if any(row.required for row in rows) else Verdict.WARNING
            advice = f"start gloc3 onboard there with --host {host}, and check the network"
            yield Check(Group.COMPONENTS, title, verdict, "no status received", advice)
        elif found.status is not None:
            status = found.status
            software = Software(status.version, status.protocol)
            yield compared(title, software, "there", Group.COMPONENTS)
            yield _time(title, status)


def _time(title: str, status: HostStatus) -> Check:
    known = f"to within {status.clock_bound_s * 1e3:.1f} ms, measured {status.clock_age_s:.0f} s ago"
    if status.clock_bound_s > UNSURE_S or status.clock_age_s > FORGOTTEN_S:
        advice = "check the network between the hosts: time replies are late or missing"
        return Check(Group.COMPONENTS, f"{title}: time", Verdict.WARNING, known, advice)
    return Check(Group.COMPONENTS, f"{title}: time", Verdict.OK, known)


GROUP: Final = Group.SENSORS
SILENT_S: Final = 1.5
"""Time without data after which a sensor counts as dead, s; the slowest scanners turn five times a second."""
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
        return Check(GROUP, one.device, bad, f"no data from {one.source}", "check its cable and power")
    if one.age_s > SILENT_S:
        finding = f"no data for {one.age_s:.1f} s, {one.source}"
        return Check(GROUP, one.device, bad, finding, "check its cable and power")
    return Check(GROUP, one.device, Verdict.OK, f"alive, {one.source}")


def _is_required(readings: Readings, device: str) -> bool:
    """Whether a component that the platform cannot do without reads the device."""
    return any(row.required and device in row.devices.values() for row in readings.platform.components)


def component_checks(readings: Readings) -> Iterator[Check]:
    """A line for all components together, and one for each that is not well."""
    if readings.components is None:
        return
    required = [one for one in readings.components if one.is_required]
    unhealthy = [
        one
        for one in readings.components
        if one.health not in (WELL if one.is_standby or one.substitute else (Health.WORKING,))
    ]
    for one in unhealthy:
        verdict = Verdict.RED if one.is_required else Verdict.WARNING
        why = f": {one.cause}" if one.cause else ""
        advice = "read its error on the Health screen, then initialize and start it"
        yield Check(Group.COMPONENTS, one.name, verdict, f"{one.health}{why}", advice, may_settle=True)
    well = len(readings.components) - len(unhealthy)
    if not any(one.is_required for one in unhealthy):
        finding = f"{well} of {len(readings.components)} work, with all {len(required)} that are required"
        replaced = [one for one in readings.components if one.substitute and one not in unhealthy]
        finding += "".join(f"; {one.substitute} is in charge for {one.name}, which is its standby" for one in replaced)
        yield Check(Group.COMPONENTS, "all", Verdict.OK, finding)


def mission_checks(readings: Readings) -> Iterator[Check]:
    """Checks that a mission is loaded, and that no pilot has control."""
    mission = readings.mission
    if readings.pilot_reason:
        advice = "resume returns the vehicle to the mission; agree with the pilot first"
        yield Check(Group.MISSION, "control", Verdict.WARNING, f"a pilot has control: {readings.pilot_reason}", advice)
    if readings.components is None:
        return
    if mission is None:
        yield Check(Group.MISSION, "loaded", Verdict.UNKNOWN, "none is loaded", "stream one from a station")
        return
    yield Check(Group.MISSION, "loaded", Verdict.OK, f"{mission.name!r}, checked onboard")
    if readings.fence_problem:
        advice = "wait for the upload, or stream the mission again"
        yield Check(Group.MISSION, "fence", Verdict.RED, readings.fence_problem, advice)
