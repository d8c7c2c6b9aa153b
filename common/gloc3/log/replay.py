"""Replays a component's recorded inputs through the component, and compares its outputs with the recorded ones.

The component runs under its real host, in virtual time, on the recorded clock: every input, command and function
message arrives at its recorded time. So the effect of a code change on a real flight can be seen.
"""

import asyncio
import re
from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise
from random import Random
from statistics import median
from typing import Any, Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.clock import Clock, VirtualLoop
from gloc3.component.context import HostContext
from gloc3.component.deployment import PUBLISHED_BY_HOSTS, Begin, ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.errors import Refused, nearest
from gloc3.exchange.base import LocalExchange
from gloc3.log.fields import flatten
from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.log.record import CAMERAS_FILE
from gloc3.log.report.flight_path import value_of
from gloc3.log.selection import period_s
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable, matches
from gloc3.platform.platform import Platform

ASIDE_S: Final = 1e-7
"""So much before or after its time an input comes that was recorded at the same instant as a cycle, to keep order."""
LONE_TOLERANCE_S: Final = 0.05
"""Largest time difference between matching outputs, where a topic has only one, s."""


class Comparison(msgspec.Struct, frozen=True):
    """Recorded outputs of a component against those of the replay."""

    topic: str
    recorded: int
    replayed: int
    matched: int
    """Pairs at about the same time."""
    differences: dict[str, float]
    """Field to the greatest difference of a number in any pair."""
    mismatches: dict[str, int]
    """Field to the count of pairs that differ in something that is no number."""
    is_thinned: bool = False
    """Whether the log has not all of its messages."""

    @property
    def is_same(self) -> bool:
        """Whether the replay equals the recording, except for rounding."""
        is_complete = self.recorded == self.matched and (self.is_thinned or self.recorded == self.replayed)
        return is_complete and not self.mismatches and all(value < 1e-6 for value in self.differences.values())


class ReplayResult(msgspec.Struct, frozen=True):
    """Result of a replay."""

    comparisons: list[Comparison]
    notes: list[str]
    """What the log lacks for an exact replay, in sentences."""

    @property
    def is_same(self) -> bool:
        """Whether there are recorded outputs, and the replay equals them, except for rounding."""
        return bool(self.comparisons) and all(found.is_same for found in self.comparisons)


class LoggedRig:
    """The cameras as the log has them: the device `rig` of processors."""

    def __init__(self, reader: LogReader, platform: Platform) -> None:
        attached = reader.attachments.get(CAMERAS_FILE)
        models = {name: model for name, model in platform.cameras.items() if isinstance(model, CameraModel)}
        self._models = msgspec.json.decode(attached, type=dict[str, CameraModel]) if attached is not None else models

    def model(self, camera: str) -> CameraModel | None:
        """The model of the camera of that name; None where the log has none."""
        return self._models.get(camera)


class NoMemory:
    """The device `memory` of a component in its first life."""

    def load(self) -> bytes | None:
        """Nothing."""
        return None

    def keep(self, data: bytes) -> None:
        """Keeps nothing."""


