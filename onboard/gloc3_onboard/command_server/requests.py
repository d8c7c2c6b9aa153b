"""Carries out what stations ask for: authority and checks here, the work in the executor and the components."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.ci import (
    FORCE,
    LOOKS,
    AnyBody,
    CallFunction,
    CiReply,
    CiRequest,
    CommandComponent,
    Control,
    Elsewhere,
    Emergency,
    EmergencyVerb,
    Hello,
    ListTopics,
    LoadMission,
    Outcome,
    Preflight,
    Query,
    ReadMission,
    RequestAction,
    RequestTask,
    StationRole,
    Steer,
    Verb,
    Watch,
)
from gloc3.errors import Gloc3Error, Refused
from gloc3.frames import GeoPoint
from gloc3.lci import CREATE, OPERATING, Command, transition
from gloc3.messages import CommandReply, CommandRequest, FunctionReply, FunctionRequest, Severity
from gloc3.mission.checker import Circumstances, check_text
from gloc3.mission.executor import MissionExecutor
from gloc3.mission.model import Mission
from gloc3.mission.reader import Surroundings, read_mission
from gloc3.preflight import PreflightReport, summary
from gloc3.software import Software
from gloc3.supervision import Supervision
from gloc3.vehicle import EmergencyDisarm, FenceProgress
from gloc3_onboard.command_server.book import ComponentBook
from gloc3_onboard.command_server.control import ControlAuthority
from gloc3_onboard.command_server.facts import VehicleFacts
from gloc3_onboard.command_server.hearsay import Hearsay
from gloc3_onboard.command_server.journal import Journal
from gloc3_onboard.command_server.senders import Senders
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.command_server.start_gate import Begin, RedChecks, StartGate
from gloc3_onboard.command_server.summaries import geofence_of

ANSWER_S: Final = 8.0
"""A component that has not answered within this time leaves its request's outcome unknown."""
THERE_S: Final = 30.0
"""A station of which nothing was heard for so long is not there."""
FENCE_S: Final = 12.0
"""So long the loading of a mission waits for its fence to be in the autopilot."""
OPEN_TO_ALL: Final = (ReadMission, Control, Emergency, Query, Hello)
"""What a station may ask for without holding control."""
TAKES_AWAY: Final = (Command.GOQUIET, Command.STOP, Command.FINISH, Command.SHUTDOWN)

MOTION: Final = "motion"
"""The resource of what moves the vehicle."""
BEGINS: Final = (Verb.START, Verb.RETRY)
"""What may lead to a take-off."""

Say = Callable[[Severity, str], None]


class ForComponent(NamedTuple):
    """A message for a component."""

    component: str
    message: CommandRequest | FunctionRequest


class _Open(NamedTuple):
    request: CiRequest
    until_s: float
    is_kept: bool = True
    """Whether the reply goes into the journal: not that to what only looks, and may be done twice."""


class _FenceWait(NamedTuple):
    request: CiRequest
    findings: str
    until_s: float


