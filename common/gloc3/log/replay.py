"""Replays a component's recorded inputs through the component, and compares its outputs with the recorded ones.

The component runs under its real host, in virtual time, on the recorded clock: every input, command and function
message arrives at its recorded time. So the effect of a code change on a real flight can be seen.
"""

import asyncio
from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise
from random import Random
from statistics import median
from typing import Any, Final

import msgspec

from gloc3.clock import Clock, VirtualLoop
from gloc3.component.context import HostContext
from gloc3.component.deployment import Begin, ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.errors import Refused, nearest
from gloc3.exchange.base import LocalExchange
from gloc3.log.fields import flatten
from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.log.report.flight_path import value_of
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

    @property
    def is_same(self) -> bool:
        """Whether the replay equals the recording, except for rounding."""
        is_complete = self.recorded == self.replayed == self.matched
        return is_complete and not self.mismatches and all(value < 1e-6 for value in self.differences.values())


def replay(reader: LogReader, platform: Platform, name: str, topics: TopicTable) -> list[Comparison]:
    """Runs one component of a platform on the inputs of a log.

    Raises:
        Refused: the platform has no such component, it works on a device, or it did not start in the log.
    """
    row = platform.component(name)
    if row is None:
        raise Refused(
            f"{platform.platform} has no component {name!r}; {nearest(name, [c.name for c in platform.components])}"
        )
    if row.devices:
        devices = ", ".join(sorted(row.devices.values()))
        raise Refused(f"{name} reads a device ({devices}), and a log can replay messages only")
    component = row.load_class()
    own = f"components/{name}"
    outputs = [topic for port in component.outputs for topic in row.topics(port)]
    inputs = [f"{own}/command", f"{own}/function"] + [topic for port in component.inputs for topic in row.topics(port)]
    entries = list(reader.entries(*inputs, *outputs, f"{own}/*"))
    recorded = [entry for entry in entries if _is_output(entry, name, outputs)]
    begin_s = _begin_s(entries, row, name)
    given = _give(entries, row, inputs, name)
    answers = _run(row, reader.platform, topics, given, begin_s, max(entry.now_s for entry in entries))
    replayed = [envelope for envelope in answers if _fits(envelope, name, outputs)]
    names = sorted({entry.envelope.topic for entry in recorded} | {envelope.topic for envelope in replayed})
    return [
        _compare(
            topic,
            [entry.envelope for entry in recorded if entry.envelope.topic == topic],
            [envelope for envelope in replayed if envelope.topic == topic],
        )
        for topic in names
    ]


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
    cycled_s = float("-inf")
    for entry in entries:
        envelope = entry.envelope
        below = envelope.topic.partition("/")[2]
        if envelope.source.component == name:
            cycled_s = entry.now_s
        elif any(matches(topic, below) for topic in inputs):
            is_trigger = any(matches(topic, below) for topic in trigger)
            aside_s = 0.0 if is_trigger else ASIDE_S if entry.now_s == cycled_s else -ASIDE_S
            yield max(entry.now_s + aside_s, 0.0), envelope


def _run(
    row: ComponentRow,
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
        row, lambda: row.create({}), HostContext(platform, exchange, Clock(loop), loop, topics, Random(0))
    )

    async def main() -> None:
        loop.call_at(begin_s, host.begin)
        for when_s, envelope in given:
            loop.call_at(when_s, exchange.publish, envelope)
        await asyncio.sleep(end_s + 2.0 * ASIDE_S)

    try:
        loop.run_until_complete(main())
        host.close()
    finally:
        loop.close()
    return published


def _compare(topic: str, recorded: list[Envelope[Any]], replayed: list[Envelope[Any]]) -> Comparison:
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
    return Comparison(topic, len(recorded), len(replayed), matched, differences, mismatches)


def _note(one: Any, other: Any, differences: dict[str, float], mismatches: dict[str, int]) -> None:
    """Adds what differs between two payloads."""
    left, right = flatten(msgspec.to_builtins(one)), flatten(msgspec.to_builtins(other))
    for field in sorted(left.keys() | right.keys()):
        a, b = left.get(field), right.get(field)
        if isinstance(a, float) and isinstance(b, float):
            differences[field] = max(differences.get(field, 0.0), 0.0 if a == b or a != a != b else abs(a - b))
        elif a != b:
            mismatches[field] = mismatches.get(field, 0) + 1


def render_comparisons(comparisons: list[Comparison]) -> str:
    """The comparison as text."""
    lines = []
    for found in comparisons:
        verdict = "same" if found.is_same else "DIFFERS"
        lines.append(
            f"{found.topic}: {found.recorded} recorded, {found.replayed} replayed, {found.matched} matched: {verdict}"
        )
        lines += [f"  {field:<40} differs by up to {value:.3g}" for field, value in found.differences.items() if value]
        lines += [f"  {field:<40} differs in {count} of them" for field, count in found.mismatches.items()]
    return "\n".join(lines) or "no output was recorded, and the replay produced none"
