"""Stand-in for a component whose process is away: reports it as faulty, with the cause."""

from typing import Final

from gloc3.component.context import HostContext
from gloc3.component.cycle import CycleStatistics
from gloc3.component.deployment import ComponentRow
from gloc3.component.error_handler import ErrorHandler
from gloc3.component.hosted import StatusNotifier, health_report
from gloc3.component.lci import CREATE, Command, State, transition
from gloc3.errors import Refused
from gloc3.exchange import Publisher
from gloc3.messages.envelope import (
    CommandReply,
    CommandRequest,
    Event,
    FunctionReply,
    FunctionRequest,
    Kind,
    Message,
    Severity,
)


class ComponentPlaceholder:
    """Speaks for one component while its process is away.

    Args:
        row: of the component.
        context: of the host's main process.
    """

    def __init__(self, row: ComponentRow, context: HostContext) -> None:
        self.row: Final = row
        self.kind: Kind = row.load_class().kind
        self.state: State | None = None
        """Last reported state, by the component or on its behalf; None before that, and after it has left."""
        self.has_left = False
        self.cause = ""
        self._loop = context.loop
        self._base = f"{context.platform}/components/{row.name}/"
        self._errors = ErrorHandler()
        self.boot: Final = context.random.getrandbits(32)
        self._publisher = Publisher(context.exchange, context.platform, row.name, self.boot)
        self._notifier = StatusNotifier(context.loop, row.status_period_s, lambda _: self._report())

    def fail(self, cause: str, words: str, *, has_been_reported: bool) -> None:
        """Reports the component as faulty after the end of its process, unless it had left before.

        Args:
            cause: one line.
            words: last output of the process.
            has_been_reported: whether another component of the process has reported it already.
        """
        if self.has_left:
            return
        was, self.state, self.cause = self.state, State.FAULTY, cause
        self._errors.record(cause, self._loop.time())
        details = "" if has_been_reported else words
        self._publish(
            "event", Event(severity=Severity.ERROR, text=f"{was or 'absent'} -> faulty: {cause}", details=details)
        )
        self._notifier.start()

    def receive_state(self, state: State | None) -> None:
        """Handles the component's own state report."""
        self.state, self.has_left = state, state is None

    def step_back(self) -> None:
        """Steps back: the process is back and reports for itself."""
        self._notifier.stop()

    def retry(self) -> None:
        """Repeats the state after a late message from before the process ended."""
        self._notifier.changed()

    def answer(self, request: CommandRequest) -> bool:
        """Answers a command while the process is away; returns whether the process should be started for it."""
        words = [request.command, *request.then]
        if self.state is None:
            if words[0] == CREATE:
                return True
            self.reply(request, f"{words[0]} is not accepted: the component is absent; accepted: {CREATE}")
            return False
        try:
            found = transition(self.state, Command(words[0]))
        except (Refused, ValueError) as refusal:
            self.reply(request, str(refusal))
            return False
        if found.to is not None:
            return True
        self.receive_state(None)
        self.reply(request, "")
        self._notifier.changed()
        self._notifier.stop()
        return False

    def reply(self, request: CommandRequest, refusal: str) -> None:
        """Replies to a command; an empty refusal accepts it."""
        self._publish(
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

    def refuse(self, request: FunctionRequest, reason: str) -> None:
        """Replies to a function request."""
        self._publish(
            "function_reply",
            FunctionReply(
                request_id=request.request_id,
                component=self.row.name,
                function=request.function,
                is_accepted=False,
                reason=reason,
            ),
        )

    def _publish(self, topic: str, message: Message) -> None:
        self._publisher.publish(self._base + topic, message, self._loop.time())

    def _report(self) -> None:
        self._publish("status", health_report(self.row, self.kind, self.state, self._errors, CycleStatistics()))
