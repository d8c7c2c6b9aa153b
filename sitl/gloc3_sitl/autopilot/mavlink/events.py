"""PX4's events: sending them, their metadata, and the health and arming report that consists of them.

Wire format, numbers and metadata are those of libevents; the words are ours.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import IntEnum
from struct import pack
from typing import Any, Final, NamedTuple, Never

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.mavlink.metadata import packed
from gloc3_sitl.autopilot.modes import NAVIGATION_STATES

_ARGUMENT_BYTES: Final = 40
_FIRST_SEQUENCE: Final = 65525
"""First sequence number, as high as PX4's, so that receivers soon meet the wrap."""
_KEPT: Final = 20
"""Newest events that can be requested again."""
_SEQUENCE_PERIOD_S: Final = 3.0
_RESET: Final = 1
"""MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET."""


class EventLevel(IntEnum):
    """Log level of an event."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    INFO = 6
    PROTOCOL = 8


class EventKind(NamedTuple):
    """One of PX4's events, by its name."""

    name: str
    level: EventLevel
    text: str
    group: str = "default"
    component: int = 0
    """Place of the affected component in the bits of `health_component_t`; 0 is none."""

    @property
    def number(self) -> int:
        """EVENT.id: component 1, and 24 bits of the name's FNV-1a hash."""
        value = 0x811C9DC5
        for byte in self.name.encode():
            value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
        return 1 << 24 | value & 0xFFFFFF


ARMING_SUMMARY: Final = EventKind(
    "commander_arming_check_summary", EventLevel.PROTOCOL, "Arming checks", "arming_check"
)
HEALTH_SUMMARY: Final = EventKind("commander_health_summary", EventLevel.PROTOCOL, "Health", "health")
ARMING_REFUSED: Final = EventKind(
    "commander_arm_denied_resolve_failures", EventLevel.CRITICAL, "Arming refused: a check fails"
)
CHECKS: Final[Mapping[str, EventKind]] = {
    name: EventKind(name, level, text, "arming_check", component)
    for name, level, component, text in (
        ("check_modes_attitude", EventLevel.CRITICAL, 16, "The attitude estimate is not ready"),
        ("check_failure_detector_roll", EventLevel.CRITICAL, 16, "The vehicle is tilted too far"),
        ("check_modes_local_alt", EventLevel.CRITICAL, 20, "The height estimate is not valid"),
        ("check_estimator_heading_not_stable", EventLevel.ERROR, 17, "The heading estimate is not stable"),
        ("check_modes_local_pos", EventLevel.ERROR, 17, "The local position estimate is not valid"),
        ("check_modes_global_pos", EventLevel.ERROR, 24, "The global position estimate is not valid"),
        ("check_battery_low", EventLevel.WARNING, 11, "The battery is low"),
        ("check_modes_manual_control", EventLevel.WARNING, 7, "No sticks: no transmitter and no joystick"),
        ("check_modes_cannot_takeoff", EventLevel.INFO, 20, "The vehicle cannot be armed in this mode"),
        ("check_modes_mission", EventLevel.INFO, 20, "There is no mission that can be flown"),
        ("check_modes_offboard_signal", EventLevel.ERROR, 20, "No offboard setpoints are received"),
        ("check_gf_violation_custom_gf", EventLevel.ERROR, 20, "The vehicle is outside the geofence"),
    )
}
"""Failed arming checks by name."""


