"""One life of a component under its host, from its creation to its shutdown: state, cycles, errors, status."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from gloc3.component.component import ActuatorDriver, Component
from gloc3.component.context import HostContext
from gloc3.component.cycle import CycleCalls, Cycler, CycleStatistics, Mailbox
from gloc3.component.data_logger import DataLogger
from gloc3.component.deployment import ComponentRow
from gloc3.component.error_handler import CountedError, ErrorHandler, describe, reason_of
from gloc3.component.jobs import CHECK_LEAVING, MAKE_SAFE, CycleJob, Gate, MethodJob
from gloc3.component.lci import OPERATING, Command, State, Transition
from gloc3.component.memory import OUT_OF_MEMORY, is_out_of_memory
from gloc3.component.outlets import KEY, Outlets, Routed
from gloc3.component.workers import JobQueue, guard
from gloc3.exchange.base import Publisher, Unsubscribe
from gloc3.messages.envelope import ComponentStatus, Envelope, Event, InternalState, Kind, Message, Severity
from gloc3.messages.summaries import component_cause

HUNG: Final = "hung"
"""First word of the cause of a component whose cycle has not ended."""

Answer = Callable[[str], None]
"""Gets an empty text, or why a command was refused or failed."""


class HostedComponent:
    """A component with everything of the paper's Fig. 2 that its author does not write."""

    def __init__(
        self, row: ComponentRow, component: Component[Any], create: Callable[[], Component[Any]], context: HostContext
    ) -> None:
        self.row: Final = row
        self.component = component
        self.state: State | None = State.IDLE
        self.is_busy = False
        """Whether commands are being carried out; there are no cycles and functions meanwhile."""
        self.errors: Final = ErrorHandler()
        self.is_device_live = False
        """Whether a driver has worked on its device and has not made it safe since."""
        self._is_driver = isinstance(component, ActuatorDriver)
        self.gate = Gate()
        worker = context.new_worker(row)
        self.jobs: Final = JobQueue(context.loop, worker, self._give_up)
        self._create = create
        self._context = context
        self._loop = context.loop
        self._base = f"{context.platform}/components/{row.name}/"
        self._publisher = Publisher(context.exchange, context.platform, row.name, self._new_boot())
        self._outlets = Outlets(row, type(component), context.platform, context.topics)
        self._working_since_s = 0.0
        self._mailbox = Mailbox(list(type(component).inputs.values()))
        self._logger = DataLogger(type(component), row.log)
        self._cycler = Cycler(
            row,
            type(component),
            context,
            self._mailbox,
            worker,
            CycleCalls(self._may_begin, self._cycle_ended, self._cycle_hung, self._unfit),
        )
        component.request_cycle = self._cycler.request
        self._notifier = StatusNotifier(context.loop, row.status_period_s, self._report_status)
        self._transition: MethodJob | None = None
        self._is_stuck = False
        """A thread never came back from this component: it is not initialized again, another one is."""
        self._is_finish_left_out = False
        """Its `finish()` never came back, or it was never initialized."""
        self._ends: list[Unsubscribe] = []

    # --- entering and leaving the system ---

    def enter(self, fault: str = "") -> None:
        """Becomes visible: alive, with inputs and status.

        Args:
            fault: why it is faulty from the begin: the process that it was in has ended. There is nothing to finish then.
        """
        if fault:
            self.state, self._is_finish_left_out = State.FAULTY, True
            self.errors.record(fault, self._loop.time())
        self._ends = [self._context.exchange.declare_alive(self._base[:-1]), *self._cycler.subscribe()]
        self._notifier.start()

    def leave(self) -> None:
        """Disconnects from the rest of the system; no method is called."""
        self._cycler.stop()
        self._notifier.stop()
        for end in self._ends:
            end()
        self._ends.clear()
        self.gate.is_shut = True
        self.jobs.abandon()

    def _new_boot(self) -> int:
        return self._context.random.getrandbits(32)

    # --- transitions ---

    def carry_out(self, command: Command, row: Transition, settings: Any, answer: Answer) -> None:
        """Runs the methods of a row of the table and commits the state; `answer` is called at the end."""
        assert self.state is not None
        methods = [name for name in row.methods if not (self._is_finish_left_out and name == "finish")]
        if self.is_device_live and ("stop" in methods or "goquiet" in methods):
            methods[:0] = [CHECK_LEAVING, MAKE_SAFE]
        job = self._transition = MethodJob(
            self.component,
            methods,
            self.gate,
            settings=settings,
            tolerated=("finish",) if self.state is State.FAULTY else (),
            is_device_live=self.is_device_live,
            create=self._create if self._is_stuck else None,
        )

        def ended(_: MethodJob) -> None:
            self._transition = None
            for failure in job.failures:
                self.count(failure)
            if job.is_skipped:
                answer(f"{command} was not carried out: {self.errors.last_cause}")
            elif job.is_refused:
                answer(reason_of(job.error))
            elif job.error is not None:
                cause = describe(job.error)
                self.fault(cause, job.error, is_stopped="stop" in job.called, is_device_safe=True)
                answer(f"{command} failed: {cause}")
            else:
                self._commit(command, row, job)
                answer("")

        self.jobs.run(
            job.run,
            ended,
            lambda cause: answer(f"{command} failed: {cause}"),
            what=command,
            limit_s=self.row.timeout_s,
            cost_s=self.method_cost_s(command),
        )

    def method_cost_s(self, name: str) -> float:
        """What a command or function costs in virtual time."""
        cost_s = self._context.method_cost_s
        return cost_s(self.row.name, name, self._loop.time()) if cost_s and self._context.clock.is_virtual else 0.0

    def _commit(self, command: Command, row: Transition, job: MethodJob) -> None:
        was, self.state = self.state, row.to
        details = ""
        if MAKE_SAFE in job.called:
            self.is_device_live = False
        if job.component is not self.component:
            self.component, self._is_stuck, self._is_finish_left_out = job.component, False, False
            self.component.request_cycle = self._cycler.request
        if command is Command.INITIALIZE:
            self._is_finish_left_out = False
            details = msgspec.json.encode(job.settings, order="sorted").decode()
        if command is Command.START:
            self._publisher.restart(self._new_boot())
            self._mailbox.clear()
        self._cycler.is_quiet = row.to is State.QUIET
        if row.to is State.WORKING:
            self._working_since_s = self._loop.time()
        if row.to not in OPERATING:
            self._cycler.stop()
        elif was not in OPERATING:
            stopwatch = None if self._context.clock.is_virtual else self._context.clock.cost_s
            cycles = CycleJob(self.component, self._outlets, self.gate, stopwatch)
            self._cycler.items = self._logger.items
            self._cycler.start(cycles)
        self.event(Severity.INFO, f"{command}: {was} -> {row.to or 'absent'}", details)
        self._notifier.changed()
        if row.to is None:
            self.leave()

    # --- cycles ---

    def _may_begin(self) -> bool:
        if self.is_busy:
            return False
        if self.jobs.running:  # a function takes the time of this cycle
            self._cycler.statistics.overruns += 1
            return False
        if self.state is State.WORKING:
            self.is_device_live = self._is_driver
        return True

    def _cycle_hung(self, limit_s: float) -> None:
        self._give_up(f"{HUNG}: a cycle had not ended after {limit_s:g} s")

    def _cycle_ended(self, job: CycleJob) -> None:
        for failure in job.failures:
            self.count(failure)
        error = job.error
        if error is None and self.state is State.WORKING and job.results:
            _, error = guard(self._publish_results, job.results)
        if error is not None:
            self.fault(describe(error), error, is_device_safe=error is job.error)
        elif job.logged is not None:
            self._publisher.publish(self._base + "internal", InternalState(items=job.logged), self._loop.time())

    def _publish_results(self, results: list[Routed]) -> None:
        publish, now_s = self._publisher.publish, self._loop.time()
        for result in results:
            outlet = result.outlet
            outlet.reported_s = now_s
            for topic in outlet.topics:
                publish(
                    topic.replace(KEY, result.key) if outlet.is_keyed else topic,
                    result.message,
                    result.t_s,
                    outlet.frame,
                )

    def _unfit(self, port: str, envelope: Envelope[Any]) -> None:
        expected = type(self.component).inputs[port].message.__name__
        found = type(envelope.payload).__name__
        self.count_cause(f"input {port} takes {expected}; {envelope.topic} brought {found}")

    def set_rate(self, rate_hz: float) -> None:
        """Changes the rate of the periodic cycles."""
        self._cycler.set_rate(rate_hz)
        self._notifier.changed()

    def set_logging(self, items: list[str] | None, is_enabled: bool) -> list[str]:
        """Changes which items the data logger records, and whether."""
        chosen = self._logger.choose(items, is_enabled)
        self._cycler.items = self._logger.items
        return chosen

    # --- errors ---

    def fault(
        self,
        cause: str,
        error: BaseException | None,
        *,
        is_started: bool = False,
        is_stopped: bool = False,
        is_device_safe: bool = False,
    ) -> None:
        """Turns faulty: ends the cycles, makes the device safe, calls `stop()` once, and reports the fault.

        Args:
            cause: one line.
            error: the exception, if any.
            is_started: whether `start()` has ended, in a state other than working and quiet.
            is_stopped: whether `stop()` has been called already.
            is_device_safe: whether the failed job has made the device safe already.
        """
        was, self.state = self.state, State.FAULTY
        self._cycler.stop()
        self.gate.is_shut = True
        self.gate = Gate()
        methods = [MAKE_SAFE] if self.is_device_live and not is_device_safe else []
        methods += ["stop"] if (was in OPERATING or is_started) and not is_stopped else []
        self.is_device_live = False
        is_exhausted = is_out_of_memory(error)
        if is_exhausted:
            cause = self._memory_cause()
            assert error is not None
            error.__traceback__ = None  # its frames hold what the failed job had made
        trace = self.errors.record(cause, self._loop.time(), None if is_exhausted else error)
        if is_exhausted:
            self._is_stuck = True
        if methods or is_exhausted:
            self._clean_up(methods, is_let_go=is_exhausted)
        self.event(Severity.ERROR, f"{was} -> faulty: {cause}", trace, cause=component_cause(self.row.name))
        self._notifier.changed()

    def _memory_cause(self) -> str:
        """Gives the reserve back, and tells once how large the process is."""
        memory = self._context.memory
        if memory is not None and memory.release():
            self.event(Severity.CRITICAL, f"{memory.text()}; components that fail by it restart by their policies")
        return OUT_OF_MEMORY

    def _clean_up(self, methods: list[str], *, is_let_go: bool = False) -> None:
        """Calls methods of the component that has failed.

        Args:
            methods: in order; failures are counted.
            is_let_go: whether the component is let go after them, with all that it holds; another one takes its place.
        """
        job = MethodJob(self.component, methods, self.gate, tolerated=methods)

        def ended(_: MethodJob) -> None:
            for failure in job.failures:
                self.count(failure)
            if is_let_go:
                fresh, _failure = guard(self._create)
                if isinstance(fresh, Component):
                    self.component, self._is_stuck, self._is_finish_left_out = fresh, False, True
                    fresh.request_cycle = self._cycler.request

        self.jobs.run(job.run, ended, lambda _: None, what="stop", limit_s=self.row.timeout_s)

    def _give_up(self, cause: str) -> None:
        """Abandons a job that is stuck and notifies all waiting callers."""
        job, self._transition = self._transition, None
        called = job.called if job else []
        is_started = job is not None and job.abandon()
        self._is_stuck = True
        self._is_finish_left_out = self._is_finish_left_out or called[-1:] == ["finish"]
        reported = self.jobs.abandon()
        self.fault(cause, None, is_started=is_started, is_stopped="stop" in called)
        for gave_up in reported:
            gave_up(cause)

    def count(self, failure: CountedError) -> None:
        """Counts an error that the component recovers from; the first of its kind is reported."""
        if is_out_of_memory(failure.error):
            self.count_cause(f"{failure.during}: {self._memory_cause()}")
        else:
            self.count_cause(f"{failure.during}: {describe(failure.error)}", failure.error)

    def count_cause(self, cause: str, error: BaseException | None = None) -> None:
        """Counts an error; the first of its kind is reported. The displayed cause of being faulty is unchanged."""
        is_new = cause not in self.errors.causes
        trace = self.errors.record(cause, self._loop.time(), error, is_minor=self.state is State.FAULTY)
        if is_new:
            self.event(Severity.WARNING, cause, trace)

    # --- what is told ---

    def publish(self, topic: str, message: Message) -> None:
        """Publishes on one of the topics that every component has."""
        self._publisher.publish(self._base + topic, message, self._loop.time())

    def event(self, severity: Severity, text: str, details: str = "", *, cause: str = "") -> None:
        """Tells something that happened once."""
        self.publish("event", Event(severity=severity, text=text, details=details, cause=cause))

    def _report_status(self, is_periodic: bool) -> None:
        if is_periodic:
            self._cycler.statistics.close_window(self._loop.time(), 0.5 * self.row.status_period_s)
        self.publish("status", self.status())

    def status(self) -> ComponentStatus:
        """The component's health as it is now."""
        is_working, rate_hz = self.state is State.WORKING, self._cycler.nominal_rate_hz
        return replace(
            health_report(self.row, self.component.kind, self.state, self.errors, self._cycler.statistics),
            nominal_rate_hz=rate_hz,
            dropped=self._mailbox.dropped,
            silent=self._outlets.silent(self._loop.time(), self._working_since_s, rate_hz) if is_working else [],
            values={**self.component.status_values},
        )


