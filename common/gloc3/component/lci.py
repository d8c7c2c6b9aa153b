"""The local command interface: the five-state machine that every component has (paper §IV-A, Fig. 3, Table I).

The table below is the only definition of the states, the commands and the transitions. The host executes it, the
drawing in `docs/states.md` is generated from it, and the ground station offers what it allows. Re-initialize, stop from
quiet, and the two ways out of faulty are our reading of the paper's Tables I and II, because Fig. 3 was not available.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final, NamedTuple

from gloc3.errors import Refused


class State(StrEnum):
    """The states of a component (paper, Table I)."""

    IDLE = "idle"
    """Initial state of the component."""
    STANDBY = "standby"
    """Properly initialized or re-initialized."""
    WORKING = "working"
    """Operating and publishing results."""
    QUIET = "quiet"
    """Operating but not publishing results."""
    FAULTY = "faulty"
    """An error that prevents it from starting or operating has occurred."""


class Command(StrEnum):
    """The commands that move a component from state to state (paper, Table II)."""

    INITIALIZE = "initialize"
    START = "start"
    GOQUIET = "goquiet"
    RESUME = "resume"
    STOP = "stop"
    FINISH = "finish"
    SHUTDOWN = "shutdown"


CREATE: Final = "create"
"""Pseudo-command: the host creates an absent component from its row again."""


class Transition(NamedTuple):
    """What a command does: the methods that are run, in order, and the state that follows."""

    methods: tuple[str, ...]
    to: State | None
    """None: the component has left the system and is shown as *absent*."""


_S, _C = State, Command

TABLE: Final[Mapping[State, Mapping[Command, Transition]]] = {
    _S.IDLE: {
        _C.INITIALIZE: Transition(("initialize",), _S.STANDBY),
        _C.SHUTDOWN: Transition((), None),
    },
    _S.STANDBY: {
        _C.INITIALIZE: Transition(("initialize",), _S.STANDBY),
        _C.START: Transition(("start",), _S.WORKING),
        _C.FINISH: Transition(("finish",), _S.IDLE),
        _C.SHUTDOWN: Transition(("finish",), None),
    },
    _S.WORKING: {
        _C.GOQUIET: Transition(("goquiet",), _S.QUIET),
        _C.STOP: Transition(("stop",), _S.STANDBY),
        _C.SHUTDOWN: Transition(("stop", "finish"), None),
    },
    _S.QUIET: {
        _C.RESUME: Transition(("resume",), _S.WORKING),
        _C.STOP: Transition(("stop",), _S.STANDBY),
        _C.SHUTDOWN: Transition(("stop", "finish"), None),
    },
    _S.FAULTY: {
        _C.INITIALIZE: Transition(("finish", "initialize"), _S.STANDBY),
        _C.FINISH: Transition(("finish",), _S.IDLE),
        _C.SHUTDOWN: Transition(("finish",), None),
    },
}

OPERATING: Final = (State.WORKING, State.QUIET)
"""The states in which `work()` is called every cycle, and in which function messages are taken."""


def allowed(state: State) -> tuple[Command, ...]:
    """The commands that have a row in `state`, in the order of the table."""
    return tuple(TABLE[state])


def transition(state: State, command: Command) -> Transition:
    """Looks up what `command` does in `state`.

    Raises:
        Refused: there is no such row; the reason names the state, the command and what would be accepted.
    """
    row = TABLE[state].get(command)
    if row is None:
        raise Refused(f"{command} is not accepted in {state}; accepted: {', '.join(allowed(state))}")
    return row


def to_mermaid() -> str:
    """The table as a Mermaid state diagram, as shown in `docs/states.md`."""
    lines = ["stateDiagram-v2", "    [*] --> idle"]
    for state, row in TABLE.items():
        for command, (methods, to) in row.items():
            run = "".join(f" {method}()" for method in methods)
            lines.append(
                f"    {state} --> {to or '[*]'}: {command} /{run}"
                if run
                else f"    {state} --> {to or '[*]'}: {command}"
            )
    lines += [f"    {state} --> faulty: error{' / stop()' if state in OPERATING else ''}" for state in State]
    return "\n".join(lines) + "\n"
