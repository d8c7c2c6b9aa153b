"""Requests of stations to components: forwards commands, functions and queries, and returns the replies."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.component.lci import CREATE, OPERATING, Command, transition
from gloc3.errors import Refused
from gloc3.messages.command_interface import FORCE, CallFunction, CiReply, CiRequest, CommandComponent, Outcome, Watch
from gloc3.messages.envelope import CommandReply, CommandRequest, FunctionReply, FunctionRequest, Severity
from gloc3.messages.summaries import EventReport
from gloc3.mission.executing.executor import MissionExecutor
from gloc3_onboard.command_server.journal import answer
from gloc3_onboard.command_server.observing import Observing

ANSWER_S: Final = 8.0
"""A component that has not answered within this time leaves its request's outcome unknown."""
RECLAIMING: Final = (Command.GOQUIET, Command.STOP, Command.FINISH, Command.SHUTDOWN)


class ForComponent(NamedTuple):
    """A message for a component."""

    component: str
    message: CommandRequest | FunctionRequest


class Answered(NamedTuple):
    """The reply to a request that waited for a component."""

    reply: CiReply
    is_kept: bool
    """Whether the reply is stored in the journal; not that to queries, which may be repeated."""


class _Open(NamedTuple):
    request: CiRequest
    until_s: float
    is_kept: bool = True


class ComponentRequests:
    """Keeps each request until its component replies or times out."""

    def __init__(self, observing: Observing, report: EventReport) -> None:
        self.messages: list[ForComponent] = []
        """Pending messages to components."""
        self._observing, self._book, self._report = observing, observing.book, report
        self._open: dict[str, _Open] = {}
        self._count = 0
        self._watches: dict[tuple[str, int], int] = {}
        """Latest boot of each watching sender, and the sequence of its latest want."""

    def command(self, request: CiRequest, body: CommandComponent, executor: MissionExecutor, now_s: float) -> None:
        """Hands an LCI command to a component.

        Raises:
            Refused: there is no such component, its state does not allow it, or a running action needs it.
        """
        row = self._book.rows.get(body.component)
        if row is None:
            raise Refused(f"there is no component {body.component!r}; there are: {', '.join(self._book.rows)}")
        state = self._book.state(body.component, now_s)
        if body.command != CREATE:
            try:
                command = Command(body.command)
            except ValueError:
                raise Refused(f"{body.command!r} is not a command; known: {', '.join(Command)}, {CREATE}") from None
            if state is None:
                raise Refused(f"{command} is not accepted: the component is absent; accepted: {CREATE}")
            transition(state, command)
            if self._observing.supervision is not None:
                self._observing.supervision.check(body.component, [command])
            if command in RECLAIMING and state in OPERATING:
                self._refuse_if_needed(body, executor, now_s)
        request_id = self._begin(_Open(request, now_s + ANSWER_S))
        message = CommandRequest(request_id=request_id, command=body.command, settings=body.settings)
        self.messages.append(ForComponent(body.component, message))
        self._report(Severity.INFO, f"station {request.sender}: {body.command} {body.component}")

    def _refuse_if_needed(self, body: CommandComponent, executor: MissionExecutor, now_s: float) -> None:
        row = self._book.rows[body.component]
        provides = [topic for port in row.load_class().outputs for topic in row.topics(port)]
        supervision = self._observing.supervision
        if row.standby_for is not None and supervision is not None:
            if supervision.in_charge(body.component) != body.component:
                return  # a quiet standby: somebody else performs its function
            provides.append(row.standby_for)
        users = executor.in_use(body.component, tuple(provides))
        if not users:
            return
        if not body.is_forced:
            raise Refused(f"{', '.join(users)} needs {body.component}; pause or abort it first, or {FORCE}")
        reason = f"ended by a forced {body.command}"
        executor.motion_lost(body.component, tuple(provides), reason, now_s)

    def call(self, request: CiRequest, body: CallFunction, now_s: float) -> None:
        """Hands a function message to a component.

        Raises:
            Refused: there is no such component, or the function is an action's.
        """
        if body.component not in self._book.rows:
            raise Refused(f"there is no component {body.component!r}; there are: {', '.join(self._book.rows)}")
        if body.function.startswith("action."):
            raise Refused("actions are requested from the platform, not from its components")
        request_id = self._begin(_Open(request, now_s + ANSWER_S))
        message = FunctionRequest(request_id=request_id, function=body.function, arguments=body.arguments)
        self.messages.append(ForComponent(body.component, message))

    def forward_query(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Forwards a query, which needs no control, to the viewer.

        A want older than the sender's latest is refused, since it would restore topics no longer watched.
        """
        body, life = request.body, (request.sender, request.boot)
        if isinstance(body, Watch):
            if request.sequence < self._watches.get(life, -1):
                return answer(request, Outcome.REFUSED, "superseded by a newer one")
            self._watches = {
                **{each: n for each, n in self._watches.items() if each[0] != life[0]},
                life: request.sequence,
            }
            wants = [list(msgspec.structs.astuple(want)) for want in body.wants]
            arguments = {"station": request.sender, "wants": wants, "is_listing": body.is_listing}
            return self._request_viewer(request, "watch", arguments, now_s)
        return self._request_viewer(request, "topics", {}, now_s)

    def _request_viewer(
        self, request: CiRequest, function: str, arguments: dict[str, Any], now_s: float
    ) -> CiReply | None:
        name = next((name for name, row in self._book.rows.items() if function in row.load_class().functions), None)
        if name is None:
            return answer(request, Outcome.REFUSED, "this platform cannot show topics: it has no viewer")
        request_id = self._begin(_Open(request, now_s + ANSWER_S, is_kept=False))
        message = FunctionRequest(request_id=request_id, function=function, arguments=arguments)
        self.messages.append(ForComponent(name, message))
        return None

    def replied(self, reply: CommandReply | FunctionReply) -> Answered | None:
        """Handles a component's reply; None if no station requested it."""
        entry = self._open.pop(reply.request_id, None)
        if entry is None:
            return None
        outcome = Outcome.ACCEPTED if reply.is_accepted else Outcome.REFUSED
        result: Mapping[str, Any] = (
            reply.result if isinstance(reply, FunctionReply) else {"state": reply.state or "absent"}
        )
        return Answered(answer(entry.request, outcome, reply.reason, result=dict(result)), entry.is_kept)

    def expire(self, now_s: float) -> list[Answered]:
        """Answers to requests whose component has not replied in time."""
        late = [request_id for request_id, entry in self._open.items() if now_s > entry.until_s]
        reason = f"the component has not answered within {ANSWER_S:g} s"
        found = [self._open.pop(request_id) for request_id in late]
        return [Answered(answer(one.request, Outcome.UNKNOWN, reason), one.is_kept) for one in found]

    def _begin(self, request: _Open) -> str:
        """Keeps a request; the id by which its component answers."""
        self._count += 1
        request_id = f"ci-{self._count}"
        self._open[request_id] = request
        return request_id
