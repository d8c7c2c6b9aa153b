"""Faults of messages in transit: loss, delay, wrong stamps or numbers, messages of another sender."""

from collections.abc import Sequence
from math import nan
from typing import Any, Final

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.messages.envelope import Envelope, Message
from gloc3_sitl.faults.fault_form import Ended, Parsed
from gloc3_sitl.faults.sabotage import Tap
from gloc3_sitl.flight.flight import Flight

STRANGER: Final = "stranger#1"
"""Who foreign setpoints say that they come from."""
TOPIC_WORDS: Final = ("lost", "late", "stale", "nan", "jump", "foreign")
_STALE_S: Final = 0.4
_LATE_S: Final = 0.5
_JUMP_M: Final = 2.0


def _message_type(flight: Flight, topic: str) -> type[Message]:
    row = flight.context.topics.row(f"{flight.name}/{topic}")
    if row is None:
        raise Refused(f"no topic {topic!r}; {nearest(topic, [name for name, _ in flight.context.topics])}")
    return row.message


def check_topic(flight: Flight, given: Parsed) -> None:
    """Checks that the topic exists and that the fault fits its messages.

    Raises:
        Refused: neither.
    """
    message = _message_type(flight, given.target)
    needed = {"foreign": "action_id", "jump": "position_ned_m"}.get(given.word)
    if needed is not None and needed not in message.__struct_fields__:
        raise Refused(f"{given.word!r} needs {needed}, which a {message.__name__} does not have")


def corrupt_topic(flight: Flight, given: Parsed, _: bool) -> Ended:
    """Taps a topic and corrupts its messages."""
    return flight.exchange.tap(f"{flight.name}/{given.target}", _tap(flight, given))


def _tap(flight: Flight, given: Parsed) -> Tap:
    """What becomes of each message."""

    def lost(_: Envelope[Any]) -> Sequence[Envelope[Any]]:
        return ()

    def late(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        flight.loop.call_later(_LATE_S if given.size is None else given.size, flight.exchange.deliver, envelope)
        return ()

    def stale(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        age_s = _STALE_S if given.size is None else given.size
        return (msgspec.structs.replace(envelope, t_s=envelope.t_s - age_s),)

    def not_finite(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        return (msgspec.structs.replace(envelope, payload=_without_numbers(envelope.payload)),)

    def jump(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        moved = _moved(envelope.payload, _JUMP_M if given.size is None else given.size)
        return (msgspec.structs.replace(envelope, payload=moved),)

    def foreign(envelope: Envelope[Any]) -> Sequence[Envelope[Any]]:
        other = msgspec.structs.replace(_moved(envelope.payload, _JUMP_M), action_id=STRANGER)
        return (envelope, msgspec.structs.replace(envelope, payload=other))

    taps = {"lost": lost, "late": late, "stale": stale, "nan": not_finite, "jump": jump, "foreign": foreign}
    return taps[given.word]


def _moved(payload: Any, metres: float) -> Any:
    """The same, with its position farther north."""
    position = getattr(payload, "position_ned_m", None)
    if position is None:
        return payload
    north, east, down = position
    return msgspec.structs.replace(payload, position_ned_m=(north + metres, east, down))


def _without_numbers(payload: Message) -> Message:
    """The same, with NaN for every number that it holds."""
    corrupted: dict[str, Any] = {}
    for name in payload.__struct_fields__:
        value = getattr(payload, name)
        if isinstance(value, float):
            corrupted[name] = nan
        elif isinstance(value, tuple) and value and all(isinstance(number, float) for number in value):
            corrupted[name] = (nan,) * len(value)
    return msgspec.structs.replace(payload, **corrupted)
