"""Status reports of a platform's hosts."""

from enum import StrEnum
from typing import Final

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.readiness import SensorCondition

HOSTS: Final = "hosts"
"""Below the platform's name: each host's status is `hosts/NAME`, its questions for the time `hosts/NAME/clock`."""


HOST_PRESENCE: Final = "host_presence"


class ProcessLine(msgspec.Struct, frozen=True, array_like=True):
    """A process of a host."""

    name: str
    """Empty for the main one."""
    pid: int
    """0 while it is away."""
    phase: str
    """`beginning`, `up`, `away` (it has exited) or `left`."""
    components: list[str]
    restarts: int = 0
    last_words: str = ""
    """Why it ended last."""
    log_problem: str = ""
    """Why its log is not written any more."""


class HostStatus(Message, frozen=True):
    """One host of a platform, once a second and on every change."""

    host: str
    is_clock_host: bool
    processes: list[ProcessLine]
    version: str = ""
    """Of the software."""
    protocol: str = ""
    """A hash over all types of messages; ends with different ones may not understand each other."""
    clock_offset_s: float = 0.0
    """The platform's time minus this computer's monotonic clock."""
    clock_bound_s: float = 0.0
    """How wrong the offset may be at most; infinite before the first measurement."""
    clock_round_trip_s: float = 0.0
    clock_age_s: float = 0.0
    """Since the measurement that counts."""
    load: float = 0.0
    """Processes that want to run, for each of the computer's cores, over the last minute."""
    vehicle_boot_s: float | None = None
    """Platform time at which the autopilot's clock started; None where it is unknown here."""
    sensors: list[SensorCondition] = []
    """Of all processes of the host."""
    is_renewing: bool = False
    """It is re-reading its network file: absent for a moment, and not lost."""


class HostState(StrEnum):
    """State of a host, as the clock host sees it."""

    EXPECTED = "expected"
    """The platform's file lists it, and it has not been received yet."""
    HERE = "here"
    DIFFERENT = "other version"
    """It is present, and uses another protocol."""
    LOST = "lost"


class HostLine(msgspec.Struct, frozen=True, array_like=True):
    """One host for the stations: at most 14 bytes as msgpack."""

    index: int
    """In `HostNames`."""
    state: int
    """Index of a `HostState`."""
    processes: int
    """That are up."""
    away: int
    """Processes that should be up, and are not."""
    restarts: int
    """Of all its processes, at most 65,535."""
    load_percent: int
    """Processes that want to run, for each core; at most 999."""
    bound_ms: int
    """How wrong the offset of its clock may be, rounded up; 65,535 where that is not known."""


class HostSummary(Message, frozen=True):
    """Some hosts of a platform, for the stations."""

    lines: list[HostLine]


class HostWords(msgspec.Struct, frozen=True, array_like=True):
    """Properties of a host that seldom change."""

    name: str
    version: str = ""
    """Of its software; empty until it is received."""
    clock_offset_s: float = 0.0
    """The platform's time minus its computer's monotonic clock."""
    last_words: str = ""
    """Of the process that ended last, with its name."""


class HostNames(Message, frozen=True):
    """Names of the hosts behind the indices, sent on change and repeated periodically."""

    hosts: list[HostWords]


class ClockQuestion(Message, frozen=True):
    """A host requests the clock host's time."""

    number: int
    """Random, so that an answer belongs to one question of one life."""


class ClockAnswer(Message, frozen=True):
    """Time on the clock host."""

    number: int
    received_s: float
    answered_s: float


class HostPresence(Message, frozen=True):
    """On the clock host, for its command interface: another host is here, or is lost."""

    host: str
    is_here: bool
    status: HostStatus | None = None
    """Its last status; None where it has sent none yet."""
