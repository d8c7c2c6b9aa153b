"""A child process of a host, seen from the main process: start, supervision and stand-ins."""

import asyncio
import os
import re
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import StrEnum
from functools import partial
from typing import Any, Final

from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import (
    CommandReply,
    CommandRequest,
    ComponentStatus,
    Envelope,
    FunctionReply,
    FunctionRequest,
)
from gloc3.messages.readiness import SensorCondition
from gloc3_onboard.hosts.pipe import (
    Beat,
    ChildReady,
    ChildReport,
    ChildSetup,
    EndChild,
    FromChild,
    Pass,
    Pipe,
    ToChild,
    socket_pair,
)
from gloc3_onboard.hosts.stand_in import ComponentPlaceholder

LINE_MAX: Final = 160

FATAL: Final = re.compile(r"Fatal Python error: (?P<what>.+)")
"""First line of the fault handler's dump."""
_THREAD: Final = re.compile(r"(Current thread|Thread) 0x[0-9a-f]+.*most recent call first")
_FRAME: Final = re.compile(r'\s*File "(?P<file>[^"]+)", line (?P<line>\d+) in (?P<function>.+)')
PROGRAM: Final = (sys.executable, "-X", "faulthandler", "-m", "gloc3_onboard.hosts.child_main")
"""Command line of a child; its arguments are its end of the pipe and a description for process lists."""
POLL_PERIOD_S: Final = 0.5
STUCK_S: Final = 2.0
"""Time without a turn of the loop after which a child is ended, s."""
BEGIN_S: Final = 60.0
"""How long a child may take until its components are there."""
DUMP_S: Final = 1.0
"""Time for a stuck child to dump its stack, s."""
LEAVE_S: Final = 2.0
WORDS_MAX: Final = 80
"""Lines of a child's stderr that are kept."""

Lives = dict[str, str | None]


class ChildPhase(StrEnum):
    """Phases in the life of a child process."""

    AWAY = "away"
    BEGINNING = "beginning"
    UP = "up"
    LEFT = "left"


