"""The state of the components and the vehicle, and their supervision."""

from collections.abc import Iterable, Iterator
from math import inf
from typing import Final, NamedTuple

from gloc3.component.deployment import FaultPolicy
from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup, PortReport
from gloc3.component.supervision import LciRequest, Step, Supervision, SupervisionVerdict
from gloc3.messages.envelope import CommandReply, CommandRequest, ComponentStatus, Envelope, Severity
from gloc3.messages.hosts import HostPresence
from gloc3.messages.readiness import AutopilotSetup, ComputerState
from gloc3.messages.summaries import Cause, EventReport, Health, component_cause
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    FenceState,
    FlightMode,
    HeightAboveGround,
    ManoeuvreKind,
    ManoeuvreState,
    Pose,
    Setpoint,
)
from gloc3.mission.model.abilities import abilities
from gloc3.platform.places import place_of
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.component_book import ComponentBook
from gloc3_onboard.command_server.vehicle_state import KeptHome, VehicleState

STOOD_STILL_S: Final = 0.3
"""Delay between cycles that counts as a standstill of the process, s: less than the shortest silence that matters."""
UNUSUAL: Final = 3.0
"""So many times the pause before that: its rate can be set, too."""
CATCH_UP_S: Final = 0.5
"""Time for queued messages to arrive after a standstill, s; silence is not judged until then."""
STOOD_STILL_AGAIN_S: Final = 2.0
"""Not again so soon after it: a process that never has time is one that has no time."""
OURS: Final = (FlightMode.GUIDED, FlightMode.HOLD, FlightMode.TAKE_OFF, FlightMode.LAND)
"""Modes in which a vehicle that a former life of a driver, or of this process, flew may be taken up again."""
COMMANDED: Final = {
    ManoeuvreKind.TAKE_OFF: (FlightMode.TAKE_OFF, FlightMode.GUIDED),
    ManoeuvreKind.SET_OFF: (FlightMode.GUIDED,),
    ManoeuvreKind.LAND: (FlightMode.LAND,),
    ManoeuvreKind.HOLD: (FlightMode.HOLD,),
    ManoeuvreKind.PLAN: (FlightMode.MISSION,),
}
"""Modes that the driver commands for each manoeuvre; the answer may come after the end of its life."""
SETPOINTS_MISSED: Final = "no setpoint for 0.5 s: holding for {:g} s, and until setpoints come steadily"
"""Told once, and again after setpoints have been followed for half a minute; `DriverState.expired` counts."""
TAKE_OVER_S: Final = 2.0
"""Time for which a driver is asked to resume, s."""


class ObservingPorts(PortGroup):
    """Inputs of the observation, and the commands of the supervision."""

    status = Input(ComponentStatus, Keep.ALL, depth=512)
    reply = Input(CommandReply, Keep.ALL)
    host_presence = Input(HostPresence, Keep.ALL)
    autopilot = Input(AutopilotState)
    pose = Input(Pose)
    setpoint = Input(Setpoint)
    driver = Input(DriverState)
    fence_state = Input(FenceState)
    autopilot_setup = Input(AutopilotSetup)
    computer = Input(ComputerState)
    height = Input(HeightAboveGround)

    command = Output(CommandRequest)


