"""Stations that command several vehicles at once and take control from each other, over bad radios; judged from what each
vehicle did.
"""

import asyncio
from collections.abc import Iterator
from contextlib import suppress
from random import Random
from typing import Any

import msgspec

from gloc3.ci import CallFunction, CiReply, Control, ControlState, ControlVerb, Outcome
from gloc3.clock import VirtualLoop
from gloc3.link.memory import Conditions
from gloc3.messages import Envelope, FunctionRequest
from gloc3_groundstation.station import Station
from gloc3_sitl.fleet_flight import FleetFlight
from gloc3_sitl.flight import Flight, FlightPlan

RADIO = Conditions(latency_s=0.05, jitter_s=0.05, loss=0.1, duplicate=0.05, reorder=0.05)
COMPONENT = "hold"
"""Whose rate the stations change: each command has a rate of its own, by which it is known again."""
LEAST_HZ, STEP_HZ = 20.0, 0.001
CRASH_S, LATE_S, KILL_S, BACK_S = 20.0, 24.0, 30.0, 32.0
FULL_WITHIN_S = 10.0


class Command(msgspec.Struct):
    """One command of a station."""

    station: str
    platform: str
    rate_hz: float
    outcome: str = ""
    reason: str = ""


class Found(msgspec.Struct):
    """What came of a trial."""

    commands: int
    accepted: int
    refused: int
    unknown: int
    hand_overs: int
    """How often control of a vehicle changed hands."""
    late_full_s: float
    """How long the station that came late took to know everything; negative where it never did."""
    wrong: list[str]
    """What must not be, in words."""


class Witness:
    """Sees what a vehicle really does."""

    def __init__(self, flight: Flight) -> None:
        self.name = flight.name
        self.executed: list[tuple[float, str]] = []
        """Rates as they reached the component, with the holder of control at that time."""
        self.holders: list[str] = [""]
        exchange = flight.exchange
        exchange.subscribe(f"{self.name}/components/{COMPONENT}/function", self._see)
        exchange.subscribe(f"{self.name}/ci/control", self._control)

    def _see(self, envelope: Envelope[FunctionRequest]) -> None:
        rate_hz = envelope.payload.arguments.get("rate_hz")
        if envelope.payload.function == "set_rate" and rate_hz is not None:
            self.executed.append((rate_hz, self.holders[-1]))

    def _control(self, envelope: Envelope[ControlState]) -> None:
        if envelope.payload.holder != self.holders[-1]:
            self.holders.append(envelope.payload.holder)


class Trial:
    """One run: every station asks, grants, takes over, commands; one crashes, one comes late, one vehicle's computer dies."""

    def __init__(self, fleet: FleetFlight, seed: int) -> None:
        self.fleet = fleet
        self.random = Random(seed)
        self.commands: list[Command] = []
        self.witnesses = {name: Witness(flight) for name, flight in fleet.flights.items()}

    async def operate(self, station: Station, until_s: float) -> None:
        """An operator who cannot make up his mind."""
        random = Random(self.random.getrandbits(32))
        names = sorted(self.fleet.flights)
        while asyncio.get_running_loop().time() < until_s:
            await asyncio.sleep(random.uniform(0.1, 0.8))
            name = random.choice(names)
            if random.random() < 0.35:
                await self._control(station, name, random)
            else:
                await self._command(station, name)

    async def _control(self, station: Station, name: str, random: Random) -> None:
        verbs = (ControlVerb.REQUEST, ControlVerb.TAKE_OVER, ControlVerb.GRANT, ControlVerb.REFUSE, ControlVerb.RELEASE)
        verb = random.choices(verbs, (4, 2, 2, 1, 1))[0]
        await station.client.ask(name, Control(verb=verb))

    async def _command(self, station: Station, name: str) -> None:
        command = Command(station.id, name, round(LEAST_HZ + STEP_HZ * len(self.commands), 3))
        self.commands.append(command)
        body = CallFunction(component=COMPONENT, function="set_rate", arguments={"rate_hz": command.rate_hz})
        reply: CiReply = await station.client.ask(name, body)
        command.outcome, command.reason = str(reply.outcome), reply.reason

    def wrong(self) -> Iterator[str]:
        """What must not be."""
        for command in self.commands:
            what = f"{command.rate_hz} of {command.station} for {command.platform}"
            for name, witness in self.witnesses.items():
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


async def _trial(seed: int, platforms: int, stations: int, span_s: float) -> Found:
    plans = [
        FlightPlan(mission="hop", name=f"vehicle{n}", seed=1000 * seed + n, station_link=RADIO)
        for n in range(platforms)
    ]
    async with FleetFlight(plans, stations, seed) as fleet:
        trial = Trial(fleet, seed)
        loop = asyncio.get_running_loop()
        await asyncio.sleep(8.0)
        began_s = loop.time()
        crew = [ground.station for ground in fleet.grounds]
        work = [asyncio.ensure_future(trial.operate(station, began_s + span_s)) for station in crew]

        async def upsets() -> float:
            await asyncio.sleep(CRASH_S)
            fleet.grounds[0].close()
            work[0].cancel()
            await asyncio.sleep(LATE_S - CRASH_S)
            late = fleet.add_station(200).station
            came_s = loop.time()
            work.append(asyncio.ensure_future(trial.operate(late, began_s + span_s)))
            full_s = -1.0
            while full_s < 0.0 and loop.time() < came_s + FULL_WITHIN_S:
                await asyncio.sleep(0.1)
                known = [late.fleet.get(name) for name in fleet.flights]
                if all(one is not None and not one.is_incomplete and one.control and one.mission for one in known):
                    full_s = loop.time() - came_s
            await asyncio.sleep(max(0.0, began_s + KILL_S - loop.time()))
            flight = fleet.flights["vehicle0"]
            flight.kill_onboard()
            await asyncio.sleep(BACK_S - KILL_S)
            flight.start_onboard()
            return full_s

        late_full_s = await upsets()
        await asyncio.sleep(max(0.0, began_s + span_s + 20.0 - loop.time()))
        for one in work:
            with suppress(asyncio.CancelledError):
                await one
        outcomes = [command.outcome for command in trial.commands]
        return Found(
            commands=len(outcomes),
            accepted=outcomes.count("accepted"),
            refused=outcomes.count("refused"),
            unknown=len(outcomes) - outcomes.count("accepted") - outcomes.count("refused"),
            hand_overs=sum(len(witness.holders) - 1 for witness in trial.witnesses.values()),
            late_full_s=round(late_full_s, 1),
            wrong=list(trial.wrong()),
        )


def run_trial(seed: int, platforms: int, stations: int, span_s: float = 45.0) -> Found:
    """One trial in virtual time.

    Args:
        seed: of everything.
        platforms: how many vehicles.
        stations: how many stations from the begin; one more comes late.
        span_s: how long the stations command.
    """
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found: Any = runner.run(_trial(seed, platforms, stations, span_s))
    return found  # type: ignore[no-any-return]
