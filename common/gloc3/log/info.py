"""Summary of a log: its length, topics with their rates, events, faults, and missing data."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, Final

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.log.payloads import origin_in
from gloc3.log.reader import LogReader, below
from gloc3.messages.envelope import Severity
from gloc3.messages.topics import TopicTable

FAULT_MARK: Final = "-> faulty: "
"""Marker in an event of a component's host: the component has become faulty."""
SLOW_SHARE: Final = 0.9
"""A topic below this share of its nominal rate is marked."""


class TopicInfo(msgspec.Struct, frozen=True):
    """One topic of the log."""

    topic: str
    type: str
    encoding: str
    messages: int
    bytes: int
    """Of the messages, before compression."""
    lives: int
    """Publishers: one for each start of each component that published on it."""
    rate_hz: float
    """Mean rate from the first message to the last; 0 where there are fewer than two."""
    nominal_hz: float
    """0 where the topic has none."""

    @property
    def is_slow(self) -> bool:
        """Whether it fell clearly behind its nominal rate."""
        return self.nominal_hz > 0.0 and self.messages > 1 and self.rate_hz < SLOW_SHARE * self.nominal_hz


class EventInfo(msgspec.Struct, frozen=True):
    """Something that happened."""

    t_s: float
    severity: str
    component: str
    text: str


class FaultInfo(msgspec.Struct, frozen=True):
    """A cause for which a component became faulty."""

    component: str
    cause: str
    count: int
    first_s: float
    last_s: float


class LogInfo(msgspec.Struct, frozen=True):
    """Contents of a log."""

    file: str
    size_bytes: int
    is_finished: bool
    losses: list[str]
    """What is missing, in sentences."""
    writer: str
    """The program that wrote it, with its version."""
    is_foreign: bool
    """Whether that was another program than GLOC3."""
    platform: str
    time: str
    """`wall` or `virtual`; empty where the log does not say."""
    start_utc: str
    """ISO 8601; empty where there is no message."""
    start_s: float
    """The first message, in seconds since boot of the clock host."""
    duration_s: float
    messages: int
    topics: list[TopicInfo]
    events: list[EventInfo]
    faults: list[FaultInfo]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, int]
    """Name to bytes."""


class _TopicCounts:
    """What is counted of a topic."""

    def __init__(self) -> None:
        self.messages = self.bytes = 0
        self.first_ns = self.last_ns = 0
        self.lives: set[tuple[int, bytes]] = set()

    def add(self, channel: int, log_ns: int, data: bytes) -> None:
        self.first_ns = self.first_ns or log_ns
        self.last_ns = log_ns
        self.messages += 1
        self.bytes += len(data)
        self.lives.add((channel, origin_in(data)))

    @property
    def rate_hz(self) -> float:
        span_ns = self.last_ns - self.first_ns
        return (self.messages - 1) * 1e9 / span_ns if span_ns > 0 else 0.0


def summarize(reader: LogReader, topics: TopicTable, progress: Callable[[float], None] | None = None) -> LogInfo:
    """Reads a log once and summarizes it.

    Args:
        reader: the open log.
        topics: the rows with the nominal rates.
        progress: called with the share that is done, 0 to 1.
    """
    tallies: dict[str, _TopicCounts] = {channel.topic: _TopicCounts() for channel in reader.scan.channels.values()}
    by_channel = {identifier: tallies[channel.topic] for identifier, channel in reader.scan.channels.items()}
    start_ns, end_ns = 0, 0
    for chunk, messages in reader.chunks():
        for message in messages:
            counts = by_channel.get(message.channel)
            if counts is None:  # described in this chunk
                topic = reader.scan.channels[message.channel].topic
                counts = by_channel[message.channel] = tallies.setdefault(topic, _TopicCounts())
            counts.add(message.channel, message.log_ns, message.data)
        if messages:
            start_ns = min(start_ns or chunk.start_ns, chunk.start_ns)
        end_ns = max(end_ns, chunk.end_ns)
        if progress is not None:
            progress(chunk.end / reader.size)
    events = list_events(reader)
    return LogInfo(
        file=reader.path.name,
        size_bytes=reader.size,
        is_finished=reader.is_finished,
        losses=reader.losses(),
        writer=reader.writer,
        is_foreign=reader.is_foreign,
        platform=reader.platform,
        time=reader.run.get("time", ""),
        start_utc=_utc(start_ns) if start_ns else "",
        start_s=reader.seconds(start_ns) if start_ns else 0.0,
        duration_s=(end_ns - start_ns) / 1e9,
        messages=sum(counts.messages for counts in tallies.values()),
        topics=[_topic_info(reader, topics, topic, tallies[topic]) for topic in sorted(tallies)],
        events=events,
        faults=_faults(events),
        metadata=dict(reader.all_metadata),
        attachments={name: len(data) for name, data in reader.attachments.items()},
    )


