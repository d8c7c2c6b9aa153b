"""The chain of causes through a log: from what was seen back to its root, each with its source and sequence."""

import re
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from gloc3.errors import Refused
from gloc3.log.commands import words
from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.command_interface import QUERIES, CiRequest
from gloc3.messages.envelope import ComponentStatus, Event
from gloc3.messages.summaries import AUTOPILOT_SAYS, CiEvent
from gloc3.messages.vehicle import AutopilotState

TOPICS: Final = ("ci/event", "components/*/event", "components/*/status", "ci/request", "autopilot", "sim/fault")
WINDOW_S: Final = 90.0
"""A cause is not looked for longer before what it led to."""
LEAST: Final = 1.8
"""What two happenings must have in common, at least."""
_AT_ONCE_S: Final = 0.02
SAYS_WITHIN_S: Final = 1.0
"""An autopilot that changes its mode by itself says why within this time, s, before or after."""
FAILSAFE: Final = "failsafe"
_WORD: Final = re.compile(r"[a-z][a-z0-9_.]+")
_TROUBLE: Final = ("is faulty", "is absent", "working -> faulty", "quiet -> faulty")
_COMMON: Final = frozenset(
    [
        "the",
        "and",
        "for",
        "not",
        "was",
        "has",
        "its",
        "out",
        "with",
        "that",
        "this",
        "from",
        "then",
        "too",
        "hop",
        "mission",
        "policy",
        "running",
        "done",
        "failed",
        "aborted",
        "after",
        "message",
        "fault",
        "working",
        "standby",
        "idle",
        "injected",
        "initialize",
        "start",
        "land",
        "hold",
        "return",
        "cause",
        "component",
        "state",
        "mode",
    ]
)
"""Words that say too little of a cause."""
_MEANS: Final = {
    "link_loss": "link lost",
    "link_slow": "link lost",
    "cable_loss": "autopilot pose late contact connected",
    "cable_slow": "autopilot pose late",
    "battery": "low battery",
    "sensor": "pose position late lost valid",
    "device": "pose position late lost valid odometry",
    "restart": "restart onboard process",
    "pilot": "pilot control chosen somebody else",
    "operator": "operator emergency station",
    "disk_full": "kept space left device",
    "topic": "pose late setpoint",
}
"""In which words the kinds of injected faults are told by what they lead to."""


class Happening(NamedTuple):
    """Something that happened, as the log has it."""

    t_s: float
    subject: str
    """Who or what it is about."""
    text: str
    topic: str
    source: str
    """The component that published it."""
    sequence: int

    def __str__(self) -> str:
        return f"{self.t_s:8.2f} s  {self.subject}: {self.text}  ({self.topic} {self.sequence} of {self.source})"


def read_happenings(reader: LogReader) -> list[Happening]:
    """The happenings of a log in the order of recording; repeated states count once."""
    states: dict[str, str] = {}
    found: list[Happening] = []
    for entry in reader.entries(*TOPICS):
        found += _happenings(entry, states)
    return found


def _happenings(entry: LoggedMessage, states: dict[str, str]) -> Iterator[Happening]:
    envelope = entry.envelope
    topic = envelope.topic.partition("/")[2]

    def made(subject: str, text: str) -> Happening:
        return Happening(entry.now_s, subject, text, topic, envelope.source.component, envelope.sequence)

    payload: Any = envelope.payload
    match payload:
        case CiEvent():
            yield made(payload.source, payload.text)
        case Event():
            yield made(envelope.source.component, payload.text)
        case CiRequest() if not isinstance(payload.body, QUERIES):
            yield made(f"station {payload.sender}", f"{words(payload.body)} by an operator")
        case ComponentStatus():
            state = str(payload.state or "absent")
            if states.get(payload.name, state) != state:
                yield made(payload.name, f"is {state}" + (f": {payload.cause}" if payload.cause else ""))
            states[payload.name] = state
        case AutopilotState():
            if states.get("autopilot", payload.mode_name) != payload.mode_name:
                yield made("autopilot", f"mode {mode_words(payload.mode_name)}")
            states["autopilot"] = payload.mode_name
        case _ if topic == "sim/fault":
            fault, is_present = _fault(payload)
            if is_present:
                yield made("injected", f"fault {fault}")
        case _:
            pass


def _fault(payload: Any) -> tuple[str, bool]:
    """An injected fault, whether its type is known here or not."""
    if isinstance(payload, dict):
        return str(payload.get("fault", "")), bool(payload.get("is_present"))
    return str(payload.fault), bool(payload.is_present)


