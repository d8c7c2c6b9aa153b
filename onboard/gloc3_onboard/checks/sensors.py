"""Checks of the vehicle's sensors, their health and calibration, and of the position."""

from collections.abc import Iterator, Mapping
from typing import Final

from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3_onboard.autopilot.health_words import SENSORS, unhealthy
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

GROUP = Group.SENSORS
DOUBTFUL: Final[Mapping[int, str]] = {1 << 24: "the autopilot's log", 1 << 16: "transmitter"}
"""Bits that are worth a warning."""
LEAST_QUALITY: Final = 0.5


def sensor_checks(readings: Readings) -> Iterator[Check]:
    """The lines about sensors and the position."""
    setup = readings.setup
    is_connected = readings.autopilot is not None and readings.autopilot.is_connected
    if is_connected and setup is not None and setup.sensors_present:
        yield from _health(setup)
    elif is_connected:
        yield Check(GROUP, "autopilot's sensors", Verdict.UNKNOWN, "no health report received")
    if setup is not None and setup.style is not None and setup.is_complete:
        yield from _calibration(setup)
    if is_connected:
        yield _position(readings)
    if readings.height is not None:
        height = readings.height
        finding = f"{height.height_m:.2f} m above the ground" if height.is_valid else height.reason or "no echo"
        verdict = Verdict.OK if height.is_valid else Verdict.WARNING
        yield Check(GROUP, "height", verdict, finding, "" if height.is_valid else "check the range finder")


def _health(setup: AutopilotSetup) -> Iterator[Check]:
    used = setup.sensors_present & setup.sensors_enabled
    bad = unhealthy(setup.sensors_present, setup.sensors_enabled, setup.sensors_health)
    good = [name for bit, name in SENSORS.items() if used & bit and setup.sensors_health & bit]
    if bad:
        advice = "wait until it has settled; if it does not, check wiring and calibration"
        finding = f"not well: {', '.join(bad)}"
        yield Check(GROUP, "autopilot's sensors", Verdict.RED, finding, advice, may_settle=True)
    else:
        yield Check(GROUP, "autopilot's sensors", Verdict.OK, ", ".join(good) or "none")
    doubtful = [name for bit, name in DOUBTFUL.items() if used & bit and not setup.sensors_health & bit]
    if doubtful:
        advice = "check its memory card, or the transmitter"
        yield Check(GROUP, "also not well", Verdict.WARNING, ", ".join(doubtful), advice)


def _calibration(setup: AutopilotSetup) -> Iterator[Check]:
    assert setup.style is not None
    table = {
        name: sensor
        for name, sensor in table_of(setup.style, setup.vehicle).calibrated.items()
        if name in setup.parameters
    }
    if not table:
        return  # such an autopilot says it in its own checks
    never = [sensor for name, sensor in table.items() if setup.parameters[name] == 0.0]
    if never:
        finding = f"never calibrated: {', '.join(never)}"
        yield Check(GROUP, "calibration", Verdict.RED, finding, "calibrate it from the Services screen")
    else:
        yield Check(GROUP, "calibration", Verdict.OK, ", ".join(table.values()))


def _position(readings: Readings) -> Check:
    pose = readings.pose
    if pose is None or not readings.is_pose_fresh:
        finding = "no pose received"
        if pose is not None:
            finding = pose.reason or ("it is not valid" if not pose.is_valid else "it has stopped")
        advice = "wait for the estimate, or check its sources"
        return Check(GROUP, "position", Verdict.RED, finding, advice, may_settle=True)
    sources = f" from {', '.join(pose.sources)}" if pose.sources else ""
    finding = f"quality {100.0 * pose.quality:.0f} %{sources}"
    if pose.quality < LEAST_QUALITY:
        return Check(GROUP, "position", Verdict.WARNING, finding, "wait until it improves")
    return Check(GROUP, "position", Verdict.OK, finding)
