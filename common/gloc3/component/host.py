"""The host of one component: handles commands of the local command interface and function messages, and starts it.

It checks each command against the table, has the methods run off the control path, and replies. Everything else of the
paper's Fig. 2 is in `gloc3.component.hosted`, one object for each life of the component.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from gloc3.component.component import Component
from gloc3.component.context import HostContext
from gloc3.component.deployment import Begin, ComponentRow, check_row
from gloc3.component.error_handler import CountedError, ErrorHandler, describe
from gloc3.component.functions import FunctionDesk
from gloc3.component.hosted import Answer, HostedComponent
from gloc3.component.lci import CREATE, Command, State, transition
from gloc3.component.settings import load_settings
from gloc3.component.workers import guard
from gloc3.errors import InputError, Refused, nearest
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import (
    CommandReply,
    CommandRequest,
    ComponentStatus,
    Envelope,
    FunctionRequest,
    Kind,
    Message,
    Severity,
)

__all__ = ["BEGIN_COMMANDS", "CREATE", "ComponentHost", "HostContext"]

BEGIN_COMMANDS: Final[Mapping[Begin, tuple[Command, ...]]] = {
    Begin.IDLE: (),
    Begin.STANDBY: (Command.INITIALIZE,),
    Begin.WORKING: (Command.INITIALIZE, Command.START),
    Begin.QUIET: (Command.INITIALIZE, Command.START, Command.GOQUIET),
}


class _Order(NamedTuple):
    """Commands that are being carried out, one after the other."""

    commands: deque[Command]
    settings: Any
    """What the component is initialized with."""
    answer: Answer


class ComponentHost:
    """Hosts one component of a deployment."""

    def __init__(self, row: ComponentRow, create: Callable[[], Component[Any]], context: HostContext) -> None:
        """A host, not yet in the system.

        Raises:
            InputError: the row does not fit the component's class.
        """
        self.row: Final = row
        self.settings: Mapping[str, Any] = row.settings
        """Settings passed to `initialize`, unless a command brings others: those of the row, or as last re-read."""
        self._create = create
        self._context = context
        self._loop = context.loop
        self._order: _Order | None = None
        component = create()
        findings = check_row(row, type(component))
        if findings:
            raise InputError(findings)
        self._make(component)
        base = f"{context.platform}/components/{row.name}/"
        self._subscriptions: list[Unsubscribe] = [
            context.exchange.subscribe(base + "command", self._receiver(CommandRequest, self._handle_command)),
            context.exchange.subscribe(base + "function", self._receiver(FunctionRequest, self._handle_function)),
        ]

    def _make(self, component: Component[Any]) -> None:
        self._hosted = HostedComponent(self.row, component, self._create, self._context)
        self._functions = FunctionDesk(self._hosted)

    def _receiver(self, expected: type[Message], handle: Callable[[Any], None]) -> Callable[[Envelope[Any]], None]:
        def deliver(envelope: Envelope[Any]) -> None:
            if isinstance(envelope.payload, expected):
                self._loop.call_soon(self._guarded, handle, envelope.payload)
            else:
                self._hosted.count_cause(f"{envelope.topic} brought {type(envelope.payload).__name__}")

        return deliver

    def _guarded(self, handle: Callable[[Any], None], message: Any) -> None:
        """Handles a request; an unexpected exception does not end the host."""
        _, error = guard(handle, message)
        if error is not None:
            self._hosted.count(CountedError(type(message).__name__, error))

    # --- life ---

    @property
    def state(self) -> State | None:
        """The state; None is *absent*."""
        return self._hosted.state

    @property
    def kind(self) -> Kind:
        """The type of component."""
        return self._hosted.component.kind

    @property
    def errors(self) -> ErrorHandler:
        """The errors of this life of the component."""
        return self._hosted.errors

    @property
    def is_beginning(self) -> bool:
        """Whether commands, such as those of the row's `begin`, are still being carried out."""
        return self._order is not None

    def status(self) -> ComponentStatus:
        """The component's health as it is now."""
        return self._hosted.status()

    def begin(self) -> None:
        """Joins the system and brings the component to the state that its row asks for."""
        self._hosted.enter()
        self._carry_out(BEGIN_COMMANDS[self.row.begin], None, self._begun)

    def begin_again(self, fault: str | None) -> None:
        """Enters the system after its process has ended: faulty with that cause, or absent until it is created (None)."""
        if fault is None:
            self._hosted.state = None
        else:
            self._hosted.enter(fault)

    def _begun(self, refusal: str) -> None:
        if refusal and self.state is not State.FAULTY:  # that has been told
            self._hosted.event(Severity.ERROR, f"it did not become {self.row.begin}: {refusal}")

    def close(self) -> None:
        """Ends without ceremony, as at the end of the process: no method is called."""
        self._hosted.leave()
        for unsubscribe in self._subscriptions:
            unsubscribe()
        self._subscriptions.clear()

    # --- commands ---

    def _handle_command(self, request: CommandRequest) -> None:
        def reply(refusal: str) -> None:
            self._hosted.publish(
                "reply",
                CommandReply(
                    request_id=request.request_id,
                    component=self.row.name,
                    command=request.command,
                    is_accepted=not refusal,
                    state=self.state,
                    reason=refusal,
                ),
            )

        words = [request.command, *request.then]
        known = (*(command.value for command in Command), CREATE)
        for word in words:
            if word not in known:
                reply(f"{word!r} is no command; {nearest(str(word), known)}")
                return
        if words[0] == CREATE:
            refusal = self._recreate()
            if refusal:
                reply(refusal)
                return
            del words[0]
        if CREATE in words:
            reply(f"{CREATE} comes first")
            return

        def keep_and_reply(refusal: str) -> None:
            if not refusal and request.is_kept and request.settings is not None:
                self.settings = request.settings
            reply(refusal)

        self._carry_out([Command(word) for word in words], request.settings, keep_and_reply)

    def _recreate(self) -> str:
        """Begins another life of an absent component; returns why not, or an empty text."""
        if self.state is not None:
            return f"{CREATE} is not accepted: the component is {self.state}, not absent"
        component, error = guard(self._create)
        if not isinstance(component, Component):
            return f"it cannot be created: {describe(error) if error else 'no component'}"
        self._make(component)
        self._hosted.enter()
        return ""

    def _carry_out(self, commands: Sequence[Command], settings: Mapping[str, Any] | None, answer: Answer) -> None:
        """Executes commands with no cycle in between; `answer` is called when the last has ended or one has failed."""
        try:
            self._check(commands)
            adopted = self._check_settings(settings) if Command.INITIALIZE in commands else None
        except (Refused, InputError) as refusal:
            answer(str(refusal))
            return
        if not commands:
            answer("")
            return
        self._order = _Order(deque(commands), adopted, answer)
        self._hosted.is_busy = True
        self._next()

    def _check(self, commands: Sequence[Command]) -> None:
        if self._order is not None:
            raise Refused(f"busy: {commands[0]} is not accepted while another command is carried out")
        state = self.state
        for command in commands:
            if state is None:
                raise Refused(f"{command} is not accepted: the component is absent; accepted: {CREATE}")
            state = transition(state, command).to

    def _check_settings(self, settings: Mapping[str, Any] | None) -> Any:
        values = {**self.settings, **(settings or {})}
        return load_settings(type(self._hosted.component).settings_type, values, self.row.name)

    def _next(self) -> None:
        assert self._order is not None
        assert self.state is not None
        command = self._order.commands.popleft()
        self._hosted.carry_out(command, transition(self.state, command), self._order.settings, self._ended)

    def _ended(self, refusal: str) -> None:
        order = self._order
        assert order is not None
        if order.commands and not refusal:
            self._next()
            return
        self._order = None
        self._hosted.is_busy = False
        order.answer(refusal)

    # --- functions ---

    def _handle_function(self, request: FunctionRequest) -> None:
        self._functions.handle(request, self._loop.time())
