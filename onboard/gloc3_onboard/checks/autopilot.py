"""Checks of the autopilot: connection, readiness to arm, version, and parameters."""

from collections.abc import Iterator, Mapping
from typing import Final

from gloc3.amounts import beside
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.vehicle import AutopilotState, VehicleClass
from gloc3_onboard.autopilot.health_words import UNHEALTHY
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

GROUP = Group.AUTOPILOT
CLASSES: Final[Mapping[str, tuple[VehicleClass, ...]]] = {
    "quadrotor": (VehicleClass.COPTER,),
    "hexarotor": (VehicleClass.COPTER,),
    "aircraft": (VehicleClass.PLANE,),
    "vtol": (VehicleClass.VTOL,),
    "rover": (VehicleClass.ROVER,),
    "boat": (VehicleClass.BOAT, VehicleClass.ROVER),
    "auv": (VehicleClass.SUB,),
    "rov": (VehicleClass.SUB,),
}
"""Autopilot vehicle classes by the vehicle type of a platform file."""


def autopilot_checks(readings: Readings) -> Iterator[Check]:
    """The lines about the autopilot; without one there is a single line."""
    state = readings.autopilot
    if state is None or not state.is_connected:
        was = "its heartbeat has stopped" if state is not None and state.style is not None else "no heartbeat received"
        advice = "check its power, and that --autopilot names its port"
        yield Check(GROUP, "answers", Verdict.RED, was, advice)
        return
    what = f"{state.style} on a {state.vehicle}" if state.vehicle is not None else str(state.style)
    yield Check(GROUP, "answers", Verdict.OK, f"{what}, mode {mode_words(state.mode_name) or 'unknown'}")
    yield from _vehicle(readings, state)
    yield _arming(state)
    yield from _remote_id(readings)
    yield from _estimator(state)
    yield _battery(readings, state)
    yield _firmware(readings)
    yield from _clock_rate(readings)
    yield _parameters(readings)
    yield from _arming_checks(readings)


def _vehicle(readings: Readings, state: AutopilotState) -> Iterator[Check]:
    """Whether the autopilot's vehicle class fits the platform file."""
    stated = readings.platform.vehicle.type
    if state.vehicle is not None and state.vehicle not in CLASSES[stated]:
        finding = f"the autopilot is set up for a {state.vehicle}; the platform file says {stated}"
        advice = "load the right firmware, or name the right platform file"
        yield Check(GROUP, "vehicle", Verdict.RED, finding, advice)


def _arming(state: AutopilotState) -> Check:
    if state.is_armed:
        return Check(GROUP, "ready to arm", Verdict.OK, "it is armed")
    if state.is_armable:
        return Check(GROUP, "ready to arm", Verdict.OK, "its own checks have passed")
    reasons = "; ".join([*state.reasons, *state.doubts]) or "it gives no reason"
    advice = "correct what it reports" if state.reasons else "wait until it is ready; its own messages say more"
    return Check(GROUP, "ready to arm", Verdict.RED, reasons, advice, may_settle=True)


def _remote_id(readings: Readings) -> Iterator[Check]:
    """Whether its Remote ID is good to arm, where it has one that reports (OPEN_DRONE_ID_ARM_STATUS)."""
    problem = readings.setup.remote_id if readings.setup is not None else None
    if problem:
        advice = "set up or repair the Remote ID; it often needs the operator's position, from a program that sends it"
        yield Check(GROUP, "remote id", Verdict.RED, f"not good to arm: {problem}", advice, may_settle=True)
    elif problem is not None:
        yield Check(GROUP, "remote id", Verdict.OK, "good to arm")


def _estimator(state: AutopilotState) -> Iterator[Check]:
    """What its estimator says of itself, where it would arm all the same."""
    problems = [problem for problem in state.doubts if not problem.startswith(UNHEALTHY)]
    if problems and state.is_armable:
        advice = "wait until it has settled; the autopilot would arm anyway"
        yield Check(GROUP, "estimator", Verdict.WARNING, "; ".join(problems), advice)