class EventSender(Microservice[Never]):
    """Sends events once to all, and again on request."""

    handles = frozenset({"REQUEST_EVENT"})

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._kept: deque[MavlinkMessage] = deque(maxlen=_KEPT)
        self._sequence = _FIRST_SEQUENCE
        self._sequence_s = -_SEQUENCE_PERIOD_S

    def send(self, kind: EventKind, now_s: float, arguments: bytes = b"") -> None:
        """Sends an event with its arguments, packed little-endian in the order of their definition."""
        if not self._kept:
            self._send_sequence(now_s, _RESET)
        self._sequence = self._sequence + 1 & 0xFFFF
        event = make(
            "EVENT",
            id_=kind.number,
            event_time_boot_ms=int(now_s * 1e3),
            sequence=self._sequence,
            log_levels=kind.level << 4 | kind.level,
            arguments=arguments.ljust(_ARGUMENT_BYTES, b"\0"),
        )
        self._kept.append(event)
        self._outgoing.append(event)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Sends requested events again; expired ones are answered one by one."""
        if not self._is_for_us(message):
            return
        kept = {event.sequence: event for event in self._kept}
        for step in range((message.last_sequence - message.first_sequence & 0xFFFF) + 1):
            sequence = message.first_sequence + step & 0xFFFF
            if sequence in kept:
                self._outgoing.append(kept[sequence])
                continue
            later = min(kept, key=lambda number: number - sequence & 0xFFFF, default=self._sequence)
            self._send_to(sender, "RESPONSE_EVENT_ERROR", sequence=sequence, sequence_oldest_available=later)
            if step >= _KEPT:
                return

    def tick(self, now_s: float) -> None:
        """Sends the newest sequence number every 3 s."""
        if now_s - self._sequence_s >= _SEQUENCE_PERIOD_S:
            self._send_sequence(now_s, 0 if self._kept else _RESET)

    def _send_sequence(self, now_s: float, flags: int) -> None:
        self._sequence_s = now_s
        self._send("CURRENT_EVENT_SEQUENCE", sequence=self._sequence, flags=flags)


# -- metadata ---------------------------------------------------------------------------------------------------------

EVENTS: Final = "etc/extras/all_events.json.xz"
_SUMMARIES: Final[Mapping[EventKind, tuple[tuple[str, str], ...]]] = {
    ARMING_SUMMARY: (
        ("chunk_idx", "uint8_t"),
        ("error", "health_component_t"),
        ("warning", "health_component_t"),
        ("can_arm", "navigation_mode_group_t"),
        ("can_run", "navigation_mode_group_t"),
    ),
    HEALTH_SUMMARY: (
        ("chunk_idx", "uint8_t"),
        ("is_present", "health_component_t"),
        ("error", "health_component_t"),
        ("warning", "health_component_t"),
    ),
}
_CHECK_ARGUMENTS: Final = (("modes", "navigation_mode_group_t"), ("health_component_index", "uint8_t"))


def metadata_file(mode_groups: Mapping[int, tuple[str, int]], components: Mapping[int, str]) -> bytes:
    """The metadata file of the events.

    Args:
        mode_groups: name and custom mode by the place of its bit in `navigation_mode_group_t`.
        components: names by the place of their bits in `health_component_t`.
    """
    groups: dict[str, dict[str, Any]] = {}
    for kind in (ARMING_REFUSED, ARMING_SUMMARY, HEALTH_SUMMARY, *CHECKS.values()):
        described: dict[str, Any] = {"name": kind.name, "message": kind.text}
        arguments = _SUMMARIES.get(kind, _CHECK_ARGUMENTS if kind.name in CHECKS else ())
        if arguments:
            described["arguments"] = [{"name": name, "type": type_} for name, type_ in arguments]
        if kind in _SUMMARIES:
            described["type"] = "summary"
        group = groups.setdefault(kind.group, {"events": {}})
        group["events"][str(kind.number & 0xFFFFFF)] = described
    own = {
        "namespace": "px4",
        "enums": {
            "navigation_mode_group_t": _bits({bit: name for bit, (name, _) in mode_groups.items()}),
            "health_component_t": _bits(components),
        },
        "event_groups": groups,
        "navigation_mode_groups": {"groups": {str(bit): [custom] for bit, (_, custom) in mode_groups.items()}},
        "supported_protocols": ["health_and_arming_check"],
    }
    return packed({"version": 2, "components": {"1": own}})


def _bits(names: Mapping[int, str]) -> dict[str, Any]:
    entries = {str(1 << bit): {"name": name, "description": name} for bit, name in names.items()}
    return {"type": "uint32_t", "description": "bits", "is_bitfield": True, "entries": entries}


# -- health and arming report --------------------------------------------------------------------------------------------

_POLL_S: Final = 0.5
_PERIOD_S: Final = 2.0
"""Shortest time between reports of changes."""
_EVERY_MODE: Final = 0xFFFFFFFF
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
        autopilot: the checked autopilot.
        events: sends the report.
    """

    def __init__(self, autopilot: Autopilot, events: EventSender) -> None:
        commander = autopilot.commander
        self._commander: Final = commander
        self._events: Final = events
        self._polled_s = -_POLL_S
        self._sent_s = -_PERIOD_S
        self._sent: Report | None = None
        groups = {NAVIGATION_STATES[mode.name]: (mode.name, mode.custom_mode) for mode in commander.style.modes}
        self.metadata: Final = metadata_file(groups, _COMPONENTS)
        """Metadata of the events."""
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
            bit = 1 << NAVIGATION_STATES[mode.name]
            every |= bit
            # A mode that does not permit arming is a reason only while it is the current one.
            counts = mode.can_arm or mode is commander.mode
            problems = commander.arming_problems(mode, counts_mode=counts)
            names = {problem.event for problem in problems if problem.event}
            can_arm |= 0 if problems else bit
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