class Observing:
    """Follows the components, the vehicle, the hosts and the process itself.

    Args:
        platform: the platform file.
        home: where the vehicle was armed, as the process before has left it.
        report: has an event of the supervision told to the stations.
        process: a random number of this process.
    """

    def __init__(self, platform: Platform, home: KeptHome | None, report: EventReport, process: int = 0) -> None:
        self.snapshot: Final = VehicleState(platform, home)
        self.book: Final = ComponentBook(platform.components, process, platform.digest())
        self.supervision: Supervision | None = None
        """None before the first cycle: only then the time is known."""
        self.setup: AutopilotSetup | None = None
        self.computer: ComputerState | None = None
        self.height: HeightAboveGround | None = None
        self.hosts: Final[dict[str, HostPresence]] = {}
        """The other hosts, as far as they were ever here."""
        self.verdicts: list[SupervisionVerdict] = []
        """Permanently lost components, with the policy to apply."""
        self.stalled_s = 0.0
        """For how long the process has just stood still; 0 in all cycles but the first after it."""
        self._availability = Availability(platform)
        self._standstill = Standstill()
        self._handover = Handover()
        self._platform, self._report = platform, report

    def observe(self, now_s: float, inbox: Inbox) -> None:
        """Takes everything in."""
        self.stalled_s = self._standstill.tick(now_s)
        if self.stalled_s:
            self._report(Severity.WARNING, f"this process stalled for {self.stalled_s:.1f} s", cause=Cause.LINK)
            self.snapshot.stalled(self.stalled_s)
            self.book.stalled(self.stalled_s)
        snapshot = self.snapshot
        for status in inbox.new(ObservingPorts.status):
            self.book.receive(status.payload, status.t_s)
        for state in inbox.new(ObservingPorts.autopilot):
            snapshot.update_autopilot(state)
        for pose in inbox.new(ObservingPorts.pose):
            snapshot.update_pose(pose)
        for setpoint in inbox.new(ObservingPorts.setpoint):
            snapshot.update_setpoint(setpoint)
        snapshot.expire(now_s)
        for driver in inbox.new(ObservingPorts.driver):
            self._handover.update(driver, snapshot.known_autopilot, now_s)
            if driver.payload.steady_s and not (snapshot.driver and snapshot.driver.steady_s):
                self._report(Severity.WARNING, SETPOINTS_MISSED.format(driver.payload.steady_s))
            snapshot.driver, snapshot.driver_s = driver.payload, now_s
        for fence in inbox.new(ObservingPorts.fence_state):
            snapshot.fence = fence.payload
        for setup in inbox.new(ObservingPorts.autopilot_setup):
            self.setup = setup.payload
        for computer in inbox.new(ObservingPorts.computer):
            self._report_logs(computer.payload)
            self.computer = computer.payload
        for height in inbox.new(ObservingPorts.height):
            self.height = height.payload
            snapshot.update_height(height)

    def _report_logs(self, computer: ComputerState) -> None:
        """A log that has stopped does not end a flight, but nobody can look into it afterwards."""
        before = "" if self.computer is None else self.computer.log_problem
        if computer.log_problem and computer.log_problem != before:
            self._report(Severity.ALERT, f"logging has stopped: {computer.log_problem}")
        elif before and not computer.log_problem:
            self._report(Severity.NOTICE, "logging goes on")

    def supervise(self, now_s: float, inbox: Inbox) -> list[PortReport]:
        """Activates standbys and restarts faulty components; a permanent loss becomes a verdict."""
        if self.supervision is None:
            self.supervision = Supervision(self._platform.components, f"supervision-{now_s:.3f}")
        supervision = self.supervision
        supervision.is_under_way = self.snapshot.is_airborne
        steps: list[Step] = []
        for reply in inbox.new(ObservingPorts.reply):
            steps += supervision.receive_reply(reply.payload, now_s)
        # A reply follows the statuses of what it answers: the last status is never older than the reply.
        last = {status.payload.name: status.payload for status in inbox.new(ObservingPorts.status)}
        for status in last.values():
            steps += supervision.receive_status(status, now_s)
        for presence in inbox.new(ObservingPorts.host_presence):
            steps += self._receive_presence(supervision, presence.payload, now_s)
        if self.is_silence_judged(now_s):
            steps += supervision.tick(now_s)
        commands: list[PortReport] = []
        for step in steps:
            match step:
                case LciRequest(component=component, request=request, reason=reason):
                    words = ", ".join([request.command, *request.then])
                    self._report(Severity.WARNING, f"{words} {component}: {reason}", cause=component_cause(component))
                    commands.append(ObservingPorts.command.report(request, key=component))
                case SupervisionVerdict():
                    self.verdicts.append(step)
        return commands

    def _receive_presence(self, supervision: Supervision, presence: HostPresence, now_s: float) -> list[Step]:
        """Supervision steps after the loss of a host; once it is back, its components report for themselves."""
        host = presence.host
        was_here, self.hosts[host] = host in self.hosts and self.hosts[host].is_here, presence
        if presence.is_here:
            if not was_here:
                self._report(Severity.NOTICE, f"host {host} is here")
            return []
        reason = f"host {host} is lost"
        self._report(Severity.ERROR, reason)
        steps: list[Step] = []
        for row in self._platform.components:
            if place_of(self._platform, row).host == host:
                steps += supervision.lose(row.name, reason, now_s)
                self.book.lose(row.name)
        policy = self._platform.hosts[host].on_loss if host in self._platform.hosts else FaultPolicy.IGNORE
        if policy is not FaultPolicy.IGNORE:
            steps.append(SupervisionVerdict(_as_lost(host), policy, "no status received"))
        return steps

    @property
    def health(self) -> Health:
        """Of the platform as a whole."""
        return self.supervision.health() if self.supervision is not None else Health.IDLE

    def is_silence_judged(self, now_s: float) -> bool:
        """Whether silence counts: not just after the process has stood still."""
        return self._standstill.is_over(now_s)

    def missing(self, now_s: float) -> dict[str, tuple[str, ...]]:
        """Unavailable capabilities and what each lacks."""
        return self._availability.missing(self.book, self.snapshot, now_s)

    def restored(self, now_s: float) -> Iterator[str]:
        """What no verdict holds for: components that work, and hosts that are here."""
        yield from self.book.working(now_s)
        yield from (_as_lost(host) for host, presence in self.hosts.items() if presence.is_here)

    def is_coming_up(self, now_s: float) -> bool:
        """Whether some capability cannot be used yet, and components are coming up still, or once more."""
        if not self.missing(now_s):
            return False
        is_tried = self.supervision is not None and self.supervision.is_bringing_up
        return is_tried or self.book.is_coming_up(now_s)

    def is_handing_over(self, now_s: float) -> bool:
        """Whether the restarted driver mistakes our own control for a pilot's."""
        driver = self.snapshot.driver
        return driver is not None and self._handover.is_ours(driver, self.snapshot.known_autopilot, now_s)

    def lands_directly(self) -> None:
        """The autopilot was asked for its own landing: that mode is ours for a driver that comes back."""
        self._handover.is_landing = True


