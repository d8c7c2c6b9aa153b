"""What a flight has reached: branches of the executor, states, modes, policies, events and their order, as a set of words.

It guides the search: a flight is worth more tries the more it has reached for the first time.
"""

import re
from typing import Any, Final

from gloc3.messages.envelope import ComponentStatus, Envelope, Event
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3.messages.vehicle import DriverState, Pose
from gloc3_sitl.proof.invariant import TrueMoment

TOPICS: Final = ("ci/event", "ci/mission", "driver", "pose", "components/*/status", "components/*/event")
_NUMBER: Final = re.compile(r"[-+]?\d+(\.\d+)?")
_LONGEST: Final = 80
_WORTH: Final = {"branch": 4.0, "mode": 2.0, "mission": 2.0, "driver": 2.0, "then": 0.25}
"""Tries that something new is worth by its kind, 1 for all others; of orders of two events there are very many."""


def worth(word: str) -> float:
    """How much a word that no flight before has reached is worth, in tries."""
    return _WORTH.get(word.partition(" ")[0], 1.0)


def plain(text: str) -> str:
    """A text without its numbers, so that the same event at another time is the same."""
    return _NUMBER.sub("#", text)[:_LONGEST]


class Reached:
    """Collects the words of one flight."""

    def __init__(self) -> None:
        self.words: Final[set[str]] = set()
        self._before: dict[str, str] = {}
        self._last_event = ""

    def receive(self, topic: str, envelope: Envelope[Any]) -> None:
        """Adds what a message shows for the first time."""
        payload = envelope.payload
        match payload:
            case CiEvent():
                event = f"{payload.source}: {plain(payload.text)}"
                self.words.add(f"event {event}")
                self.words.add(f"then {self._last_event} > {event}")
                self._last_event = event
            case Event():
                self.words.add(f"component {envelope.source.component}: {plain(payload.text)}")
            case ComponentStatus():
                self._change(f"state {payload.name}", str(payload.state or "absent"))
            case MissionSummary():
                self._change("mission", f"{payload.state} {payload.policy} {plain(payload.reason)}")
            case DriverState():
                manoeuvre = f"{payload.manoeuvre or ''} {payload.manoeuvre_state or ''}"
                why = plain(payload.pilot_reason or payload.refusal or payload.manoeuvre_reason)
                self._change("driver", f"{manoeuvre} {payload.is_streaming:d}{payload.has_pilot_control:d} {why}")
            case Pose():
                self._change("pose", f"{payload.is_valid} {plain(payload.reason)} {','.join(payload.sources)}")
            case _:
                pass

    def observe(self, moment: TrueMoment) -> None:
        """Adds what the autopilot does."""
        self._change("mode", f"{moment.mode_name} {moment.mode_author} {moment.is_armed:d}{moment.is_landed:d}")

    def _change(self, what: str, now: str) -> None:
        before = self._before.get(what)
        if before != now:
            self._before[what] = now
            self.words.add(f"{what} {now}")
            if before is not None and what in ("mode", "mission", "driver"):
                self.words.add(f"{what} {before} > {now}")