class ChildProcess:
    """One child process with its components.

    Args:
        name: name of the process.
        rows: its components.
        context: context of the host's main process.
        order: makes the setup of the process, from the states to restore.
        report: called with each line of its output.
    """

    def __init__(
        self,
        name: str,
        rows: Sequence[ComponentRow],
        context: HostContext,
        order: Callable[[Lives | None], ChildSetup],
        report: Callable[[str], None],
    ) -> None:
        self.name: Final = name
        self.rows: Final = tuple(rows)
        self.phase = ChildPhase.AWAY
        self.restarts = 0
        self.cause = ""
        """Why it ended last."""
        self.sensors: list[SensorCondition] = []
        self.log_problem = ""
        self._context, self._loop = context, context.loop
        self._order, self._report = order, report
        self._placeholders = {row.name: ComponentPlaceholder(row, context) for row in rows}
        self._waiting: list[Envelope[Any]] = []
        """Requests for when it is there."""
        self._unanswered: dict[tuple[str, str], CommandRequest | FunctionRequest] = {}
        """Requests that it has, by component and id."""
        self._words: deque[str] = deque(maxlen=WORDS_MAX)
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Pipe | None = None
        self._ends: list[int] = []
        """Files that the loop reads: the process's stderr, and its end."""
        self._remainder = b""
        self._is_dying = False
        self._silent = 0
        """Checks since its last heartbeat."""
        self._verdict = ""
        """Why it was ended, where that was us."""
        self._has_ended = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        self._subscriptions = list(self._listen())

    def _listen(self) -> Sequence[Unsubscribe]:
        exchange, platform = self._context.exchange, self._context.platform
        ends = []
        for row in self.rows:
            base = f"{platform}/components/{row.name}/"
            ends += [
                exchange.subscribe(base + "command", partial(self._receive_request, row.name)),
                exchange.subscribe(base + "function", partial(self._receive_request, row.name)),
                exchange.subscribe(base + "status", partial(self._receive_status, row.name)),
                exchange.subscribe(base + "reply", partial(self._receive_reply, row.name)),
                exchange.subscribe(base + "function_reply", partial(self._receive_reply, row.name)),
            ]
        return ends

    # --- what is known ---

    @property
    def pid(self) -> int:
        """Its process id; 0 while it is away."""
        return self._process.pid if self._process is not None else 0

    def component(self, name: str) -> ComponentPlaceholder:
        """What is known of one of its components."""
        return self._placeholders[name]

    # --- life ---

    def begin(self) -> None:
        """Begins the process; its components come to what their rows ask for."""
        self._spawn(None)

    async def end(self) -> None:
        """Ends it permanently, after its components have left."""
        if self._process is not None and self._pipe is not None:
            self.phase = ChildPhase.LEFT
            self._pipe.send(EndChild())
            with suppress(TimeoutError):
                async with asyncio.timeout(LEAVE_S):
                    await self._has_ended.wait()
        self.close()

    def close(self) -> None:
        """Ends it without ceremony."""
        self.phase = ChildPhase.LEFT
        for unsubscribe in self._subscriptions:
            unsubscribe()
        self._subscriptions = []
        for placeholder in self._placeholders.values():
            placeholder.step_back()
        if self._process is not None:
            self._process.kill()
            self._reap()

    def send_offset(self, offset_s: float) -> None:
        """Tells it how far the platform's time is from this computer's."""
        if self._pipe is not None:
            self._pipe.send(ChildReport(offset_s))

    def give_up_beginning(self) -> None:
        """Stops waiting for its start; requests to its components no longer restart it."""
        if self.phase is ChildPhase.BEGINNING and self._process is not None:
            self._verdict = "was still starting at shutdown"
            self._process.kill()

    def _spawn(self, lives: Lives | None) -> None:
        self.phase = ChildPhase.BEGINNING
        self._words.clear()
        self._remainder, self._silent, self._verdict, self._is_dying = b"", 0, "", False
        self._has_ended = asyncio.Event()
        ours, theirs = socket_pair()
        read_end, write_end = os.pipe2(os.O_CLOEXEC)
        os.set_blocking(read_end, False)
        try:
            self._process = subprocess.Popen(
                [*PROGRAM, str(theirs.fileno()), f"{self._context.platform}/{self.name}"],
                stdin=subprocess.DEVNULL,
                stdout=write_end,
                stderr=write_end,
                pass_fds=[theirs.fileno()],
            )
        finally:
            os.close(write_end)
            theirs.close()
        end = os.pidfd_open(self._process.pid)
        self._ends = [read_end, end]
        self._loop.add_reader(read_end, self._receive_text, read_end)
        self._loop.add_reader(end, self._ended, end, read_end)
        self._pipe = Pipe(ours, FromChild, self._loop, self._receive)  # type: ignore[arg-type] # a union is no class
        self._pipe.send(self._order(lives))
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._check_heartbeat)

    def _reap(self) -> int:
        """Releases the resources of the ended process; returns its exit code."""
        assert self._process is not None
        for file in self._ends:
            self._loop.remove_reader(file)
            os.close(file)
        self._ends = []
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        if self._timer is not None:
            self._timer.cancel()
        code = self._process.wait()
        self._process = None
        return code

    def _ended(self, end: int, read_end: int) -> None:
        self._receive_text(read_end)
        code = self._reap()
        self._has_ended.set()
        if self.phase is ChildPhase.LEFT:
            return
        lines = list(self._words)
        words = last_lines(lines)
        manner = self._verdict or f"ended {describe_exit(code)}"
        self.cause = f"process {self.name} {manner}" + (f": {words}" if words else "")
        self.phase = ChildPhase.AWAY
        self.sensors = []
        for number, placeholder in enumerate(self._placeholders.values()):
            placeholder.fail(self.cause, "\n".join(last_error(lines)), has_been_reported=number > 0)
        self._answer_all()

    def _answer_all(self) -> None:
        """Whoever waits for an answer of the process gets it."""
        waiting = [(self._name_of(envelope), envelope.payload) for envelope in self._waiting]
        waiting += [(component, request) for (component, _), request in self._unanswered.items()]
        self._waiting, self._unanswered = [], {}
        for component, request in waiting:
            if isinstance(request, CommandRequest):
                self._placeholders[component].reply(request, self.cause)
            else:
                self._placeholders[component].refuse(request, self.cause)

    def _check_heartbeat(self) -> None:
        """Counts missed heartbeats by checks, so that a delay of the main process itself is not blamed on the child."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._check_heartbeat)
        self._silent += 1
        limit_s = BEGIN_S if self.phase is ChildPhase.BEGINNING else STUCK_S
        views = round(limit_s / POLL_PERIOD_S)
        if self._process is None or self.phase is ChildPhase.LEFT or self._silent <= views:
            return
        self._verdict = f"did not run its loop for {limit_s:g} s and was ended"
        is_last = self._silent > views + round(DUMP_S / POLL_PERIOD_S)
        self._process.send_signal(signal.SIGKILL if is_last else signal.SIGABRT)

    # --- what it says ---

    def _receive(self, message: ToChild | FromChild | None) -> None:
        self._silent = 0
        match message:
            case ChildReady():
                self._come_up()
            case Beat(sensors=list() as sensors, log_problem=problem):
                self.sensors, self.log_problem = sensors, problem

    def _come_up(self) -> None:
        self.phase = ChildPhase.UP
        for placeholder in self._placeholders.values():
            placeholder.step_back()
        waiting, self._waiting = self._waiting, []
        for envelope in waiting:
            self._pass_on(self._name_of(envelope), envelope)

    def _receive_text(self, read_end: int) -> None:
        while True:
            try:
                data = os.read(read_end, 1 << 16)
            except BlockingIOError:
                return
            if not data:  # it has closed its stderr; its end is told elsewhere
                self._loop.remove_reader(read_end)
                return
            *lines, self._remainder = (self._remainder + data).split(b"\n")
            for line in lines:
                text = line.decode(errors="replace").rstrip()
                self._words.append(text)
                self._is_dying = self._is_dying or FATAL.match(text) is not None
                if not self._is_dying:  # else it is told with the fault
                    self._report(f"{self.name}: {text}")

    def _receive_status(self, name: str, envelope: Envelope[ComponentStatus]) -> None:
        placeholder = self._placeholders[name]
        if self.phase is ChildPhase.UP or envelope.source.boot == placeholder.boot:
            placeholder.receive_state(envelope.payload.state)
        elif self.phase is ChildPhase.AWAY:
            placeholder.retry()

    def _receive_reply(self, name: str, envelope: Envelope[CommandReply | FunctionReply]) -> None:
        self._unanswered.pop((name, envelope.payload.request_id), None)

    # --- what it is asked ---

    def _receive_request(self, name: str, envelope: Envelope[Any]) -> None:
        request = envelope.payload
        if not isinstance(request, CommandRequest | FunctionRequest):
            return
        match self.phase:
            case ChildPhase.UP:
                self._pass_on(name, envelope)
            case ChildPhase.BEGINNING:
                self._waiting.append(envelope)
            case ChildPhase.AWAY if isinstance(request, FunctionRequest):
                self._placeholders[name].refuse(request, self.cause)
            case ChildPhase.AWAY if isinstance(request, CommandRequest) and self._placeholders[name].answer(request):
                self._waiting.append(envelope)
                self.restarts += 1
                known = self._placeholders.values()
                self._spawn({each.row.name: None if each.has_left else each.cause for each in known})

    def _pass_on(self, name: str, envelope: Envelope[Any]) -> None:
        self._unanswered[name, envelope.payload.request_id] = envelope.payload
        assert self._pipe is not None
        self._pipe.send(Pass(self._context.topics.types.encode(envelope)))

    @staticmethod
    def _name_of(envelope: Envelope[Any]) -> str:
        return envelope.topic.split("/")[-2]

    @property
    def states(self) -> dict[str, State | None]:
        """Its components' states."""
        return {name: placeholder.state for name, placeholder in self._placeholders.items()}


