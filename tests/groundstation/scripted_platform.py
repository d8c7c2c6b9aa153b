"""A platform's command interface server that does what a test tells it, on a local exchange."""

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec
from msgspec.structs import astuple

from gloc3 import __version__
from gloc3.component.lci import Command, State, transition
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import (
    AnyBody,
    CallFunction,
    CiReply,
    CiRequest,
    CommandComponent,
    Control,
    Hello,
    ListTopics,
    LoadMission,
    Outcome,
    Preflight,
    Query,
    ReadMission,
    Steer,
    Verb,
    Watch,
)
from gloc3.messages.envelope import Envelope, Message, Severity
from gloc3.messages.preflight import Check, Group, PreflightReport, Verdict, red, summary
from gloc3.messages.summaries import (
    CiEvent,
    ComponentLine,
    ComponentTable,
    ComponentTrouble,
    ControlState,
    Health,
    MissionSummary,
    Summary,
    TableRow,
    VehicleSummary,
    health_of,
)
from gloc3.messages.watch import TopicEntry

ROWS = [
    TableRow("autopilot", "SS", 20.0, True, ""),
    TableRow("ground_camera", "SS", 2.0, False, ""),
    TableRow("height", "SS", 20.0, True, ""),
    TableRow("pose", "DP", 20.0, True, ""),
    TableRow("pose_backup", "DP", 20.0, False, "pose"),
    TableRow("waypoints", "CC", 20.0, True, ""),
    TableRow("hold", "CC", 20.0, True, ""),
    TableRow("take_off", "CC", 20.0, True, ""),
    TableRow("landing", "CC", 20.0, True, ""),
    TableRow("limiter", "CC", 20.0, True, ""),
    TableRow("driver", "AD", 20.0, True, ""),
    TableRow("recorder", "AD", 2.0, False, ""),
    TableRow("command_server", "CI", 20.0, True, ""),
]

VEHICLE = VehicleSummary(
    t_s=0.0,
    mode="HOLD",
    is_armed=False,
    landed="on_ground",
    battery_percent=97,
    position_m=(0.0, 0.0, 0.0),
    speed_m_s=0.0,
    heading_deg=90,
    is_pose_valid=True,
    has_pilot_control=False,
    is_autopilot_connected=True,
    frame="hold",
    geo=(43.1, 9.2, 12.0),
    pose_sources=["autopilot"],
    pose_quality_percent=100,
)

CHECKS = (
    Check(Group.AUTOPILOT, "answers", Verdict.OK, "px4, mode AUTO.LOITER"),
    Check(Group.AUTOPILOT, "battery", Verdict.OK, "97 %, 12.4 V"),
    Check(Group.AUTOPILOT, "firmware", Verdict.OK, "px4 1.16.0"),
    Check(Group.FAILSAFES, "link loss", Verdict.OK, "continue after 10 s (NAV_DLL_ACT 0)"),
    Check(Group.FAILSAFES, "low battery", Verdict.OK, "return at 10 % (COM_LOW_BAT_ACT 3)"),
    Check(Group.SENSORS, "position", Verdict.OK, "quality 100 % from autopilot"),
    Check(Group.COMPONENTS, "all", Verdict.OK, "13 of 13 work, with all 10 that are required"),
    Check(Group.COMPUTER, "disk", Verdict.OK, "79.8 GB free"),
)
LINK_LOSS = Check(
    Group.FAILSAFES,
    "link loss",
    Verdict.RED,
    "return after 10 s (NAV_DLL_ACT 2); the platform file says continue",
    "set NAV_DLL_ACT to 0, or correct failsafes in the platform file",
)
CLOCK = Check(
    Group.COMPUTER,
    "clock",
    Verdict.WARNING,
    "12.0 s behind the autopilot's",
    "set it (timedatectl), or logs cannot be compared",
)

TASKS = {
    "depart": "waiting",
    "depart.climb": "waiting",
    "sweep": "waiting",
    "sweep.wall": "waiting",
    "sweep.photos": "waiting",
    "recover": "waiting",
    "recover.home": "waiting",
    "recover.down": "waiting",
}

Answer = Callable[[CiRequest], CiReply | None]


