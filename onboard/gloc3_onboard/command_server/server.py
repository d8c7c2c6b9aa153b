"""CI: the platform's command interface server: the one path from stations to components, and the mission's executor."""

from collections.abc import Sequence
from typing import Any

from gloc3.component.component import CommandInterface
from gloc3.component.deployment import FaultPolicy
from gloc3.component.ports import Inbox, Input, Keep, Output, Report, Result
from gloc3.component.supervision import Order, Step, Supervision, Verdict
from gloc3.messages.command_interface import CiReply, CiRequest, LogChunk
from gloc3.messages.envelope import (
    CommandReply,
    CommandRequest,
    ComponentStatus,
    Envelope,
    Event,
    FunctionReply,
    FunctionRequest,
    Severity,
)
from gloc3.messages.hosts import HostPresence
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.preflight import PreflightReport
from gloc3.messages.readiness import AutopilotSetup, ComputerState, ReadSetup
from gloc3.messages.summaries import (
    CiEvent,
    ComponentTable,
    ComponentTrouble,
    ContactSummary,
    ControlState,
    Health,
    MissionSummary,
    StationHeard,
    Summary,
    VehicleSummary,
)
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    EmergencyDisarm,
    FenceState,
    GeoFence,
    HeightAboveGround,
    Home,
    MotionGrant,
    MotionLimits,
    Pose,
    Setpoint,
    TakeOver,
)
from gloc3.mission.executing.executor import MissionExecutor, Verb
from gloc3.mission.executing.requests import Cancel, Grant, Pause, Persist, Request, Resume, Start, TakeBack, Told
from gloc3.mission.executing.restore import restore
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3.platform.places import place_of
from gloc3_onboard.command_server.availability import Availability
from gloc3_onboard.command_server.book import ComponentBook
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.control import ControlAuthority
from gloc3_onboard.command_server.demands import Demands
from gloc3_onboard.command_server.facts import VehicleFacts
from gloc3_onboard.command_server.handover import TAKE_OVER_S, Handover
from gloc3_onboard.command_server.held_back import HeldBack
from gloc3_onboard.command_server.kept_flight import flies_for_us, was_under_way
from gloc3_onboard.command_server.motion import motion_summary, site_summary
from gloc3_onboard.command_server.news import News
from gloc3_onboard.command_server.requests import RequestHandler
from gloc3_onboard.command_server.settings import ServerSettings
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.command_server.standstill import Standstill
from gloc3_onboard.command_server.summaries import geofence_of, mission_summary, motion_limits, vehicle_summary
from gloc3_onboard.command_server.tally import Tally

COME_UP_S = 30.0
"""After a restart: how long components that are still coming up are waited for before the mission is taken up."""
COMPARE_S = 0.2
"""How often it is looked for changes to tell, when nothing was asked of the server or of its executor."""


