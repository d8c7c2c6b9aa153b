"""Rows, statuses and replies for tests of the supervision."""

from collections.abc import Iterable
from typing import Any

import msgspec

from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.supervision import LciRequest, Step, Supervision
from gloc3.messages.envelope import CommandReply, ComponentStatus, Kind


def row(name: str, **entries: Any) -> ComponentRow:
    """A row at 10 Hz."""
    return msgspec.convert({"name": name, "class": "tests:Specimen", "rate_hz": 10.0, **entries}, ComponentRow)


PAIR = (
    row("main", required=True, on_fault={"standby": "spare", "reinitialize": {"times": 2}, "then": "land"}),
    row("spare", begin="quiet", standby_for="main", on_fault={"reinitialize": {"times": 2}}),
)
ALONE = (row("alone", required=True, on_fault={"reinitialize": {"times": 3, "back_off_s": 0.5}, "then": "hold"}),)


def status(name: str, state: State | None, cause: str = "") -> ComponentStatus:
    """A component's health."""
    return ComponentStatus(name=name, kind=Kind.PROCESSOR, state=state, cause=cause)


def reported(supervision: Supervision, now_s: float = 0.0, **states: State | None) -> list[Step]:
    """Tells the states of some components."""
    steps: list[Step] = []
    for name, state in states.items():
        steps += supervision.receive_status(status(name, state, "ValueError: odd"), now_s)
    return steps


def pair(now_s: float = 0.0) -> Supervision:
    """A primary that works and a standby that is quiet."""
    supervision = Supervision(PAIR)
    assert reported(supervision, now_s, main=State.WORKING, spare=State.QUIET) == []
    return supervision


def words(steps: Iterable[Step]) -> list[str]:
    """Orders and verdicts in short."""
    return [
        f"{step.component}: {' '.join((step.request.command, *step.request.then))}"
        if isinstance(step, LciRequest)
        else f"{step.component}: {step.policy}!"
        for step in steps
    ]


def reply_to(step: Step, state: State | None, reason: str = "") -> CommandReply:
    """What a host answers to an order."""
    assert isinstance(step, LciRequest)
    return CommandReply(
        request_id=step.request.request_id,
        component=step.component,
        command=step.request.command,
        is_accepted=not reason,
        state=state,
        reason=reason,
    )
