"""The cycles of a component: periodic or begun by an input, one at a time, counted, and watched for hanging."""

import asyncio
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gloc3.component import ActuatorDriver, Component
from gloc3.deployment import ComponentRow
from gloc3.errors import Misuse, Refused, nearest
from gloc3.exchange.base import Unsubscribe
from gloc3.messages import Envelope
from gloc3.ports import Actuation, Inbox, Mailbox, Report, Result
from gloc3.statistics import CycleStatistics
from gloc3.workers import Worker, guard

if TYPE_CHECKING:
    from gloc3.host import HostContext

HUNG_PERIODS: Final = 5.0
HUNG_FLOOR_S: Final = 0.2


class CycleOutcome(NamedTuple):
    """How a cycle ended."""

    t_s: float
    """When it began."""
    results: Sequence[Report | Actuation] = ()
    items: dict[str, Any] | None = None
    """The internal state's items to log."""
    error: Exception | None = None
    hung_s: float = 0.0
    """Not 0: it had not ended after so many seconds."""


class Cycler:
    """Begins cycles when they are due and hands each outcome to the host."""

    def __init__(
        self,
        row: ComponentRow,
        component: type[Component[Any]],
        context: "HostContext",
        ready: Callable[[], tuple[Component[Any], Worker] | None],
        mailbox: Mailbox,
        ended: Callable[[CycleOutcome], None],
    ) -> None:
        self.rate_hz = row.rate_hz
        self.is_quiet = False
        self.statistics = CycleStatistics()
        self.measured_rate_hz = 0.0
        self._row = row
        self._class = component
        self._context = context
        self._loop = context.loop
        self._ready = ready
        self._mailbox = mailbox
        self._ended = ended
        self._items = self._check_items(row.log)
        self._is_logging = bool(self._items)
        self._port_of = _ports_by_type(component)
        self._limit_s = self._hung_limit_s()
        self._timer: asyncio.TimerHandle | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._start_s = 0.0
        self._tick = 0
        self._began_s = float("-inf")
        self._is_running = False
        self._is_cycling = False
        self._is_triggered = False

    def subscribe(self) -> list[Unsubscribe]:
        """Binds the component's inputs to their topics."""
        unsubscribes = []
        for name in self._class.inputs:
            for topic in self._row.topics(name):
                unsubscribes.append(
                    self._context.exchange.subscribe(f"{self._context.platform}/{topic}", self._taker(name))
                )
        return unsubscribes

    def _taker(self, port: str) -> Callable[[Envelope[Any]], None]:
        put, expected = self._mailbox.put, self._class.inputs[port].message
        if port != self._row.trigger:

            def take(envelope: Envelope[Any]) -> None:
                if self._is_cycling and isinstance(envelope.payload, expected):
                    put(port, envelope)

            return take

        def take_and_trigger(envelope: Envelope[Any]) -> None:
            if self._is_cycling and isinstance(envelope.payload, expected):
                put(port, envelope)
                if not self._is_triggered:
                    self._is_triggered = True
                    self._loop.call_soon(self._triggered)

        return take_and_trigger

    # --- start, stop, settings ---

    def start(self) -> None:
        """Begins the cycles."""
        self._is_cycling = True
        self.statistics.restart(self._loop.time())
        self._restart_timer()

    def stop(self) -> None:
        """Ends the cycles; one that is under way is forgotten."""
        self._is_cycling = self._is_running = False
        for timer in (self._timer, self._deadline):
            if timer is not None:
                timer.cancel()
        self._timer = self._deadline = None

    def set_rate(self, rate_hz: float) -> float:
        """Changes the period of a component that has one."""
        if self.rate_hz is None:
            raise Refused("it has no rate: its cycles are begun by an input")
        self.rate_hz = rate_hz
        self._limit_s = self._hung_limit_s()
        self._restart_timer()
        return rate_hz

    def set_logging(self, items: list[str] | None, is_enabled: bool) -> list[str]:
        """Changes what is recorded at the end of a cycle."""
        if items is not None:
            self._items = self._check_items(items)
        self._is_logging = is_enabled and bool(self._items)
        return list(self._items) if self._is_logging else []

    def close_window(self) -> None:
        """Takes the measured rate of the time since the last call."""
        self.measured_rate_hz = self.statistics.take_rate_hz(self._loop.time())

    def _check_items(self, items: Sequence[str]) -> tuple[str, ...]:
        for item in items:
            if item not in self._class.loggable:
                raise Refused(f"{item!r} cannot be logged; {nearest(item, self._class.loggable)}")
        return tuple(items)

    def _hung_limit_s(self) -> float:
        rate_hz = self.rate_hz
        if rate_hz is None and self._row.trigger is not None:
            row = self._context.topics.row(f"{self._context.platform}/{self._row.topics(self._row.trigger)[0]}")
            rate_hz = row.rate_hz if row else None
        return max(HUNG_PERIODS / rate_hz if rate_hz else 0.0, HUNG_FLOOR_S)

    # --- the cycle ---

    def _restart_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.rate_hz is not None and self._is_cycling:
            self._start_s, self._tick = self._loop.time(), 0
            self._timer = self._loop.call_at(self._start_s, self._ticked)

    def _ticked(self) -> None:
        assert self.rate_hz is not None
        now_s = self._loop.time()
        period_s = 1.0 / self.rate_hz
        self._tick += 1
        behind = int((now_s - self._start_s) * self.rate_hz) - self._tick
        if behind > 0:  # the loop itself was late: those periods are lost, not made up
            self._tick += behind
            self.statistics.overruns += behind
        self._timer = self._loop.call_at(self._start_s + self._tick * period_s, self._ticked)
        if self._row.trigger is None or now_s - self._began_s > 0.5 * period_s:
            self._begin(now_s)

    def _triggered(self) -> None:
        self._is_triggered = False
        if self._is_cycling:
            self._begin(self._loop.time())

    def _begin(self, now_s: float) -> None:
        if self._is_running:
            self.statistics.overruns += 1
            return
        ready = self._ready()
        if ready is None:
            return
        component, worker = ready
        self._is_running = True
        self._began_s = now_s
        inbox, is_quiet, items = self._mailbox.take(), self.is_quiet, self._items if self._is_logging else ()
        cost_s = self._row.latency_s
        if self._context.cycle_cost_s is not None:
            cost_s += self._context.cycle_cost_s(self._row.name, now_s)
        clock, is_virtual = self._context.clock, self._context.clock.is_virtual

        def job() -> tuple[CycleOutcome, float]:
            begin_s = 0.0 if is_virtual else clock.cost_s()
            outcome = self._cycle(component, now_s, inbox, is_quiet, items)
            return outcome, cost_s if is_virtual else clock.cost_s() - begin_s

        worker.run(job, self._done, cost_s)
        if self._is_running:
            self._deadline = self._loop.call_later(self._limit_s, self._hung, now_s)

    def _cycle(
        self, component: Component[Any], now_s: float, inbox: Inbox, is_quiet: bool, items: tuple[str, ...]
    ) -> CycleOutcome:
        """On the worker: the author's `work()`, the writes that it decided, and the items to log."""

        def work() -> CycleOutcome:
            reports = [self._resolve(result) for result in component.work(now_s, inbox)]
            if not is_quiet and isinstance(component, ActuatorDriver):
                for report in reports:
                    if isinstance(report, Actuation):
                        component.actuate(report.write)
            logged = {item: getattr(component, item) for item in items} if items else None
            return CycleOutcome(now_s, reports, logged)

        outcome, error = guard(work)
        return outcome if outcome is not None else CycleOutcome(now_s, error=error)

    def _resolve(self, result: Result) -> Report | Actuation:
        if isinstance(result, Report | Actuation):
            return result
        port = self._port_of.get(type(result))
        if port is None:
            raise Misuse(
                f"{self._class.__name__} reported {type(result).__name__}, which fits no single output of its class"
            )
        return Report(port, result)

    def _done(self, ended: tuple[CycleOutcome, float]) -> None:
        if not self._is_running:
            return
        self._is_running = False
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        outcome, cost_s = ended
        self.statistics.add(cost_s)
        self._ended(outcome)

    def _hung(self, began_s: float) -> None:
        self._deadline = None
        self._ended(CycleOutcome(began_s, hung_s=self._limit_s))


def _ports_by_type(component: type[Component[Any]]) -> dict[type, str]:
    """Message type to output, for the types that only one output has."""
    types = [port.message for port in component.outputs.values()]
    return {port.message: name for name, port in component.outputs.items() if types.count(port.message) == 1}