def describe_exit(code: int) -> str:
    """End of a process, from its `subprocess` exit code: `by SIGSEGV`, `with code 1`, `by itself`."""
    if code < 0:
        try:
            return f"by {signal.Signals(-code).name}"
        except ValueError:
            return f"by signal {-code}"
    return f"with code {code}" if code else "by itself"


def last_lines(lines: Sequence[str]) -> str:
    """One-line summary of a process's last stderr output; empty without output.

    For a crash caught by the fault handler: the error and the innermost function of the failing thread.
    """
    reported = last_error(lines)
    fatal = FATAL.match(reported[0]) if reported else None
    if fatal is None:
        return _cut(reported[-1].strip()) if reported else ""
    frame = next(filter(None, map(_FRAME.match, reported)), None)
    where = f" in {frame['function']} ({frame['file'].rpartition('/')[2]}:{frame['line']})" if frame else ""
    return _cut(fatal["what"] + where)


def last_error(lines: Sequence[str]) -> list[str]:
    """The lines that explain the end of a process: of a dump only the error and the failing thread, else all."""
    text = [line for line in lines if line.strip()]
    begin = next((index for index, line in enumerate(text) if FATAL.match(line)), None)
    if begin is None:
        return text
    starts = [index for index in range(begin, len(text)) if _THREAD.match(text[index])]
    thread = next((index for index in starts if text[index].startswith("Current")), starts[0] if starts else len(text))
    frames = []
    for line in text[thread + 1 :]:
        if not _FRAME.match(line):
            break
        frames.append(line)
    return [text[begin], *frames]


def _cut(text: str) -> str:
    return text if len(text) <= LINE_MAX else text[: LINE_MAX - 1] + "…"
