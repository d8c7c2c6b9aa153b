"""Carries out what stations ask for: authority and checks here, the work in the executor and the components."""

import json
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

import msgspec

from gloc3.errors import Finding, Gloc3Error, Refused
from gloc3.messages.command_interface import (
    LOOKS,
    AboutLogs,
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
    ReadReports,
    RequestAction,
    RequestTask,
    StationRole,
    Steer,
    Verb,
    Watch,
)
from gloc3.messages.envelope import CommandReply, FunctionReply, Severity
from gloc3.messages.frames import GeoPoint
from gloc3.messages.preflight import PreflightReport, summary
from gloc3.messages.software import Software
from gloc3.messages.vehicle import EmergencyDisarm, FenceProgress
from gloc3.mission.checking.checker import Circumstances, Report
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.model.abilities import abilities
from gloc3.mission.model.model import Mission
from gloc3.mission.reading.reader import Surroundings, read_mission
from gloc3_onboard.command_server.answers import answer
from gloc3_onboard.command_server.book import ComponentBook
from gloc3_onboard.command_server.component_requests import Answered, ComponentRequests, Say
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.control import ControlAuthority
from gloc3_onboard.command_server.facts import VehicleFacts
from gloc3_onboard.command_server.hearsay import Hearsay
from gloc3_onboard.command_server.held_back import AT_ONCE_S, LONGEST_S
from gloc3_onboard.command_server.journal import Journal
from gloc3_onboard.command_server.mission_checks import Checked, MissionChecks
from gloc3_onboard.command_server.senders import Senders
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.command_server.start_gate import Begin, Held, RedChecks, StartGate
from gloc3_onboard.command_server.summaries import geofence_of

THERE_S: Final = 30.0
"""A station of which nothing was heard for so long is not there."""
URGENT_S: Final = 8.0
"""So long an emergency waits for a platform that is only just starting."""
FENCE_S: Final = 12.0
"""So long the loading of a mission waits for its fence to be in the autopilot."""
OPEN_TO_ALL: Final = (ReadMission, Control, Emergency, Query, Hello)
"""What a station may ask for without holding control."""

MOTION: Final = "motion"
"""The resource of what moves the vehicle."""
MOST_FINDINGS: Final = 100
"""Of a mission: more would go over no radio."""
BEGINS: Final = (Verb.START, Verb.RETRY)
"""What may lead to a take-off."""


class _FenceWait(NamedTuple):
    request: CiRequest
    findings: str
    until_s: float


class _Urgent(NamedTuple):
    request: CiRequest
    until_s: float


class _Noted(NamedTuple):
    request: CiRequest
    mark: int
    until_s: float