class CommandServer(CommandInterface[ServerSettings]):
    """Checks authority, claims and states; runs missions; supervises; summarises."""

    settings_type = ServerSettings
    loggable = ("holder", "policy")

    request = Input(CiRequest, Keep.ALL)
    velocity_demand = Input(VelocityDemand, Keep.ALL)
    heard = Input(StationHeard, Keep.ALL)
    status = Input(ComponentStatus, Keep.ALL, depth=512)
    reply = Input(CommandReply, Keep.ALL)
    function_reply = Input(FunctionReply, Keep.ALL)
    event = Input(Event, Keep.ALL, depth=256)
    action_status = Input(ActionStatus, Keep.ALL, depth=256)
    autopilot = Input(AutopilotState)
    pose = Input(Pose)
    setpoint = Input(Setpoint)
    driver = Input(DriverState)
    fence_state = Input(FenceState)
    autopilot_setup = Input(AutopilotSetup)
    computer = Input(ComputerState)
    height = Input(HeightAboveGround)
    host_presence = Input(HostPresence, Keep.ALL)

    ci_reply = Output(CiReply)
    summary = Output(Summary)
    table = Output(ComponentTable)
    trouble = Output(ComponentTrouble)
    vehicle = Output(VehicleSummary)
    motion = Output(MotionSummary)
    whereabouts = Output(SiteSummary)
    mission = Output(MissionSummary)
    control = Output(ControlState)
    ci_event = Output(CiEvent)
    contact = Output(ContactSummary)
    log_chunk = Output(LogChunk)
    command = Output(CommandRequest)
    function = Output(FunctionRequest)
    grant = Output(MotionGrant)
    limits = Output(MotionLimits)
    motion_demand = Output(VelocityDemand)
    home = Output(Home)
    geofence = Output(GeoFence)
    take_over = Output(TakeOver)
    emergency = Output(EmergencyDisarm)
    read_setup = Output(ReadSetup)
    preflight = Output(PreflightReport)

    def __init__(self, site: Site) -> None:
        self.holder = self.policy = ""
        self._site = site
        self._settings = ServerSettings()

    def initialize(self, settings: ServerSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def start(self) -> None:
        """Reads what the process before has left; it is taken up when the autopilot has told its state."""
        platform = self._site.platform
        self._snapshot, home = self._site.load()
        self._facts = VehicleFacts(platform, home)
        self._book = ComponentBook(platform.components)
        self._authority = ControlAuthority()
        self._availability = Availability(platform)
        self._supervision: Supervision | None = None
        self._verdicts: list[Verdict] = []
        self._standstill = Standstill()
        self._handover = Handover()
        self._performing: dict[str, str] = {}
        """Component to the action that it says it is performing."""
        self._contacts = Contacts(self._site.reports)
        self._requests = RequestHandler(self._site, self._facts, self._book, self._authority, self._contacts, self._say)
        self._executor: MissionExecutor | None = None
        self._tally = Tally()
        self._demands = Demands(self._authority, self._say)
        self._granted = Grant(action_id="", component="")
        self._waiting: dict[str, tuple[str, Verb]] = {}
        self._events: list[CiEvent] = []
        self._news = News()
        self._held_back = HeldBack(self._site)
        self._connected_s: float | None = None
        self._count = 0
        self._compared_s = float("-inf")
        self._now_s = 0.0
        self._unkept = self._site.problems()
        """Why something is not kept, as it was told last."""
        for problem in filter(None, (self._site.problem, *self._unkept)):
            self._say(Severity.ERROR, problem)

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes everything in, decides, and says what follows."""
        self._now_s = now_s
        results: list[Result] = []
        stood_s = self._standstill.look(now_s)
        if stood_s:
            self._say(Severity.WARNING, f"this process stood still for {stood_s:.1f} s", "supervision")
        self._observe(now_s, inbox)
        results += self._supervise(now_s, inbox)
        if self._executor is None:
            results += self._try_to_begin(now_s)
        if self._executor is not None:  # what is asked for now is judged by what is known now
            self._inform(self._executor, now_s, inbox)
            if self._facts.driver is not None and self._is_handing_over(self._executor, self._facts.driver, now_s):
                results.append(TakeOver(is_resumed=True))
        for request in inbox.new(self.request):
            answer = self._requests.handle(request.payload, now_s)
            results += [] if answer is None else [answer]
        results += self._demands.take(inbox.new(self.velocity_demand), now_s)
        replies: list[CommandReply | FunctionReply] = [reply.payload for reply in inbox.new(self.reply)]
        for reply in (*replies, *(reply.payload for reply in inbox.new(self.function_reply))):
            results += self._replied(reply, now_s)
        results += [*self._requests.expire(now_s), *self._site.shelf.take()]
        asks: Sequence[Request] = ()
        if self._executor is not None:
            self._executor.tick(now_s)
            asks = self._executor.take(now_s)
            for ask in asks:
                results += self._carry_out(ask)
        for component, message in self._requests.components.messages:
            port = self.command if isinstance(message, CommandRequest) else self.function
            results.append(port.report(message, key=component))  # type: ignore[arg-type] # each port has its own type
        self._requests.components.messages.clear()
        results += [*self._requests.disarms, *self._requests.gate.take()]
        self._requests.disarms.clear()
        if self._facts.is_home_new and self._facts.home is not None:
            self._facts.is_home_new = False
            self._site.keep_home(self._facts.home)
        results += self._report(now_s, is_eventful=bool(asks or inbox.new(self.request)))
        return self._held_back.pass_on(results, now_s)

    def _observe(self, now_s: float, inbox: Inbox) -> None:
        for status in inbox.new(self.status):
            self._book.hear(status.payload, status.t_s)
        for heard in inbox.new(self.heard):
            self._authority.hear(heard.payload.station, now_s)
            if heard.payload.is_reached:
                self._contacts.hear(heard.payload.station, now_s)
        for state in inbox.new(self.autopilot):
            self._facts.see_autopilot(state)
        for pose in inbox.new(self.pose):
            self._facts.see_pose(pose)
        for setpoint in inbox.new(self.setpoint):
            self._facts.see_setpoint(setpoint)
        self._facts.look(now_s)
        for action in inbox.new(self.action_status):
            component, status_of = action.source.component, action.payload
            if status_of.state in (ActionState.RUNNING, ActionState.PAUSED):
                self._performing[component] = status_of.action_id
            elif self._performing.get(component) == status_of.action_id:
                del self._performing[component]
        for driver in inbox.new(self.driver):
            self._handover.see(driver, self._facts.known_autopilot, now_s)
            self._facts.driver = driver.payload
        for fence in inbox.new(self.fence_state):
            self._facts.fence = fence.payload
        for setup in inbox.new(self.autopilot_setup):
            self._requests.gate.see(setup.payload)
        for computer in inbox.new(self.computer):
            self._requests.gate.see(computer.payload)
        for height in inbox.new(self.height):
            self._requests.gate.see(height.payload)
            self._facts.see_height(height)
        for event in inbox.new(self.event):
            self._forward(event)

    def _supervise(self, now_s: float, inbox: Inbox) -> list[Result]:
        """Has standbys take over and faulty components come up again; what is lost for good goes to the executor."""
        if self._supervision is None:  # the first cycle: only now is the time known
            if was_under_way(self._snapshot):
                self._authority.restore(self._site.holder, now_s)
            self._supervision = Supervision(self._site.platform.components, f"supervision-{now_s:.3f}")
            self._requests.components.supervision = self._supervision
        supervision = self._supervision
        steps: list[Step] = []
        for reply in inbox.new(self.reply):
            steps += supervision.receive_reply(reply.payload, now_s)
        # A reply follows the statuses of what it answers: the last status is never older than the reply.
        last = {status.payload.name: status.payload for status in inbox.new(self.status)}
        for status in last.values():
            steps += supervision.receive_status(status, now_s)
        for presence in inbox.new(self.host_presence):
            steps += self._see_host(supervision, presence.payload, now_s)
        if self._standstill.is_over(now_s):
            steps += supervision.tick(now_s)
        results: list[Result] = []
        for step in steps:
            match step:
                case Order(component=component, request=request, reason=reason):
                    commands = ", ".join([request.command, *request.then])
                    self._say(Severity.WARNING, f"{commands} {component}: {reason}", "supervision")
                    results.append(self.command.report(request, key=component))
                case Verdict():
                    self._verdicts.append(step)
        return results

    def _see_host(self, supervision: Supervision, told: HostPresence, now_s: float) -> list[Step]:
        """What follows from the loss of a host; when it is back its components speak for themselves."""
        known = self._requests.gate.hosts
        was_here, known[told.host] = told.host in known and known[told.host].is_here, told
        if told.is_here:
            if not was_here:
                self._say(Severity.NOTICE, f"host {told.host} is here", "supervision")
            return []
        reason = f"host {told.host} is lost"
        self._say(Severity.ERROR, reason, "supervision")
        platform = self._site.platform
        steps: list[Step] = []
        for row in platform.components:
            if place_of(platform, row).host == told.host:
                steps += supervision.lose(row.name, reason, now_s)
                self._book.lose(row.name)
        policy = platform.hosts[told.host].on_loss if told.host in platform.hosts else FaultPolicy.IGNORE
        if policy is not FaultPolicy.IGNORE:
            steps.append(Verdict(f"host {told.host}", policy, "nothing is heard of it"))
        return steps

    def _try_to_begin(self, now_s: float) -> list[Result]:
        """Takes up what was kept, once it is known whether the vehicle flies."""
        facts, kept = self._facts, self._snapshot
        if not facts.is_connected:
            return []
        if self._connected_s is None:
            self._connected_s = now_s
        waited_s = now_s - self._connected_s - self._settings.settle_s
        if kept is None or not kept.programs:
            self._executor = MissionExecutor(self._site.platform)
        elif waited_s < 0.0 or not facts.is_flight_known:
            return []
        elif waited_s < TAKE_OVER_S and flies_for_us(facts, kept):
            return [TakeOver(is_resumed=True)]
        elif waited_s < COME_UP_S and not self._requests.is_urgent and self._is_still_coming(now_s):
            return []
        else:
            read = self._requests.read_again
            self._executor = restore(self._site.platform, kept, read, facts.is_airborne, now_s)
        self._requests.executor = self._executor
        return []

    def _is_still_coming(self, now_s: float) -> bool:
        """Whether some capability cannot be used yet, and components are coming up still, or once more."""
        if not self._availability.missing(self._book, self._facts, now_s):
            return False
        is_tried = self._supervision is not None and self._supervision.is_bringing_up
        return is_tried or self._book.is_coming_up(now_s)

    def _is_handing_over(self, executor: MissionExecutor, driver: DriverState, now_s: float) -> bool:
        """Whether the driver has come up anew and only takes for a pilot's what is ours."""
        return not executor.board.has_pilot and self._handover.is_ours(driver, self._facts.known_autopilot, now_s)

    def _inform(self, executor: MissionExecutor, now_s: float, inbox: Inbox) -> None:
        """Tells the executor the facts."""
        facts, is_silence_told = self._facts, self._standstill.is_over(now_s)
        for name in self._book.down(now_s) if is_silence_told else ():
            status = self._book.status(name)
            executor.component_failed(name, (status.cause if status is not None else "") or "it has left", now_s)
        for action in inbox.new(self.action_status):
            executor.reported(action.payload, now_s)
        if is_silence_told:
            executor.available(self._availability.missing(self._book, facts, now_s), now_s)
        if facts.is_connected:
            executor.vehicle(facts.is_airborne, now_s)
        driver = facts.driver
        if driver is not None and not self._is_handing_over(executor, driver, now_s):
            executor.pilot(driver.has_pilot_control, driver.pilot_reason, now_s)
        fence = executor.mission.mission.fence if executor.mission is not None and executor.mission.is_open else None
        if is_silence_told:
            for condition, is_on, reason in facts.conditions(fence, now_s):
                executor.condition(condition, is_on, reason, now_s)
            silent_s = self._authority.silent_s(now_s)
            executor.link(silent_s, now_s)
            executor.sensed(facts.readings(now_s) | {"link_silent_s": silent_s}, now_s)
        self._count_up(executor, now_s)
        for verdict in self._verdicts:
            executor.component_lost(verdict.component, Policy(verdict.policy), verdict.reason, now_s)
        self._verdicts.clear()

    def _count_up(self, executor: MissionExecutor, now_s: float) -> None:
        """What the mission takes, for the comparison with its estimate."""
        facts = self._facts
        if self._tally.program is not executor.mission:
            self._tally = Tally(executor.mission)
        at = facts.pose.position_ned_m if facts.pose is not None and facts.is_pose_fresh(now_s) else None
        self._tally.look(at, facts.autopilot.battery_remaining if facts.autopilot is not None else -1.0, now_s)

    def _replied(self, reply: CommandReply | FunctionReply, now_s: float) -> list[Result]:
        waiting = self._waiting.pop(reply.request_id, None)
        if waiting is not None and self._executor is not None:
            action_id, verb = waiting
            self._executor.replied(action_id, verb, reply.is_accepted, reply.reason, now_s)
            return []
        answer = self._requests.replied(reply)
        return [] if answer is None else [answer]

    # --- what the executor asks for ---

    def _carry_out(self, ask: Request) -> list[Result]:
        match ask:
            case Persist(snapshot=snapshot):
                self._site.keep_snapshot(snapshot)
            case Grant():
                self._granted = ask
                return [MotionGrant(action_id=self._granted.action_id, component=self._granted.component)]
            case Start(progress=progress):
                arguments = {"capability": ask.capability, "arguments": ask.arguments, "progress": progress}
                start = self._ask(ask.component, ask.action_id, "start", arguments)
                return [*self._clear(ask.component), start]
            case Pause():
                return [self._ask(ask.component, ask.action_id, "pause", {})]
            case Resume():
                return [self._ask(ask.component, ask.action_id, "resume", {})]
            case Cancel():
                return [self._ask(ask.component, ask.action_id, "cancel", {})]
            case TakeBack():
                return [TakeOver(is_resumed=True)]
            case Told():
                self._say(ask.severity, ask.text)
        return []

    def _clear(self, component: str) -> list[Report]:
        """Has a component end an action that a former life of this server has left it with."""
        left = self._performing.pop(component, "")
        if not left or self._executor is None or self._executor.knows(left):
            return []
        return [self._ask(component, left, "cancel", {})]

    def _ask(self, component: str, action_id: str, verb: Verb, more: dict[str, Any]) -> Report:
        self._count += 1
        request_id = f"action-{self._count}"
        self._waiting[request_id] = (action_id, verb)
        message = FunctionRequest(
            request_id=request_id, function=f"action.{verb}", arguments={"action_id": action_id, **more}
        )
        return self.function.report(message, key=component)

    # --- reports ---

    def _say(self, severity: Severity, text: str, source: str = "mission") -> None:
        self._events.append(CiEvent(severity=severity, source=source, text=text, t_s=self._now_s))

    def _forward(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity <= self._settings.event_severity:
            self._events.append(
                CiEvent(severity=event.severity, source=envelope.source.component, text=event.text, t_s=envelope.t_s)
            )

    def _report(self, now_s: float, *, is_eventful: bool) -> list[Result]:
        results: list[Result] = [*self._contact(now_s), *self._book.new_troubles()]
        results += [self._site.reports.add(event) for event in self._events]
        self._events.clear()
        if self._requests.wants_everything:
            self._requests.wants_everything = False
            self._news.forget("site")
        self._authority.tick(now_s)
        is_slow = self._news.is_due("slow", 1.0, now_s)
        if is_slow:
            self._tell_what_is_not_kept()
        if is_slow or is_eventful or now_s - self._compared_s >= COMPARE_S - 1e-6:
            self._compared_s = now_s
            results += self._changes(is_slow)
        if self._news.is_due("grant", self._settings.grant_period_s, now_s):
            results.append(MotionGrant(action_id=self._granted.action_id, component=self._granted.component))
        if self._news.is_due("summary", self._settings.summary_period_s, now_s):
            assert self._supervision is not None
            health = self._supervision.health()
            results += [self._book.summary(health, now_s), vehicle_summary(self._site.platform, self._facts, now_s)]
        if self._news.is_due("motion", self._settings.motion_period_s, now_s):
            motion = motion_summary(self._site.platform, self._facts, now_s)
            results += [] if motion is None else [motion]
        if self._news.is_due("site", self._settings.site_period_s, now_s):
            whereabouts = site_summary(self._site.platform, self._facts)
            results += [] if whereabouts is None else [whereabouts]
        return results

    def _tell_what_is_not_kept(self) -> None:
        """A full or broken disk ends no flight, but a restart would know an older state: that is told."""
        problems = [*self._site.problems(), *filter(None, [self._held_back.problem])]
        for problem in problems:
            if problem not in self._unkept:
                self._say(Severity.ERROR, f"{problem}; a restart would know an older state")
        if self._unkept and not problems:
            self._say(Severity.NOTICE, "everything is kept on disk again")
        self._unkept = problems

    def _contact(self, now_s: float) -> list[ContactSummary]:
        """What is told first to who is heard after a silence; while nobody is heard, the state is kept now and then."""
        contacts, is_flying = self._contacts, self._facts.is_airborne
        is_silent = is_flying and contacts.is_alone(now_s)
        if not contacts.has_news and not contacts.is_due(now_s, is_silent=is_silent):
            return []
        vehicle = vehicle_summary(self._site.platform, self._facts, now_s)
        mission = mission_summary(self._executor, self._tally)
        if is_silent:
            self._events.append(contacts.status(vehicle, mission, now_s))
        health = self._supervision.health() if self._supervision is not None else Health.IDLE
        wrong = [str(condition) for condition in self._executor.board.conditions] if self._executor is not None else []
        return contacts.take(health, vehicle, mission, wrong, now_s)

    def _changes(self, is_slow: bool) -> list[Result]:
        """What is told when it has changed, and once a second besides."""
        results: list[Result] = []
        self.holder = self._authority.holder
        if self.holder != self._site.holder:
            self._site.keep_holder(self.holder)
        self.policy = self._executor.policy if self._executor is not None else ""
        is_kept = self._executor is None and self._snapshot is not None and bool(self._snapshot.programs)
        if not is_kept:  # who is told of none would give it up for lost
            results += self._news.of(mission_summary(self._executor, self._tally), is_due=is_slow)
            results += self._news.of(geofence_of(self._executor), is_due=is_slow)
        results += self._news.of(self._authority.state(), is_due=is_slow)
        results += self._news.of(self._book.table(), is_due=False)
        results += self._news.of(motion_limits(self._site.platform, self._facts, self._executor), is_due=is_slow)
        if is_slow and self._facts.home is not None:
            results.append(Home(position_ned_m=self._facts.home.position_ned_m))
        return results
