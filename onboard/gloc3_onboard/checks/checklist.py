"""The whole list of a platform, from everything that is known of it."""

from gloc3.messages.preflight import Check, in_order
from gloc3.messages.software import compared
from gloc3_onboard.checks.autopilot import autopilot_checks
from gloc3_onboard.checks.computer import computer_checks
from gloc3_onboard.checks.failsafes import failsafe_checks
from gloc3_onboard.checks.hosts import host_checks
from gloc3_onboard.checks.own_sensors import own_sensor_checks
from gloc3_onboard.checks.platform_parts import component_checks, mission_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.sensors import sensor_checks


def checklist(readings: Readings) -> list[Check]:
    """Every line, group by group."""
    return in_order(
        [
            *autopilot_checks(readings),
            *failsafe_checks(readings),
            *sensor_checks(readings),
            *own_sensor_checks(readings),
            *component_checks(readings),
            *host_checks(readings),
            *mission_checks(readings),
            *computer_checks(readings),
            *(compared(f"station {name}", other, "there") for name, other in readings.stations.items()),
        ]
    )