class RequestHandler:
    """One for each life of the server. `handle` answers now, or later through `replied`."""

    def __init__(
        self, site: Site, facts: VehicleFacts, book: ComponentBook, authority: ControlAuthority, say: Say
    ) -> None:
        self.executor: MissionExecutor | None = None
        """None until what the process before has left is taken up again."""
        self.supervision: Supervision | None = None
        """Set by the server as soon as it works."""
        self._site, self._facts, self._book, self._authority, self._say = site, facts, book, authority, say
        self.gate: Final = StartGate(site, facts, book)
        """What every start has to pass."""
        self._senders = Senders()
        self._journal = Journal(site.journal)
        self._open: dict[str, _Open] = {}
        self._fence_wait: _FenceWait | None = None
        self._emergencies: dict[tuple[str, int], int] = {}
        self._software: dict[str, Software] = {}
        """Of the stations that have said hello."""
        self._count = 0
        self._hearsay = Hearsay(authority, say)
        self._watches: dict[tuple[str, int], int] = {}
        """The last life of each sender that looks, and the sequence of the last that it wanted to see."""
        self.for_components: list[ForComponent] = []
        self.disarms: list[EmergencyDisarm] = []
        """What the driver is to be told."""
        self.wants_everything = False
        """A station asked for the full state."""

    # --- requests ---

    def handle(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Carries out a request that has not been carried out yet; None if the answer comes later."""
        if request.role is StationRole.OBSERVER and not isinstance(request.body, LOOKS):
            return _answer(
                request, Outcome.REFUSED, f"station {request.sender} may look and not command: it is an observer"
            )
        self._authority.hear(request.sender, now_s)
        if isinstance(request.body, Hello | Control):
            self._software[request.sender] = Software(request.body.version, request.body.protocol)
        if doubled := self._senders.hear(request.sender, request.boot, now_s):
            self._say(Severity.WARNING, doubled)
        if isinstance(request.body, Query):
            return self._query(request, request.body)
        if isinstance(request.body, Watch | ListTopics):
            return self._look(request, now_s)
        if isinstance(request.body, Elsewhere):
            if self.executor is not None:
                self._hearsay.take(self.executor, request.sender, request.body, now_s)
            return None
        if isinstance(request.body, Preflight):
            return self.gate.answer(request, lambda at_s: self._list(request, at_s), now_s)
        known = self._journal.begin(request)
        if not known.is_new:
            return known.reply
        return self._try(request, lambda: self._carry_out(request, now_s))

    def _try(self, request: CiRequest, carry_out: Callable[[], CiReply | None]) -> CiReply | None:
        """Carries a request out; what is refused, and what was overtaken meanwhile, gets its reason as the answer."""
        reply: CiReply | None
        try:
            self._refuse_overtaken(request)
            reply = carry_out()
        except Gloc3Error as refusal:
            text = refusal.lines if isinstance(refusal, RedChecks) else ""
            reply = _answer(request, Outcome.REFUSED, str(refusal), text=text)
        if reply is not None and not isinstance(request.body, Preflight):
            self._journal.end(reply)
        return reply

    def _refuse_overtaken(self, request: CiRequest) -> None:
        """An emergency overtakes on the link; what its sender asked for before it is not done after it."""
        life = (request.sender, request.boot)
        if isinstance(request.body, Emergency):
            self._emergencies[life] = max(request.sequence, self._emergencies.get(life, -1))
        elif request.sequence < self._emergencies.get(life, -1):
            raise Refused("overtaken by an emergency; ask again if it is still wanted")

    def _query(self, request: CiRequest, body: Query) -> CiReply:
        outcome, reply = self._journal.query(request.sender, body.boot, body.sequence)
        if reply is not None:
            return _answer(request, outcome, reply.reason, text=reply.text, result=reply.result)
        return _answer(request, outcome, "nothing is known of that request")

    def _carry_out(self, request: CiRequest, now_s: float) -> CiReply | None:
        body: AnyBody = request.body
        if not isinstance(body, OPEN_TO_ALL):
            self._authority.require(request.sender)
        executor = self.executor
        if executor is None:
            raise Refused("the platform is starting; the autopilot has not answered yet")
        match body:
            case LoadMission():
                return self._load(request, body, executor, now_s)
            case ReadMission():
                if executor.mission is None:
                    raise Refused("no mission is loaded")
                return _answer(request, text=executor.mission.mission.text)
            case Steer(verb=verb) if verb in BEGINS:
                self._refuse_to_begin(body, executor)
                return self._start(request, lambda at_s: self._steer(request, body, executor, at_s), now_s)
            case Steer():
                return self._steer(request, body, executor, now_s)
            case RequestTask():
                return self._single(request, body.text, executor, now_s)
            case RequestAction():
                return self._single(request, self._as_mission(body, executor), executor, now_s)
            case CommandComponent():
                return self._command(request, body, executor, now_s)
            case CallFunction():
                return self._call(request, body, now_s)
            case Control():
                after_s = executor.board.policies.link_loss_after_s
                return _answer(request, reason=self._authority.handle(request.sender, body, after_s, now_s))
            case Emergency():
                return self._emergency(request, body, executor, now_s)
            case Hello():
                self.wants_everything = True
                return _answer(request)
        raise Refused("what only looks is answered elsewhere")

    # --- missions ---

    def circumstances(self) -> Circumstances:
        """What missions are checked against onboard.

        Raises:
            Refused: it is not known yet where the vehicle is.
        """
        facts = self._facts
        if facts.pose is None or facts.origin is None or facts.home_ned_m is None:
            raise Refused("it is not known yet where the vehicle is")
        return Circumstances(
            platform=self._site.platform,
            origin=facts.origin,
            home_altitude_m=facts.home_altitude_m,
            home_ned_m=facts.home_ned_m,
            start_ned_m=facts.pose.position_ned_m if facts.is_airborne else None,
        )

    def read_again(self, text: str) -> Mission:
        """A mission that was checked before the process ended; raises `InputError` where it cannot be read.

        It is not checked again: now it would begin elsewhere. Home tells where NED begins, even without a pose.
        """
        home = self._facts.home
        origin = GeoPoint(*home.origin_geo) if home is not None and home.origin_geo is not None else self._facts.origin
        altitude_m = None if home is None or origin is None else origin.altitude_m - home.position_ned_m[2]
        surroundings = Surroundings.of(self._site.platform, origin=origin, home_altitude_m=altitude_m)
        return read_mission(text, "kept mission", surroundings)

    def _load(self, request: CiRequest, body: LoadMission, executor: MissionExecutor, now_s: float) -> CiReply | None:
        report = check_text(body.text, body.name, self.circumstances())
        findings = "\n".join(str(finding) for finding in report.findings)
        if not report.is_ok:
            count = sum(not finding.is_warning for finding in report.findings)
            return _answer(request, Outcome.REFUSED, f"the mission has {count} error(s)", text=findings)
        executor.load(report.flyable(), now_s)
        if geofence_of(executor).areas:
            self._fence_wait = _FenceWait(request, findings, now_s + FENCE_S)
            return None
        return _answer(request, text=findings)

    def _steer(self, request: CiRequest, body: Steer, executor: MissionExecutor, now_s: float) -> CiReply:
        if body.verb is Verb.CLEAR:
            executor.clear(now_s)
        else:
            if body.verb in BEGINS:
                self._refuse_to_begin(body, executor)
            executor.steer(body.verb, body.target, now_s, self._facts.home_ned_m)
        return _answer(request)

    # --- starts ---

    def _start(self, request: CiRequest, begin: Begin, now_s: float) -> CiReply | None:
        """Begins what may lead to a take-off if the pre-flight list allows it; in the air nothing is held against it."""

        def judged(at_s: float) -> CiReply:
            self._authority.require(request.sender)
            override = self.gate.let_through(request, self._report(at_s))
            reply = begin(at_s)
            if override:
                self._say(Severity.WARNING, override)
            return reply

        return begin(now_s) if self._facts.is_airborne else self.gate.answer(request, judged, now_s)

    def _report(self, now_s: float) -> PreflightReport:
        executor = self.executor
        is_held = executor is None or self._fence_progress(executor) is FenceProgress.CONFIRMED
        program = executor.mission if executor is not None else None
        mission = program.mission if program is not None else None
        self.gate.stations = {
            name: one for name, one in self._software.items() if self._authority.is_heard(name, now_s, THERE_S)
        }
        return self.gate.report(mission, "" if is_held else self._fence_problem(), now_s)

    def _list(self, request: CiRequest, now_s: float) -> CiReply:
        report = self._report(now_s)
        return _answer(request, reason=summary(report.checks), result=msgspec.to_builtins(report))

    def _refuse_to_begin(self, body: Steer, executor: MissionExecutor) -> None:
        """What no operator can override."""
        if body.verb is Verb.START and (problem := self._facts.autopilot_problem):
            raise Refused(problem)
        if body.verb is Verb.START and not body.target:
            self._refuse_without_fence(executor)

    def _refuse_without_fence(self, executor: MissionExecutor) -> None:
        """A mission with a fence on Earth starts when the autopilot has given the same fence back."""
        if self._fence_progress(executor) is not FenceProgress.CONFIRMED:
            raise Refused(self._fence_problem())

    def _fence_progress(self, executor: MissionExecutor) -> FenceProgress:
        wanted, held = geofence_of(executor), self._facts.fence
        if not wanted.areas:
            return FenceProgress.CONFIRMED
        return held.progress if held is not None and held.digest == wanted.digest else FenceProgress.NONE

    def _fence_problem(self) -> str:
        held = self._facts.fence
        return f"the autopilot does not hold the mission's fence: {held.reason if held and held.reason else 'not uploaded yet'}"

    def _fence_answer(self, now_s: float) -> list[CiReply]:
        """A mission with a fence on Earth is loaded when the autopilot has given its fence back, or will not."""
        wait = self._fence_wait
        if wait is None or self.executor is None:
            return []
        progress = self._fence_progress(self.executor)
        if progress is FenceProgress.CONFIRMED:
            answer = _answer(wait.request, text=wait.findings)
        elif progress is FenceProgress.FAILED or now_s > wait.until_s:
            answer = _answer(wait.request, Outcome.REFUSED, self._fence_problem(), text=wait.findings)
        else:
            return []
        self._fence_wait = None
        self._journal.end(answer)
        return [answer]

    def _single(self, request: CiRequest, text: str, executor: MissionExecutor, now_s: float) -> CiReply | None:
        report = check_text(text, "command", self.circumstances())
        if not report.is_ok:
            first = next(finding for finding in report.findings if not finding.is_warning)
            findings = "\n".join(str(finding) for finding in report.findings)
            return _answer(request, Outcome.REFUSED, first.message, text=findings)
        mission, rows = report.flyable(), self._site.platform.capabilities

        def begin(at_s: float) -> CiReply:
            return _answer(request, reason=executor.command(mission, at_s))

        wanted = {one.capability for one in mission.actions().values()}
        if not any(MOTION in row.claims for name, row in rows.items() if name in wanted):
            return begin(now_s)
        if not self._facts.is_airborne and self._facts.autopilot_problem:
            raise Refused(self._facts.autopilot_problem)
        return self._start(request, begin, now_s)

    def _as_mission(self, body: RequestAction, executor: MissionExecutor) -> str:
        frames = list(self._site.platform.frames)
        geo_keys = ("waypoints", "position", "at")
        frame = "geo" if not frames or any(key in body.arguments for key in geo_keys) else frames[0]
        name = executor.free_name()
        action = {body.capability: body.arguments}
        return json.dumps({"mission": name, "frame": frame, "tasks": {name: {"actions": {body.capability: action}}}})

    def _emergency(self, request: CiRequest, body: Emergency, executor: MissionExecutor, now_s: float) -> CiReply:
        author = body.author or f"station {request.sender}"
        match body.verb:
            case EmergencyVerb.HOLD:
                executor.emergency("hold", author, now_s)
            case EmergencyVerb.LAND:
                executor.emergency("land", author, now_s)
            case EmergencyVerb.DISARM:
                if body.confirmation != self._site.platform.platform:
                    raise Refused(f"to disarm, type the platform's name: {self._site.platform.platform}")
                self._disarm(author, executor, now_s)
        return _answer(request, reason=f"emergency {body.verb} by {author}")

    def _disarm(self, author: str, executor: MissionExecutor, now_s: float) -> None:
        self._say(Severity.ALERT, f"emergency disarm by {author}")
        self.disarms.append(EmergencyDisarm(author=author))
        if executor.mission is not None and executor.mission.is_open:
            executor.steer("abort", "", now_s)

    # --- components ---

    def _command(
        self, request: CiRequest, body: CommandComponent, executor: MissionExecutor, now_s: float
    ) -> CiReply | None:
        row = self._book.rows.get(body.component)
        if row is None:
            raise Refused(f"there is no component {body.component!r}; there are: {', '.join(self._book.rows)}")
        state = self._book.state(body.component, now_s)
        if body.command != CREATE:
            try:
                command = Command(body.command)
            except ValueError:
                raise Refused(f"{body.command!r} is no command; known: {', '.join(Command)}, {CREATE}") from None
            if state is None:
                raise Refused(f"{command} is not accepted: the component is absent; accepted: {CREATE}")
            transition(state, command)
            if self.supervision is not None:
                self.supervision.check(body.component, [command])
            if command in TAKES_AWAY and state in OPERATING:
                self._refuse_if_needed(body, executor, now_s)
        self._count += 1
        request_id = f"ci-{self._count}"
        self._open[request_id] = _Open(request, now_s + ANSWER_S)
        message = CommandRequest(request_id=request_id, command=body.command, settings=body.settings)
        self.for_components.append(ForComponent(body.component, message))
        self._say(Severity.INFO, f"station {request.sender}: {body.command} {body.component}")
        return None

    def _refuse_if_needed(self, body: CommandComponent, executor: MissionExecutor, now_s: float) -> None:
        row = self._book.rows[body.component]
        provides = [topic for port in row.load_class().outputs for topic in row.topics(port)]
        if row.standby_for is not None and self.supervision is not None:
            if self.supervision.in_charge(body.component) != body.component:
                return  # a quiet standby: somebody else performs its function
            provides.append(row.standby_for)
        users = executor.in_use(body.component, tuple(provides))
        if not users:
            return
        if not body.is_forced:
            raise Refused(f"{', '.join(users)} needs {body.component}; pause or abort it first, or {FORCE}")
        reason = f"taken away by {body.command}, forced"
        executor.taken_away(body.component, tuple(provides), reason, now_s)

    def _call(self, request: CiRequest, body: CallFunction, now_s: float) -> CiReply | None:
        if body.component not in self._book.rows:
            raise Refused(f"there is no component {body.component!r}; there are: {', '.join(self._book.rows)}")
        if body.function.startswith("action."):
            raise Refused("actions are requested from the platform, not from its components")
        self._count += 1
        request_id = f"ci-{self._count}"
        self._open[request_id] = _Open(request, now_s + ANSWER_S)
        message = FunctionRequest(request_id=request_id, function=body.function, arguments=body.arguments)
        self.for_components.append(ForComponent(body.component, message))
        return None

    def _look(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Hands what only looks, and needs no control, to the component that shows topics.

        A want that comes after a newer one of its sender is not taken: it would bring back what nobody looks at.
        """
        body, life = request.body, (request.sender, request.boot)
        if isinstance(body, Watch):
            if request.sequence < self._watches.get(life, -1):
                return _answer(request, Outcome.REFUSED, "overtaken by a newer one")
            self._watches = {
                **{each: n for each, n in self._watches.items() if each[0] != life[0]},
                life: request.sequence,
            }
            wants = [list(msgspec.structs.astuple(want)) for want in body.wants]
            arguments = {"station": request.sender, "wants": wants, "is_listing": body.is_listing}
            return self._ask_viewer(request, "watch", arguments, now_s)
        return self._ask_viewer(request, "topics", {}, now_s)

    def _ask_viewer(self, request: CiRequest, function: str, arguments: dict[str, Any], now_s: float) -> CiReply | None:
        name = next((name for name, row in self._book.rows.items() if function in row.load_class().functions), None)
        if name is None:
            return _answer(request, Outcome.REFUSED, "this platform shows no topics: it has no viewer")
        self._count += 1
        request_id = f"ci-{self._count}"
        self._open[request_id] = _Open(request, now_s + ANSWER_S, is_kept=False)
        message = FunctionRequest(request_id=request_id, function=function, arguments=arguments)
        self.for_components.append(ForComponent(name, message))
        return None

    def replied(self, reply: CommandReply | FunctionReply) -> CiReply | None:
        """A component has answered; None if that was not asked for by a station."""
        entry = self._open.pop(reply.request_id, None)
        if entry is None:
            return None
        outcome = Outcome.ACCEPTED if reply.is_accepted else Outcome.REFUSED
        result: Mapping[str, Any] = (
            reply.result if isinstance(reply, FunctionReply) else {"state": reply.state or "absent"}
        )
        answer = _answer(entry.request, outcome, reply.reason, result=dict(result))
        if entry.is_kept:
            self._journal.end(answer)
        return answer

    def expire(self, now_s: float) -> list[CiReply]:
        """The answers to requests that have waited: for a fence, or for a component that has not answered."""
        late = [request_id for request_id, entry in self._open.items() if now_s > entry.until_s]
        answers = self._fence_answer(now_s)
        for held in self.gate.due(now_s):
            judged = self._try(held.request, partial(held.answer, now_s))
            answers += [] if judged is None else [judged]
        for request_id in late:
            request, _, is_kept = self._open.pop(request_id)
            answer = _answer(request, Outcome.UNKNOWN, f"the component has not answered within {ANSWER_S:g} s")
            if is_kept:
                self._journal.end(answer)
            answers.append(answer)
        return answers


def _answer(
    request: CiRequest,
    outcome: Outcome = Outcome.ACCEPTED,
    reason: str = "",
    *,
    text: str = "",
    result: dict[str, Any] | None = None,
) -> CiReply:
    return CiReply(
        sender=request.sender,
        boot=request.boot,
        sequence=request.sequence,
        outcome=outcome,
        reason=reason,
        text=text,
        result=result or {},
    )