class RequestHandler:
    """One for each life of the server. `handle` answers now, or later through `replied`."""

    def __init__(
        self,
        site: Site,
        facts: VehicleFacts,
        book: ComponentBook,
        authority: ControlAuthority,
        contacts: Contacts,
        say: Say,
    ) -> None:
        self.executor: MissionExecutor | None = None
        """None until what the process before has left is taken up again."""
        self._contacts = contacts
        self._site, self._facts, self._book, self._authority, self._say = site, facts, book, authority, say
        self.gate: Final = StartGate(site, facts, book)
        """What every start has to pass."""
        self.components: Final = ComponentRequests(book, say)
        """What is asked of components."""
        self._checks = MissionChecks(site.worker)
        self._senders = Senders()
        self._journal = Journal(site.journal)
        self._fence_wait: _FenceWait | None = None
        self._urgent: list[_Urgent] = []
        """Emergencies for which there is no executor yet."""
        self._noted: deque[_Noted] = deque()
        """What is on its way to the disk: only then it is carried out, so that a power cut has nothing done twice."""
        self._emergencies: dict[tuple[str, int], int] = {}
        self._software: dict[str, Software] = {}
        """Of the stations that have said hello."""
        self._hearsay = Hearsay(authority, say)
        self.disarms: list[EmergencyDisarm] = []
        """What the driver is to be told."""
        self.wants_everything = False
        """A station asked for the full state."""

    # --- requests ---

    @property
    def is_urgent(self) -> bool:
        """Whether an emergency waits for what was kept to be taken up."""
        return bool(self._urgent)

    def handle(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Carries out a request that has not been carried out yet; None if the answer comes later."""
        if request.role is StationRole.OBSERVER and not isinstance(request.body, LOOKS):
            return answer(
                request, Outcome.REFUSED, f"station {request.sender} may look and not command: it is an observer"
            )
        self._authority.hear(request.sender, now_s)
        if isinstance(request.body, Hello | Control):
            self._software[request.sender] = Software(request.body.version, request.body.protocol)
        if doubled := self._senders.hear(request.sender, request.boot, now_s):
            self._say(Severity.WARNING, doubled)
        if isinstance(request.body, Query):
            return self._query(request, request.body)
        if isinstance(request.body, AboutLogs):
            return self._site.shelf.ask(request)
        if isinstance(request.body, ReadReports):
            return self._contacts.read(request, request.body)
        if isinstance(request.body, Watch | ListTopics):
            return self.components.look(request, now_s)
        if isinstance(request.body, Elsewhere):
            if self.executor is not None:
                self._hearsay.take(self.executor, request.sender, request.body, now_s)
            return None
        if isinstance(request.body, Preflight):
            return self.gate.answer(request, lambda at_s: self._list(request, at_s), now_s)
        known = self._journal.begin(request)
        if not known.is_new:
            return known.reply
        if isinstance(request.body, Emergency):
            if self.executor is None:
                self._urgent.append(_Urgent(request, now_s + URGENT_S))
                return None
        elif self._noted or not self._site.journal.wait(self._site.journal.mark(), AT_ONCE_S):
            self._noted.append(_Noted(request, self._site.journal.mark(), now_s + LONGEST_S))
            return None
        return self._try(request, lambda: self._carry_out(request, now_s))

    def _try(self, request: CiRequest, carry_out: Callable[[], CiReply | None]) -> CiReply | None:
        """Carries a request out; what is refused, and what was overtaken meanwhile, gets its reason as the answer."""
        reply: CiReply | None
        try:
            self._refuse_overtaken(request)
            reply = carry_out()
        except Gloc3Error as refusal:
            text = refusal.lines if isinstance(refusal, RedChecks) else ""
            reply = answer(request, Outcome.REFUSED, str(refusal), text=text)
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
            return answer(request, outcome, reply.reason, text=reply.text, result=reply.result)
        return answer(request, outcome, "nothing is known of that request")

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
                return answer(request, text=executor.mission.mission.text)
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
                self.components.command(request, body, executor, now_s)
                return None
            case CallFunction():
                self.components.call(request, body, now_s)
                return None
            case Control():
                after_s = executor.board.policies.link_loss_after_s
                return answer(request, reason=self._authority.handle(request.sender, body, after_s, now_s))
            case Emergency():
                return self._emergency(request, body, executor, now_s)
            case Hello():
                self.wants_everything = True
                return answer(request)
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
        executor.refuse_under_way()  # before the check, which takes its time, and the vehicle is on its way

        def judge(report: Report, at_s: float) -> CiReply | None:
            self._authority.require(request.sender)
            findings = _lines(report.findings)
            if not report.is_ok:
                count = sum(not finding.is_warning for finding in report.findings)
                return answer(request, Outcome.REFUSED, f"the mission has {count} error(s)", text=findings)
            executor.load(report.flyable(), at_s)
            if geofence_of(executor).areas:
                self._fence_wait = _FenceWait(request, findings, at_s + FENCE_S)
                return None
            return answer(request, text=findings)

        return self._checks.answer(request, body.text, body.name, self.circumstances(), judge, now_s)

    def _steer(self, request: CiRequest, body: Steer, executor: MissionExecutor, now_s: float) -> CiReply:
        if body.verb is Verb.CLEAR:
            executor.clear(now_s)
        else:
            if body.verb in BEGINS:
                self._refuse_to_begin(body, executor)
            executor.steer(body.verb, body.target, now_s, self._facts.home_ned_m)
        return answer(request)

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
        return answer(request, reason=summary(report.checks), result=msgspec.to_builtins(report))

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
            reply = answer(wait.request, text=wait.findings)
        elif progress is FenceProgress.FAILED or now_s > wait.until_s:
            reply = answer(wait.request, Outcome.REFUSED, self._fence_problem(), text=wait.findings)
        else:
            return []
        self._fence_wait = None
        self._journal.end(reply)
        return [reply]

    def _single(self, request: CiRequest, text: str, executor: MissionExecutor, now_s: float) -> CiReply | None:
        def judge(report: Report, checked_s: float) -> CiReply | None:
            self._authority.require(request.sender)
            if not report.is_ok:
                first = next(finding for finding in report.findings if not finding.is_warning)
                return answer(request, Outcome.REFUSED, first.message, text=_lines(report.findings))
            mission, rows = report.flyable(), abilities(self._site.platform)

            def begin(at_s: float) -> CiReply:
                return answer(request, reason=executor.command(mission, at_s))

            wanted = {one.ability for one in mission.actions().values()}
            if not any(MOTION in row.claims for name, row in rows.items() if name in wanted):
                return begin(checked_s)
            if not self._facts.is_airborne and self._facts.autopilot_problem:
                raise Refused(self._facts.autopilot_problem)
            return self._start(request, begin, checked_s)

        return self._checks.answer(request, text, "command", self.circumstances(), judge, now_s)

    def _as_mission(self, body: RequestAction, executor: MissionExecutor) -> str:
        frames = list(self._site.platform.frames)
        geo_keys = ("waypoints", "position", "at")
        frame = "geo" if not frames or any(key in body.arguments for key in geo_keys) else frames[0]
        name = executor.free_name()
        action = {body.capability: body.arguments}
        mission = {"mission": name, "frame": frame, "tasks": {name: {"actions": {body.capability: action}}}}
        try:
            return json.dumps(mission)
        except (TypeError, RecursionError) as error:  # bytes and times travel, and say nothing in a mission
            raise Refused(f"the arguments of {body.capability} cannot be read: {error}") from None

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
        return answer(request, reason=f"emergency {body.verb} by {author}")

    def _disarm(self, author: str, executor: MissionExecutor, now_s: float) -> None:
        self._say(Severity.ALERT, f"emergency disarm by {author}")
        self.disarms.append(EmergencyDisarm(author=author))
        if executor.mission is not None and executor.mission.is_open:
            executor.steer("abort", "", now_s)

    # --- answers that come later ---

    def replied(self, reply: CommandReply | FunctionReply) -> CiReply | None:
        """A component has answered; None if that was not asked for by a station."""
        found = self.components.replied(reply)
        return None if found is None else self._kept(found)

    def expire(self, now_s: float) -> list[CiReply]:
        """The answers to requests that have waited: for the disk, a check, a fence, or a component that has not answered."""
        answers = self._fence_answer(now_s)
        while self._noted and self._is_kept(self._noted[0], now_s):
            noted = self._noted.popleft().request
            reply = self._try(noted, partial(self._carry_out, noted, now_s))
            answers += [] if reply is None else [reply]
        for urgent in list(self._urgent):
            if self.executor is not None or now_s >= urgent.until_s:
                self._urgent.remove(urgent)
                reply = self._try(urgent.request, partial(self._carry_out, urgent.request, now_s))
                answers += [] if reply is None else [reply]
        ready: list[Checked | Held] = [*self._checks.due(), *self.gate.due(now_s)]
        for one in ready:
            judged = self._try(one.request, partial(one.answer, now_s))
            answers += [] if judged is None else [judged]
        return [*answers, *(self._kept(found) for found in self.components.expire(now_s))]

    def _is_kept(self, noted: _Noted, now_s: float) -> bool:
        return now_s >= noted.until_s or self._site.journal.wait(noted.mark, 0.0)

    def _kept(self, found: Answered) -> CiReply:
        if found.is_kept:
            self._journal.end(found.reply)
        return found.reply


def _lines(findings: Sequence[Finding]) -> str:
    """Findings as they are told to a station, errors first where they are too many."""
    told = findings
    if len(findings) > MOST_FINDINGS:
        told = sorted(findings, key=lambda finding: finding.is_warning)[:MOST_FINDINGS]
    more = len(findings) - len(told)
    return "\n".join([*map(str, told), *([f"and {more:,} more"] if more else [])])