def find_happening(happenings: Sequence[Happening], what: str) -> Happening:
    """The happening at a time in seconds (the last one until then), or the first that holds a text.

    A component that comes up counts only where nothing else holds the text: *land* is a landing, not `landing` that starts.

    Raises:
        Refused: there is none.
    """
    try:
        at_s = float(what)
    except ValueError:
        found = [one for one in happenings if what.lower() in f"{one.subject}: {one.text}".lower()]
        if found:
            return next((one for one in found if not _is_ordinary(one)), found[0])
        raise Refused(f"nothing in the log says {what!r}; `gloc3 log info --events` lists its events") from None
    shown = [one for one in happenings if one.t_s <= at_s + _AT_ONCE_S and one.topic == "ci/event"]
    if not shown:
        raise Refused(f"nothing is told in the log until {at_s:g} s")
    return shown[-1]


def causes_of(happenings: Sequence[Happening], seen: Happening) -> list[Happening]:
    """The chain from what was seen back to its root: each is the cause of the one before it in the list."""
    chain = [seen]
    while True:
        cause = _cause(happenings, chain)
        if cause is None:
            return chain
        chain.append(cause)


def _cause(happenings: Sequence[Happening], chain: Sequence[Happening]) -> Happening | None:
    """The happening before a chain that has most in common with its last one, the later the better; None at a root."""
    seen = chain[-1]
    if seen.topic in ("sim/fault", "ci/request"):
        return None
    reason = _failsafe_of(happenings, seen) if seen.topic == "autopilot" else None
    if reason is not None and reason not in chain:
        return reason
    index = min(happenings.index(one) for one in chain)  # a failsafe may be named only after its mode
    wanted = _words(seen)
    best, best_score = None, LEAST
    for one in happenings[:index]:
        elapsed_s = seen.t_s - one.t_s
        if elapsed_s > WINDOW_S or _is_ordinary(one) or _gist(one) == _gist(seen) or _are_modes(one, seen):
            continue
        score = _score(seen, wanted, one) - 0.5 * elapsed_s / WINDOW_S
        if score >= best_score:
            best, best_score = one, score
    return best


def _failsafe_of(happenings: Sequence[Happening], mode: Happening) -> Happening | None:
    """The failsafe for which an autopilot has chosen a mode by itself, in its own words; None where it names none."""
    reported = [
        one
        for one in happenings
        if abs(one.t_s - mode.t_s) <= SAYS_WITHIN_S
        and one.text.startswith(AUTOPILOT_SAYS)
        and FAILSAFE in one.text.lower()
    ]
    return min(reported, key=lambda one: abs(one.t_s - mode.t_s), default=None)


def _is_ordinary(one: Happening) -> bool:
    """Whether it explains nothing: a component that comes up."""
    return one.topic.startswith("components/") and not one.text.startswith(_TROUBLE)


def _are_modes(*both: Happening) -> bool:
    """Whether they are modes of the autopilot: one is no cause of the next."""
    return all(one.topic == "autopilot" for one in both)


def _gist(one: Happening) -> tuple[str, str]:
    """What different messages of one happening, and its repetitions, have in common."""
    return one.subject, one.text.rpartition(": ")[2]


def _score(seen: Happening, wanted: frozenset[str], one: Happening) -> float:
    """How much of what was seen another happening explains."""
    score = float(len(wanted & _words(one)))
    parts = [part for part in re.split(r": |; ", seen.text) if " " in part]
    score += 2.0 * any(part in one.text or part.startswith(one.text) for part in parts)
    score += 1.5 * any(one.text.startswith(part) for part in parts)
    score += 1.0 * (one.topic == "sim/fault" and score > 0.0)
    score += 1.5 * (one.subject in wanted)
    return score


def _words(one: Happening) -> frozenset[str]:
    """The words that tell of what a happening is about."""
    text = f"{one.subject} {one.text}".lower()
    kind = re.match(r"injected fault ([a-z_]+)(?::([a-z_]+))?", text)
    if kind is not None:
        text = f"{_MEANS.get(kind[1], '')} {kind[2] or ''}"
    return frozenset(word for word in _WORD.findall(text) if len(word) > 2 and word not in _COMMON)


def render_causes(chain: Sequence[Happening]) -> str:
    """The chain for a terminal, what was seen first."""
    first, *rest = chain
    return "\n".join([str(first), *(f"because\n{one}" for one in rest)])
