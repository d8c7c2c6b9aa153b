"""The mission host: restores the executor, updates its state, and carries out its requests to components."""

from collections.abc import Mapping
from math import hypot, inf
from typing import Any, Final

from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup, PortReport, Result
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import CommandReply, FunctionReply, FunctionRequest, Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.summaries import Cause, EventReport
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    FlightMode,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    MotionGrant,
    TakeOver,
    VehicleClass,
)
from gloc3.mission.executing.board import UNATTENDED_S
from gloc3.mission.executing.executor import MissionExecutor, Verb
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.executing.requests import (
    Cancel,
    Grant,
    MissionEvent,
    Pause,
    Persist,
    ReclaimMotion,
    Request,
    Resume,
    Start,
)
from gloc3.mission.executing.restore import restore
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.model import Mission
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.authority import ControlAuthority
from gloc3_onboard.command_server.circling import CirclingWatch
from gloc3_onboard.command_server.observing import OURS, TAKE_OVER_S, Observing
from gloc3_onboard.command_server.site import ServerSettings, Site
from gloc3_onboard.command_server.summaries import RequestCounts
from gloc3_onboard.command_server.vehicle_state import VehicleState

DIRECT_PERIOD_S: Final = 2.0
"""How often the autopilot is asked for its own landing until it lands."""
DRIVER_SILENT_S: Final = 2.0
"""What a driver that has not reported for so long was doing says nothing of the present; it reports at 5 Hz."""
BY_ITSELF: Final[Mapping[FlightMode, frozenset[FlightMode]]] = {
    FlightMode.TAKE_OFF: frozenset({FlightMode.HOLD}),
    FlightMode.MISSION: frozenset({FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND}),
    FlightMode.RETURN: frozenset({FlightMode.HOLD, FlightMode.LAND}),
}
"""Modes to which an autopilot goes over at the end of what it was commanded."""
COME_UP_S: Final = 30.0
"""After a restart: how long components that are still coming up are waited for before the mission is taken up."""


class MissionPorts(PortGroup):
    """Inputs and outputs of the mission host."""

    action_status = Input(ActionStatus, Keep.ALL, depth=256)

    function = Output(FunctionRequest)
    grant = Output(MotionGrant)
    take_over = Output(TakeOver)
    direct_landing = Output(Manoeuvre)


