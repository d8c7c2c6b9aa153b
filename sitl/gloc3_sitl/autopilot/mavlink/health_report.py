"""PX4's health and arming report: which modes can be armed and flown, and what speaks against each, as events."""

from struct import pack
from typing import Final

from gloc3_sitl.autopilot.commander import Commander
from gloc3_sitl.autopilot.mavlink.events import (
    ARMING_REFUSED,
    ARMING_SUMMARY,
    CHECKS,
    HEALTH_SUMMARY,
    EventLevel,
    EventSender,
    metadata_files,
)

_POLL_S: Final = 0.5
_PERIOD_S: Final = 2.0
"""Shortest time between reports of changes."""
_EVERY_MODE: Final = 0xFFFFFFFF
_BITS: Final = {
    "Manual": 0,
    "Altitude": 1,
    "Position": 2,
    "Mission": 3,
    "Hold": 4,
    "Return": 5,
    "Offboard": 14,
    "Stabilized": 15,
    "Takeoff": 17,
    "Land": 18,
    "Follow": 19,
    "Orbit": 21,
}
"""Place of each mode's bit in `navigation_mode_group_t`: PX4's number of the navigation state."""
_COMPONENTS: Final = {
    0: "none",
    1: "absolute_pressure",
    3: "gps",
    6: "distance_sensor",
    7: "remote_control",
    11: "battery",
    16: "attitude_estimate",
    17: "local_position_estimate",
    20: "system",
    24: "global_position_estimate",
    27: "magnetometer",
    28: "accel",
    29: "gyro",
}
"""By the place of its bit in `health_component_t`."""
_PRESENT: Final = sum(1 << bit for bit in (1, 3, 6, 11, 27, 28, 29))

Report = tuple[bytes, tuple[tuple[str, int], ...]]


class HealthReporter:
    """Reports the checks when they change, and on request.

    Args:
        commander: whose checks.
        events: sends the report.
    """

    def __init__(self, commander: Commander, events: EventSender) -> None:
        self._commander: Final = commander
        self._events: Final = events
        self._polled_s = -_POLL_S
        self._sent_s = -_PERIOD_S
        self._sent: Report | None = None
        groups = {_BITS[mode.name]: (mode.name, mode.custom_mode) for mode in commander.style.modes}
        self.files: Final = metadata_files(groups, _COMPONENTS)
        """Metadata of the events, by path."""
        commander.on_arming_refused = self._refused

    def tick(self, now_s: float) -> None:
        """Sends a report of the checks that have changed; none while armed."""
        if self._commander.craft.is_armed or now_s - self._polled_s < _POLL_S or now_s - self._sent_s < _PERIOD_S:
            return
        self._polled_s = now_s
        found = self._report()
        if found != self._sent:
            self.send(now_s, found)

    def send(self, now_s: float, found: Report | None = None) -> None:
        """Sends a report: the arming summary, an event for each failed check, the health summary."""
        self._sent = found or self._report()
        self._sent_s = now_s
        summary, failed = self._sent
        self._events.send(ARMING_SUMMARY, now_s, summary)
        for name, modes in failed:
            self._events.send(CHECKS[name], now_s, pack("<IB", modes, CHECKS[name].component))
        self._events.send(HEALTH_SUMMARY, now_s, pack("<BIII", 0, _PRESENT, 0, 0))

    def _refused(self) -> None:
        self._events.send(ARMING_REFUSED, self._commander.craft.now_s)

    def _report(self) -> Report:
        commander = self._commander
        failed: dict[str, int] = {}
        can_arm = can_run = every = 0
        for mode in commander.style.modes:
            bit = 1 << _BITS[mode.name]
            every |= bit
            # A mode that does not permit arming is a reason only while it is the current one.
            counts = mode.can_arm or mode is commander.mode
            names = {problem.event for problem in commander.arming_problems(mode, counts_mode=counts)}
            can_arm |= 0 if names else bit
            can_run |= 0 if commander.cannot_fly(mode) else bit
            for name in names:
                failed[name] = failed.get(name, 0) | bit
        if not commander.has_pilot:
            failed.setdefault("check_modes_manual_control", every)
        error = warning = 0
        for name in failed:
            level, component = CHECKS[name].level, 1 << CHECKS[name].component
            error |= component if level <= EventLevel.ERROR else 0
            warning |= component if level is EventLevel.WARNING else 0
        order = tuple(name for name in CHECKS if name in failed)
        modes = tuple((name, _EVERY_MODE if failed[name] == every else failed[name]) for name in order)
        return pack("<BIIII", 0, error, warning, can_arm, can_run), modes
