"""Topics as rows of data: one rate drives pacing, liveness, the log's budget and the downlink."""

from collections.abc import Iterator, Mapping
from enum import StrEnum
from fnmatch import fnmatchcase
from math import inf
from typing import Final

import msgspec

from gloc3.errors import Misuse
from gloc3.installed import installed_points
from gloc3.messages.envelope import (
    CommandReply,
    CommandRequest,
    ComponentStatus,
    Event,
    FunctionReply,
    FunctionRequest,
    InternalState,
    Message,
)
from gloc3.messages.wire import TypeRegistry

MESSAGE_BYTES: Final = 512_000
"""Longest message of an ordinary topic, bytes: room for a mission with its plan, or a table of 1,000 components."""
BULK_BYTES: Final = 8_000_000
"""Longest message of a bulk topic, bytes: room for a colour picture of 1920 x 1080, not compressed."""
ENVELOPE_BYTES: Final = 64_000
"""Room for what goes with the longest message, bytes."""


class TopicService(StrEnum):
    """Quality of service of a topic between processes."""

    COMMAND = "command"
    """Everything arrives, before everything else."""
    REPORT = "report"
    """Everything arrives."""
    CONTROL = "control"
    """In real time: what cannot leave at once is dropped, the next is newer."""
    STREAM = "stream"
    """The same, behind commands."""
    BULK = "bulk"
    """Large: it leaves when nothing else does, or is dropped."""

    @property
    def most_bytes(self) -> int:
        """Longest message between processes, bytes."""
        return BULK_BYTES if self is TopicService.BULK else MESSAGE_BYTES


class TopicRow(msgspec.Struct, frozen=True):
    """Properties of a topic."""

    message: type[Message]
    rate_hz: float = 0.0
    """Nominal rate; 0 for event topics, which are never *silent*."""
    is_logged: bool = True
    downlink_every: int = 0
    """Every n-th message goes to the stations; 0 for none."""
    silent_after: float = 10.0
    """Nominal periods without a message after which the topic is *silent*."""
    service: TopicService | None = None
    """None is a stream for topics with a rate, and a report for others."""
    is_latched: bool = False
    """It holds a state, not an event: late subscribers get the last message."""
    is_inner: bool = False
    """The platform keeps it to itself, and ends without it still speak the same protocol."""
    most_hz: float = 0.0
    """Most messages a second that are received on one key from other processes, 1/s; 0 for no limit."""

    @property
    def travels(self) -> TopicService:
        """How the topic travels between processes."""
        return self.service or (TopicService.STREAM if self.rate_hz else TopicService.REPORT)

    def is_alive(self, age_s: float) -> bool:
        """Whether a topic whose last message has this age counts as alive."""
        return age_s < self.silent_s

    @property
    def silent_s(self) -> float:
        """Age of the last message from which the topic counts as silent, s; infinite for one that never does."""
        return self.silent_after / self.rate_hz if self.rate_hz else inf


GENERIC: Final[Mapping[str, TopicRow]] = {
    "components/*/status": TopicRow(ComponentStatus, 1.0, service=TopicService.REPORT),
    "components/*/command": TopicRow(CommandRequest, service=TopicService.COMMAND),
    "components/*/reply": TopicRow(CommandReply, service=TopicService.COMMAND),
    "components/*/function": TopicRow(FunctionRequest, service=TopicService.COMMAND),
    "components/*/function_reply": TopicRow(FunctionReply, service=TopicService.COMMAND),
    "components/*/event": TopicRow(Event),
    "components/*/internal": TopicRow(InternalState),
}
"""The topics of every component, below the platform's name."""


class TopicTable:
    """Topic rows known to a process: the generic ones, ours, and other packages' (entry points `gloc3.topics`)."""

    def __init__(self, rows: Mapping[str, TopicRow] | None = None) -> None:
        self.types = TypeRegistry()
        self._rows: dict[str, TopicRow] = {}
        self._found: dict[str, TopicRow | None] = {}
        self.add(GENERIC)
        self.add(rows or {})

    @classmethod
    def installed(cls) -> "TopicTable":
        """The table with the rows of every installed package."""
        table = cls()
        for point in installed_points("gloc3.topics"):
            table.add(point.load())
        return table

    def add(self, rows: Mapping[str, TopicRow]) -> None:
        """Adds rows; a name may contain `*` for one level. Adding the same name twice is a programming error."""
        for name, row in rows.items():
            if self._rows.setdefault(name, row) is not row:
                raise Misuse(f"two packages declare the topic {name!r}")
            self.types.add(row.message)
        self._found.clear()

    def row(self, topic: str) -> TopicRow | None:
        """The row for a full topic `PLATFORM/TOPIC`; an exact name goes before a pattern."""
        if topic not in self._found:
            name = topic.partition("/")[2]
            self._found[topic] = self._rows.get(name) or next(
                (row for pattern, row in self._rows.items() if "*" in pattern and matches(pattern, name)), None
            )
        return self._found[topic]

    def __iter__(self) -> Iterator[tuple[str, TopicRow]]:
        return iter(self._rows.items())


def matches(pattern: str, topic: str) -> bool:
    """Whether a topic matches a pattern: `*` is one level, `**` at the end any number of levels."""
    if "*" not in pattern:
        return pattern == topic
    wanted, levels = pattern.split("/"), topic.split("/")
    if wanted[-1] == "**":
        wanted.pop()
        levels = levels[: len(wanted)]
    return len(wanted) == len(levels) and all(map(fnmatchcase, levels, wanted))
