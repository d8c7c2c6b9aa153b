"""Stations that command several vehicles at once and take control from each other, over bad radios; judged from what each
vehicle did.
"""

import asyncio
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import msgspec
from tests.flight.fleet_flight import FleetFlight

from gloc3.clock import VirtualLoop
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.command_interface import CallFunction, CiReply, Control, ControlVerb, Outcome
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.station.station import Station
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

RADIO = Conditions(latency_s=0.05, jitter_s=0.05, loss=0.1, duplicate=0.05, reorder=0.05)
COMPONENT = "hold"
"""Whose rate the stations change: each command has a rate of its own, by which it is known again."""
LEAST_HZ, STEP_HZ = 20.0, 0.001
CONTROL_SHARE = 0.35
"""So often an operator asks for something about control."""
WITNESSED = (f"components/{COMPONENT}/function", "ci/control")
CRASH_S, LATE_S, KILL_S, BACK_S = 20.0, 24.0, 30.0, 32.0
FULL_WITHIN_S = 10.0
TWO = """\
mission: two of five
frame: hold
on_failure: land
on_link_loss: continue
tasks:
  rise: {platform: vehicle0, actions: {climb: {take_off: {height_m: 1.5}}}}
  follow:
    platform: vehicle1
    after: [rise]
    actions: {climb: {take_off: {height_m: 2}}, down: {land: {}, after: [climb]}}
  back: {platform: vehicle0, after: [follow], actions: {down: {land: {}}}}
"""
FLYING = 2
"""So many of the vehicles fly that mission, where there are more than that."""
FLYING_STATION = 251
"""Who flies it."""
HAND_OVERS = {
    "granted to station": "granted by its holder",
    "taken over from station": "taken over",
    "granted: station": "given up by a holder that was gone",
    "released": "released",
}
"""How control changes hands, by the beginning of the platform's answer."""


class Command(msgspec.Struct):
    """One command of a station."""

    station: str
    platform: str
    rate_hz: float
    outcome: str = ""
    reason: str = ""


class HandOver(msgspec.Struct):
    """Control of a vehicle changed hands."""

    way: str


class Found(msgspec.Struct):
    """What came of a trial."""

    commands: int
    accepted: int
    refused: int
    unknown: int
    hand_overs: dict[str, int]
    """How often control of a vehicle changed hands, by the way."""
    crashed_holding: int
    """Of how many vehicles the station that died held control, which another has now."""
    mission: str
    """How the mission across two of the vehicles ended; empty where none was flown."""
    late_full_s: float
    """How long the station that came late took to know everything; negative where it never did."""
    wrong: list[str]
    """What must not be, in words."""


class Witness:
    """What a vehicle really did, from what it published."""

    def __init__(self) -> None:
        self.executed: list[tuple[float, str]] = []
        """Rates as they reached the component, with the holder of control at that time."""
        self.holders: list[str] = [""]

    def see(self, payload: Any) -> None:
        """Takes a message on the component's functions, or of who holds control."""
        if isinstance(payload, ControlState):
            if payload.holder != self.holders[-1]:
                self.holders.append(payload.holder)
        elif payload.function == "set_rate" and "rate_hz" in payload.arguments:
            self.executed.append((payload.arguments["rate_hz"], self.holders[-1]))


