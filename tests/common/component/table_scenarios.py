"""One scenario for each cell of the state table: a real host, in virtual time, with what a person expects of it.

The expectations are written by hand from the paper's Tables I and II and their reading in the design; they are not
derived from the table in the code.
"""

from typing import Final, NamedTuple

from gloc3.component.test_bench import Bench

from .specimen import Diary, Specimen, row

STATES: Final = ("idle", "standby", "working", "quiet", "faulty")
COMMANDS: Final = ("initialize", "start", "goquiet", "resume", "stop", "finish", "shutdown")

WAY_TO: Final = {
    "idle": [],
    "standby": ["initialize"],
    "working": ["initialize", "start"],
    "quiet": ["initialize", "start", "goquiet"],
    "faulty": ["initialize", "start"],  # and then work() raises
}

ACCEPTED: Final = {
    ("idle", "initialize"): ("standby", ["initialize"]),
    ("idle", "shutdown"): ("absent", []),
    ("standby", "initialize"): ("standby", ["initialize"]),
    ("standby", "start"): ("working", ["start"]),
    ("standby", "finish"): ("idle", ["finish"]),
    ("standby", "shutdown"): ("absent", ["finish"]),
    ("working", "goquiet"): ("quiet", ["goquiet"]),
    ("working", "stop"): ("standby", ["stop"]),
    ("working", "shutdown"): ("absent", ["stop", "finish"]),
    ("quiet", "resume"): ("working", ["resume"]),
    ("quiet", "stop"): ("standby", ["stop"]),
    ("quiet", "shutdown"): ("absent", ["stop", "finish"]),
    ("faulty", "initialize"): ("standby", ["finish", "initialize"]),
    ("faulty", "finish"): ("idle", ["finish"]),
    ("faulty", "shutdown"): ("absent", ["finish"]),
}
"""State and command to the state after it and the methods that were run. Every other cell is refused."""

CELLS: Final = tuple((state, command) for state in STATES for command in COMMANDS)


class Seen(NamedTuple):
    """What a cell did under the host."""

    is_accepted: bool
    state: str
    methods: list[str]
    reason: str
    works: bool
    """Whether cycles are run after it."""
    publishes: bool
    """Whether results are published after it."""


def expected(state: str, command: str) -> Seen:
    """What a person expects of a cell."""
    to, methods = ACCEPTED.get((state, command), (state, []))
    if (state, command) in ACCEPTED:
        reason = ""
    else:
        others = [other for other in COMMANDS if (state, other) in ACCEPTED]
        reason = f"{command} is not accepted in {state}; accepted: {', '.join(others)}"
    return Seen(not reason, to, methods, reason, to in ("working", "quiet"), to == "working")


def run(state: str, command: str) -> Seen:
    """Brings a component to a state, sends it a command, and looks."""
    diary = Diary()
    with Bench() as bench:
        bench.host(row(begin="idle"), lambda: Specimen(diary))
        for step in WAY_TO[state]:
            assert bench.command("specimen", step).is_accepted
        if state == "faulty":
            diary.errors["work"] = RuntimeError("broken on purpose")
            bench.run(0.2)
            diary.errors.clear()
        assert bench.state("specimen") == state
        diary.calls.clear()
        reply = bench.command("specimen", command)
        methods = diary.methods()
        after = bench.state("specimen") or "absent"
        assert (reply.state or "absent") == after
        diary.calls.clear()
        bench.envelopes.clear()
        bench.run(0.35)
        works, publishes = "work" in diary.calls, bool(bench.all("result"))
        return Seen(reply.is_accepted, str(after), methods, reply.reason, works, publishes)