def _battery(readings: Readings, state: AutopilotState) -> Check:
    left, power = state.battery_remaining, readings.platform.power
    reserve = power.reserve if power is not None else 0.0
    if left < 0.0:
        advice = "set up the autopilot's battery monitor: without it on_low_battery never acts"
        return Check(GROUP, "battery", Verdict.WARNING, "it does not report the remaining charge", advice)
    volts = f", {state.battery_v:.1f} V" if state.battery_v > 0.0 else ""
    if left < reserve:
        finding = f"{beside(100.0 * left, 100.0 * reserve, 0)} %{volts}, below the platform's reserve of {100.0 * reserve:.0f} %"
        return Check(GROUP, "battery", Verdict.RED, finding, "change or charge the battery")
    return Check(GROUP, "battery", Verdict.OK, f"{100.0 * left:.0f} %{volts}")


def _firmware(readings: Readings) -> Check:
    setup = readings.setup
    if setup is None or setup.firmware is None or setup.style is None:
        return Check(GROUP, "firmware", Verdict.UNKNOWN, "it has not reported its version")
    version = ".".join(map(str, setup.firmware))
    least = table_of(setup.style, setup.vehicle).least_firmware
    if setup.firmware < least:
        needed = ".".join(map(str, least))
        advice = f"update to {needed} or later: modes and parameters of older ones differ"
        return Check(GROUP, "firmware", Verdict.WARNING, f"{setup.style} {version}", advice)
    if not setup.is_official:
        advice = "install a release, unless you need this version"
        return Check(GROUP, "firmware", Verdict.WARNING, f"{setup.style} {version}, not a release", advice)
    return Check(GROUP, "firmware", Verdict.OK, f"{setup.style} {version}")


def _clock_rate(readings: Readings) -> Iterator[Check]:
    """Whether its seconds are ours: time limits, speeds and failsafes count in both."""
    rate = readings.setup.clock_rate if readings.setup is not None else 1.0
    if rate > 1.0:
        finding = f"it runs {rate:.1f} times as fast as this computer's: a simulation at a higher speed"
        advice = "run it at real time (gloc3 sitl without --speed), or use gloc3 fly, in which all clocks are one"
        yield Check(GROUP, "clock", Verdict.RED, finding, advice, may_settle=True)


def _parameters(readings: Readings) -> Check:
    setup = readings.setup
    if setup is None:
        advice = "add a component of gloc3_onboard.components.samplers.autopilot_setup to the platform file"
        return Check(GROUP, "parameters", Verdict.UNKNOWN, "no component of this platform reads them", advice)
    count = len(setup.parameters)
    if not setup.is_complete or not count:
        advice = "check the link to the autopilot, then check again"
        return Check(GROUP, "parameters", Verdict.UNKNOWN, "they have not been read yet", advice)
    if not readings.is_setup_fresh:
        finding = f"{count} were read earlier, but not for this check"
        return Check(GROUP, "parameters", Verdict.WARNING, finding, "check the link to the autopilot, then check again")
    alternatives = table_of(setup.style, setup.vehicle).alternatives if setup.style is not None else ()
    unread = [name for name in setup.unread if name not in alternatives]
    without = f"; missing: {', '.join(unread)}" if unread else ""
    return Check(GROUP, "parameters", Verdict.OK, f"{count} read{without}")


def _arming_checks(readings: Readings) -> Iterator[Check]:
    """Whether the autopilot's own checks are all made."""
    setup = readings.setup
    if setup is None or setup.style is None:
        return
    for name, wanted in table_of(setup.style, setup.vehicle).arming_checks.items():
        value = setup.parameters.get(name)
        if value is not None:
            verdict = Verdict.OK if value == wanted else Verdict.WARNING
            advice = "" if value == wanted else f"set {name} to {wanted:g}, which enables all arming checks"
            finding = "all are enabled" if value == wanted else f"some are disabled ({name} is {value:g})"
            yield Check(GROUP, "arming checks", verdict, finding, advice)
            return
