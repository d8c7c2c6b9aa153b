"""A flight as it stands on a test card: each line lets virtual time pass until it is done, or fails with the story."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pytest

from gloc3.clock import VirtualLoop
from gloc3.component.lci import State
from gloc3.mavlink.codec import MavlinkMessage, Parser
from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    CommandComponent,
    Emergency,
    EmergencyVerb,
    Outcome,
    RequestAction,
    Steer,
    Verb,
)
from gloc3.messages.envelope import ComponentStatus, Envelope, Message, Source
from gloc3.messages.summaries import CiEvent, Health, MissionSummary
from gloc3.messages.vehicle import AutopilotState, DriverState, FlightMode, LandedState
from gloc3.messages.wire import type_name
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_sitl.faults.faults import Injection, schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

T = TypeVar("T")

POLL_PERIOD_S = 0.02
ONE_STYLE = pytest.mark.parametrize("style", ["px4"], indirect=True)
"""Marks a test of what the autopilot has no part in: one style is enough."""


class Card:
    """One flight in virtual time. `begin` it, then write down what is done and what is to be seen."""

    def __init__(self, style: str, folder: Path) -> None:
        self.style = style
        self.received: dict[str, list[Envelope[Any]]] = {}
        """Everything that was published but pictures, by topic below the platform's name."""
        self.to_autopilot: list[tuple[float, MavlinkMessage]] = []
        """What the onboard process sent over the autopilot's cable, and when."""
        self.failures: list[BaseException] = []
        self._folder = folder
        self._others: dict[str, CommandClient] = {}
        self._runner = asyncio.Runner(loop_factory=VirtualLoop)
        self._flight: Flight | None = None

    # --- begin and end ---

    def begin(self, mission: str, *, is_started: bool = True, faults: Sequence[str] = (), **plan: Any) -> None:
        """Everything is switched on, the mission brought up and, unless told otherwise, started.

        Args:
            mission: the name of an example, or a text.
            is_started: whether the operator starts it.
            faults: what is wrong from the begin.
            plan: other fields of the `FlightPlan`; `platform` may be a text, too.
        """
        plan = {"mission": mission, "autopilot": self.style, **plan}
        for key in ("mission", "platform"):
            if "\n" in plan.get(key, ""):
                file = self._folder / f"{key}.yaml"
                file.write_text(plan[key])
                plan[key] = str(file)
        self.run(self._enter(FlightPlan(**plan)))
        self.flight.exchange.subscribe(f"{self.flight.name}/**", self._receive)
        self._listen_on_the_cable()
        for text in faults:
            self.fault(text)
        if is_started:
            self.run(self.flight.upload_and_start())
        else:
            self.run(self._upload())

    async def _enter(self, plan: FlightPlan) -> None:
        self._flight = await Flight(plan).__aenter__()

    async def _upload(self) -> None:
        flight = self.flight
        await flights.await_platform(flight.station, flight.name)
        assert not await flights.await_ready(flight.station, flight.name)
        plan = CheckedPlan(name=flight.mission_file.name, title=flight.mission.name, text=flight.mission.text)
        await flights.stream(flight.station, flight.name, plan)

    def close(self) -> None:
        """Ends the flight; what callbacks raised meanwhile fails the test."""
        try:
            if self._flight is not None:
                self.run(self._flight.__aexit__(None, None, None))
            loop = self._runner.get_loop()
            assert isinstance(loop, VirtualLoop)
            self.failures = loop.failures
        finally:
            self._runner.close()

    def run(self, steps: Coroutine[Any, Any, T]) -> T:
        """Lets virtual time pass until a coroutine has ended."""
        return self._runner.run(steps)

    # --- what is done ---

    def wait(self, seconds: float) -> None:
        """Lets time pass."""
        self.run(asyncio.sleep(seconds))

    def fault(self, text: str, for_s: float | None = None) -> Injection:
        """Something goes wrong, at the times in the text or from now on."""
        span = "" if for_s is None else f"@{self.now_s}..{self.now_s + for_s}"
        return self.run(self._fault(text + span))

    async def _fault(self, text: str) -> Injection:
        return schedule_faults(self.flight, (text,))[0]

    def request(self, body: AnyBody) -> CiReply:
        """The station asks for something."""
        return self.run(self.flight.station.client.request(self.flight.name, body))

    def as_station(self, station: str, body: AnyBody) -> CiReply:
        """Another station asks for something, by the platform's own middleware."""
        return self.run(self._as_station(station, body))

    async def _as_station(self, station: str, body: AnyBody) -> CiReply:
        flight = self.flight
        if station not in self._others:
            self._others[station] = CommandClient(flight.exchange, flight.loop, station, boot=1)
        return await self._others[station].request(flight.name, body)

    def command(self, verb: str, target: str = "") -> None:
        """The operator starts, pauses, resumes, skips or aborts; it must be acknowledged."""
        reply = self.request(Steer(verb=Verb(verb), target=target))
        assert reply.outcome is Outcome.ACCEPTED, self.story(f"{verb} {target}: {reply.reason}")

    def refused(self, body: AnyBody) -> str:
        """The station asks for something that must be refused; the reason."""
        reply = self.request(body)
        assert reply.outcome is Outcome.REFUSED, self.story(f"{body} was {reply.outcome}")
        assert reply.reason
        return reply.reason

    def refused_steer(self, verb: str, target: str = "") -> str:
        """The operator asks for what must be refused; the reason."""
        return self.refused(Steer(verb=Verb(verb), target=target))

    def component(self, name: str, command: str, *, is_forced: bool = False) -> CiReply:
        """The station commands a component's LCI."""
        return self.request(CommandComponent(component=name, command=command, is_forced=is_forced))

    def action(self, capability: str, **arguments: Any) -> CiReply:
        """The station asks for a single action, a low-level command."""
        return self.request(RequestAction(capability=capability, arguments=arguments))

    def emergency(self, verb: str) -> None:
        """The emergency key."""
        assert self.emergency_reply(verb).outcome is Outcome.ACCEPTED

    def emergency_reply(self, verb: str, confirmation: str = "") -> CiReply:
        """What becomes of the emergency key."""
        return self.request(Emergency(verb=EmergencyVerb(verb), confirmation=confirmation))

    # --- what is to be seen ---

    def until(self, condition: Callable[[], bool], within_s: float, what: str) -> float:
        """Waits until something is so; returns how long that took."""
        return self.run(self._until(condition, within_s, what))

    async def _until(self, condition: Callable[[], bool], within_s: float, what: str) -> float:
        begin_s = self.now_s
        while not condition():
            assert self.now_s - begin_s <= within_s, self.story(f"not within {within_s:g} s: {what}")
            await asyncio.sleep(POLL_PERIOD_S)
        return self.now_s - begin_s

    def always(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        """Watches that something stays so."""
        self.run(self._always(condition, seconds, what))

    async def _always(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            assert condition(), self.story(f"no longer so: {what}")
            await asyncio.sleep(POLL_PERIOD_S)

    def expect(self, topic: str, predicate: Callable[[Any], bool], within_s: float) -> Any:
        """Waits for a message that fits."""
        return self.run(self.flight.expect(topic, predicate, within_s))

    def await_state(self, target: str, state: str, within_s: float = 20.0) -> float:
        """Waits for the state of the `mission`, a `TASK` or a `TASK.ACTION`, as the station sees it."""
        wanted = ActionState(state)
        return self.until(lambda: self.state(target) == wanted, within_s, f"{target} {state}")

    def await_component(self, name: str, state: str, within_s: float = 5.0) -> float:
        """Waits for the state of a component's LCI."""
        wanted = State(state)
        return self.until(lambda: self.lci(name) is wanted, within_s, f"{name} {state}")

    def await_mode(self, mode: FlightMode, within_s: float = 5.0) -> float:
        """Waits for a mode of the autopilot, as its driver sees it."""
        return self.until(lambda: self.autopilot.mode is mode, within_s, f"mode {mode}")

    def await_policy(self, policy: str, within_s: float = 8.0) -> float:
        """Waits until a policy is carried out; empty for until none is."""
        return self.until(lambda: self.mission.policy == policy, within_s, f"policy {policy!r}")

    def await_landed(self, within_s: float = 30.0) -> None:
        """Waits until the vehicle stands, disarmed."""
        self.until(lambda: not self.autopilot.is_armed, within_s, "disarmed")
        self.until(lambda: self.autopilot.landed is LandedState.ON_GROUND, 0.5, "on the ground")
        assert abs(self.height_m) < 0.2, self.story(f"disarmed at {self.height_m:.2f} m")

    # --- looking ---

    @property
    def flight(self) -> Flight:
        """The stack."""
        assert self._flight is not None, "begin() the flight first"
        return self._flight

    @property
    def now_s(self) -> float:
        return self.flight.loop.time()

    @property
    def mission(self) -> MissionSummary:
        """The mission, as the platform tells it."""
        return self.last("ci/mission")  # type: ignore[no-any-return]

    @property
    def autopilot(self) -> AutopilotState:
        return self.last("autopilot")  # type: ignore[no-any-return]

    @property
    def driver(self) -> DriverState:
        return self.last("driver")  # type: ignore[no-any-return]

    @property
    def health(self) -> Health:
        """The platform's, as it summarises it."""
        return self.last("ci/summary").health  # type: ignore[no-any-return]

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Where the vehicle truly is: x, y, height in the frame `hold`."""
        north, east, down = self.flight.truth.samples[-1].position_ned_m
        return north, -east, -down

    @property
    def height_m(self) -> float:
        return self.position_m[2]

    @property
    def speed_m_s(self) -> float:
        """How fast it truly is, over ground."""
        north, east, _ = self.flight.simulator.truth().velocity_ned_m_s
        return float((north**2 + east**2) ** 0.5)

    def state(self, target: str) -> str:
        mission = self.mission
        return mission.state if target == "mission" else mission.tasks.get(target, "")

    def lci(self, name: str) -> State | None:
        status = self.last(f"components/{name}/status")
        assert isinstance(status, ComponentStatus)
        return status.state

    def last(self, topic: str) -> Any:
        """The last message on a topic."""
        received = self.received.get(topic)
        assert received, self.story(f"nothing ever came on {topic}")
        return received[-1].payload

    def since(self, t_s: float, topic: str) -> list[Any]:
        """The messages on a topic since a time."""
        return [envelope.payload for envelope in self.received.get(topic, []) if envelope.t_s >= t_s]

    @property
    def events(self) -> list[CiEvent]:
        """What the platform told its stations."""
        return [envelope.payload for envelope in self.received.get("ci/event", [])]

    def was_told(self, text: str, since_s: float = 0.0) -> bool:
        """Whether an event held this text."""
        return any(text in event.text for event in self.events if event.t_s >= since_s)

    def story(self, what: str) -> str:
        """What to say when something is wrong: what happened last."""
        lines = [f"{event.t_s:8.2f}  {event.source}: {event.text}" for event in self.events[-25:]]
        for topic, received in self.received.items():
            if topic == "components/command_server/event":  # what it cannot tell itself
                lines += [f"{one.t_s:8.2f}  command_server: {one.payload.text}" for one in received[-5:]]
        texts = [f"{t_s:8.2f}  autopilot: {text}" for t_s, _, text in list(self.flight.simulator.texts)[-10:]]
        state = (
            f"now {self.now_s:.2f} s at {tuple(round(x, 2) for x in self.position_m)}"
            if self.flight.truth.samples
            else ""
        )
        return "\n".join([what, state, *sorted([*lines, *texts])])

    def envelope(self, topic: str, message: Message, component: str = "stranger") -> Envelope[Any]:
        """A message as a component would publish it now."""
        source = Source(self.flight.name, component, 7)
        kind = type_name(type(message))
        return Envelope(f"{self.flight.name}/{topic}", source, 0, self.now_s, "ned", kind, message)

    def _listen_on_the_cable(self) -> None:
        """Reads along what the onboard process says to the autopilot."""
        end = self.flight.links.cable.a
        receive, parser = end.on_data, Parser(is_datagram=True)
        assert receive is not None

        def listen(data: bytes) -> None:
            for frame in parser.receive(data):
                message = frame.decode()
                if message is not None:
                    self.to_autopilot.append((self.now_s, message))
            receive(data)

        end.on_data = listen

    def _receive(self, envelope: Envelope[Any]) -> None:
        if "/camera/" in envelope.topic:  # the pictures of a flight would fill the memory
            return
        self.received.setdefault(envelope.topic.partition("/")[2], []).append(envelope)
