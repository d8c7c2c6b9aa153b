"""What the kinds of faults do to a flight: one table, each row with its form in text and how it begins and ends."""

import math
from collections.abc import Callable, Mapping, Sequence
from math import inf, nan
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.link.memory import MemoryLink
from gloc3.messages import Envelope, Message
from gloc3_sitl.autopilot.modes import Behaviour, Style
from gloc3_sitl.flight import Flight
from gloc3_sitl.sabotage import Tap
from gloc3_sitl.sensors.sensor import FaultMode
from gloc3_sitl.wind import gusty

Ended = Callable[[], None]
"""Ends a fault's effect."""

SENSORS: Final = ("imu", "barometer", "magnetometer", "height", "fix", "battery")
AWAY_S: Final = 2.0
"""How long a restarted onboard process is away."""
STRANGER: Final = "stranger#1"
"""Who foreign setpoints say that they come from."""


class Parsed(NamedTuple):
    """What stands in a fault's text, apart from its times."""

    target: str
    word: str
    """The value, where it is a word."""
    number: float
    """The value, where it is a number."""
    size: float | None


class Form(msgspec.Struct, frozen=True, kw_only=True):
    """How a kind of fault is written."""

    text: str
    """For people."""
    does: str
    """In a line."""
    has_target: bool = False
    words: tuple[str, ...] = ()
    """What the value may be; empty where it is a number."""
    bounds: tuple[float, float] | None = None
    """Of the number; None where there is none."""
    default: float | None = None
    """Of the number; None where it must be given."""
    size_of: tuple[str, ...] = ()
    """The words that take a size; the number takes one where this holds an empty text."""
    is_event: bool = False
    """It happens once, unless a span is given and it `may_last`."""
    may_last: bool = False
    lasts_s: float = inf
    """How long it lasts if no end is given."""

    def read(self, target: str | None, value: str | None, size: str | None) -> Parsed:
        """Reads the parts of a text.

        Raises:
            Refused: what is wrong.
        """
        if self.has_target != (target is not None):
            raise Refused("it lacks a name after the colon" if self.has_target else f"{target!r} is not expected")
        word, number = "", 0.0
        if self.words:
            word = value or ""
            if word not in self.words:
                raise Refused(f"{word!r} is unknown; known: {', '.join(self.words)}")
        elif self.bounds is not None:
            number = self._number(value)
        elif value is not None:
            raise Refused(f"={value} is not expected")
        if size is not None and word not in self.size_of:
            raise Refused(f"/{size} is not expected")
        sized = None if size is None else _finite(size)
        if sized is not None and sized < 0.0 and word in ("late", "stale", "noisy"):
            raise Refused(f"/{size} is negative")
        return Parsed(target or "", word, number, sized)

    def _number(self, value: str | None) -> float:
        assert self.bounds is not None
        if value is None:
            if self.default is None:
                raise Refused("it lacks a number")
            return self.default
        number, (low, high) = _finite(value), self.bounds
        if not low <= number <= high:
            raise Refused(f"{number:g} is not from {low:g} to {high:g}")
        return number


