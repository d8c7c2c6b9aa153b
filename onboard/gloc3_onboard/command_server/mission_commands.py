"""Stations' commands to the mission: load, start and steer it, single tasks and actions, emergencies."""

import json
import sys
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Final, NamedTuple

import msgspec

from gloc3.errors import Finding, Refused
from gloc3.messages.command_interface import (
    CiReply,
    CiRequest,
    Control,
    Elsewhere,
    Emergency,
    EmergencyVerb,
    LoadMission,
    Outcome,
    RequestAction,
    RequestTask,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, yaw_of
from gloc3.messages.preflight import PreflightReport, summary
from gloc3.messages.summaries import EventReport
from gloc3.messages.vehicle import EmergencyDisarm, FenceProgress
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.executing import amending, steering
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.model.abilities import abilities
from gloc3.mission.model.model import Mission, digest_of
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.reader import read_mission
from gloc3.network.rights_file import Right
from gloc3_onboard.command_server.authority import Authority
from gloc3_onboard.command_server.journal import answer
from gloc3_onboard.command_server.mission_host import MissionHost
from gloc3_onboard.command_server.observing import Observing
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.command_server.start_gate import Begin, HeldRequest, StartGate
from gloc3_onboard.command_server.summaries import geofence_of

FENCE_S: Final = 12.0
"""So long the loading of a mission waits for its fence to be in the autopilot."""
MOTION: Final = "motion"
"""Resource of vehicle motion."""
MOST_FINDINGS: Final = 100
"""Of a mission: more would go over no radio."""
MOST_UNKNOWN: Final = 32
"""Greatest number of unauthorized stations that are reported."""
BEGINS: Final = (Verb.START, Verb.RESUME, Verb.RETRY)
"""What may lead to a take-off."""
HOMEWARD: Final = frozenset({"land", "return_home"})
"""Capabilities that end a flight, with a geofence or without."""
STOPS: Final = (Verb.PAUSE, Verb.ABORT, Verb.CLEAR)
"""What nobody who may fly is too limited for."""
MOST_CHECKS: Final = 8
"""Missions that wait for their check."""
SWITCH_S: Final = 0.001
"""So long the loop waits at most for each turn while a check computes; Python's own choice is five times that."""

Judge = Callable[[CheckReport, float], CiReply | None]
"""What follows from a report, at a time; None if the answer comes later still."""

_STATES: Final = {state.value: state for state in ActionState}


class _FenceWait(NamedTuple):
    request: CiRequest
    text: str
    findings: str
    until_s: float


class MissionCommands:
    """Checks stations' mission commands and passes them to the executor.

    Args:
        site: the platform, and the worker that checks missions.
        observing: the observed state.
        authority: permissions.
        host: host of the executor.
        report: sends an event to the stations.
    """

    def __init__(
        self, site: Site, observing: Observing, authority: Authority, host: MissionHost, report: EventReport
    ) -> None:
        self.gate: Final = StartGate(site.platform, observing)
        """What every start has to pass."""
        self.disarms: Final[list[EmergencyDisarm]] = []
        """Pending disarm commands for the driver."""
        self._platform, self._snapshot = site.platform, observing.snapshot
        self._terrain = site.terrain
        self._authority, self._host, self._report_text = authority, host, report
        self._checks = MissionChecks(site.worker)
        self._fence_waits: list[_FenceWait] = []
        """Loaded missions whose fence is not on the autopilot yet; only the last one is still loaded."""
        self._unknown_sources: set[str] = set()
        """Stations that were not believed."""

    @property
    def executor(self) -> MissionExecutor:
        """The executor.

        Raises:
            Refused: the previous process's state is not restored yet.
        """
        if self._host.executor is None:
            raise Refused("the platform is starting; the autopilot has not answered yet")
        return self._host.executor

    @property
    def is_ready(self) -> bool:
        """Whether there is an executor."""
        return self._host.executor is not None

    @property
    def origin(self) -> GeoPoint | None:
        """Origin of NED; None while it is not known."""
        return self._snapshot.origin

    def _check_rights(self, request: CiRequest, mission: Mission) -> None:
        """Refuses a mission with capabilities that the request's member may not use."""
        used = sorted({one.ability for one in mission.actions().values()})
        self._authority.rights.check_capabilities(request.member, used)

    def _admit(self, request: CiRequest, mission: Mission, *, has_fence: bool) -> None:
        """Refuses a mission that the request's member may not load, or not alone.

        Args:
            request: the request.
            mission: what it leads to.
            has_fence: whether it is flown in a geofence.
        """
        self._check_rights(request, mission)
        self._authority.second(request, *([] if has_fence else [Right.FENCE_OFF]))

    # --- the loaded mission ---

    def load(self, request: CiRequest, body: LoadMission, now_s: float) -> CiReply | None:
        """Has a mission checked, and loads it."""
        executor = self.executor
        if body.amends:
            return self._amend(request, body, now_s)
        executor.refuse_running()  # before the check, which takes its time, and the vehicle is on its way

        def judge(report: CheckReport, at_s: float) -> CiReply | None:
            self._authority.control.require(request.sender)
            findings = _lines(report.findings)
            if not report.is_ok:
                count = sum(not finding.is_warning for finding in report.findings)
                return answer(request, Outcome.REFUSED, f"the mission has {count} error(s)", text=findings)
            mission = report.flyable()
            self._admit(request, mission, has_fence=mission.fence is not None)
            executor.load(mission, at_s)
            if geofence_of(self._platform, executor).areas:
                self._fence_waits.append(_FenceWait(request, mission.text, findings, at_s + FENCE_S))
                return None
            return answer(request, text=findings)

        return self._checks.answer(request, body.text, body.name, self._circumstances(), judge, now_s)

    def _amend(self, request: CiRequest, body: LoadMission, now_s: float) -> CiReply | None:
        """Has what is left of another text of the running mission checked, and continues by it."""
        executor = self.executor
        circumstances = self._circumstances()
        ended = amending.begun(amending.running(executor.board))

        def judge(report: CheckReport, at_s: float) -> CiReply | None:
            self._authority.control.require(request.sender)
            program = amending.running(executor.board)
            if digest_of(program.mission.text) != body.amends:
                raise Refused("another mission is running than the one that this text amends")
            findings = _lines(report.findings)
            if not report.is_ok:
                count = sum(not finding.is_warning for finding in report.findings)
                return answer(request, Outcome.REFUSED, f"the mission has {count} error(s)", text=findings)
            whole = read_mission(body.text, body.name, circumstances.surroundings())
            self._admit(request, whole, has_fence=whole.fence is not None)
            executor.amend(whole, at_s)
            return answer(request, text=findings)

        left = replace(circumstances, ended=ended)
        return self._checks.answer(request, body.text, body.name, left, judge, now_s)

    def read(self, request: CiRequest) -> CiReply:
        """The text of the loaded mission."""
        program = self.executor.mission
        if program is None:
            raise Refused("no mission is loaded")
        return answer(request, text=program.mission.text)

    def steer(self, request: CiRequest, body: Steer, now_s: float) -> CiReply | None:
        """Starts, pauses, resumes, skips, aborts, retries or clears the mission, a task or an action."""
        if body.verb not in STOPS and (program := self.executor.mission) is not None:
            self._check_rights(request, program.mission)
        if body.verb not in BEGINS:
            return self._steer(request, body, now_s)
        self._refuse_to_begin(body)
        loaded = self.executor.mission

        def begin(at_s: float) -> CiReply:
            if self.executor.mission is not loaded:
                raise Refused("another mission was loaded meanwhile; send it again if that one is meant")
            return self._steer(request, body, at_s)

        return self._start(request, begin, now_s)

    def _steer(self, request: CiRequest, body: Steer, now_s: float) -> CiReply:
        executor = self.executor
        if body.verb is Verb.CLEAR:
            executor.clear(now_s)
        else:
            if body.verb in BEGINS:
                self._refuse_to_begin(body)
            executor.steer(body.verb, body.target, now_s, self._snapshot.home_ned_m)
        return answer(request)

    def elsewhere(self, sender: str, body: Elsewhere, now_s: float) -> None:
        """Handles another platform's progress, if its sender commands this one and it concerns the loaded mission."""
        executor = self._host.executor
        program = executor.mission if executor is not None else None
        if executor is None or program is None:
            return
        if body.digest != digest_of(program.mission.text) or body.state not in _STATES:
            return
        if sender != self._authority.control.holder:
            if sender not in self._unknown_sources and len(self._unknown_sources) < MOST_UNKNOWN:
                self._unknown_sources.add(sender)
                self._report_text(
                    Severity.WARNING, f"station {sender} reports {body.platform} without control: ignored"
                )
            return
        tasks = {name: _STATES[state] for name, state in body.tasks.items() if state in _STATES}
        executor.elsewhere(body.platform, _STATES[body.state], tasks, now_s)

    # --- single tasks and actions ---

    def single(self, request: CiRequest, body: RequestTask | RequestAction, now_s: float) -> CiReply | None:
        """Has a single task or action checked, and runs it beside the loaded mission."""
        executor = self.executor
        text = body.text if isinstance(body, RequestTask) else self._as_mission(body)

        def judge(report: CheckReport, checked_s: float) -> CiReply | None:
            self._authority.control.require(request.sender)
            if not report.is_ok:
                # The last one in the text is about the argument itself, the first about the flight as a whole.
                *_, nearest = (finding for finding in report.findings if not finding.is_warning)
                return answer(request, Outcome.REFUSED, nearest.message, text=_lines(report.findings))
            mission, rows = report.flyable(), abilities(self._platform)
            wanted = {one.ability for one in mission.actions().values()}
            is_moving = any(MOTION in row.claims for name, row in rows.items() if name in wanted)
            is_free = is_moving and not wanted <= HOMEWARD
            self._admit(request, mission, has_fence=fence is not None or not is_free)

            def begin(at_s: float) -> CiReply:
                return answer(request, reason=executor.command(mission, at_s))

            if not is_moving:
                return begin(checked_s)
            if not self._snapshot.is_airborne and self._snapshot.autopilot_problem:
                raise Refused(self._snapshot.autopilot_problem)
            return self._start(request, begin, checked_s)

        loaded = executor.mission
        fence = loaded.mission.fence if loaded is not None else None
        circumstances = replace(self._circumstances(), fence=fence)
        return self._checks.answer(request, text, "command", circumstances, judge, now_s)

    def _as_mission(self, body: RequestAction) -> str:
        frames = list(self._platform.frames)
        geo_keys = ("waypoints", "position", "at")
        frame = "geo" if not frames or any(key in body.arguments for key in geo_keys) else frames[0]
        name = self.executor.free_name()
        action = {body.capability: body.arguments}
        mission = {"mission": name, "frame": frame, "tasks": {name: {"actions": {body.capability: action}}}}
        try:
            return json.dumps(mission)
        except (TypeError, RecursionError) as error:  # bytes and times travel, and say nothing in a mission
            raise Refused(f"the arguments of {body.capability} cannot be read: {error}") from None

    def _circumstances(self) -> Circumstances:
        """What missions are checked against onboard.

        Raises:
            Refused: the vehicle's position is not known yet.
        """
        snapshot = self._snapshot
        if snapshot.pose is None or snapshot.origin is None or snapshot.home_ned_m is None:
            raise Refused("the vehicle's position is not known yet")
        return Circumstances(
            platform=self._platform,
            origin=snapshot.origin,
            home_altitude_m=snapshot.home_altitude_m,
            home_ned_m=snapshot.home_ned_m,
            start_ned_m=snapshot.pose.position_ned_m if snapshot.is_airborne else None,
            heading_rad=None if snapshot.is_airborne else yaw_of(snapshot.pose.ned_from_frd),
            terrain=self._terrain,
        )

    # --- emergencies ---

    def emergency(self, request: CiRequest, body: Emergency, now_s: float) -> CiReply:
        """The emergency key: goes before any policy and any mission."""
        executor = self.executor
        author = body.author or f"station {request.sender}"
        match body.verb:
            case EmergencyVerb.HOLD:
                executor.emergency("hold", author, now_s)
            case EmergencyVerb.LAND:
                executor.emergency("land", author, now_s)
            case EmergencyVerb.DISARM:
                if body.confirmation != self._platform.platform:
                    raise Refused(f"to disarm, type the platform's name: {self._platform.platform}")
                self._disarm(author, executor, now_s)
        return answer(request, reason=f"emergency {body.verb} by {author}")

    def operated(self, request: CiRequest, body: Control, now_s: float) -> CiReply:
        """What an operator has commanded the autopilot itself is no pilot's."""
        self._host.operated(self.executor, f"station {request.sender} sent {body.command}", now_s)
        return answer(request)

    def _disarm(self, author: str, executor: MissionExecutor, now_s: float) -> None:
        self._report_text(Severity.ALERT, f"emergency disarm by {author}")
        self.disarms.append(EmergencyDisarm(author=author))
        if executor.mission is not None and executor.mission.is_open:
            executor.steer("abort", "", now_s)

    # --- starts ---

    def _start(self, request: CiRequest, begin: Begin, now_s: float) -> CiReply | None:
        """Starts what may lead to a take-off if the pre-flight checks allow it; in the air they are not applied."""

        def judged(at_s: float) -> CiReply:
            self._authority.control.require(request.sender)
            override = self.gate.let_through(request, self._report(at_s))
            reply = begin(at_s)
            if override:
                self._report_text(Severity.WARNING, override)
            return reply

        return begin(now_s) if self._snapshot.is_airborne else self.gate.answer(request, judged, now_s)

    def preflight(self, request: CiRequest, now_s: float) -> CiReply | None:
        """Has the pre-flight checks made again."""
        return self.gate.answer(request, lambda at_s: self._list(request, at_s), now_s)

    def _list(self, request: CiRequest, now_s: float) -> CiReply:
        report = self._report(now_s)
        return answer(request, reason=summary(report.checks), result=msgspec.to_builtins(report))

    def _report(self, now_s: float) -> PreflightReport:
        executor = self._host.executor
        is_held = executor is None or self._fence_progress(executor) is FenceProgress.CONFIRMED
        program = executor.mission if executor is not None else None
        mission = program.mission if program is not None else None
        problem = "" if is_held else self._fence_problem()
        return self.gate.report(mission, problem, self._authority.software(now_s), now_s)

    def _refuse_to_begin(self, body: Steer) -> None:
        """What no operator can override."""
        if body.verb is Verb.RETRY or (body.verb is Verb.RESUME and self._snapshot.is_airborne):
            return
        if problem := self._snapshot.autopilot_problem:
            raise Refused(problem)
        board = self.executor.board
        if body.verb is Verb.RESUME and (body.target or board.mission is not None):
            steering.check_resumable(board, board.find(body.target))
        if not body.target:
            self._refuse_without_fence()

    def _refuse_without_fence(self) -> None:
        """Refuses the start of a mission with a fence on Earth until the autopilot has returned the same fence."""
        if self._fence_progress(self.executor) is not FenceProgress.CONFIRMED:
            raise Refused(self._fence_problem())

    def _fence_progress(self, executor: MissionExecutor) -> FenceProgress:
        wanted, held = geofence_of(self._platform, executor), self._snapshot.fence
        if not wanted.areas:
            return FenceProgress.CONFIRMED
        return held.progress if held is not None and held.digest == wanted.digest else FenceProgress.NONE

    def _fence_problem(self) -> str:
        held = self._snapshot.fence
        return f"the autopilot does not hold the mission's fence: {held.reason if held and held.reason else 'not uploaded yet'}"

    # --- answers that come later ---

    @property
    def waiting(self) -> list[CiRequest]:
        """Requests whose mission is being checked, or that wait for the pre-flight checks."""
        return [*self._checks.waiting, *self.gate.waiting]

    def due(self, now_s: float) -> list["Checked | HeldRequest"]:
        """Requests with a finished mission check or a pending pre-flight list."""
        return [*self._checks.due(), *self.gate.due(now_s)]

    def fence_answer(self, now_s: float) -> list[CiReply]:
        """Answers to loading missions with a fence on Earth, once the autopilot has returned or refused it."""
        executor = self._host.executor
        if not self._fence_waits or executor is None:
            return []
        progress = self._fence_progress(executor)
        loaded = executor.mission.mission.text if executor.mission is not None else ""
        found, waits = [], []
        for wait in self._fence_waits:
            if wait.text != loaded:
                found.append(answer(wait.request, Outcome.REFUSED, "another mission was loaded after it"))
            elif progress is FenceProgress.CONFIRMED:
                found.append(answer(wait.request, text=wait.findings))
            elif progress is FenceProgress.FAILED or now_s > wait.until_s:
                found.append(answer(wait.request, Outcome.REFUSED, self._fence_problem(), text=wait.findings))
            else:
                waits.append(wait)
        self._fence_waits = waits
        return found


class Checked(NamedTuple):
    """A request with a finished mission check."""

    request: CiRequest
    report: "Future[CheckReport]"
    judge: Judge

    def answer(self, now_s: float) -> CiReply | None:
        """Its answer."""
        return self.judge(self.report.result(), now_s)


class MissionChecks:
    """Checks missions on a worker, one at a time.

    Args:
        worker: a thread in wall time; `ImmediateExecutor` in virtual time.
    """

    def __init__(self, worker: Executor) -> None:
        self._worker = worker
        self._waiting: deque[Checked] = deque()

    def answer(
        self, request: CiRequest, text: str, name: str, circumstances: Circumstances, judge: Judge, now_s: float
    ) -> CiReply | None:
        """Begins a check, and answers at once where it is done at once.

        Raises:
            Refused: too many are waiting.
        """
        if len(self._waiting) >= MOST_CHECKS:
            raise Refused(f"{MOST_CHECKS} missions are being checked already; try again later")
        checked = Checked(request, self._worker.submit(_check, text, name, circumstances), judge)
        if not self._waiting and checked.report.done():
            return checked.answer(now_s)
        self._waiting.append(checked)
        return None

    @property
    def waiting(self) -> list[CiRequest]:
        """Requests with an unfinished check."""
        return [checked.request for checked in self._waiting]

    def due(self) -> list[Checked]:
        """Requests with a finished check, in order of arrival."""
        found: list[Checked] = []
        while self._waiting and self._waiting[0].report.done():
            found.append(self._waiting.popleft())
        return found


def _check(text: str, name: str, circumstances: Circumstances) -> CheckReport:
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH_S, before_s))
    try:
        return check_text(text, name, circumstances)
    finally:
        sys.setswitchinterval(before_s)


def _lines(findings: Sequence[Finding]) -> str:
    """Findings as text for a station, errors first if there are too many."""
    reported = findings
    if len(findings) > MOST_FINDINGS:
        reported = sorted(findings, key=lambda finding: finding.is_warning)[:MOST_FINDINGS]
    more = len(findings) - len(reported)
    return "\n".join([*map(str, reported), *([f"and {more:,} more"] if more else [])])
