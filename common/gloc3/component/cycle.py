"""Cycles of a component: periodic or triggered by an input, one at a time, with hang detection; and its mailbox."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isfinite
from typing import Any, Final, NamedTuple

from gloc3.component.component import Component
from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.jobs import CycleJob
from gloc3.component.ports import Inbox, Input, Keep
from gloc3.component.workers import Worker
from gloc3.errors import Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import Envelope

HUNG_PERIODS: Final = 5.0
HUNG_FLOOR_S: Final = 0.2
HUNG_POLLS: Final = 5
"""Pieces into which the wait for the end of a cycle is split, in wall time."""
HUNG_SPARE_PIECES: Final = 15
"""Pieces that are repeated, at most, because the whole process made no progress in them, or lacked a processor."""
STARVED_SHARE: Final = 0.5
"""Share of a piece for which a thread of the process waited for a processor that counts as lacking one."""
SILENT_PERIODS: Final = 1.5
"""Periods without a triggered cycle after which the periodic cycles resume."""
REST_PERIODS: Final = 0.5
"""A device's request so soon after a cycle waits until then, so that no more than twice the rate is reached."""

_EARLY: Final = 1e-6
"""Share of a period by which a timer may come early, or be rounded."""


class Mailbox:
    """The bounded input queues of one component."""

    def __init__(self, inputs: Sequence[Input[Any]]) -> None:
        self._inputs = {port.name: port for port in inputs}
        self._queues: dict[str, deque[Envelope[Any]]] = {port.name: deque() for port in inputs}
        self._latest: dict[str, Envelope[Any]] = {}
        self._drained: dict[str, Envelope[Any]] = {}
        """What the last inbox holds: never changed, because a worker may be reading it."""
        self._filled: list[str] = []
        """Ports whose queues are not empty."""
        self._nothing: Inbox | None = None
        """What cycles without news read."""
        self.dropped = 0

    def put(self, port: str, envelope: Envelope[Any]) -> None:
        """Queues a message by the port's policy; drops one that is not sound, or whose time of validity is not finite."""
        if not isfinite(envelope.t_s) or not envelope.payload.is_sound():
            self.dropped += 1
            return
        queue = self._queues[port]
        declared = self._inputs[port]
        if len(queue) >= declared.depth:
            if declared.keep is Keep.ALL:
                self.dropped += 1
                return
            queue.popleft()
        elif not queue:
            self._filled.append(port)
        queue.append(envelope)
        self._latest[port] = envelope

    def drain(self) -> Inbox:
        """What the next cycle reads; the queues are empty afterwards."""
        if not self._filled:
            if self._nothing is None:
                self._nothing = Inbox({}, self._drained)
            return self._nothing
        new: dict[str, Sequence[Envelope[Any]]] = {}
        for name in self._filled:
            queue = self._queues[name]
            new[name] = tuple(queue)
            queue.clear()
        self._filled.clear()
        self._drained, self._nothing = self._latest.copy(), None
        return Inbox(new, self._drained)

    def clear(self) -> None:
        """Clears all queues, as at a start: a component never works on messages from before its start."""
        for queue in self._queues.values():
            queue.clear()
        self._latest, self._drained, self._nothing = {}, {}, None
        self._filled.clear()


class CycleCalls(NamedTuple):
    """Callbacks from the cycles to their owner."""

    may_begin: Callable[[], bool]
    """Asked before every cycle."""
    ended: Callable[[CycleJob], None]
    """Gets every cycle that has ended."""
    hung: Callable[[float], None]
    """Called when a cycle has not ended after this many seconds."""
    unfit: Callable[[str, Envelope[Any]], None]
    """Told of messages that are of another type than their port."""