def _finite(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not math.isfinite(number):
        raise Refused(f"{text!r} is no number")
    return number


def _fits(flight: Flight, given: Parsed) -> None:
    """For faults that fit every flight."""


class Effect(NamedTuple):
    """A row of the table."""

    form: Form
    begin: Callable[[Flight, Parsed, bool], Ended]
    """Begins it; the flag says that it is a single event."""
    check: Callable[[Flight, Parsed], None] = _fits
    """Raises `Refused` where it does not fit the flight."""


def _nothing() -> None:
    """What happened once needs no end."""


# --- links, air, battery, sensors ---


def _lose(link: MemoryLink, share: float) -> Ended:
    before = link.a.conditions
    link.set_conditions(msgspec.structs.replace(before, loss=share))
    return lambda: link.set_conditions(before)


def _lose_radio(flight: Flight, given: Parsed, _: bool) -> Ended:
    return _lose(flight.radio, given.number)


def _lose_cable(flight: Flight, given: Parsed, _: bool) -> Ended:
    return _lose(flight.cable, given.number)


def _blow(flight: Flight, given: Parsed, _: bool) -> Ended:
    before = flight.simulator.wind
    flight.simulator.wind = gusty(given.number, from_deg=270.0 if given.size is None else given.size)

    def calm_down() -> None:
        flight.simulator.wind = before

    return calm_down


def _drain(flight: Flight, given: Parsed, _: bool) -> Ended:
    flight.simulator.sensors.battery.remaining = given.number
    return _nothing


def _spoil_sensor(flight: Flight, given: Parsed, _: bool) -> Ended:
    sensors = flight.simulator.sensors
    sensors.fail(given.target, given.word, given.size)
    return lambda: sensors.repair(given.target)


def _check_sensor(_: Flight, given: Parsed) -> None:
    if given.target not in SENSORS:
        raise Refused(f"there is no sensor {given.target!r}; {nearest(given.target, SENSORS)}")


# --- components ---


def _check_component(flight: Flight, given: Parsed) -> None:
    names = [row.name for row in flight.platform.components]
    if given.target not in names:
        raise Refused(f"{flight.name} has no component {given.target!r}; {nearest(given.target, names)}")


def _hang(flight: Flight, given: Parsed, _: bool) -> Ended:
    return flight.sabotage.hang(given.target)


def _slow(flight: Flight, given: Parsed, _: bool) -> Ended:
    return flight.sabotage.slow(given.target, given.number)


def _crash(flight: Flight, given: Parsed, is_once: bool) -> Ended:
    return flight.sabotage.crash(given.target, is_once=is_once)


def _restart(flight: Flight, _: Parsed, __: bool) -> Ended:
    flight.kill_onboard()
    return flight.start_onboard


# --- the pilot ---

_BEHAVIOURS: Final[Mapping[str, tuple[Behaviour, ...]]] = {
    "manual": (Behaviour.STABILIZE,),
    "altitude": (Behaviour.ALTITUDE,),
    "position": (Behaviour.POSITION,),
    "hold": (Behaviour.HOLD, Behaviour.BRAKE),
    "guided": (Behaviour.STREAMED,),
    "mission": (Behaviour.MISSION,),
    "return": (Behaviour.RETURN,),
    "land": (Behaviour.LAND,),
}
_SWITCHES: Final = ("arm", "disarm", "kill", "on", "off")


def _modes(style: Style) -> dict[str, str]:
    """What a mode may be called, in lower case, to its name in the simulated autopilot: by sense, and in its words."""
    names = {mode.name.lower(): mode.name for mode in style.modes}
    for word, behaviours in _BEHAVIOURS.items():
        fitting = [mode.name for mode in style.modes if mode.behaviour in behaviours]
        names |= {word: fitting[0]} if fitting else {}
    return names


def _check_pilot(flight: Flight, given: Parsed) -> None:
    known = [*_modes(flight.simulator.autopilot.style), *_SWITCHES]
    if given.target.lower() not in known:
        raise Refused(f"a pilot cannot {given.target!r} here; {nearest(given.target.lower(), known)}")


def _pilot(flight: Flight, given: Parsed, _: bool) -> Ended:
    pilot, word = flight.simulator.pilot, given.target.lower()
    match word:
        case "arm":
            pilot.arm()
        case "disarm":
            pilot.disarm()
        case "kill":
            pilot.kill()
        case "on":
            pilot.switch_on()
        case "off":
            pilot.switch_off()
        case _:
            pilot.switch_mode(_modes(flight.simulator.autopilot.style)[word])
    return _nothing


# --- messages on their way ---

_STALE_S: Final = 0.4
_LATE_S: Final = 0.5
_JUMP_M: Final = 2.0


def _message_type(flight: Flight, topic: str) -> type[Message]:
    row = flight.topics.row(f"{flight.name}/{topic}")
    if row is None:
        raise Refused(f"there is no topic {topic!r}; {nearest(topic, [name for name, _ in flight.topics])}")
    return row.message


def _check_topic(flight: Flight, given: Parsed) -> None:
    message = _message_type(flight, given.target)
    needed = {"foreign": "action_id", "jump": "position_ned_m"}.get(given.word)
    if needed is not None and needed not in message.__struct_fields__:
        raise Refused(f"{given.word!r} needs {needed}, which a {message.__name__} does not have")


def _spoil_topic(flight: Flight, given: Parsed, _: bool) -> Ended:
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
    spoilt: dict[str, Any] = {}
    for name in payload.__struct_fields__:
        value = getattr(payload, name)
        if isinstance(value, float):
            spoilt[name] = nan
        elif isinstance(value, tuple) and value and all(isinstance(number, float) for number in value):
            spoilt[name] = (nan,) * len(value)
    return msgspec.structs.replace(payload, **spoilt)


_SHARE: Final = (0.0, 1.0)

EFFECTS: Final[Mapping[str, Effect]] = {
    "link_loss": Effect(
        Form(text="link_loss[=SHARE]", does="the station's radio loses that share, or all", bounds=_SHARE, default=1.0),
        _lose_radio,
    ),
    "cable_loss": Effect(
        Form(text="cable_loss[=SHARE]", does="the autopilot's cable does", bounds=_SHARE, default=1.0), _lose_cable
    ),
    "wind": Effect(
        Form(
            text="wind=SPEED[/FROM]",
            does="gusty wind, in m/s, from a bearing (270)",
            bounds=(0.0, 30.0),
            size_of=("",),
        ),
        _blow,
    ),
    "battery": Effect(
        Form(text="battery=SHARE", does="so much charge is left, 0 to 1", bounds=_SHARE, is_event=True), _drain
    ),
    "sensor": Effect(
        Form(
            text=f"sensor:NAME={'|'.join(FaultMode)}[/SIZE]",
            does=f"one of the autopilot's sensors: {', '.join(SENSORS)}",
            has_target=True,
            words=tuple(FaultMode),
            size_of=(FaultMode.BIASED, FaultMode.NOISY, FaultMode.LATE),
        ),
        _spoil_sensor,
        _check_sensor,
    ),
    "hang": Effect(Form(text="hang:COMPONENT", does="its cycles do not end", has_target=True), _hang, _check_component),
    "slow": Effect(
        Form(
            text="slow:COMPONENT=SECONDS",
            does="each of its cycles takes so much longer",
            has_target=True,
            bounds=(0.0, 3600.0),
        ),
        _slow,
        _check_component,
    ),
    "crash": Effect(
        Form(
            text="crash:COMPONENT",
            does="its next cycle raises an error; with END every one does",
            has_target=True,
            is_event=True,
            may_last=True,
        ),
        _crash,
        _check_component,
    ),
    "restart": Effect(
        Form(
            text="restart",
            does=f"the onboard process dies; it comes back at END, or after {AWAY_S:g} s",
            lasts_s=AWAY_S,
        ),
        _restart,
    ),
    "pilot": Effect(
        Form(
            text="pilot:MODE|" + "|".join(_SWITCHES),
            does=f"the pilot's switches; modes: {', '.join(_BEHAVIOURS)}, or in the autopilot's words",
            has_target=True,
            is_event=True,
        ),
        _pilot,
        _check_pilot,
    ),
    "topic": Effect(
        Form(
            text="topic:TOPIC=lost|late|stale|nan|jump|foreign[/SIZE]",
            does="what becomes of its messages; sizes in s (late, stale) and m (jump); foreign adds a stranger's",
            has_target=True,
            words=("lost", "late", "stale", "nan", "jump", "foreign"),
            size_of=("late", "stale", "jump"),
        ),
        _spoil_topic,
        _check_topic,
    ),
}
"""Every kind of fault."""