def replay(reader: LogReader, platform: Platform, name: str, topics: TopicTable) -> ReplayResult:
    """Runs one component of a platform on the inputs of a log.

    Raises:
        Refused: the platform has no such component, it works on a device of which the log has no messages, an input is
            not recorded, or it did not start in the log.
    """
    row = platform.component(name)
    if row is None:
        raise Refused(
            f"{platform.platform} has no component {name!r}; {nearest(name, [c.name for c in platform.components])}"
        )
    devices: dict[str, Any] = {"rig": LoggedRig(reader, platform), "memory": NoMemory()}
    if not platform.known_map:
        devices["known_map"] = None
    others = sorted(set(row.devices.values()) - set(devices))
    if others:
        raise Refused(f"{name} reads a device ({', '.join(others)}), and a log can replay messages only")
    component = row.load_class()
    own = f"components/{name}"
    outputs = [topic for port in component.outputs for topic in row.topics(port)]
    inputs = [f"{own}/command", f"{own}/function"] + [topic for port in component.inputs for topic in row.topics(port)]
    _require_inputs(reader, platform, name, inputs[2:], topics)
    entries = sorted(reader.entries(*inputs, *outputs, f"{own}/*"), key=lambda entry: entry.now_s)
    recorded = [entry for entry in entries if _is_output(entry, name, outputs)]
    begin_s = _begin_s(entries, row, name)
    given = _give(entries, row, inputs, name)
    answers = _run(row, devices, reader.platform, topics, given, begin_s, max(entry.now_s for entry in entries))
    replayed = [envelope for envelope in answers if _fits(envelope, name, outputs)]
    names = sorted({entry.envelope.topic for entry in recorded} | {envelope.topic for envelope in replayed})
    thinned = _thinned(entries)
    notes = [f"{topic}: {share} are in the log" for topic, share in thinned.items()]
    comparisons = []
    for topic in names:
        before = [entry.envelope for entry in recorded if entry.envelope.topic == topic]
        after = [envelope for envelope in replayed if envelope.topic == topic]
        if before or _is_recorded(topic.partition("/")[2], platform, topics):
            comparisons.append(_compare(topic, before, after, is_thinned=topic in thinned))
        else:
            notes.append(f"{topic}: {len(after)} replayed; it was not recorded, so there is nothing to compare with")
    return ReplayResult(comparisons, notes)


def _is_recorded(topic: str, platform: Platform, topics: TopicTable) -> bool:
    return period_s(topic, topics.row(f"{platform.platform}/{topic}"), platform.log) is not None


def _require_inputs(reader: LogReader, platform: Platform, name: str, inputs: list[str], topics: TopicTable) -> None:
    """Requires that each input that somebody publishes is recorded.

    Raises:
        Refused: one is not.
    """
    logged = {topic.partition("/")[2] for topic in reader.topics}
    published = platform.topics()
    missing = [
        topic
        for topic in dict.fromkeys(inputs)
        if not any(matches(topic, one) for one in logged)
        and any(matches(topic, one) for one in published)
        and not _is_recorded(topic, platform, topics)
    ]
    if missing:
        asked = ", ".join(f"{topic}: true" for topic in missing)
        raise Refused(
            f"{name} cannot be replayed: its input {', '.join(missing)} was not recorded. "
            f"`log: {{{asked}}}` in the platform file records it in the next flight"
        )


def _thinned(entries: list[LoggedMessage]) -> dict[str, str]:
    """Topics of which messages are missing between the first and the last, with how many there are of how many."""
    sequences: dict[tuple[str, Any], list[int]] = {}
    for _, envelope in entries:
        sequences.setdefault((envelope.topic, envelope.source), []).append(envelope.sequence)
    found = {}
    for (topic, _), numbers in sequences.items():
        span = max(numbers) - min(numbers) + 1
        if len(numbers) < span:
            found[topic] = f"{len(numbers)} of {span} messages"
    return found


def _fits(envelope: Envelope[Any], name: str, topics: list[str]) -> bool:
    below = envelope.topic.partition("/")[2]
    return envelope.source.component == name and any(matches(topic.replace("{key}", "*"), below) for topic in topics)


def _is_output(entry: LoggedMessage, name: str, outputs: list[str]) -> bool:
    return _fits(entry.envelope, name, outputs)


def _begin_s(entries: list[LoggedMessage], row: ComponentRow, name: str) -> float:
    """When the host began: at the component's start, or where the row does not start it, at its first message."""
    is_started = row.begin in (Begin.WORKING, Begin.QUIET)
    for entry in entries:
        envelope = entry.envelope
        if envelope.source.component == name and envelope.topic.startswith(f"{envelope.source.platform}/components/"):
            text = value_of(envelope.payload, "text") or ""
            if not is_started or text.startswith("start: "):
                return entry.now_s
    raise Refused(f"{name} did not start in this log")


