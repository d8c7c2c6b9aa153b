"""Station for scripts: connect, upload a mission, start it, follow it, command it; the same desk as the terminal's.

    async with connect("udpin://127.0.0.1:14550") as station:
        vehicle = await station.vehicle("heron")
        await vehicle.upload("inspection")
        await vehicle.start()
        async for line in vehicle.follow():
            print(line)

Everything runs in the event loop of the script. A call that the vehicle refuses raises `Refused` with the reason; one
that gets no answer, or a vehicle that is not received, raises `NotHeard`.
"""

import asyncio
import secrets
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.errors import NoContact as NotHeard
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.messages.command_interface import Control, ControlVerb, EmergencyVerb, Verb
from gloc3_groundstation.assembly import GroundStation, StationSetup, read_membership
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.control import require_operator
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.flights import End, FarAway, Follower
from gloc3_groundstation.desk.vehicle_commands import NotDone, parse_vehicle_command
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.reporting.lines import NarrationLine
from gloc3_groundstation.reporting.narration import ChangeNarrator
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.command_client import CheckFailed
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

__all__ = [
    "CheckFailed",
    "End",
    "FarAway",
    "Gloc3Error",
    "InputError",
    "NarrationLine",
    "NotDone",
    "NotHeard",
    "Refused",
    "ScriptStation",
    "ScriptVehicle",
    "connect",
]

WAIT_S: Final = 60.0
"""Default time for contact with a vehicle, and then for it to be ready, s."""
DONE_WITHIN_S: Final = 120.0
"""Default time for a command to be done, s."""


class ScriptVehicle:
    """One vehicle; `ScriptStation.vehicle` makes it."""

    def __init__(self, desk: Desk, name: str) -> None:
        self.name: Final = name
        self._desk, self._station = desk, desk.station
        self._follower: Follower | None = None

    @property
    def state(self) -> PlatformSnapshot:
        """Its last known state: position, mode, mission, components, each with its age."""
        known = self._station.fleet.get(self.name)
        if known is None:
            raise NotHeard(f"{self.name} is no longer heard")
        return known

    async def upload(self, mission: str | Path, *, is_far_ok: bool = False) -> None:
        """Checks a mission, takes control, and uploads it, read back and compared.

        The autopilot of a vehicle without a companion gets the file as it is: a `.plan`, or a file of waypoints.

        Args:
            mission: a mission file, a `.plan`, a file of waypoints, or the name of an example.
            is_far_ok: whether its first waypoint may be 2 km or more from the vehicle.

        Raises:
            InputError: it does not pass the check here; `CheckFailed`: nor onboard. Both have `findings`.
            FarAway: it begins 2 km or more away.
            Refused: there is no such file, another station keeps control, or the vehicle refuses.
            NotHeard: the vehicle does not answer.
        """
        if not self.state.has_companion:
            require_operator(self._station)
            plans = self._desk.services.vehicle(self.name).services.plans
            if await plans.upload(plans.read(Path(mission))):
                raise Refused(f"{mission} was uploaded, but the vehicle's plan differs from it")
            return
        plan = await asyncio.to_thread(read_plan, str(mission), self.name)
        await flights.stream(self._station, self.name, plan, is_far_ok=is_far_ok)

    async def start(self, *, wait_s: float = WAIT_S, override: str = "") -> None:
        """Starts the loaded mission; it may arm the vehicle.

        Args:
            wait_s: how long to wait for the vehicle to be ready, and for red checks that may pass, s.
            override: reason to start although checks are red; logged onboard.

        Raises:
            Refused: a check is red, or no mission is loaded.
            NotHeard: the vehicle does not answer.
        """
        await flights.request_control(self._station, self.name)
        await flights.await_ready(self._station, self.name, wait_s)
        author = f"station {self._station.id}" if override else ""
        self._follower = await flights.start(self._station, self.name, override, author, wait_s)

    async def follow(self) -> AsyncGenerator[NarrationLine]:
        """Lines about the vehicle until its started mission ends: its health first, then changes and events.

        Raises:
            Refused: no mission was started here.
        """
        follower = self._started()
        end = asyncio.ensure_future(flights.follow(self._station, self.name, follower))
        try:
            async with aclosing(_lines(self._desk, self.name, end)) as found:
                async for line in found:
                    yield line
        finally:
            end.cancel()

    async def end(self) -> End:
        """Waits for the end of the mission that was started here; silence of the vehicle is no end.

        Raises:
            Refused: none was.
        """
        return await flights.follow(self._station, self.name, self._started())

    async def pause(self, target: str = "") -> None:
        """Pauses the mission, a `TASK` or a `TASK.ACTION`; errors as of `start`."""
        await self._steer(Verb.PAUSE, target)

    async def resume(self, target: str = "") -> None:
        """Resumes what is paused; errors as of `start`."""
        await self._steer(Verb.RESUME, target)

    async def skip(self, target: str) -> None:
        """Skips a `TASK` or a `TASK.ACTION`; errors as of `start`."""
        await self._steer(Verb.SKIP, target)

    async def abort(self, target: str = "") -> None:
        """Aborts the mission, a `TASK` or a `TASK.ACTION`; errors as of `start`."""
        await self._steer(Verb.ABORT, target)

    async def command(self, text: str, *, ready_s: float = WAIT_S, within_s: float = DONE_WITHIN_S) -> str:
        """Commands the vehicle and waits until telemetry shows it done: `arm`, `take_off 5`, `hold`, `land`.

        Args:
            text: as of `gloc3 station --headless --do`: to the autopilot of a vehicle without a companion, otherwise a
                single action.
            ready_s: for how long it is repeated while the autopilot is not ready for it, s.
            within_s: the time for it to be done, s.

        Returns:
            What telemetry shows then, in words.

        Raises:
            Refused: it is no command, or the vehicle refuses.
            NotDone: it is accepted, and not done in time.
            NotHeard: nothing is received from the vehicle.
        """
        return await self._desk.commands.carry_out(
            self.name, parse_vehicle_command(text), ready_s=ready_s, within_s=within_s
        )

    async def act(self, capability: str, **arguments: Any) -> str:
        """Requests a single action of a vehicle with a companion, with arguments as in a mission; errors as of `start`.

        Returns:
            The name of its task, for `pause`, `resume`, `skip` and `abort`.
        """
        return await self._desk.missions.request(self.name, capability, arguments)

    async def hold(self) -> None:
        """The emergency key: the vehicle holds at once, whoever has control.

        Raises:
            Refused: the vehicle refuses.
            NotHeard: the vehicle does not answer.
        """
        if self._desk.autopilots.is_its_own(self.state):
            await self._desk.autopilots.command(self.name, Action.HOLD)
        else:
            await self._station.client.emergency(self.name, EmergencyVerb.HOLD)

    async def take_over(self) -> str:
        """Takes control without asking its holder; returns the station that had it, or an empty text.

        Raises:
            Refused: the vehicle refuses.
        """
        return await flights.take_over(self._station, self.name)

    def _started(self) -> Follower:
        if self._follower is None:
            raise Refused(f"no mission of {self.name} was started here: start() first")
        return self._follower

    # --- roles of a network's members ---

    async def appoint(self, member: str, role: str, for_s: float) -> str:
        """Gives a member of the network a role for some time, as a commander of the vehicle; returns the answer.

        Args:
            member: its name.
            role: operator, maintainer, or observer, which takes all other roles away meanwhile.
            for_s: for how long, s.

        Raises:
            Refused: this station is no commander, or the role cannot be given.
        """
        body = Control(verb=ControlVerb.APPOINT, station=member, role=role, for_s=for_s)
        return (await self._station.client.carry_out(self.name, body)).reason

    async def dismiss(self, member: str) -> str:
        """Takes a given role back; returns the answer.

        Raises:
            Refused: this station is no commander, or no role is given.
        """
        body = Control(verb=ControlVerb.DISMISS, station=member)
        return (await self._station.client.carry_out(self.name, body)).reason

    async def _steer(self, verb: Verb, target: str) -> None:
        await flights.request_control(self._station, self.name)
        await self._station.client.steer(self.name, verb, target)


