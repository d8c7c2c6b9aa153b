"""The host of one component: everything of the paper's Fig. 2 that an author does not write.

It checks each command against the table of the local command interface, runs the method off the control path, commits
the state, calls `work()` every cycle, publishes what it returns unless quiet, and turns any exception into *faulty*.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Mapping
from random import Random
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.clock import Clock
from gloc3.component import ActuatorDriver, Component
from gloc3.cycle import CycleOutcome, Cycler
from gloc3.deployment import Begin, ComponentRow
from gloc3.error_handler import ErrorHandler, describe
from gloc3.errors import InputError, Refused
from gloc3.exchange.base import Exchange, Publisher, Unsubscribe
from gloc3.functions import SetLogging, SetLoggingReply, SetRate, SetRateReply, decode_request
from gloc3.lci import OPERATING, Command, State, Transition, transition
from gloc3.messages import (
    CommandReply,
    CommandRequest,
    ComponentStatus,
    Envelope,
    Event,
    FunctionReply,
    FunctionRequest,
    InternalState,
    Message,
    Severity,
)
from gloc3.ports import Mailbox, Report
from gloc3.settings import load_settings
from gloc3.topics import TopicTable
from gloc3.workers import InlineWorker, ThreadWorker, Worker, guard

CREATE: Final = "create"
"""Beside the LCI's commands: makes an absent component anew from its row."""

BEGIN_COMMANDS: Final[Mapping[Begin, tuple[Command, ...]]] = {
    Begin.IDLE: (),
    Begin.STANDBY: (Command.INITIALIZE,),
    Begin.WORKING: (Command.INITIALIZE, Command.START),
    Begin.QUIET: (Command.INITIALIZE, Command.START, Command.GOQUIET),
}


class HostContext(NamedTuple):
    """What the hosts of one process share."""

    platform: str
    exchange: Exchange
    clock: Clock
    loop: asyncio.AbstractEventLoop
    topics: TopicTable
    random: Random
    """Draws boot numbers."""
    cycle_cost_s: Callable[[str, float], float] | None = None
    """Virtual time: what a cycle of the component called so costs at that time, by the fault model."""

    def new_worker(self, name: str) -> Worker:
        """A worker for one component."""
        return InlineWorker(self.loop) if self.clock.is_virtual else ThreadWorker(self.loop, name)