def _give(
    entries: list[LoggedMessage], row: ComponentRow, inputs: list[str], name: str
) -> Iterator[tuple[float, Envelope[Any]]]:
    """The inputs with their replay times, in the recorded order relative to cycles."""
    trigger = [topic for port in row.triggers for topic in row.topics(port)]
    hosts_own = {f"components/{name}/{report}" for report in PUBLISHED_BY_HOSTS if report != "internal"}
    cycled_s = float("-inf")
    """When a cycle ran last: at a trigger, or where there is none, when the component reported something."""
    for entry in entries:
        envelope = entry.envelope
        below = envelope.topic.partition("/")[2]
        if envelope.source.component == name:
            if not trigger and below not in hosts_own:
                cycled_s = entry.now_s
        elif any(matches(topic, below) for topic in inputs):
            is_trigger = any(matches(topic, below) for topic in trigger)
            aside_s = 0.0 if is_trigger else ASIDE_S if entry.now_s == cycled_s else -ASIDE_S
            yield max(entry.now_s + aside_s, 0.0), envelope
            cycled_s = entry.now_s if is_trigger else cycled_s


def _run(
    row: ComponentRow,
    devices: dict[str, Any],
    platform: str,
    topics: TopicTable,
    given: Iterator[tuple[float, Envelope[Any]]],
    begin_s: float,
    end_s: float,
) -> list[Envelope[Any]]:
    """All messages published while the inputs are replayed, including the inputs."""
    loop = VirtualLoop()
    exchange = LocalExchange()
    published: list[Envelope[Any]] = []
    exchange.subscribe("**", published.append)
    host = ComponentHost(
        row, lambda: row.create(devices), HostContext(platform, exchange, Clock(loop), loop, topics, Random(0))
    )

    async def main() -> None:
        loop.call_at(begin_s, host.begin)
        for when_s, envelope in given:
            loop.call_at(when_s, exchange.publish, envelope)
        await asyncio.sleep(end_s + 2.0 * ASIDE_S)

    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        runner.run(main())
        host.close()
    return published


def _compare(
    topic: str, recorded: list[Envelope[Any]], replayed: list[Envelope[Any]], *, is_thinned: bool
) -> Comparison:
    gaps = [later.t_s - earlier.t_s for earlier, later in pairwise(recorded)]
    tolerance_s = 0.5 * median(gaps) if gaps else LONE_TOLERANCE_S
    times = [envelope.t_s for envelope in replayed]
    differences: dict[str, float] = {}
    mismatches: dict[str, int] = {}
    matched, free = 0, 0
    for envelope in recorded:
        at = max(bisect_left(times, envelope.t_s), free)
        nearby = [index for index in (at - 1, at) if free <= index < len(times)]
        best = min(nearby, key=lambda index: abs(times[index] - envelope.t_s), default=None)
        if best is None or abs(times[best] - envelope.t_s) > max(tolerance_s, ASIDE_S):
            continue
        free = best + 1
        matched += 1
        _note(envelope.payload, replayed[best].payload, differences, mismatches)
    return Comparison(topic, len(recorded), len(replayed), matched, differences, mismatches, is_thinned)


def _note(one: Any, other: Any, differences: dict[str, float], mismatches: dict[str, int]) -> None:
    """Adds what differs between two payloads."""
    left, right = flatten(msgspec.to_builtins(one)), flatten(msgspec.to_builtins(other))
    for field in sorted(left.keys() | right.keys()):
        a, b = left.get(field), right.get(field)
        if isinstance(a, float) and isinstance(b, float):
            differences[field] = max(differences.get(field, 0.0), 0.0 if a == b or a != a != b else abs(a - b))
        elif a != b:
            mismatches[field] = mismatches.get(field, 0) + 1


def render_replay(result: ReplayResult) -> str:
    """The result as text."""
    lines = list(result.notes)
    for found in result.comparisons:
        verdict = "same" if found.is_same else "DIFFERS"
        lines.append(
            f"{found.topic}: {found.recorded} recorded, {found.replayed} replayed, {found.matched} matched: {verdict}"
        )
        greatest: dict[str, float] = {}
        for field, value in found.differences.items():
            name = re.sub(r"(\[\d+\])+", "[]", field)
            greatest[name] = max(greatest.get(name, 0.0), value)
        lines += [f"  {field:<40} differs by up to {value:.3g}" for field, value in greatest.items() if value]
        lines += [f"  {field:<40} differs in {count} of them" for field, count in found.mismatches.items()]
    return "\n".join(lines) or "no output was recorded, and the replay produced none"
