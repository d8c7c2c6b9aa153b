"""The whole stack in one process on one virtual clock: simulator, onboard process, ground station, and their links.

This is the one place that may import all three applications. A flight reads like a test card:

    async with Flight(FlightPlan(mission="hop")) as flight:
        await flight.upload_and_start()
        await flight.await_end(within_s=120)
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Any, Final, Self

import msgspec

from gloc3.clock import Clock
from gloc3.component.context import HostContext
from gloc3.errors import Gloc3Error, Refused, nearest
from gloc3.log.description import RunDescription
from gloc3.messages.command_interface import AnyBody, CommandComponent
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.topics import TopicTable
from gloc3.mission.examples import find_mission
from gloc3.mission.model.model import Mission
from gloc3.mission.reading.reader import MissionReferences, load_mission
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform, whole_text
from gloc3.terrain import open_terrain
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station
from gloc3_onboard.process.runner import HOST_DEVICES
from gloc3_onboard.sensors.rig import calibrations
from gloc3_sitl.faults.sabotage import FaultInjector, TappedExchange
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.firmware.in_step import READY_WITHIN_S, FirmwareInStep
from gloc3_sitl.flight.log import FlightRecording
from gloc3_sitl.flight.mission_file import is_without_satellites, place_for
from gloc3_sitl.flight.onboard_process import FlightProcess
from gloc3_sitl.flight.plan import MISSION_FILE, WORLD_FILE, FlightPlan
from gloc3_sitl.flight.sim_rig import PROBE, SIM_DEVICES, SimRig
from gloc3_sitl.flight.truth import FlightTruth
from gloc3_sitl.physics.water import rough
from gloc3_sitl.physics.wind import CALM
from gloc3_sitl.sensors.gimbal import SimulatedGimbal
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.vehicles.table import style_of, vehicle_named, vehicle_of
from gloc3_sitl.world import World

WEST_DEG: Final = 270.0
DEVICES: Final = (*HOST_DEVICES, *SIM_DEVICES, "imu", f"*{PROBE}")
"""What the onboard process of a flight has, as patterns."""


class SettableClock(Clock):
    """A clock whose date, not its time since boot, may be set in flight."""

    set_by_s = 0.0
    """So much later is the date than it would be."""

    def utc_s(self) -> float:
        """Seconds since 1970 by the computer's clock."""
        return super().utc_s() + self.set_by_s