class StatusNotifier:
    """The status notifier (paper §IV-A): reports the health of a component periodically and on every change.

    Requests a report at a set period; `changed()` requests one in between.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, period_s: float, report: Callable[[bool], None]) -> None:
        self._loop = loop
        self._period_s = period_s
        self._report = report
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Reports now, then periodically."""
        self._timer = self._loop.call_later(self._period_s, self._periodic)
        self.changed()

    def stop(self) -> None:
        """Ends the reports."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def changed(self) -> None:
        """Reports now, because something changed."""
        self._report(False)

    def _periodic(self) -> None:
        self._timer = self._loop.call_later(self._period_s, self._periodic)
        self._report(True)


def health_report(
    row: ComponentRow, kind: Kind, state: State | None, errors: ErrorHandler, statistics: CycleStatistics
) -> ComponentStatus:
    """Builds a component's status message, also that of a component whose host is lost."""
    last = errors.last
    return ComponentStatus(
        name=row.name,
        kind=kind,
        state=state,
        rate_hz=statistics.rate_hz if state in OPERATING else 0.0,
        cycle_mean_s=statistics.mean_s,
        cycle_max_s=statistics.max_s,
        cycles=statistics.cycles,
        overruns=statistics.overruns,
        errors=errors.total,
        cause=errors.last_cause,
        cause_first_s=last.first_s if last else 0.0,
        cause_last_s=last.last_s if last else 0.0,
        is_required=row.required,
        standby_for=row.standby_for or "",
    )