class Cycler:
    """Begins cycles when they are due and hands each ended one to the host."""

    def __init__(
        self,
        row: ComponentRow,
        component: type[Component[Any]],
        context: HostContext,
        mailbox: Mailbox,
        worker: Worker,
        calls: CycleCalls,
    ) -> None:
        """Creates the cycles of one hosted component.

        Args:
            row: its row of the deployment.
            component: its class.
            context: shared by the hosts of the process.
            mailbox: its input queues.
            worker: runs its cycles.
            calls: callbacks to the owner.
        """
        self.rate_hz = row.rate_hz
        self.is_quiet = False
        self.items: tuple[str, ...] = ()
        """What the data logger records."""
        self.statistics = CycleStatistics()
        self._row = row
        self._class = component
        self._context = context
        self._loop = context.loop
        self._mailbox = mailbox
        self._worker = worker
        self._may_begin, self._ended, self._hung, self._unfit = calls
        self._trigger_hz = self._trigger_rate_hz()
        self._limit_s = self._hung_limit_s()
        self._is_modelled = context.clock.is_virtual and (row.latency_s > 0.0 or context.cycle_cost_s is not None)
        self._timer: asyncio.TimerHandle | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._start_s = 0.0
        self._tick = 0
        self._began_s = float("-inf")
        self._job: CycleJob | None = None
        """None while there are no cycles."""
        self._is_running = False
        self._is_triggered = self._is_requested = False
        self._was_prompted = False
        """Whether the last cycle was triggered by an input or a device."""
        self._is_owed = False
        """Whether a device's request waits for the next tick."""

    # --- inputs and devices ---

    def subscribe(self) -> list[Unsubscribe]:
        """Binds the component's inputs to their topics."""
        exchange, platform = self._context.exchange, self._context.platform
        return [
            exchange.subscribe(f"{platform}/{topic}", self._receiver(name))
            for name in self._class.inputs
            for topic in self._row.topics(name)
        ]

    def _receiver(self, port: str) -> Callable[[Envelope[Any]], None]:
        put, expected = self._mailbox.put, self._class.inputs[port].message
        is_trigger = port in self._row.triggers

        def handle(envelope: Envelope[Any]) -> None:
            if self._job is None:
                return
            if not isinstance(envelope.payload, expected):
                self._unfit(port, envelope)
                return
            put(port, envelope)
            if is_trigger and not self._is_triggered:
                self._is_triggered = True
                self._loop.call_soon(self._triggered)

        return handle

    def request(self) -> None:
        """Begins a cycle soon, because a device has something new; from any thread."""
        if self._job is not None and not self._is_requested:
            self._is_requested = True
            with suppress(RuntimeError):  # the loop has been closed: nobody waits any more
                self._loop.call_soon_threadsafe(self._requested)

    def _requested(self) -> None:
        self._is_requested = False
        now_s, rate_hz = self._loop.time(), self.rate_hz
        if rate_hz is None or (now_s - self._began_s) * rate_hz > REST_PERIODS - _EARLY:
            self._prompted(now_s)
        elif self._job is not None and not self._is_owed:
            self._is_owed = True
            self._restart_timer(self._began_s + REST_PERIODS / rate_hz)

    # --- start, stop, rate ---

    def start(self, job: CycleJob) -> None:
        """Begins the cycles, the first one at once, but in real time."""
        now_s = self._loop.time()
        self._job = job
        self._was_prompted = self._is_owed = False
        self.statistics.restart(now_s)
        self._restart_timer(now_s + self._context.phase(self._row.name) / (self.rate_hz or 1.0))

    def stop(self) -> None:
        """Ends the cycles; one that is under way is abandoned."""
        self._job = None
        self._is_running = False
        for timer in (self._timer, self._deadline):
            if timer is not None:
                timer.cancel()
        self._timer = self._deadline = None

    def set_rate(self, rate_hz: float) -> None:
        """Changes the period; the next cycle comes one new period after the last one's begin.

        Raises:
            Refused: the component has no periodic cycles.
        """
        if self.rate_hz is None:
            raise Refused("it has no rate: its cycles are begun by an input")
        self.rate_hz = rate_hz
        self._limit_s = self._hung_limit_s()
        if self._job is not None:
            self._restart_timer(max(self._loop.time(), self._began_s + 1.0 / rate_hz))

    @property
    def nominal_rate_hz(self) -> float:
        """Cycle rate while the inputs arrive as expected; 0 where it is unknown.

        The periodic cycles of a triggered component only fill gaps: its rate is that of the trigger's topic.
        """
        return max(self.rate_hz or 0.0, self._trigger_hz)

    def _trigger_rate_hz(self) -> float:
        """Nominal rate of the triggers: the fastest of their topics; 0 without one."""
        rows = [
            self._context.topics.row(f"{self._context.platform}/{topic}")
            for trigger in self._row.triggers
            for topic in self._row.topics(trigger)
        ]
        return max((row.rate_hz for row in rows if row is not None), default=0.0)

    def _hung_limit_s(self) -> float:
        rate_hz = self.rate_hz or self._trigger_hz
        return max(HUNG_PERIODS / rate_hz if rate_hz else 0.0, HUNG_FLOOR_S)

    # --- the cycle ---

    def _restart_timer(self, first_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.rate_hz is not None:
            self._start_s, self._tick = first_s, 0
            self._timer = self._loop.call_at(first_s, self._ticked)

    def _ticked(self) -> None:
        rate_hz = self.rate_hz
        assert rate_hz is not None
        self._timer = None
        now_s, tick = self._loop.time(), self._tick
        is_owed, self._is_owed = self._is_owed, False
        if self._was_prompted and not is_owed and (now_s - self._began_s) * rate_hz < SILENT_PERIODS - _EARLY:
            self._restart_timer(self._began_s + SILENT_PERIODS / rate_hz)
            return
        missed = int((now_s - self._start_s) * rate_hz + _EARLY) - tick
        if missed > 0:  # the loop itself was late: those cycles are lost, not made up
            tick += missed
            self.statistics.overruns += missed
        self._tick = tick + 1
        self._timer = self._loop.call_at(self._start_s + self._tick / rate_hz, self._ticked)
        self._was_prompted = is_owed
        self._begin(now_s)

    def _triggered(self) -> None:
        self._is_triggered = False
        self._prompted(self._loop.time())

    def _prompted(self, now_s: float) -> None:
        if self._job is not None:
            self._was_prompted = True
            self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        if self._is_running:
            self.statistics.overruns += 1
            return
        if not self._may_begin():
            return
        job = self._job
        assert job is not None
        self._is_running = True
        self._began_s = job.now_s = now_s
        job.inbox = self._mailbox.drain()
        job.is_quiet = self.is_quiet
        job.items = self.items
        self._worker.run(job.run, self._done, self._model_cost_s(job, now_s) if self._is_modelled else 0.0)
        if self._is_running:
            self._await_end(1 if self._context.clock.is_virtual else HUNG_POLLS)

    def _model_cost_s(self, job: CycleJob, now_s: float) -> float:
        """What the cycle costs in virtual time; one that hangs never ends."""
        cost_s = self._row.latency_s
        if self._context.cycle_cost_s is not None:
            cost_s += self._context.cycle_cost_s(self._row.name, now_s)
        job.cost_s = cost_s
        return cost_s if cost_s <= self._limit_s else float("inf")

    def _done(self, job: CycleJob) -> None:
        if job is not self._job:  # the cycles have been stopped meanwhile
            return
        self._is_running = False
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        self.statistics.add(job.cost_s)
        self._ended(job)

    def _await_end(self, pieces: int) -> None:
        """Waits in pieces for the longest duration of a cycle.

        Time in which the whole process stood still, or waited for a processor, does not count: the component could not run
        either. What it waited is asked from the second piece on, since nearly every cycle has ended before.
        """
        self._await_piece(pieces, HUNG_SPARE_PIECES, self._limit_s / pieces, None)

    def _await_piece(self, left: int, spare: int, piece_s: float, starved_s: float | None) -> None:
        due_s = self._loop.time() + piece_s
        self._deadline = self._loop.call_at(due_s, self._expired, left, spare, piece_s, due_s, starved_s)

    def _expired(self, left: int, spare: int, piece_s: float, due_s: float, before_s: float | None) -> None:
        self._deadline = None
        starved_s = self._context.clock.starved_s()
        is_starved = before_s is not None and starved_s - before_s > STARVED_SHARE * piece_s
        if spare and (is_starved or self._loop.time() - due_s > piece_s):
            self._await_piece(left, spare - 1, piece_s, starved_s)
        elif left > 1:
            self._await_piece(left - 1, spare, piece_s, starved_s)
        else:
            self._hung(self._limit_s)


class CycleStatistics:
    """Counts cycles; `close_window()` measures rate and mean cost since it was last called."""

    def __init__(self) -> None:
        self.cycles = 0
        self.overruns = 0
        self.max_s = 0.0
        self.rate_hz = 0.0
        """Cycles per second in the last closed window."""
        self._mean_s: float | None = None
        """Mean cost in the last closed window that had a cycle."""
        self._window_total_s = 0.0
        self._window_cycles = 0
        self._window_start_s = 0.0

    def restart(self, now_s: float) -> None:
        """Restarts the rate measurement, as at a start of the component."""
        self.rate_hz = 0.0
        self._window_cycles, self._window_total_s = 0, 0.0
        self._window_start_s = now_s

    def add(self, cost_s: float) -> None:
        """Counts a cycle that has ended."""
        self.cycles += 1
        self._window_cycles += 1
        self._window_total_s += cost_s
        if cost_s > self.max_s:
            self.max_s = cost_s

    @property
    def mean_s(self) -> float:
        """Mean cost of a cycle of the last window, in seconds; in the first one, of those so far."""
        if self._mean_s is not None:
            return self._mean_s
        return self._window_total_s / self._window_cycles if self._window_cycles else 0.0

    def close_window(self, now_s: float, least_s: float) -> None:
        """Measures since the last window or the start, if that is at least `least_s` ago."""
        span_s = now_s - self._window_start_s
        if span_s >= least_s:
            rate_hz = self._window_cycles / span_s
            if self._window_cycles:
                self._mean_s = self._window_total_s / self._window_cycles
            self.restart(now_s)
            self.rate_hz = rate_hz