class Operator:
    """Somebody who cannot make up his mind: asks for control, grants it, takes it, and commands.

    Args:
        station: his.
        platforms: that he commands.
        contested: of these, those that he wants to control.
        random: what he does next.
        rates: the rates that he may use, each once.
        told: is given each command when it is sent, and again when it is answered, and each hand-over.
    """

    def __init__(
        self,
        station: Station,
        platforms: Sequence[str],
        contested: Sequence[str],
        random: Random,
        rates: Iterator[float],
        told: Callable[[Command | HandOver], None] = lambda _: None,
    ) -> None:
        self.commands: list[Command] = []
        self.hand_overs: list[HandOver] = []
        self._station, self._platforms, self._contested, self._random = station, platforms, contested, random
        self._rates, self._told = rates, told

    async def work(self, until_s: float) -> None:
        """Goes on until then."""
        while asyncio.get_running_loop().time() < until_s:
            await asyncio.sleep(self._random.uniform(0.1, 0.8))
            if self._random.random() < CONTROL_SHARE:
                await self._control(self._random.choice(self._contested))
            else:
                await self._command(self._random.choice(self._platforms))

    async def seize(self) -> list[str]:
        """Takes control of one vehicle more; all that he holds then, as he knows it."""
        name = self._random.choice(self._contested)
        reply: CiReply = await self._station.client.ask(name, Control(verb=ControlVerb.TAKE_OVER))
        taken = [name] if reply.outcome == Outcome.ACCEPTED else []
        return sorted({*taken, *(other for other in self._contested if self._holds(other))})

    def _holds(self, name: str) -> bool:
        platform = self._station.fleet.get(name)
        return (
            platform is not None and platform.control is not None and platform.control.value.holder == self._station.id
        )

    async def _control(self, name: str) -> None:
        verbs = (ControlVerb.REQUEST, ControlVerb.TAKE_OVER, ControlVerb.GRANT, ControlVerb.REFUSE, ControlVerb.RELEASE)
        verb = self._random.choices(verbs, (4, 2, 2, 1, 1))[0]
        reply: CiReply = await self._station.client.ask(name, Control(verb=verb))
        for begin, way in HAND_OVERS.items():
            if reply.outcome == Outcome.ACCEPTED and reply.reason.startswith(begin):
                self.hand_overs.append(HandOver(way))
                self._told(self.hand_overs[-1])

    async def _command(self, name: str) -> None:
        command = Command(self._station.id, name, next(self._rates))
        self.commands.append(command)
        self._told(command)
        body = CallFunction(component=COMPONENT, function="set_rate", arguments={"rate_hz": command.rate_hz})
        reply: CiReply = await self._station.client.ask(name, body)
        command.outcome, command.reason = str(reply.outcome), reply.reason
        self._told(command)


def rates_of(number: int) -> Iterator[float]:
    """The rates of one operator, which nobody else has."""
    return (round(LEAST_HZ + number + STEP_HZ * step, 3) for step in range(round(1.0 / STEP_HZ)))


def wrongs(commands: Iterable[Command], witnesses: Mapping[str, Witness]) -> Iterator[str]:
    """What must not be."""
    for command in commands:
        what = f"{command.rate_hz} of {command.station} for {command.platform}"
        for name, witness in witnesses.items():
            times = [holder for rate_hz, holder in witness.executed if rate_hz == command.rate_hz]
            if name != command.platform and times:
                yield f"{what} reached {name}"
            if len(times) > 1:
                yield f"{what} was executed {len(times)} times"
            if times and times[0] != command.station:
                yield f"{what} was executed while {times[0] or 'nobody'} held control"
            if name == command.platform and command.outcome == Outcome.ACCEPTED and not times:
                yield f"{what} was accepted, and not executed"
            if (
                name == command.platform
                and command.outcome == Outcome.REFUSED
                and times
                and "busy" not in command.reason
            ):
                yield f"{what} was refused ({command.reason}), and executed"


def knows_everything(station: Station, platforms: Iterable[str]) -> bool:
    """Whether a station has the full state of these."""
    known = [station.fleet.get(name) for name in platforms]
    return all(one is not None and not one.is_incomplete and one.control and one.mission for one in known)


def witness_of(flight: Flight) -> Witness:
    """One who watches a flight."""
    witness = Witness()
    for topic in WITNESSED:
        flight.exchange.subscribe(f"{flight.name}/{topic}", lambda envelope: witness.see(envelope.payload))
    return witness


async def _fly(station: Station, file: Path) -> str:
    """Flies the mission across two vehicles; how it ended."""
    plan = read_plan(str(file))
    for name in plan.platforms:
        await flights.await_platform(station, name)
        problems = await flights.await_ready(station, name)
        if problems:
            return f"{name} is not ready: {problems}"
    await flights.stream_to_all(station, plan.platforms, plan)
    end = await flights.follow_all(station, await flights.start_all(station, plan.platforms))
    return "done" if end.is_done else str(end)