def _as_lost(host: str) -> str:
    """Name of a host in a verdict."""
    return f"host {host}"


class _LastSeen(NamedTuple):
    """Inputs of the last answer."""

    working: frozenset[str]
    silent: frozenset[tuple[str, str]]
    has_pose: bool
    """There is a valid one, which may be late."""
    is_connected: bool


class Availability:
    """Checks each capability's needs: components, topics, capabilities, and the vehicle's pose and autopilot.

    A topic is available while a component that provides it is working and publishes on it.
    """

    def __init__(self, platform: Platform) -> None:
        self._platform: Final = platform
        self._producers: Final[dict[str, list[str]]] = {}
        for row in platform.components:
            for port in row.load_class().outputs:
                for topic in row.topics(port):
                    self._producers.setdefault(topic, []).append(row.name)
        self._needs: Final = {
            name: {need: self._who(need) for need in (row.performed_by, *row.needs) if need}
            for name, row in abilities(platform).items()
            if row.performed_by
        }
        """Needs of each capability, with the components of which one must be working."""
        self._seen: _LastSeen | None = None
        self._missing: dict[str, tuple[str, ...]] = {}

    def missing(self, book: ComponentBook, snapshot: VehicleState, now_s: float) -> dict[str, tuple[str, ...]]:
        """Unavailable capabilities and what each lacks."""
        has_pose = snapshot.is_pose_fresh(now_s) or snapshot.is_pose_late(now_s)
        seen = _LastSeen(book.working(now_s), book.silent, has_pose, snapshot.is_connected)
        if seen != self._seen:
            self._seen = seen
            self._missing = dict(self._find(seen))
        return self._missing

    def _find(self, seen: _LastSeen) -> Iterable[tuple[str, tuple[str, ...]]]:
        snapshot = {"pose": seen.has_pose, "autopilot": seen.is_connected}

        def is_alive(need: str, who: frozenset[str]) -> bool:
            return snapshot.get(need, any(one in seen.working and (one, need) not in seen.silent for one in who))

        for name, needs in self._needs.items():
            missing = tuple(need for need, who in needs.items() if not is_alive(need, who))
            if missing:
                yield name, missing

    def _who(self, need: str) -> frozenset[str]:
        """The components of which one must work: itself, a capability's, or a topic's producers; and their standbys."""
        rows, capabilities = self._platform.components, self._platform.capabilities
        if any(row.name == need for row in rows):
            names = [need]
        elif need in capabilities:
            names = [capabilities[need].performed_by]
        else:
            names = self._producers.get(need, [])
        return frozenset([*names, *(row.name for row in rows if row.standby_for in names)])