class MissionHost:
    """Runs the executor; the only part that starts actions.

    Args:
        site: the platform, and the stored progress.
        observing: the observed state.
        control: the holder of control.
        settings: the server's settings.
        report: sends an event to the stations.
    """

    def __init__(
        self, site: Site, observing: Observing, control: ControlAuthority, settings: ServerSettings, report: EventReport
    ) -> None:
        self.executor: MissionExecutor | None = None
        """None until the previous process's state is restored."""
        self.counts = RequestCounts()
        """What the loaded mission takes."""
        self.granted = MotionGrant(action_id="", component="")
        """The owner of motion."""
        self._landed_directly_s = self._held_directly_s = -inf
        self._has_landed_directly = False
        """Whether the autopilot lands by itself because it was asked to, and nothing has ended that since."""
        self._ended: MissionProgram | None = None
        """The program whose end was reported."""
        self._site, self._observing, self._control, self._report = site, observing, control, report
        self._settle_s = settings.settle_s
        self._connected_s: float | None = None
        self._performing: dict[str, str] = {}
        """Component to the action that it says it is performing."""
        self._waiting: dict[str, tuple[str, Verb]] = {}
        """Action and verb of each pending request id."""
        self._count = 0
        self._attended_s: float | None = None
        """When we had control last, or somebody was heard who may be the pilot."""
        self._gap_s = 0.0
        """Of the last gap that was reported."""
        self._circling = CirclingWatch()
        self._operated = FlightMode.OTHER
        """Mode that an operator has commanded the autopilot itself; what follows from it is the operator's, too."""

    @property
    def policy(self) -> str:
        """The policy that is being carried out; empty where none is."""
        return self.executor.policy if self.executor is not None else ""

    @property
    def is_operators(self) -> bool:
        """Whether an operator has control, who commanded the autopilot itself."""
        return self.executor is not None and self.executor.board.is_operator

    @property
    def is_mission_unknown(self) -> bool:
        """Whether a stored mission is not restored yet; a station told of no mission would consider it lost."""
        kept = self._site.snapshot
        return self.executor is None and kept is not None and bool(kept.programs)

    # --- before the executor decides ---

    def observe(self, now_s: float, inbox: Inbox, *, is_urgent: bool) -> list[Result]:
        """Passes the observed state to the executor; without one, restores the stored state as soon as possible.

        Args:
            now_s: the time.
            inbox: received messages.
            is_urgent: whether an emergency is waiting for the executor.
        """
        for action in inbox.new(MissionPorts.action_status):
            component, status = action.source.component, action.payload
            if status.state in (ActionState.RUNNING, ActionState.PAUSED):
                self._performing[component] = status.action_id
            elif self._performing.get(component) == status.action_id:
                del self._performing[component]
        results: list[Result] = [] if self.executor is not None else self._try_to_begin(now_s, is_urgent=is_urgent)
        if self.executor is not None:
            self._inform(self.executor, now_s, inbox)
            if self._is_handing_over(self.executor, now_s):
                results.append(TakeOver(is_resumed=True))
            results += self._land_directly(self.executor, now_s)
        return results

    def _try_to_begin(self, now_s: float, *, is_urgent: bool) -> list[Result]:
        """Restores the stored state once it is known whether the vehicle flies."""
        snapshot, kept = self._observing.snapshot, self._site.snapshot
        if not snapshot.is_connected:
            return []
        if self._connected_s is None:
            self._connected_s = now_s
        waited_s = now_s - self._connected_s - self._settle_s
        if kept is None or not kept.programs:
            self.executor = MissionExecutor(self._site.platform)
        elif waited_s < 0.0 or not snapshot.is_flight_known:
            return []
        elif waited_s < TAKE_OVER_S and flies_for_us(snapshot, kept, self._site.platform):
            return [TakeOver(is_resumed=True)]
        elif waited_s < COME_UP_S and not is_urgent and self._observing.is_coming_up(now_s):
            return []
        else:
            self.executor = restore(self._site.platform, kept, self._read_again, snapshot.is_airborne, now_s)
        return []

    def _read_again(self, text: str) -> Mission:
        """Reads a mission that was checked before the process ended; raises `InputError` if unreadable.

        It is not checked again, since its start would differ now. Home gives the origin of NED, even without a pose.
        """
        snapshot = self._observing.snapshot
        home = snapshot.home
        origin = GeoPoint(*home.origin_geo) if home is not None and home.origin_geo is not None else snapshot.origin
        home_geo = None if home is None or origin is None else TangentPlane(origin).geo_from_ned(home.position_ned_m)
        altitude_m = None if home is None or origin is None else origin.altitude_m - home.position_ned_m[2]
        surroundings = MissionReferences.of(
            self._site.platform, origin=origin, home_altitude_m=altitude_m, home=home_geo, terrain=self._site.terrain
        )
        return read_mission(text, "kept mission", surroundings)

    def _land_directly(self, executor: MissionExecutor, now_s: float) -> list[Result]:
        """Requests the autopilot's own landing, of its driver or else of the landing watchdog, until it is under way."""
        if executor.board.has_pilot:
            self._has_landed_directly = False
            return []
        if not executor.needs_direct_landing(now_s):
            return self._hold_directly(executor, now_s)
        driver = self._driver_state(now_s)
        if driver is not None and _is_landing(driver):
            self._has_landed_directly = True
            return []
        if now_s - self._landed_directly_s < DIRECT_PERIOD_S:
            return []
        self._landed_directly_s = now_s
        self._observing.lands_directly()
        if not self._has_landed_directly:
            self._has_landed_directly = True
            self._report(Severity.WARNING, "the autopilot is asked to land by itself")
        return self._request_manoeuvre(ManoeuvreKind.LAND)

    def _hold_directly(self, executor: MissionExecutor, now_s: float) -> list[Result]:
        """Breaks off such a landing for an operator's hold: nobody performs it, so there is nobody to cancel it."""
        driver, autopilot = self._driver_state(now_s), self._observing.snapshot.known_autopilot
        if executor.policy != Policy.HOLD:
            self._has_landed_directly = False
        if not self._has_landed_directly or autopilot is None or now_s - self._held_directly_s < DIRECT_PERIOD_S:
            return []
        is_driven = driver is not None and _is_landing(driver)
        if not is_driven and autopilot.mode not in (FlightMode.RETURN, FlightMode.LAND):
            self._has_landed_directly = False
            return []
        if self._held_directly_s < self._landed_directly_s:
            self._report(Severity.WARNING, "the autopilot is asked to hold by itself")
        self._held_directly_s = now_s
        return self._request_manoeuvre(ManoeuvreKind.HOLD)

    def _driver_state(self, now_s: float) -> DriverState | None:
        """What the driver says; None while it is silent."""
        snapshot = self._observing.snapshot
        return snapshot.driver if now_s - snapshot.driver_s <= DRIVER_SILENT_S else None

    def _request_manoeuvre(self, kind: ManoeuvreKind) -> list[Result]:
        return [MissionPorts.direct_landing.report(Manoeuvre(action_id=self.granted.action_id, kind=kind))]

    def _is_handing_over(self, executor: MissionExecutor, now_s: float) -> bool:
        return not executor.board.has_pilot and self._observing.is_handing_over(now_s)

    def _inform(self, executor: MissionExecutor, now_s: float, inbox: Inbox) -> None:
        """Tells the executor the facts."""
        known, snapshot = self._observing, self._observing.snapshot
        if known.stalled_s:
            executor.stalled(known.stalled_s)
        is_silence_judged = known.is_silence_judged(now_s)
        for name in known.book.down(now_s) if is_silence_judged else ():
            status = known.book.status(name)
            executor.component_failed(name, (status.cause if status is not None else "") or "it has left", now_s)
        for action in inbox.new(MissionPorts.action_status):
            executor.reported(action.payload, now_s)
        if is_silence_judged:
            executor.available(known.missing(now_s), now_s)
        if snapshot.is_connected:
            executor.vehicle(snapshot.is_airborne, now_s)
        driver = snapshot.driver
        if driver is not None and not self._is_handing_over(executor, now_s):
            self._inform_control(executor, driver, now_s)
        fence = executor.mission.mission.fence if executor.mission is not None and executor.mission.is_open else None
        if is_silence_judged:
            if (report := snapshot.late_pose_report(now_s)) and not executor.board.has_pilot:
                self._report(Severity.WARNING, report, cause=Cause.POSITION)
            for condition, is_on, reason in snapshot.conditions(fence, now_s):
                executor.condition(condition, is_on, reason, now_s)
            silent_s = self._control.unattended_s(now_s, is_airborne=snapshot.is_airborne)
            executor.link(silent_s, now_s)
            executor.sensed(snapshot.readings(now_s) | {"link_silent_s": silent_s}, now_s)
        self._count_up(executor, now_s)
        self._report_uncertainty(executor)
        for verdict in known.verdicts:
            executor.component_lost(verdict.component, Policy(verdict.policy), verdict.reason, now_s)
        known.verdicts.clear()
        executor.restored(known.restored(now_s))

    def _inform_control(self, executor: MissionExecutor, driver: DriverState, now_s: float) -> None:
        """Reports who has control: we, a pilot, or the autopilot's failsafe, which only we can end."""
        is_failsafe = driver.has_pilot_control and driver.is_failsafe
        reported_s = self._observing.snapshot.driver_s
        executor.pilot(
            driver.has_pilot_control, driver.pilot_reason, now_s, is_failsafe=is_failsafe, reported_s=reported_s
        )
        autopilot = self._observing.snapshot.known_autopilot
        if is_failsafe and autopilot is not None:
            snapshot = self._observing.snapshot
            self._circling.update(autopilot, snapshot.pose if snapshot.is_pose_fresh(now_s) else None)
            if not autopilot.is_armed:
                executor.failsafe_landed(now_s)
            elif self._is_held(autopilot, now_s) or self._circling.is_circling:
                executor.failsafe_holds(now_s)
        else:
            self._circling.clear()
        self._follow_operator(executor, autopilot, now_s)
        is_operators = executor.board.is_operator
        is_there = (autopilot is None or autopilot.has_transmitter) and not is_operators
        if not driver.has_pilot_control or is_there or self._attended_s is None:
            self._attended_s = now_s
        if not is_operators:
            self._attended_s = max(self._attended_s, self._control.others_received_s())
        is_attended = not is_operators and now_s - self._attended_s < UNATTENDED_S
        if driver.has_pilot_control and not is_attended and not _brings_down(autopilot, is_operators=is_operators):
            executor.unattended(now_s - self._attended_s, now_s, is_held=self._is_held(autopilot, now_s))
        if driver.held_after_gap_s not in (0.0, self._gap_s):
            text = (
                f"no contact with the autopilot for {driver.held_after_gap_s:.1f} s: it held meanwhile, now it goes on"
            )
            self._report(Severity.WARNING, text)
        self._gap_s = driver.held_after_gap_s

    def _is_held(self, autopilot: AutopilotState | None, now_s: float) -> bool:
        """Whether the vehicle holds; a diver also in a mode of a pilot who is not there: ArduSub's failsafe ends in one."""
        if autopilot is None:
            return False
        is_left = autopilot.vehicle is VehicleClass.SUB and autopilot.mode is FlightMode.MANUAL
        is_alone = not autopilot.has_transmitter and now_s - self._control.others_received_s() >= UNATTENDED_S
        return autopilot.mode is FlightMode.HOLD or (is_left and is_alone)

    def operated(self, executor: MissionExecutor, what: str, now_s: float) -> None:
        """An operator has commanded the autopilot itself: `station 255 sent return`."""
        autopilot = self._observing.snapshot.known_autopilot
        self._operated = autopilot.mode if autopilot is not None else FlightMode.OTHER
        executor.operated(what, now_s)

    def _follow_operator(self, executor: MissionExecutor, autopilot: AutopilotState | None, now_s: float) -> None:
        """After an operator's command to the autopilot, a mode that does not follow from it is a pilot's."""
        if not executor.board.is_operator or autopilot is None or autopilot.mode is self._operated:
            return
        if autopilot.mode in BY_ITSELF.get(self._operated, ()):
            self._operated = autopilot.mode
        else:
            reason = f"mode {mode_words(autopilot.mode_name)} was chosen by another party"
            executor.pilot_after_operator(reason, now_s)

    def _report_uncertainty(self, executor: MissionExecutor) -> None:
        """Says once, at the end of a mission, where the position is less certain than its waypoints needed."""
        program, pose = executor.mission, self._observing.snapshot.pose
        if program is None or program is self._ended or not program.has_ended:
            return
        self._ended = program
        std_m = 0.0 if pose is None else hypot(*pose.position_std_m[:2])
        near_m = self._site.platform.limits.survey_acceptance_m
        if std_m > near_m:
            text = f"the position is uncertain by {std_m:.1f} m (standard deviation); waypoints counted within {near_m:g} m"
            self._report(Severity.NOTICE, text)

    def _count_up(self, executor: MissionExecutor, now_s: float) -> None:
        """What the mission takes, for the comparison with its estimate."""
        snapshot = self._observing.snapshot
        if self.counts.program is not executor.mission:
            if self.counts.program is not None and self.counts.program.is_open:
                self.counts.program = executor.mission  # the same flight by another text
            else:
                self.counts = RequestCounts(executor.mission)
        at = snapshot.pose.position_ned_m if snapshot.pose is not None and snapshot.is_pose_fresh(now_s) else None
        self.counts.update(at, snapshot.autopilot.battery_remaining if snapshot.autopilot is not None else -1.0, now_s)

    # --- what the executor asks for ---

    def receive_reply(self, reply: CommandReply | FunctionReply, now_s: float) -> bool:
        """Whether a component's reply was to a request of the executor."""
        waiting = self._waiting.pop(reply.request_id, None)
        if waiting is None or self.executor is None:
            return False
        action_id, verb = waiting
        self.executor.replied(action_id, verb, reply.is_accepted, reply.reason, now_s)
        return True

    def take(self, now_s: float) -> list[Request]:
        """Pending requests of the executor, to be carried out in this order."""
        if self.executor is None:
            return []
        self.executor.tick(now_s)
        return self.executor.collect(now_s)

    def carry_out(self, request: Request) -> list[Result]:
        """Carries out a request of the executor."""
        match request:
            case Persist(snapshot=snapshot):
                self._site.keep_snapshot(snapshot)
            case Grant():
                self.granted = MotionGrant(action_id=request.action_id, component=request.component)
                return [self.granted]
            case Start(progress=progress):
                arguments = {"capability": request.capability, "arguments": request.arguments, "progress": progress}
                start = self._function(request.component, request.action_id, "start", arguments)
                return [*self._clear(request.component), start]
            case Pause():
                return [self._function(request.component, request.action_id, "pause", {})]
            case Resume():
                return [self._function(request.component, request.action_id, "resume", {})]
            case Cancel():
                return [self._function(request.component, request.action_id, "cancel", {})]
            case ReclaimMotion():
                return [TakeOver(is_resumed=True)]
            case MissionEvent():
                self._report(request.severity, request.text, cause=request.cause)
        return []

    def _clear(self, component: str) -> list[PortReport]:
        """Has a component end an action that a former life of this server has left it with."""
        left = self._performing.pop(component, "")
        if not left or self.executor is None or self.executor.has_item(left):
            return []
        return [self._function(component, left, "cancel", {})]

    def _function(self, component: str, action_id: str, verb: Verb, more: dict[str, Any]) -> PortReport:
        self._count += 1
        request_id = f"action-{self._count}"
        self._waiting[request_id] = (action_id, verb)
        arguments = {"action_id": action_id, **more}
        message = FunctionRequest(request_id=request_id, function=f"action.{verb}", arguments=arguments)
        return MissionPorts.function.report(message, key=component)


