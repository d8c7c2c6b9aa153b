"""The states of actions, tasks and missions: one enum and one table of transitions for all three levels."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from gloc3.errors import Refused


class ActionState(StrEnum):
    """States of actions, tasks and missions."""

    WAITING = "waiting"
    """Not started: the items before it have not ended."""
    RUNNING = "running"
    PAUSED = "paused"
    """At rest, to be resumed."""
    DONE = "done"
    FAILED = "failed"
    """Ended without success; it can be tried again."""
    SKIPPED = "skipped"
    """Skipped on purpose; the items after it run."""
    ABORTED = "aborted"
    """Ended before it was done."""


class StateTrigger(StrEnum):
    """Triggers of transitions: commands of operators and policies, and ends of actions."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    SKIP = "skip"
    ABORT = "abort"
    RETRY = "retry"
    REPEAT = "repeat"
    """Its task is done once more."""
    FINISH = "finish"
    FAIL = "fail"


_S, _T = ActionState, StateTrigger

TABLE: Final[Mapping[ActionState, Mapping[StateTrigger, ActionState]]] = {
    _S.WAITING: {
        _T.START: _S.RUNNING,
        _T.SKIP: _S.SKIPPED,
        _T.ABORT: _S.ABORTED,
    },
    _S.RUNNING: {
        _T.PAUSE: _S.PAUSED,
        _T.FINISH: _S.DONE,
        _T.FAIL: _S.FAILED,
        _T.SKIP: _S.SKIPPED,
        _T.ABORT: _S.ABORTED,
    },
    _S.PAUSED: {
        _T.RESUME: _S.RUNNING,
        _T.FINISH: _S.DONE,
        _T.FAIL: _S.FAILED,
        _T.SKIP: _S.SKIPPED,
        _T.ABORT: _S.ABORTED,
    },
    _S.FAILED: {
        _T.RETRY: _S.WAITING,
        _T.SKIP: _S.SKIPPED,
        _T.ABORT: _S.ABORTED,
    },
    _S.DONE: {
        _T.REPEAT: _S.WAITING,
    },
    _S.SKIPPED: {
        _T.REPEAT: _S.WAITING,
    },
    _S.ABORTED: {},
}

OURS: Final = (_T.FINISH, _T.FAIL, _T.REPEAT)
"""Triggers that no operator sends."""

ENDED: Final = (_S.DONE, _S.FAILED, _S.SKIPPED, _S.ABORTED)
"""States in which nothing is running."""
ENDED_BY_FAILSAFE: Final = "ended by the autopilot's failsafe"
"""Reason for aborting a mission whose vehicle the autopilot's failsafe has landed."""
RESTART: Final = "restart"
"""Reason for what a restart of the onboard process has changed; on the ground, it has paused the mission."""


def allowed(state: ActionState) -> tuple[StateTrigger, ...]:
    """The triggers that have a row in `state`, in the order of the table."""
    return tuple(TABLE[state])


def transition(state: ActionState, trigger: StateTrigger) -> ActionState:
    """Looks up where `trigger` leads from `state`.

    Raises:
        Refused: there is no such row; the reason names the state, the trigger and what would be accepted.
    """
    to = TABLE[state].get(trigger)
    if to is None:
        accepted = ", ".join(one for one in allowed(state) if one is not StateTrigger.REPEAT) or "nothing"
        raise Refused(f"{trigger} is not accepted in {state}; accepted: {accepted}")
    return to


def to_mermaid() -> str:
    """The table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {_S.WAITING}"]
    lines += [f"    {state} --> {to}: {trigger}" for state, row in TABLE.items() for trigger, to in row.items()]
    lines += [f"    {state} --> [*]" for state in TABLE if all(trigger in OURS for trigger in TABLE[state])]
    return "\n".join(lines) + "\n"