async def _trial(seed: int, platforms: int, stations: int, span_s: float, file: Path) -> Found:
    plans = [
        FlightPlan(mission="hop", name=f"vehicle{n}", seed=1000 * seed + n, station_link=RADIO)
        for n in range(platforms)
    ]
    async with FleetFlight(plans, stations, seed) as fleet:
        random = Random(seed)
        witnesses = {name: witness_of(flight) for name, flight in fleet.flights.items()}
        operators: list[Operator] = []
        loop = asyncio.get_running_loop()
        names = sorted(fleet.flights)
        has_mission = platforms > FLYING
        contested = names[FLYING:] if has_mission else names
        flying = loop.create_task(_fly(fleet.add_station(FLYING_STATION).station, file)) if has_mission else None
        await asyncio.sleep(8.0)
        began_s = loop.time()

        def put_to_work(station: Station) -> asyncio.Task[None]:
            chance = Random(random.getrandbits(32))
            operators.append(Operator(station, names, contested, chance, rates_of(len(operators))))
            return loop.create_task(operators[-1].work(began_s + span_s))

        work = [put_to_work(ground.station) for ground in fleet.grounds[:stations]]

        async def upsets() -> tuple[list[str], float]:
            await asyncio.sleep(CRASH_S)
            held = await operators[0].seize()
            await fleet.grounds[0].close()
            work[0].cancel()
            await asyncio.sleep(LATE_S - CRASH_S)
            late = fleet.add_station(200).station
            came_s = loop.time()
            work.append(put_to_work(late))
            full_s = -1.0
            while full_s < 0.0 and loop.time() < came_s + FULL_WITHIN_S:
                await asyncio.sleep(0.1)
                if knows_everything(late, fleet.flights):
                    full_s = loop.time() - came_s
            await asyncio.sleep(max(0.0, began_s + KILL_S - loop.time()))
            flight = fleet.flights[contested[0]]
            flight.process.kill()
            await asyncio.sleep(BACK_S - KILL_S)
            flight.process.start()
            return held, full_s

        held, late_full_s = await upsets()
        await asyncio.sleep(max(0.0, began_s + span_s + 20.0 - loop.time()))
        for one in work:
            with suppress(asyncio.CancelledError):
                await one
        commands = [command for operator in operators for command in operator.commands]
        outcomes = [command.outcome for command in commands]
        dead = fleet.grounds[0].station.id
        return Found(
            commands=len(outcomes),
            accepted=outcomes.count("accepted"),
            refused=outcomes.count("refused"),
            unknown=len(outcomes) - outcomes.count("accepted") - outcomes.count("refused"),
            hand_overs=ways(one.way for operator in operators for one in operator.hand_overs),
            crashed_holding=passed_on(held, dead, witnesses),
            mission="" if flying is None else await asyncio.wait_for(flying, 120.0),
            late_full_s=round(late_full_s, 1),
            wrong=list(wrongs(commands, witnesses)),
        )


def ways(seen: Iterable[str]) -> dict[str, int]:
    """How often each way in which control changes hands was seen."""
    found = dict.fromkeys(HAND_OVERS.values(), 0)
    for way in seen:
        found[way] += 1
    return found


def passed_on(held: Iterable[str], dead: str, witnesses: Mapping[str, Witness]) -> int:
    """How many of the vehicles that a station held when it died, somebody else holds, or held, after it."""
    return sum(dead in (holders := witnesses[name].holders) and holders[-1] != dead for name in held)


def run_trial(seed: int, platforms: int, stations: int, span_s: float = 45.0) -> Found:
    """One trial in virtual time.

    Args:
        seed: of everything.
        platforms: how many vehicles.
        stations: how many stations from the begin; one more comes late.
        span_s: how long the stations command.
    """
    with tempfile.TemporaryDirectory() as name, asyncio.Runner(loop_factory=VirtualLoop) as runner:
        file = Path(name) / "two.yaml"
        file.write_text(TWO)
        found: Any = runner.run(_trial(seed, platforms, stations, span_s, file))
    return found  # type: ignore[no-any-return]
