"""Timed faults of a simulated flight: read from text such as `link_loss@30..60`, started and ended at their times.

    KIND[:TARGET][=VALUE[/SIZE]][@BEGIN[..[END]]]

Times are seconds of the flight's clock, as in its log and narration. Without `@` a fault starts immediately. Without
END, an event happens once, and other faults are permanent; so is `BEGIN..`.
"""

import re
from math import inf
from typing import Final

import msgspec

from gloc3.errors import Refused, nearest
from gloc3_sitl.faults.fault_effects import EFFECTS
from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.messages import SimFault

SHORT: Final = {
    "foreign_setpoints": "topic:setpoint=foreign",
    "stale_setpoints": "topic:setpoint=stale/0.4",
    "nan_setpoints": "topic:setpoint=nan",
    "far_setpoints": "topic:setpoint=jump/50",
    "no_setpoints": "topic:setpoint=lost",
    "pose_jump": "topic:autopilot_pose=jump/2",
}
"""Words for faults that are often wanted."""

_SPAN: Final = "[@BEGIN[..[END]]]"
_TEXT: Final = re.compile(
    r"(?P<kind>[a-z_]+)(?::(?P<target>[^=@]+))?(?:=(?P<value>[^@/]*)(?:/(?P<size>[^@]*))?)?(?:@(?P<span>.*))?"
)


class TimedFault(msgspec.Struct, frozen=True, kw_only=True):
    """A fault with its times of begin and end."""

    text: str
    """Text of the request."""
    kind: str
    given: Parsed
    begin_s: float | None = None
    """On the flight's clock; None for at once."""
    lasts_s: float | None = None
    """Duration, s; infinite for permanent faults, None for an event that happens once."""


def read_fault(text: str) -> TimedFault:
    """Reads a fault.

    Raises:
        Refused: the text is not a fault; the message names the expected form.
    """
    word, at, span = text.strip().partition("@")
    match = _TEXT.fullmatch(SHORT.get(word, word) + at + span)
    if match is None:
        raise Refused(f"fault {text!r} cannot be read; its form is KIND[:TARGET][=VALUE[/SIZE]]{_SPAN}")
    kind = match["kind"]
    if kind not in EFFECTS:
        raise Refused(f"fault {text!r}: unknown kind {kind!r}; {nearest(kind, [*EFFECTS, *SHORT])}")
    form = EFFECTS[kind].form
    try:
        given = form.read(match["target"], match["value"], match["size"])
        begin_s, lasts_s = _read_span(match["span"], form)
    except Refused as problem:
        span = "[@TIME]" if form.is_event and not form.may_last else _SPAN
        raise Refused(f"fault {text!r}: {problem}; its form is {form.text}{span}") from None
    return TimedFault(text=text.strip(), kind=kind, given=given, begin_s=begin_s, lasts_s=lasts_s)


def _read_span(text: str | None, form: FaultForm) -> tuple[float | None, float | None]:
    """Start and duration of a fault."""
    lasts_s = None if form.is_event else form.lasts_s
    if text is None:
        return None, lasts_s
    first, dots, last = text.partition("..")
    begin_s = _seconds(first)
    if not dots:
        return begin_s, lasts_s
    if form.is_event and not form.may_last:
        raise Refused("it happens at one time and has no end")
    end_s = _seconds(last) if last else inf
    if end_s <= begin_s:
        raise Refused(f"its end at {end_s:g} s is not after its begin at {begin_s:g} s")
    return begin_s, end_s - begin_s


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        raise Refused(f"{text!r} is not a time in seconds") from None
    if not 0.0 <= seconds < inf:
        raise Refused(f"{text!r} is not a time in seconds")
    return seconds


class Injection:
    """One fault of one flight: starts and ends at its times, or earlier by `end`."""

    def __init__(self, flight: Flight, fault: TimedFault) -> None:
        """Checks the fault against the flight and schedules it.

        Raises:
            Refused: the fault does not fit this flight, or its time has passed.
        """
        self.fault: Final = fault
        self._flight = flight
        self._ended: Ended | None = None
        self._is_over = False
        effect = EFFECTS[fault.kind]
        try:
            effect.check(flight, fault.given)
        except Refused as problem:
            raise Refused(f"fault {fault.text!r}: {problem}") from None
        loop, now_s = flight.loop, flight.loop.time()
        begin_s = now_s if fault.begin_s is None else fault.begin_s
        if begin_s < now_s:
            raise Refused(f"fault {fault.text!r}: its begin has passed, it is {now_s:.1f} s already")
        if begin_s > now_s:
            loop.call_at(begin_s, self._begin)
        else:
            self._begin()
        if fault.lasts_s is not None and fault.lasts_s < inf:
            loop.call_at(begin_s + fault.lasts_s, self.end)

    def _begin(self) -> None:
        if self._is_over:
            return
        self._record(is_present=True)
        effect = EFFECTS[self.fault.kind]
        self._ended = effect.begin(self._flight, self.fault.given, self.fault.lasts_s is None)

    def end(self) -> None:
        """Ends the fault, also before its start."""
        if not self._is_over and self._ended is not None:
            self._ended()
            self._record(is_present=False)
        self._is_over = True

    def _record(self, *, is_present: bool) -> None:
        self._flight.truth.publish_fault(SimFault(fault=self.fault.text, is_present=is_present))


def schedule_faults(flight: Flight, texts: tuple[str, ...]) -> list[Injection]:
    """Reads faults and schedules them.

    Raises:
        Refused: one cannot be read, or does not fit the flight; none is scheduled then.
    """
    faults = [read_fault(text) for text in texts]
    return [Injection(flight, fault) for fault in faults]


def _help() -> str:
    forms = [(effect.form.text, effect.form.does) for effect in EFFECTS.values()]
    forms += [(short, f"the same as {meaning}") for short, meaning in SHORT.items()]
    width = max(len(form) for form, _ in forms)
    lines = [f"  {form:<{width}}  {does}" for form, does in forms]
    return "\n".join(["KIND[:TARGET][=VALUE[/SIZE]][@BEGIN[..[END]]], times in seconds of the flight's clock:", *lines])


FAULTS_HELP: Final = _help()
"""Every kind of fault, a line each, for people."""
