"""Observes one flight for its invariants, for what it reaches, and for the story of it."""

from typing import Any, Final, NamedTuple

from gloc3.evaluation.requested_path import RequestedPath
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import CiEvent
from gloc3.messages.topics import matches
from gloc3_sitl.faults.faults import TimedFault
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.messages import SimFault, SimTruth
from gloc3_sitl.physics.wind import CALM
from gloc3_sitl.proof.course import PersonInControl
from gloc3_sitl.proof.invariant import (
    DIVING,
    BrokenInvariant,
    FlightFacts,
    FlownMission,
    Invariant,
    TrueMoment,
)
from gloc3_sitl.proof.reached import TOPICS, Reached
from gloc3_sitl.vehicles.simulator import Simulator


class StoryLine(NamedTuple):
    """Something that happened."""

    t_s: float
    severity: int
    text: str

    def __str__(self) -> str:
        return f"{self.t_s:8.2f} s  {self.text}"


class Observer:
    """Listens to a flight's messages and to its truth.

    Args:
        flight: one that has been entered.
        faults: what is injected into it.
        kinds: the invariants.
    """

    def __init__(self, flight: Flight, faults: tuple[TimedFault, ...], kinds: tuple[type[Invariant], ...]) -> None:
        plan = flight.plan
        is_calm = plan.wind == CALM and not plan.waves_m and not plan.current_m_s
        facts = FlightFacts(flight.platform, flight.mission, faults, _floor_m(flight), is_calm)
        self.invariants: Final = [kind(facts) for kind in kinds]
        self.reached: Final = Reached()
        self.path: Final = RequestedPath(flight.exchange, flight.name)
        self.story: Final[list[StoryLine]] = []
        self.last: TrueMoment | None = None
        self.mission_state, self.mission_reason = "", ""
        self.mission_reported_s = 0.0
        """When the mission's state was last told."""
        self.changes_s: Final[list[float]] = []
        """Times at which the mission's state, its policy or the autopilot's mode has changed."""
        self.settled_since_s: float | None = None
        """Since when a person has the vehicle and no fault has begun or ended; None where that is not so."""
        self._control = PersonInControl(facts)
        self._conduct = ""
        self._flight = flight
        self._routes: dict[str, tuple[Invariant, ...]] = {}
        self._is_reaching: dict[str, bool] = {}
        self._prefix = len(flight.name) + 1
        flight.exchange.subscribe(f"{flight.name}/**", self._receive)

    @property
    def broken(self) -> list[BrokenInvariant]:
        """What did not hold, the earliest first."""
        found = [one.broken for one in self.invariants if one.broken is not None]
        return sorted(found, key=lambda one: one.t_s)

    def end(self, given_s: float, failures: list[str], log_problem: str) -> None:
        """Has all invariants judge the end."""
        flown = FlownMission(
            t_s=self._flight.loop.time(),
            state=self.mission_state,
            reason=self.mission_reason,
            last=self.last,
            given_s=given_s,
            requested=self.path.flights,
            failures=failures,
            log_problem=log_problem,
        )
        for invariant in self.invariants:
            invariant.end(flown)

    def _receive(self, envelope: Envelope[Any]) -> None:
        topic, now_s = envelope.topic[self._prefix :], self._flight.loop.time()
        if topic.startswith("camera/"):
            return
        payload = envelope.payload
        match payload:
            case SimTruth():
                self._observe(payload, envelope.t_s, now_s)
            case SimFault():
                self.settled_since_s = None
                verb = "begins" if payload.is_present else "is over"
                self.story.append(StoryLine(now_s, Severity.WARNING, f"fault {payload.fault} {verb}"))
            case CiEvent():
                self.story.append(StoryLine(now_s, payload.severity, f"{payload.source}: {payload.text}"))
            case _:
                pass
        self._control.receive(payload)
        if topic == "ci/mission":
            self.mission_state, self.mission_reason = payload.state, payload.reason
            self.mission_reported_s = now_s
        routes = self._routes.get(topic)
        if routes is None:
            routes = self._routes[topic] = tuple(
                one for one in self.invariants if any(matches(pattern, topic) for pattern in one.topics)
            )
            self._is_reaching[topic] = any(matches(pattern, topic) for pattern in TOPICS)
        for invariant in routes:
            invariant.receive(topic, envelope, now_s)
        if self._is_reaching[topic]:
            self.reached.receive(topic, envelope)

    def _observe(self, truth: SimTruth, t_s: float, now_s: float) -> None:
        simulator = self._flight.simulator
        assert isinstance(simulator, Simulator)
        autopilot, commander, craft = simulator.autopilot, simulator.autopilot.commander, simulator.autopilot.craft
        body = simulator.truth()
        mode = commander.mode.name
        if self.last is not None and self.last.mode_name != mode:
            self.story.append(StoryLine(now_s, Severity.NOTICE, f"autopilot: {mode} ({commander.mode_author})"))
        moment = TrueMoment(
            t_s=t_s,
            position_ned_m=truth.position_ned_m,
            velocity_ned_m_s=truth.velocity_ned_m_s,
            height_above_ground_m=body.height_above_ground_m,
            is_on_ground=body.is_on_ground,
            is_armed=craft.is_armed,
            is_landed=craft.is_landed,
            behaviour=commander.mode.behaviour,
            mode_name=mode,
            mode_author=commander.mode_author,
            setpoint_age_s=craft.now_s - craft.stream.received_s,
            has_transmitter=autopilot.pilot.is_on,
        )
        self.last = moment
        self._follow(moment)
        for invariant in self.invariants:
            invariant.observe(moment)
        self.reached.observe(moment)

    def _follow(self, moment: TrueMoment) -> None:
        """Keeps when something has changed, and since when a person has the vehicle."""
        mission = self._control.mission
        conduct = f"{mission.state} {mission.policy} {moment.mode_name}" if mission is not None else moment.mode_name
        if conduct != self._conduct:
            self._conduct = conduct
            self.changes_s.append(round(moment.t_s, 1))
        if not moment.is_armed or not self._control.has_one(moment):
            self.settled_since_s = None
        elif self.settled_since_s is None:
            self.settled_since_s = moment.t_s


def _floor_m(flight: Flight) -> float:
    """The height of the water's floor for what dives; minus infinite for everything else."""
    if flight.platform.vehicle.type not in DIVING:
        return float("-inf")
    return flight.simulator.world.water.floor_m