def _is_landing(driver: DriverState) -> bool:
    """Whether the driver has the autopilot land."""
    return driver.manoeuvre is ManoeuvreKind.LAND and driver.manoeuvre_state is ManoeuvreState.RUNNING


def _brings_down(autopilot: AutopilotState | None, *, is_operators: bool) -> bool:
    """Whether its failsafe, or an operator's command, already returns or lands the vehicle: no milder policy interrupts."""
    is_theirs = autopilot is not None and (autopilot.is_failsafe or is_operators)
    return autopilot is not None and is_theirs and autopilot.mode in (FlightMode.RETURN, FlightMode.LAND)


def was_running(kept: Snapshot | None) -> bool:
    """Whether a mission, a single command or a policy was under way."""
    return kept is not None and (
        kept.policy is not None
        or any(program.own.state in (ActionState.RUNNING, ActionState.PAUSED) for program in kept.programs)
    )


def flies_for_us(snapshot: VehicleState, kept: Snapshot, platform: Platform) -> bool:
    """Whether the vehicle continues what was started before, although the driver attributes it to a pilot."""
    state = snapshot.autopilot
    modes = (*OURS, FlightMode.MISSION) if _flew_a_plan(kept, platform) else OURS
    is_ours = state is not None and state.is_armed and state.mode in modes
    is_accepted = snapshot.driver is None or snapshot.driver.has_pilot_control
    return was_running(kept) and is_ours and is_accepted and not kept.has_pilot


def _flew_a_plan(kept: Snapshot, platform: Platform) -> bool:
    """Whether the autopilot had been given a plan to fly, as winged vehicles always are."""
    items = (item for program in kept.programs for item in program.items.values())
    has_wings = platform.vehicle.type in ("aircraft", "vtol")
    return any((has_wings or item.is_planned) and item.state is ActionState.RUNNING for item in items)