class ScriptStation:
    """A station that is connected; `connect` makes it."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk

    @property
    def fleet(self) -> Fleet:
        """Every vehicle that was received, and recent events."""
        return self._desk.station.fleet

    async def vehicle(self, name: str | None = None, *, wait_s: float = WAIT_S) -> ScriptVehicle:
        """Waits for contact with a vehicle.

        Args:
            name: its name, or the MAVLink system of its autopilot; None for the first one.
            wait_s: for how long, s.

        Raises:
            NotHeard: it was not received in this time.
            Refused: several vehicles have that system.
        """
        station = self._desk.station
        try:
            async with asyncio.timeout(wait_s):
                return ScriptVehicle(self._desk, await flights.await_vehicle(station, name))
        except TimeoutError:
            others = ", ".join(platform.name for platform in station.fleet) or "nothing"
            raise NotHeard(f"{name or 'a vehicle'} did not respond within {wait_s:g} s; heard: {others}") from None

    async def follow(self) -> AsyncGenerator[NarrationLine]:
        """Lines about all vehicles, without an end."""
        async with aclosing(_lines(self._desk, "", None)) as found:
            async for line in found:
                yield line


async def _lines(desk: Desk, name: str, end: asyncio.Future[End] | None) -> AsyncGenerator[NarrationLine]:
    """Lines about vehicles, as the headless station narrates them.

    Args:
        desk: the desk.
        name: of the vehicle; empty for all.
        end: no further lines come once it is done; None for no end.
    """
    station = desk.station
    narrator = ChangeNarrator(station.started_s, station.fleet.utc_offset_s)
    queue: asyncio.Queue[NarrationLine | None] = asyncio.Queue()

    def changed(before: Fleet, after: Fleet, now_s: float) -> None:
        for line in narrator.changes(before, after, now_s):
            if name in ("", line.platform):
                queue.put_nowait(line)

    now = station.fleet
    changed(replace(now, platforms={}), now, station.now_s())
    unlisten: Callable[[], None] = station.listen(changed)
    if end is not None:
        end.add_done_callback(lambda _: queue.put_nowait(None))
    try:
        while (line := await queue.get()) is not None:
            yield line
    finally:
        unlisten()


@asynccontextmanager
async def connect(
    *links: str,
    station_id: int = 255,
    signing_key: Path | None = None,
    network: Path | None = None,
    record: Path | None = None,
) -> AsyncIterator[ScriptStation]:
    """Opens a station, and closes it at the end; vehicles are then left to their missions' policies.

    Args:
        *links: MAVLink links, as of `gloc3 station --link`, such as `udpin://0.0.0.0:14550`.
        station_id: MAVLink system of the station, 200 to 255; unique among stations.
        signing_key: file with the signing key of all links; None for links that are not signed.
        network: network file of the station; None for MAVLink alone.
        record: folder for records of the session; None to record nothing.

    Raises:
        Refused: a link cannot be opened.
        InputError: a file cannot be read.
    """
    setup = StationSetup(
        boot=secrets.randbits(32),
        system=station_id,
        record=record,
        signing_key=None if signing_key is None else read_signing_key(signing_key.expanduser()),
        network=read_membership(network),
    )
    ground = GroundStation(setup)
    try:
        await ground.open(links)
        yield ScriptStation(ground.desk())
    finally:
        await ground.close()