class Flight:
    """One flight in virtual time; an asynchronous context."""

    def __init__(self, plan: FlightPlan) -> None:
        self.plan: Final = plan
        self.platform: Final[Platform] = _called(load_platform(plan.platform), plan.name)
        self.mission_file: Final = find_mission(plan.mission)
        self._terrain = open_terrain(plan.terrain)
        references = MissionReferences.of(self.platform, origin=plan.home, terrain=self._terrain)
        self.mission: Final[Mission] = load_mission(plan.mission, references)
        self.loop: Final = asyncio.get_running_loop()
        self.exchange: Final = TappedExchange()
        self.clock: Final = SettableClock(self.loop)
        """Of the onboard computer; its date may be set."""
        self.fault_injector: Final = FaultInjector(self.loop, plan.cycle_cost_s)
        """What faults have the onboard process suffer."""
        random = Random(plan.seed)
        self.context: Final = HostContext(
            self.name,
            self.exchange,
            self.clock,
            self.loop,
            TopicTable.installed(),
            random,
            self.fault_injector.cost_s,
        )
        world = self._world()
        self.simulator: Final = self._simulator(world)
        self.gimbal: Final = self._gimbal()
        """The gimbal of a platform that can point one; None for others."""
        self.rig: Final = SimRig(world, self.loop, self.simulator.truth, plan.seed, self.gimbal)
        """The cameras and the laser scanner; they cost nothing until they are opened."""
        self.log: Final = self._open_log()
        self._requests: set[asyncio.Task[Any]] = set()
        """Commands that have not been answered."""
        self._ground_boot = random.getrandbits(32)
        self.process: Final = FlightProcess(
            plan, self.platform, self.mission, self.context, self.fault_injector.create, self.rig, self.log
        )
        """The onboard process."""
        self.links: Final = self.process.links
        cable = self.links.cable.a
        cable.on_data = self.simulator.attach(cable.send, LinkKind.COMPANION)
        self.truth: Final = self._truth(world, random.getrandbits(32))

    @property
    def name(self) -> str:
        """The platform's name."""
        return self.platform.platform

    @property
    def autopilot(self) -> str:
        """The autopilot's style."""
        return style_of(vehicle_of(self.platform), self.plan.autopilot or None)

    # --- setting up ---

    def _open_log(self) -> FlightRecording:
        plan = self.plan
        metadata = {"platform": self.name, "autopilot": self.autopilot, "seed": str(plan.seed)}
        metadata |= {"wind": msgspec.json.encode(plan.wind).decode()} if plan.wind != CALM else {}
        beside = {"waves_m": plan.waves_m, "current_m_s": plan.current_m_s}
        metadata |= {name: f"{value:g}" for name, value in beside.items() if value}
        metadata |= {"world": plan.world} if plan.world else {}
        metadata |= {"home": msgspec.json.encode(plan.home).decode()} if plan.home is not None else {}
        metadata |= {"terrain": str(plan.terrain.absolute())} if plan.terrain is not None else {}
        metadata |= {"parameters": msgspec.json.encode(plan.parameters).decode()} if plan.parameters else {}
        files = {MISSION_FILE: self.mission.text.encode()}
        if Path(plan.world).is_file():
            files[WORLD_FILE] = Path(plan.world).read_bytes()
        description = RunDescription(
            self.platform,
            whole_text(plan.platform),
            calibrations(self.platform, self.rig),
            files,
        )
        return FlightRecording(plan.out, self.context, metadata, description)

    def _world(self) -> World:
        """The requested world, or the one of the mission's frame."""
        plan = self.plan
        if plan.world:
            world = _fitting(World.load(plan.world), self.mission)
        else:
            world = World.load(*place_for(self.mission, self.platform, vehicle_of(self.platform), plan.home))
        world.water = rough(world.water, waves_m=plan.waves_m, waves_from_deg=WEST_DEG, current_m_s=plan.current_m_s)
        return world

    def _simulator(self, world: World) -> Simulator | FirmwareInStep:
        plan, is_without_gps = self.plan, is_without_satellites(self.platform)
        vehicle = vehicle_of(self.platform)
        if plan.is_firmware:
            body = BodySettings(vehicle=vehicle, seed=plan.seed, wind=plan.wind, is_without_gps=is_without_gps)
            return FirmwareInStep(plan.autopilot, world, body, plan.parameters, plan.out)
        settings = SimulatorSettings(
            vehicle=vehicle,
            style=plan.autopilot or None,
            seed=plan.seed,
            wind=plan.wind,
            is_plain_gps=plan.is_plain_gps,
            is_without_gps=is_without_gps,
            battery_remaining=plan.battery,
            parameters=plan.parameters,
        )
        return Simulator(world, settings)

    def _gimbal(self) -> SimulatedGimbal | None:
        is_fitted = any(row.arguments == "point_camera" for row in self.platform.capabilities.values())
        simulator = self.simulator
        if not is_fitted or isinstance(simulator, FirmwareInStep):
            return None
        return SimulatedGimbal(simulator, lambda receive: simulator.attach(receive, LinkKind.BARE), self.loop)

    def _truth(self, world: World, boot: int) -> FlightTruth:
        is_diving = vehicle_named(vehicle_of(self.platform)).is_diving
        surface_m = world.home.altitude_m if is_diving else None
        return FlightTruth(self.exchange, self.name, self.loop, boot, self.simulator.truth, self.links.sink, surface_m)

    # --- life ---

    async def __aenter__(self) -> Self:
        """Starts everything."""
        self.simulator.start(self.loop)
        if self.gimbal is not None:
            self.gimbal.start()
        self.process.start()
        if self.plan.has_station:
            self.start_station(self._ground_boot)
        self.truth.begin()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends everything; the log is closed whatever has happened."""
        self.truth.close()
        for request in self._requests:
            request.cancel()
        if self.plan.has_station:
            await self.ground.close()
        self.process.kill()
        if self.gimbal is not None:
            self.gimbal.stop()
        self.simulator.stop()
        self.log.close()

    def start_station(self, boot: int) -> None:
        """Starts the ground station, also after it was closed."""
        self.ground = GroundStation(StationSetup(boot=boot, terrain=self._terrain))
        self.ground.attach(self.links.radio.a)
        if self.plan.modem_period_s:
            self.ground.attach_modem(self.name, self.links.modem.a)

    # --- the operator ---

    @property
    def station(self) -> Station:
        """The ground station."""
        return self.ground.station

    async def upload_and_start(self) -> flights.Follower:
        """Waits for the platform, takes control, streams the mission, starts it.

        Raises:
            Gloc3Error: the platform turned something down.
        """
        await flights.await_platform(self.station, self.name)
        within_s = READY_WITHIN_S if self.plan.is_firmware else flights.READY_WITHIN_S
        missing = await flights.await_ready(self.station, self.name, within_s)
        if missing:
            raise Gloc3Error(f"{self.name} is not ready; missing: {', '.join(missing)}")
        plan = CheckedPlan(name=self.mission_file.name, title=self.mission.name, text=self.mission.text)
        await flights.stream(self.station, self.name, plan)
        return await flights.start(self.station, self.name)

    async def await_end(self, follower: flights.Follower, within_s: float) -> End:
        """Follows the mission to its end.

        Raises:
            TimeoutError: it has not ended by then.
        """
        async with asyncio.timeout(within_s):
            return await flights.follow(self.station, self.name, follower)

    async def exchange_component(self, name: str, class_name: str, settings: dict[str, Any]) -> None:
        """Has a component made anew in flight, of another class or with other settings.

        Raises:
            Gloc3Error: the platform turned it down.
        """
        row = self.platform.component(name)
        if row is None:
            raise Refused(
                f"{self.name} has no component {name!r}; {nearest(name, [one.name for one in self.platform.components])}"
            )
        new = msgspec.structs.replace(
            row, class_name=class_name or row.class_name, settings={**row.settings, **settings}
        )
        self.fault_injector.replaced[name] = new
        client = self.station.client
        await client.carry_out(self.name, CommandComponent(component=name, command="shutdown", is_forced=True))
        await client.carry_out(self.name, CommandComponent(component=name, command="create", is_forced=True))
        await client.carry_out(
            self.name, CommandComponent(component=name, command="initialize", settings=new.settings, is_forced=True)
        )
        await client.carry_out(self.name, CommandComponent(component=name, command="start", is_forced=True))

    def operate(self, body: AnyBody) -> None:
        """Sends a command of the operator, if the station is up, without waiting for what becomes of it."""
        if hasattr(self, "ground"):
            request = self.loop.create_task(self.station.client.request(self.name, body))
            self._requests.add(request)
            request.add_done_callback(self._requests.discard)

    async def expect(self, topic: str, predicate: Callable[[Any], bool], within_s: float) -> Message:
        """Waits for a matching message on a topic below the platform's name.

        Raises:
            TimeoutError: no match in time; the message names the topic.
        """
        found: asyncio.Future[Message] = self.loop.create_future()

        def handle(envelope: Envelope[Any]) -> None:
            if not found.done() and predicate(envelope.payload):
                found.set_result(envelope.payload)

        unsubscribe = self.exchange.subscribe(f"{self.name}/{topic}", handle)
        try:
            async with asyncio.timeout(within_s):
                return await found
        except TimeoutError:
            raise TimeoutError(f"no matching message on {topic} within {within_s:g} s") from None
        finally:
            unsubscribe()


def _called(platform: Platform, name: str) -> Platform:
    return msgspec.structs.replace(platform, platform=name) if name else platform


def _fitting(world: World, mission: Mission) -> World:
    """The world, if a mission can fly there.

    Raises:
        Refused: it is another place.
    """
    if mission.frame != world.frame_name:
        raise Refused(f"the mission's frame is {mission.frame!r}, that of world {world.name} is {world.frame_name!r}")
    return world
