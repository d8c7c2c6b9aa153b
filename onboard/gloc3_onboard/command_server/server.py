"""CI: the platform's command interface server: the one path from stations to components, and the mission's executor."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

import msgspec

from gloc3.component.component import CommandInterface
from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup, Result
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import (
    QUERIES,
    AboutLogs,
    AnyBody,
    CallFunction,
    CiReply,
    CiRequest,
    CommandComponent,
    Control,
    ControlVerb,
    Elsewhere,
    Emergency,
    Hello,
    ListTopics,
    LoadMission,
    LogChunk,
    Outcome,
    Preflight,
    Query,
    ReadMission,
    ReadReports,
    RequestAction,
    RequestTask,
    Steer,
    Watch,
)
from gloc3.messages.envelope import CommandReply, CommandRequest, FunctionReply
from gloc3.messages.preflight import PreflightReport
from gloc3.messages.readiness import ReadSetup
from gloc3.messages.vehicle import EmergencyDisarm
from gloc3.network.rights import FLIGHTS
from gloc3_onboard.command_server.authority import Authority, AuthorityPorts
from gloc3_onboard.command_server.component_requests import Answered, ComponentRequests
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.inventory import VehicleInventory
from gloc3_onboard.command_server.journal import Journal, answer
from gloc3_onboard.command_server.mission_commands import MissionCommands
from gloc3_onboard.command_server.mission_host import MissionHost, MissionPorts, was_running
from gloc3_onboard.command_server.neighbours import NeighbourPorts, NeighbourReports
from gloc3_onboard.command_server.observing import Observing, ObservingPorts
from gloc3_onboard.command_server.reporting import AT_ONCE_S, LONGEST_S, EventQueue, Reporting, ReportingPorts
from gloc3_onboard.command_server.site import ServerSettings, Site
from gloc3_onboard.command_server.start_gate import RedChecks

URGENT_S: Final = 8.0
"""So long an emergency waits for a platform that is only just starting."""
LONGEST_LIMIT_S: Final = 1800.0
"""Time limits of requests are shorter, those of the largest missions over the slowest links included."""
MOST_LIVES: Final = 64
"""Lives of stations whose last emergency is remembered."""
OPEN_TO_ALL: Final = (ReadMission, Control, Emergency, Query, Hello)
"""What a station may ask for without holding control."""


class RequestPorts(PortGroup):
    """Inputs and outputs of the request handler."""

    request = Input(CiRequest, Keep.ALL)
    function_reply = Input(FunctionReply, Keep.ALL)

    ci_reply = Output(CiReply)
    log_chunk = Output(LogChunk)
    read_setup = Output(ReadSetup)
    preflight = Output(PreflightReport)
    emergency = Output(EmergencyDisarm)


class _Urgent(NamedTuple):
    request: CiRequest
    until_s: float


class _Noted(NamedTuple):
    request: CiRequest
    mark: int
    until_s: float


def time_limit(request: CiRequest, now_s: float) -> str:
    """Why a request comes too late to be carried out; empty if it does not, has no time limit, or only reads."""
    if request.until_s <= 0.0 or isinstance(request.body, QUERIES):
        return ""
    left_s = request.until_s - now_s
    if left_s > LONGEST_LIMIT_S:
        return f"its time limit is {left_s:.0f} s ahead: the platform's clock has started again since; send it again"
    if left_s < 0.0:
        return f"it came {-left_s:.1f} s after its time limit; send it again if it is still wanted"
    return ""


def _key(request: CiRequest) -> tuple[str, int, int]:
    return request.sender, request.boot, request.sequence


class RequestHandler:
    """Handler of stations' requests; answers in `handle`, or later in `replied` and `expire`.

    Args:
        site: the journal and the logs.
        authority: permissions to command.
        missions: carries out mission commands.
        components: carries out component commands.
        contacts: reports delivered to stations.
        neighbours: other vehicles, for the limiter.
        inventory: of the vehicle.
    """

    def __init__(
        self,
        site: Site,
        authority: Authority,
        missions: MissionCommands,
        components: ComponentRequests,
        contacts: Contacts,
        neighbours: NeighbourReports,
        inventory: VehicleInventory,
    ) -> None:
        self.missions: Final = missions
        self.components: Final = components
        self.neighbours: Final = neighbours
        self.inventory: Final = inventory
        self._site, self._authority, self._contacts = site, authority, contacts
        self._journal = Journal(site.journal)
        self._urgent: list[_Urgent] = []
        """Emergencies for which there is no executor yet."""
        self._noted: deque[_Noted] = deque()
        """Requests on their way to the disk; carried out only then, so that a power cut repeats nothing."""
        self._emergencies: dict[tuple[str, int], int] = {}
        """The last emergency of each life of a station."""
        self._overtaken: set[tuple[str, int, int]] = set()
        """Requests of anybody that waited when an emergency came, by sender, boot and sequence."""
        self.wants_everything = False
        """Whether a station has requested the full state."""

    # --- requests ---

    @property
    def is_urgent(self) -> bool:
        """Whether an emergency is waiting for the restoration of the stored state."""
        return bool(self._urgent)

    def handle(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Carries out a request that has not been carried out yet; None if the answer comes later."""
        if refusal := self._authority.receive(request, now_s):
            return answer(request, Outcome.REFUSED, refusal)
        if isinstance(request.body, Query):
            return self._query(request, request.body)
        if isinstance(request.body, AboutLogs):
            return self._site.log_store.handle(request)
        if isinstance(request.body, ReadReports):
            return self._contacts.read(request, request.body)
        if isinstance(request.body, Watch | ListTopics):
            return self.components.forward_query(request, now_s)
        if isinstance(request.body, Hello) and request.body.is_about_inventory:
            return answer(request, result={"inventory": msgspec.to_builtins(self.inventory.read())})
        if isinstance(request.body, Hello) and request.body.is_about_rights:
            return self._greet(request)
        late = time_limit(request, now_s)
        if isinstance(request.body, Elsewhere):
            if request.body.vehicles:
                if not late and request.sender == self._authority.control.holder:
                    self.neighbours.receive(request.body.vehicles, self.missions.origin, now_s)
            elif not late:
                self.missions.elsewhere(request.sender, request.body, now_s)
            return None
        if isinstance(request.body, Preflight):
            return self.missions.preflight(request, now_s)
        known = self._journal.begin(request)
        if not known.is_new:
            return known.reply
        if late:
            reply = answer(request, Outcome.REFUSED, late)
            self._journal.end(reply)
            return reply
        if isinstance(request.body, Emergency):
            if not self.missions.is_ready:
                self._urgent.append(_Urgent(request, now_s + URGENT_S))
                return None
        elif self._noted or not self._site.journal.wait(self._site.journal.mark(), AT_ONCE_S):
            self._noted.append(_Noted(request, self._site.journal.mark(), now_s + LONGEST_S))
            return None
        return self._try(request, lambda: self._carry_out(request, now_s))

    def _try(self, request: CiRequest, carry_out: Callable[[], CiReply | None]) -> CiReply | None:
        """Carries a request out; a refused or superseded one is answered with its reason."""
        reply: CiReply | None
        try:
            self._refuse_overtaken(request)
            reply = carry_out()
        except Gloc3Error as refusal:
            text, result = "", None
            if isinstance(refusal, RedChecks):
                text, result = refusal.lines, {"may_settle": refusal.may_settle}
            reply = answer(request, Outcome.REFUSED, str(refusal), text=text, result=result)
        if reply is not None and not isinstance(request.body, Preflight):
            self._journal.end(reply)
        return reply

    def _refuse_overtaken(self, request: CiRequest) -> None:
        """Refuses requests superseded by an emergency.

        Those are the requests of the same sender that the emergency has overtaken on the link, and those of anybody that
        were waiting here when it came.
        """
        life, key = (request.sender, request.boot), _key(request)
        if isinstance(request.body, Emergency):
            self._emergencies[life] = max(request.sequence, self._emergencies.pop(life, -1))
            if len(self._emergencies) > MOST_LIVES:
                del self._emergencies[next(iter(self._emergencies))]
            waiting = [*(noted.request for noted in self._noted), *self.missions.waiting]
            self._overtaken = {_key(one) for one in waiting if not isinstance(one.body, Preflight)}
        elif request.sequence < self._emergencies.get(life, -1) or key in self._overtaken:
            self._overtaken.discard(key)
            raise Refused("superseded by an emergency; send it again if it is still wanted")

    def _query(self, request: CiRequest, body: Query) -> CiReply:
        outcome, reply = self._journal.query(request.sender, body.boot, body.sequence)
        if reply is not None:
            return answer(request, outcome, reply.reason, text=reply.text, result=reply.result)
        return answer(request, outcome, "that request is not known")

    def _carry_out(self, request: CiRequest, now_s: float) -> CiReply | None:
        body: AnyBody = request.body
        if not isinstance(body, OPEN_TO_ALL):
            self._authority.require(request)
        if not isinstance(body, FLIGHTS):  # these are checked first, and then known to have a geofence or none
            self._authority.second(request)
        executor = self.missions.executor
        match body:
            case LoadMission():
                return self.missions.load(request, body, now_s)
            case ReadMission():
                return self.missions.read(request)
            case Steer():
                return self.missions.steer(request, body, now_s)
            case RequestTask() | RequestAction():
                return self.missions.single(request, body, now_s)
            case Emergency():
                return self.missions.emergency(request, body, now_s)
            case CommandComponent():
                self.components.command(request, body, executor, now_s)
                return None
            case CallFunction():
                self.components.call(request, body, now_s)
                return None
            case Control(verb=ControlVerb.OPERATED):
                return self.missions.operated(request, body, now_s)
            case Control():
                after_s = executor.board.policies.link_loss_after_s
                return answer(request, reason=self._authority.handle(request, body, after_s, now_s))
            case Hello():
                self.wants_everything = True
                return self._greet(request)
        raise Refused("queries are answered elsewhere")

    def _greet(self, request: CiRequest) -> CiReply:
        rights = self._authority.rights
        return answer(request, result={} if rights.is_open else msgspec.to_builtins(rights.summary(request.member)))

    # --- answers that come later ---

    def replied(self, reply: CommandReply | FunctionReply) -> CiReply | None:
        """Handles a component's reply; None if no station requested it."""
        found = self.components.replied(reply)
        return None if found is None else self._kept(found)

    def expire(self, now_s: float) -> list[CiReply]:
        """The answers to requests that have waited: for the disk, a check, a fence, or a component that has not answered."""
        answers = self.missions.fence_answer(now_s)
        for one in answers:
            self._journal.end(one)
        while self._noted and self._is_kept(self._noted[0], now_s):
            noted = self._noted.popleft().request
            reply = self._try(noted, partial(self._carry_out, noted, now_s))
            answers += [] if reply is None else [reply]
        for urgent in list(self._urgent):
            if self.missions.is_ready or now_s >= urgent.until_s:
                self._urgent.remove(urgent)
                reply = self._try(urgent.request, partial(self._carry_out, urgent.request, now_s))
                answers += [] if reply is None else [reply]
        for waiting in self.missions.due(now_s):
            judged = self._try(waiting.request, partial(waiting.answer, now_s))
            answers += [] if judged is None else [judged]
        return [*answers, *(self._kept(found) for found in self.components.expire(now_s))]

    def _is_kept(self, noted: _Noted, now_s: float) -> bool:
        return now_s >= noted.until_s or self._site.journal.wait(noted.mark, 0.0)

    def _kept(self, found: Answered) -> CiReply:
        if found.is_kept:
            self._journal.end(found.reply)
        return found.reply


