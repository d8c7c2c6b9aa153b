"""Commands of the operator, in a flight's text of faults: any of them may come at any moment."""

from collections.abc import Mapping
from typing import Final

from gloc3.errors import Refused, nearest
from gloc3.messages.command_interface import AnyBody, Emergency, EmergencyVerb, Steer, Verb
from gloc3_sitl.faults.effect import Effect, nothing
from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.flight.flight import Flight

_STEERS: Final[Mapping[str, Verb]] = {
    verb.value: verb for verb in (Verb.START, Verb.PAUSE, Verb.RESUME, Verb.SKIP, Verb.ABORT, Verb.RETRY, Verb.CLEAR)
}
_KEYS: Final[Mapping[str, EmergencyVerb]] = {"hold": EmergencyVerb.HOLD, "land": EmergencyVerb.LAND}


def _check(flight: Flight, given: Parsed) -> None:
    if given.target not in (*_STEERS, *_KEYS):
        raise Refused(f"unknown command {given.target!r}; {nearest(given.target, [*_STEERS, *_KEYS])}")
    targets = [*flight.mission.tasks, *flight.mission.actions()]
    if given.word and (given.target in _KEYS or given.word not in targets):
        raise Refused(f"the mission has no {given.word!r}; {nearest(given.word, targets)}")
    if not flight.plan.has_station:
        raise Refused("the flight has no station")


def _command(flight: Flight, given: Parsed, _: bool) -> Ended:
    key = _KEYS.get(given.target)
    body: AnyBody = Emergency(verb=key) if key is not None else Steer(verb=_STEERS[given.target], target=given.word)
    flight.operate(body)
    return nothing


OPERATOR: Final = Effect(
    FaultForm(
        text="operator:" + "|".join((*_STEERS, *_KEYS)) + "[=TASK[.ACTION]]",
        does="a command of the operator at the station; hold and land are the emergency key",
        has_target=True,
        takes_text=True,
        is_event=True,
    ),
    _command,
    _check,
)
"""The one kind."""