class ComponentHost:
    """Hosts one component of a deployment."""

    def __init__(self, row: ComponentRow, create: Callable[[], Component[Any]], context: HostContext) -> None:
        self.row: Final = row
        self.state: State | None = State.IDLE
        self.errors = ErrorHandler()
        self._create = create
        self._component = create()
        self._is_stuck = False
        self._context = context
        self._loop = context.loop
        self._worker = context.new_worker(row.name)
        self._overlay: dict[str, Any] = {}
        self._agenda: deque[Command] = deque()
        self._pending: dict[int, Callable[[str], None]] = {}
        self._next_job = 0
        self._is_busy = False
        self._base = f"{context.platform}/components/{row.name}/"
        self._publisher = Publisher(context.exchange, context.platform, row.name, self._new_boot())
        self._mailbox = Mailbox(list(type(self._component).inputs.values()))
        self._cycler = Cycler(
            row, type(self._component), context, self._operating_component, self._mailbox, self._cycle_ended
        )
        self._withdraw: Unsubscribe | None = None
        self._status_timer: asyncio.TimerHandle | None = None
        self._subscriptions = [
            context.exchange.subscribe(self._base + "command", lambda e: self._soon(self._command, e)),
            context.exchange.subscribe(self._base + "function", lambda e: self._soon(self._function, e)),
            *self._cycler.subscribe(),
        ]

    # --- life ---

    def begin(self) -> None:
        """Enters the system and is brought to the state that the row asks for."""
        self._enter()
        self._agenda.extend(BEGIN_COMMANDS[self.row.begin])
        self._next_in_agenda()

    def close(self) -> None:
        """Ends without ceremony, as at the end of the process: no method is called."""
        self._leave()
        self._worker.abandon()
        for unsubscribe in self._subscriptions:
            unsubscribe()
        self._subscriptions.clear()

    def _enter(self) -> None:
        self._withdraw = self._context.exchange.declare_alive(self._base[:-1])
        self._publish_status()
        self._arm_status_timer()

    def _leave(self) -> None:
        self._cycler.stop()
        if self._status_timer is not None:
            self._status_timer.cancel()
            self._status_timer = None
        if self._withdraw is not None:
            self._withdraw()
            self._withdraw = None

    def _soon(self, handle: Callable[[Any], None], envelope: Envelope[Any]) -> None:
        self._loop.call_soon(handle, envelope.payload)

    def _new_boot(self) -> int:
        return self._context.random.getrandbits(32)

    # --- commands ---

    def _command(self, request: CommandRequest) -> None:
        if request.command == CREATE:
            self._create_anew(request)
            return
        try:
            command = Command(request.command)
        except ValueError:
            self._reply(request, f"{request.command!r} is no command; known: {', '.join(Command)}, {CREATE}")
            return
        self._execute(command, request.settings, lambda refusal: self._reply(request, refusal))

    def _reply(self, request: CommandRequest, refusal: str) -> None:
        reply = CommandReply(
            request_id=request.request_id,
            component=self.row.name,
            command=request.command,
            is_accepted=not refusal,
            state=self.state,
            reason=refusal,
        )
        self._publisher.publish(self._base + "reply", reply, self._loop.time())

    def _create_anew(self, request: CommandRequest) -> None:
        if self.state is not None:
            self._reply(request, f"create is only for an absent component; this one is {self.state}")
            return
        component, error = guard(self._create)
        if component is None:
            self._reply(request, f"it cannot be created: {describe(error) if error else ''}")
            return
        self._component = component
        self.state, self._is_stuck, self._overlay = State.IDLE, False, {}
        self._publisher.restart(self._new_boot())
        self._enter()
        self._reply(request, "")

    def _execute(self, command: Command, settings: Mapping[str, Any] | None, answer: Callable[[str], None]) -> None:
        """Carries out a command; `answer` gets an empty text, or why it was refused or failed."""
        was = self.state
        try:
            if was is None:
                raise Refused(f"{command} is not accepted: the component is absent; accepted: {CREATE}")
            if self._is_busy:
                raise Refused(f"busy: {command} is not accepted while another command is carried out")
            row = transition(was, command)
            adopted = self._check_settings(command, settings)
        except (Refused, InputError) as refusal:
            answer(str(refusal))
            return
        self._is_busy = True

        def ended(outcome: tuple[Component[Any] | None, Exception | None]) -> None:
            deadline.cancel()
            self._is_busy = False
            del self._pending[job]
            component, error = outcome
            if isinstance(error, Refused):
                answer(str(error))
            elif error is not None:
                self._fault(describe(error), error, is_stop_done="stop" in row.methods)
                answer(f"{command} failed: {describe(error)}")
            else:
                if component is not None and component is not self._component:
                    self._component, self._is_stuck = component, False
                self._commit(command, row, settings, adopted)
                answer("")
            self._next_in_agenda()

        job = self._remember(lambda cause: answer(f"{command} failed: {cause}"))
        deadline = self._loop.call_later(
            self.row.timeout_s, self._give_up, f"timeout: {command} took over {self.row.timeout_s:g} s"
        )
        component, is_stuck = self._component, self._is_stuck
        self._worker.run(lambda: guard(lambda: self._run_methods(component, row, adopted, was, is_stuck)), ended)

    def _check_settings(self, command: Command, settings: Mapping[str, Any] | None) -> Any:
        if command is not Command.INITIALIZE:
            return None
        values = {**self.row.settings, **(settings or {})}
        return load_settings(self._component.settings_type, values, self.row.name)

    def _run_methods(
        self, component: Component[Any], row: Transition, adopted: Any, was: State, is_stuck: bool
    ) -> Component[Any]:
        """On the worker: the methods of a transition, in order."""
        for name in row.methods:
            if name in ("stop", "goquiet") and isinstance(component, ActuatorDriver):
                component.make_safe()
            if name == "initialize":
                if is_stuck:
                    component = self._create()
                component.initialize(adopted)
            elif name == "finish" and was is State.FAULTY:
                _, error = guard(component.finish)
                if error is not None:
                    self._loop.call_soon_threadsafe(self._count_only, f"finish: {describe(error)}", error)
            else:
                getattr(component, name)()
        return component

    def _commit(self, command: Command, row: Transition, settings: Mapping[str, Any] | None, adopted: Any) -> None:
        was, self.state = self.state, row.to
        details = ""
        if command is Command.INITIALIZE:
            self._overlay = dict(settings or {})
            details = json.dumps(msgspec.to_builtins(adopted), sort_keys=True)
        if command is Command.START:
            self._publisher.restart(self._new_boot())
            self._mailbox.clear()
        self._cycler.is_quiet = row.to is State.QUIET
        if row.to in OPERATING:
            if was not in OPERATING:
                self._cycler.start()
        else:
            self._cycler.stop()
        self._event(Severity.INFO, f"{command}: {was} -> {row.to or 'absent'}", details)
        self._publish_status()
        if row.to is None:
            self._leave()

    def _next_in_agenda(self) -> None:
        if self._agenda and not self._is_busy:
            command = self._agenda.popleft()
            self._execute(command, None, lambda refusal: self._begin_refused(command, refusal) if refusal else None)

    def _begin_refused(self, command: Command, refusal: str) -> None:
        self._agenda.clear()
        self._event(Severity.ERROR, f"{command}: {refusal}")

    @property
    def is_beginning(self) -> bool:
        """Whether the row's `begin` is still being carried out."""
        return bool(self._agenda) or self._is_busy

    # --- cycles ---

    def _operating_component(self) -> tuple[Component[Any], Worker] | None:
        """The component and its worker while it may run a cycle: operating, and no command under way."""
        if self.state not in OPERATING or self._is_busy or self._agenda:
            return None
        return self._component, self._worker

    def _cycle_ended(self, outcome: CycleOutcome) -> None:
        if self.state not in OPERATING:
            return
        if outcome.hung_s:
            self._give_up(f"hung: a cycle had not ended after {outcome.hung_s:g} s")
            return
        if outcome.error is not None:
            self._fault(describe(outcome.error), outcome.error)
            return
        now_s = self._loop.time()
        if self.state is State.WORKING:
            for result in outcome.results:
                if isinstance(result, Report):
                    self._publish_result(result, outcome.t_s)
        if outcome.items is not None:
            self._publisher.publish(self._base + "internal", InternalState(items=outcome.items), now_s)

    def _publish_result(self, report: Report, cycle_s: float) -> None:
        port = type(self._component).outputs[report.port]
        t_s = cycle_s if report.t_s is None else report.t_s
        for topic in self.row.topics(report.port):
            name = topic.replace("{key}", report.key) if report.key else topic
            self._publisher.publish(f"{self._context.platform}/{name}", report.message, t_s, port.frame)

    # --- functions ---

    def _function(self, request: FunctionRequest) -> None:
        def answer(refusal: str, reply: Message | None = None) -> None:
            message = FunctionReply(
                request_id=request.request_id,
                component=self.row.name,
                function=request.function,
                is_accepted=not refusal,
                reason=refusal,
                result={} if reply is None else msgspec.to_builtins(reply),
            )
            self._publisher.publish(self._base + "function_reply", message, self._loop.time())

        try:
            if self.state not in OPERATING:
                raise Refused(f"functions are taken while working or quiet; it is {self.state or 'absent'}")
            entry, arguments = decode_request(type(self._component), request)
            if isinstance(arguments, SetRate | SetLogging):
                answer("", self._generic_function(arguments))
                return
        except Refused as refusal:
            answer(str(refusal))
            return

        def ended(outcome: tuple[Message | None, Exception | None]) -> None:
            del self._pending[job]
            reply, error = outcome
            if isinstance(error, Refused):
                answer(str(error))
            elif error is not None:
                answer(f"{request.function} failed: {describe(error)}")
                self._fault(describe(error), error)
            else:
                answer("", reply)

        job = self._remember(lambda cause: answer(f"{request.function} failed: {cause}"))
        method, now_s = getattr(self._component, entry.method), self._loop.time()
        self._worker.run(lambda: guard(lambda: method(arguments, now_s)), ended)

    def _generic_function(self, arguments: SetRate | SetLogging) -> Message:
        if isinstance(arguments, SetRate):
            return SetRateReply(rate_hz=self._cycler.set_rate(arguments.rate_hz))
        return SetLoggingReply(items=self._cycler.set_logging(arguments.items, arguments.is_enabled))

    # --- errors ---

    def _remember(self, give_up: Callable[[str], None]) -> int:
        self._next_job += 1
        self._pending[self._next_job] = give_up
        return self._next_job

    def _give_up(self, cause: str) -> None:
        """The job under way is stuck: it is abandoned with its worker, and everyone who waits is told."""
        self._worker.abandon()
        self._worker = self._context.new_worker(self.row.name)
        self._is_stuck, self._is_busy = True, False
        pending, self._pending = self._pending, {}
        self._fault(cause, None, is_stop_done=cause.startswith("timeout: stop"))
        for answer in pending.values():
            answer(cause)

    def _fault(self, cause: str, error: BaseException | None, *, is_stop_done: bool = False) -> None:
        was, self.state = self.state, State.FAULTY
        self._agenda.clear()
        self._cycler.stop()
        trace = self.errors.record(cause, self._loop.time(), error)
        self._event(Severity.ERROR, f"{was} -> faulty: {cause}", trace)
        self._publish_status()
        if was in OPERATING:
            component = self._component

            def clean_up() -> list[Exception]:
                steps = [component.make_safe] if isinstance(component, ActuatorDriver) else []
                steps += [] if is_stop_done else [component.stop]
                return [failure for failure in (guard(step)[1] for step in steps) if failure is not None]

            def cleaned(failures: list[Exception]) -> None:
                for failure in failures:
                    self._count_only(f"stop: {describe(failure)}", failure)

            self._worker.run(clean_up, cleaned)

    def _count_only(self, cause: str, error: BaseException) -> None:
        trace = self.errors.record(cause, self._loop.time(), error)
        self._event(Severity.WARNING, cause, trace)

    # --- status ---

    def _event(self, severity: Severity, text: str, details: str = "") -> None:
        self._publisher.publish(
            self._base + "event", Event(severity=severity, text=text, details=details), self._loop.time()
        )

    def _arm_status_timer(self) -> None:
        self._status_timer = self._loop.call_later(self.row.status_period_s, self._periodic_status)

    def _periodic_status(self) -> None:
        self._cycler.close_window()
        self._publish_status()
        self._arm_status_timer()

    def _publish_status(self) -> None:
        self._publisher.publish(self._base + "status", self.status(), self._loop.time())

    def status(self) -> ComponentStatus:
        """The component's health as it is now."""
        last, statistics = self.errors.last, self._cycler.statistics
        is_operating = self.state in OPERATING
        return ComponentStatus(
            name=self.row.name,
            kind=self._component.kind,
            state=self.state,
            rate_hz=self._cycler.measured_rate_hz if is_operating else 0.0,
            nominal_rate_hz=self._cycler.rate_hz or 0.0,
            cycle_mean_s=statistics.mean_s,
            cycle_max_s=statistics.max_s,
            cycles=statistics.cycles,
            overruns=statistics.overruns,
            errors=self.errors.total,
            cause=self.errors.last_cause,
            cause_first_s=last.first_s if last else 0.0,
            cause_last_s=last.last_s if last else 0.0,
            dropped=self._mailbox.dropped,
            is_required=self.row.required,
            standby_for=self.row.standby_for or "",
        )