class CommandServer(CommandInterface[ServerSettings]):
    """Checks authority, claims and states; runs missions; supervises; summarises. Each part does one of these."""

    loggable = ("holder", "policy")

    requested = RequestPorts
    stations = AuthorityPorts
    observed = ObservingPorts
    missions = MissionPorts
    reported = ReportingPorts
    nearby = NeighbourPorts

    def __init__(self, site: Site) -> None:
        self.holder = self.policy = ""
        self._site = site

    def start(self) -> None:
        """Reads the previous process's state; it is restored once the autopilot has reported its own."""
        site = self._site
        snapshot, home = site.load()
        self._events = EventQueue(site)
        report = self._events.report
        contacts = Contacts(site.reports)
        self._observing = Observing(site.platform, home, self._events.report_supervision, site.process)
        self._authority = Authority(site.holder if was_running(snapshot) else "", report, site.rights)
        self._mission = MissionHost(site, self._observing, self._authority.control, self.settings, report)
        commands = MissionCommands(site, self._observing, self._authority, self._mission, report)
        components = ComponentRequests(self._observing, report)
        self._neighbours = NeighbourReports(site.platform.platform, report)
        self._inventory = VehicleInventory(site, self._observing)
        self._requests = RequestHandler(
            site, self._authority, commands, components, contacts, self._neighbours, self._inventory
        )
        self._reporting = Reporting(site, self.settings, self._events, contacts)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Handles all input, decides, and returns the results."""
        self._events.now_s = now_s
        self._observing.observe(now_s, inbox)
        self._authority.observe(now_s, inbox)
        self._neighbours.observe(inbox)
        self._inventory.observe(now_s)
        self._reporting.observe(now_s, inbox)
        results: list[Result] = [*self._observing.supervise(now_s, inbox)]
        # what is asked for now is judged by what is known now
        results += self._mission.observe(now_s, inbox, is_urgent=self._requests.is_urgent)
        for request in inbox.new(RequestPorts.request):
            answer = self._requests.handle(request.payload, now_s)
            results += [] if answer is None else [answer]
        results += self._authority.demands.newest(inbox.new(AuthorityPorts.velocity_demand), now_s)
        results += self._receive_replies(now_s, inbox)
        results += [*self._requests.expire(now_s), *self._site.log_store.collect()]
        wanted = self._mission.take(now_s)
        for one in wanted:
            results += self._mission.carry_out(one)
        results += self._outgoing()
        self._authority.control.tick(now_s)
        self._keep()
        if self._requests.wants_everything:
            self._requests.wants_everything = False
            self._reporting.repeat_all()
        is_eventful = bool(wanted or inbox.new(RequestPorts.request))
        results += self._reporting.report(
            now_s, self._observing, self._authority.control, self._mission, is_eventful=is_eventful
        )
        return self._reporting.release(results, now_s)

    def _receive_replies(self, now_s: float, inbox: Inbox) -> list[Result]:
        replies: list[CommandReply | FunctionReply] = [reply.payload for reply in inbox.new(ObservingPorts.reply)]
        replies += [reply.payload for reply in inbox.new(RequestPorts.function_reply)]
        results: list[Result] = []
        for reply in replies:
            if not self._mission.receive_reply(reply, now_s):
                answer = self._requests.replied(reply)
                results += [] if answer is None else [answer]
        return results

    def _outgoing(self) -> list[Result]:
        """Stations' requests for components, the driver and the reader of the autopilot's setup."""
        results: list[Result] = []
        for component, message in self._requests.components.messages:
            if isinstance(message, CommandRequest):
                results.append(ObservingPorts.command.report(message, key=component))
            else:
                results.append(MissionPorts.function.report(message, key=component))
        self._requests.components.messages.clear()
        commands = self._requests.missions
        results += [*commands.disarms, *commands.gate.collect(), *self._neighbours.collect()]
        commands.disarms.clear()
        return results

    def _keep(self) -> None:
        """Has the disk keep home and the holder of control where they have changed."""
        snapshot = self._observing.snapshot
        if snapshot.is_home_new and snapshot.home is not None:
            snapshot.is_home_new = False
            self._site.keep_home(snapshot.home)
        self.holder, self.policy = self._authority.control.holder, self._mission.policy
        if self.holder != self._site.holder:
            self._site.keep_holder(self.holder)