def list_events(reader: LogReader) -> list[EventInfo]:
    """The events of all components, in the order of recording."""
    found = []
    for entry in reader.entries("components/*/event"):
        event = entry.envelope.payload
        if not isinstance(event, dict):
            severity, text = event.severity.name.lower(), event.text
        else:
            severity, text = _severity(event.get("severity")), str(event.get("text", ""))
        found.append(EventInfo(entry.envelope.t_s, severity, entry.envelope.source.component, text))
    return found


def is_serious(event: EventInfo) -> bool:
    """Whether an event is a warning or worse."""
    return event.severity in [severity.name.lower() for severity in Severity if severity <= Severity.WARNING]


def _severity(value: Any) -> str:
    return Severity(value).name.lower() if value in list(Severity) else "info"


def _faults(events: list[EventInfo]) -> list[FaultInfo]:
    found: dict[tuple[str, str], FaultInfo] = {}
    for event in events:
        _, mark, cause = event.text.partition(FAULT_MARK)
        if mark:
            key = (event.component, cause)
            before = found.get(key) or FaultInfo(event.component, cause, 0, event.t_s, event.t_s)
            found[key] = FaultInfo(event.component, cause, before.count + 1, before.first_s, event.t_s)
    return list(found.values())


def _topic_info(reader: LogReader, topics: TopicTable, topic: str, counts: _TopicCounts) -> TopicInfo:
    infos = [reader.channel(identifier) for identifier in reader.scan.channels]
    own = [info for info in infos if info.topic == topic]
    row = topics.row(topic)
    return TopicInfo(
        topic=topic,
        type=own[0].type.partition("#")[0],
        encoding=own[0].encoding,
        messages=counts.messages,
        bytes=counts.bytes,
        lives=len(counts.lives),
        rate_hz=counts.rate_hz,
        nominal_hz=row.rate_hz if row is not None else 0.0,
    )


def _utc(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat(timespec="milliseconds")


def render(info: LogInfo, *, has_all_events: bool = False) -> str:
    """The summary as text."""
    state = "finished" if info.is_finished else "NOT FINISHED"
    lines = [
        f"{info.file}: {info.size_bytes:,} bytes, {state}",
        f"written by {info.writer}, not by GLOC3: times count from its first message"
        if info.is_foreign
        else f"platform {info.platform or 'unknown'}, {info.time or 'unknown'} time",
        f"start {info.start_utc or 'unknown'} (t = {info.start_s:.3f} s)",
        f"duration {info.duration_s:.3f} s, {info.messages:,} messages",
        *(f"LOST: {loss}" for loss in info.losses),
        "",
        f"{'topic':<44} {'type':<18} {'messages':>9} {'rate':>7} {'nominal':>7} {'bytes':>12} {'lives':>5}",
    ]
    for topic in info.topics:
        rate = f"{topic.rate_hz:.1f}" if topic.rate_hz else ""
        nominal = f"{topic.nominal_hz:g}" if topic.nominal_hz else ""
        mark = " slow" if topic.is_slow else ""
        lines.append(
            f"{topic.topic:<44} {topic.type or topic.encoding:<18} {topic.messages:>9,} {rate:>7} {nominal:>7}"
            f" {topic.bytes:>12,} {topic.lives:>5}{mark}"
        )
    if info.attachments:
        lines += ["", "attached: " + ", ".join(f"{name} ({size:,} bytes)" for name, size in info.attachments.items())]
    lines += ["", "faults:" if info.faults else "no faults"]
    lines += [
        f"  {fault.component}: {fault.cause} (x{fault.count}, {fault.first_s:.3f} s to {fault.last_s:.3f} s)"
        for fault in info.faults
    ]
    shown = [event for event in info.events if has_all_events or is_serious(event)]
    others = len(info.events) - len(shown)
    lines += ["", "events:" if shown else "no warnings or errors"]
    lines += [f"  {event.t_s:>10.3f} {event.severity:<9} {event.component:<20} {event.text}" for event in shown]
    if others:
        lines.append(f"  and {others} routine (--events shows all)")
    return "\n".join(lines)


def require_topic(reader: LogReader, topic: str) -> str:
    """The name, below the platform's, of a topic of the log.

    Raises:
        Refused: the log has none of that name.
    """
    known = [below(name) for name in reader.topics]
    wanted = topic.removeprefix(f"{reader.platform}/")
    if wanted not in known:
        raise Refused(f"the log has no topic {topic!r}; {nearest(wanted, known)}")
    return wanted