class ScriptedPlatform:
    """Answers everything well unless told otherwise; `requests` holds what came."""

    def __init__(self, exchange: LocalExchange, name: str = "heron", boot: int = 7) -> None:
        self.name = name
        self.loop = asyncio.get_running_loop()
        self.publisher = Publisher(exchange, name, "command_server", boot)
        self.requests: list[AnyBody] = []
        self.answers: dict[type, list[Answer]] = {}
        self.is_deaf = False
        self.delay_s = 0.05
        self.text = ""
        self.vehicle = VEHICLE
        self.mission = MissionSummary(name="", digest="", state="")
        self.control = ControlState(holder="")
        self.checks = list(CHECKS)
        self.states = {row.name: Health.QUIET if row.standby_for else Health.WORKING for row in ROWS}
        self.topics: list[TopicEntry] = []
        self.watched = Watch()
        """What is looked at."""
        self._replies: dict[tuple[str, int, int], CiReply] = {}
        exchange.subscribe(f"{name}/ci/request", self._take)

    # --- what a test makes it say ---

    def report(self, topic: str, message: Message) -> None:
        self.publisher.publish(f"{self.name}/ci/{topic}", message, self.loop.time())

    def speak(self) -> None:
        """Its periodic status, once."""
        self.report("vehicle", self.vehicle)
        self.report("mission", self.mission)
        self.report("control", self.control)
        states = list(Health)
        lines = [ComponentLine(i, states.index(self.states[row.name]), 100, 12, 0, 0) for i, row in enumerate(ROWS)]
        worst = Health.FAULTY if Health.FAULTY in self.states.values() else Health.WORKING
        self.report("summary", Summary(table=1, health=worst, lines=lines))

    def speak_every(self, period_s: float) -> None:
        if not self.is_deaf:
            self.speak()
        self.loop.call_later(period_s, self.speak_every, period_s)

    def fly(self, **changes: Any) -> None:
        self.vehicle = msgspec.structs.replace(self.vehicle, **changes)
        self.report("vehicle", self.vehicle)

    def advance(self, state: str = "running", progress: dict[str, float] | None = None, /, **tasks: str) -> None:
        """Says another state of the mission; `sweep__wall="done"` stands for the action `sweep.wall`."""
        named = {target.replace("__", "."): value for target, value in tasks.items()}
        self.mission = msgspec.structs.replace(
            self.mission, state=state, tasks={**self.mission.tasks, **named}, progress=progress or {}
        )
        self.report("mission", self.mission)

    def event(self, text: str, severity: Severity = Severity.WARNING, source: str = "driver") -> None:
        self.report("event", CiEvent(severity=severity, source=source, text=text, t_s=self.loop.time()))

    def problem(self, name: str, cause: str) -> None:
        self.states[name] = Health.FAULTY
        self.report("trouble", ComponentTrouble(name=name, cause=cause, errors=1))

    # --- how it answers ---

    def answer_next(self, body: type, *answers: Answer) -> None:
        """The next requests of that kind are answered so; those after them well again."""
        self.answers.setdefault(body, []).extend(answers)

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        request = envelope.payload
        self.requests.append(request.body)
        if self.is_deaf:
            return
        key = request.sender, request.boot, request.sequence
        scripted = self.answers.get(type(request.body))
        if scripted:
            reply = scripted.pop(0)(request)
        else:
            reply = self._replies.get(key) or self._carry_out(request)
            self._replies[key] = reply
        if reply is not None:
            self.loop.call_later(self.delay_s, self.report, "reply", reply)

    def _carry_out(self, request: CiRequest) -> CiReply:
        match request.body:
            case Hello():
                self.report("table", ComponentTable(table=1, rows=ROWS))
                self.speak()
            case LoadMission(text=text):
                self.text = text
                self.mission = MissionSummary(name="cargo hold", digest="d1", state="waiting", tasks=TASKS)
            case ReadMission():
                return reply_to(request, text=self.text)
            case Control():
                self.control = ControlState(holder=request.sender)
                self.report("control", self.control)
            case CommandComponent(component=name, command=command):
                return self._command(request, name, command)
            case CallFunction(arguments=values):
                return reply_to(request, result=values)
            case Preflight():
                report = PreflightReport(checks=self.checks, version=__version__, utc_s=None)
                return msgspec.structs.replace(
                    reply_to(request, reason=summary(self.checks)), result=msgspec.to_builtins(report)
                )
            case Steer(verb=Verb.START, override="") if red(self.checks):
                return reply_to(request, Outcome.REFUSED, f"red: {', '.join(one.title for one in red(self.checks))}")
            case Steer(verb=Verb.START):
                self.loop.call_soon(self.advance)
            case Query(boot=boot, sequence=sequence):
                known = self._replies.get((request.sender, boot, sequence))
                if known is None:
                    return reply_to(request, Outcome.UNKNOWN)
                return reply_to(request, known.outcome, known.reason, known.text)
            case ListTopics():
                return reply_to(request, result={"topics": [list(astuple(entry)) for entry in self.topics]})
            case Watch():
                self.watched = request.body
                refused = {
                    want.topic: "there is no such topic" for want in request.body.wants if want.topic == "nothing"
                }
                return reply_to(request, result={"lease_s": 8.0, "refused": refused})
            case _:
                pass
        return reply_to(request)

    def _command(self, request: CiRequest, name: str, command: str) -> CiReply:
        """Carries a command out by the LCI's own table."""
        try:
            to = transition(State(self.states[name].value), Command(command)).to
        except Refused as reason:
            return reply_to(request, Outcome.REFUSED, str(reason))
        self.states[name] = health_of(to)
        self.speak()
        return reply_to(request, result={"state": to or "absent"})


def reply_to(
    request: CiRequest,
    outcome: Outcome = Outcome.ACCEPTED,
    reason: str = "",
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


def refused(reason: str, text: str = "") -> Answer:
    return lambda request: reply_to(request, Outcome.REFUSED, reason, text)


def lost(request: CiRequest) -> None:
    """Never arrives: nothing is known of it, nothing is answered."""