class Standstill:
    """Detects that the process has stalled, by the times of its cycles."""

    def __init__(self) -> None:
        self._before_s, self._pause_s = inf, 0.0
        self._until_s = -inf

    def tick(self, now_s: float) -> float:
        """Takes the time of a cycle.

        Returns:
            For how long the process has stood still, in the first cycle after it; else 0.
        """
        usual_s, pause_s = self._pause_s, now_s - self._before_s
        self._before_s, self._pause_s = now_s, pause_s
        if pause_s <= max(STOOD_STILL_S, UNUSUAL * usual_s) or now_s < self._until_s + STOOD_STILL_AGAIN_S:
            return 0.0
        self._until_s = now_s + CATCH_UP_S
        return pause_s

    def is_over(self, now_s: float) -> bool:
        """Whether silence counts."""
        return now_s >= self._until_s


class Handover:
    """Distinguishes a driver that restarted in flight from a pilot's takeover (DESIGN §7).

    A new driver finds an armed vehicle and cannot know who has control. The server can: if the mode is still the one
    before the restart, one that the former driver was just commanding, or the hold in which a failing driver leaves the
    vehicle, nobody has taken over; nor where a landing of ours has ended meanwhile. The time for that begins when the
    autopilot is connected; where it was not, a transmitter means that a pilot may have taken over unseen.
    """

    def __init__(self) -> None:
        self.is_landing = False
        """Whether the autopilot was asked for its own landing without the driver."""
        self._was_blind = False
        self._boot: int | None = None
        self._was_ours = False
        self._mode = FlightMode.OTHER
        self._commanded: tuple[FlightMode, ...] = ()
        self._until_s = float("-inf")

    def update(self, report: Envelope[DriverState], autopilot: AutopilotState | None, now_s: float) -> None:
        """Handles a driver's report and the autopilot's mode."""
        boot = report.source.boot
        if boot != self._boot:
            is_new_life = self._boot is not None and self._was_ours
            self._until_s = now_s + TAKE_OVER_S if is_new_life else float("-inf")
            self._boot, self._was_blind = boot, False
        if now_s < self._until_s and (autopilot is None or not autopilot.is_connected):
            self._until_s, self._was_blind = now_s + TAKE_OVER_S, True
        if now_s >= self._until_s:
            self.is_landing = False
            self._was_ours = not report.payload.has_pilot_control
            self._mode = autopilot.mode if autopilot is not None else FlightMode.OTHER
            self._commanded = self._modes_commanded(report.payload)

    def is_ours(self, driver: DriverState, autopilot: AutopilotState | None, now_s: float) -> bool:
        """Whether the control that the new driver attributes to a pilot was ours; the driver must then be told."""
        if not driver.has_pilot_control or now_s >= self._until_s or autopilot is None:
            return False
        if self._was_blind and autopilot.has_transmitter:
            return False
        before = (self._mode, *self._commanded, *((FlightMode.LAND,) if self.is_landing else ()))
        if not autopilot.is_armed:
            return FlightMode.LAND in before  # which has ended meanwhile
        modes = (*OURS, FlightMode.MISSION)  # of a plan that goes on by itself
        mode = FlightMode.LAND if driver.is_after_landing else autopilot.mode
        return mode in modes and mode in (*before, FlightMode.HOLD)

    @staticmethod
    def _modes_commanded(driver: DriverState) -> tuple[FlightMode, ...]:
        """Those of the manoeuvre that is under way, and of the stream of setpoints."""
        is_running = driver.manoeuvre is not None and driver.manoeuvre_state is ManoeuvreState.RUNNING
        manoeuvre = COMMANDED[driver.manoeuvre] if driver.manoeuvre is not None and is_running else ()
        return (*manoeuvre, FlightMode.GUIDED) if driver.is_streaming else manoeuvre
