"""Invariants of what is recorded: numbers that are numbers, no unhandled error, a whole log."""

import re
from collections.abc import Iterator
from math import isfinite
from typing import Any, Final

from gloc3.messages.envelope import Envelope, Event
from gloc3.messages.vehicle import Pose
from gloc3_sitl.proof.invariant import FlightFacts, FlownMission, Invariant

_OWN_ERROR: Final = re.compile(r"-> faulty: [A-Z]\w*(Error|Exception|Exit|Iteration|Lookup|Misuse)\b")
"""A component's cause that is an error of Python's, or a broken rule; injected crashes and devices' errors are told in words."""


FROM_STATIONS: Final = ("ci/request", "velocity_demand")


class OnlyNumbers(Invariant):
    """What moves the vehicle and what is shown of it."""

    name = "only_numbers"
    sentence = "Valid poses, setpoints and what is shown of the vehicle hold no NaN and nothing infinite."
    topics = ("pose", "setpoint", "ci/vehicle", "ci/motion")

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Judges one message."""
        payload = envelope.payload
        if isinstance(payload, Pose) and not payload.is_valid:
            return
        if not all(map(isfinite, _floats(payload))) and not self.facts.has_corrupted(topic):
            self.break_at(now_s, f"{topic} of {envelope.source.component} holds a value that is no finite number")


def _floats(payload: Any) -> Iterator[float]:
    for name in payload.__struct_fields__:
        value = getattr(payload, name)
        if isinstance(value, float):
            yield value
        elif isinstance(value, tuple):
            yield from (one for one in value if isinstance(one, float))


class NoTraceback(Invariant):
    """Errors that no fault has injected."""

    name = "no_traceback"
    sentence = "No component fails by an error of its own, and no error is left unhandled."
    topics = ("components/*/event",)

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Judges one event."""
        event: Event = envelope.payload
        if _OWN_ERROR.search(event.text):
            self.break_at(now_s, f"{envelope.source.component}: {event.text}")

    def end(self, flown: FlownMission) -> None:
        """Judges what nobody handled."""
        if flown.failures:
            self.break_at(flown.t_s, f"not handled: {flown.failures[0]}")


class LogComplete(Invariant):
    """The sequence numbers of all that is published, and the log that was written."""

    name = "log_complete"
    sentence = (
        "What components publish is counted without a gap, and a log that is written holds all of it; what stations send may "
        "be lost on its way."
    )
    topics = ("**",)

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._next: dict[tuple[str, str, int], int] = {}
        self._corrupted = {fault.given.target for fault in facts.faults if fault.kind == "topic"}

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Compares a number with the one before."""
        if topic in FROM_STATIONS:
            return
        key = (topic, envelope.source.component, envelope.source.boot)
        expected = self._next.get(key)
        self._next[key] = envelope.sequence + 1
        if expected is not None and envelope.sequence != expected and topic not in self._corrupted:
            self.break_at(
                now_s, f"{topic} of {envelope.source.component}: number {envelope.sequence} follows {expected - 1}"
            )

    def end(self, flown: FlownMission) -> None:
        """Judges the log."""
        if flown.log_problem:
            self.break_at(flown.t_s, flown.log_problem)
