"""The whole stack in one process on one virtual clock: simulator, onboard process, ground station, and their links.

This is the one place that may import all three applications. A flight reads like a test card:

    async with Flight(FlightPlan(mission="hop")) as flight:
        await flight.upload_and_start()
        await flight.await_end(within_s=120)
"""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Any, Final, Self

import msgspec

from gloc3.clock import Clock
from gloc3.component.context import HostContext
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange import Publisher
from gloc3.log.record import PLATFORM_FILE, Recorder
from gloc3.mavlink.codec import Frame
from gloc3.mavlink.router import Router
from gloc3.mavlink.transport.memory import ACOUSTIC, Conditions, MemoryEnd, MemoryLink
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Pose
from gloc3.mission.examples import find_mission
from gloc3.mission.model.model import Mission
from gloc3.mission.reading.reader import Surroundings, load_mission
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform, whole_text
from gloc3.store import MemoryRecords
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.missions.plans import Plan
from gloc3_groundstation.station.station import Station
from gloc3_onboard.autopilot.arm_authority import ArmAuthority
from gloc3_onboard.autopilot.device import AutopilotDevice
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.news import LinkNews
from gloc3_onboard.autopilot.sensor_devices import AutopilotImu
from gloc3_onboard.command_server.log_shelf import AtOnce, LogShelf, NoShelf, Shelf
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.companion.acoustic_link import AcousticLink
from gloc3_onboard.companion.companion import Companion
from gloc3_onboard.companion.files import LOGS, Folders
from gloc3_onboard.companion.files import LogFiles as SharedLogs
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import HeartbeatSource, StationLink
from gloc3_onboard.process.computer import SimulatedComputer
from gloc3_onboard.process.log_files import LogFiles
from gloc3_onboard.process.runner import HOST_DEVICES, Onboard
from gloc3_onboard.process.storage import NoPictures, PictureFolder
from gloc3_onboard.process.taps import ExchangeTaps
from gloc3_onboard.sensors.sensor_watch import SensorWatch
from gloc3_onboard.sources.asked import NOWHERE
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_sitl.faults.sabotage import CycleCost, Sabotage, TappedExchange
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.firmware.in_step import READY_WITHIN_S, FirmwareInStep
from gloc3_sitl.flight.messages import SimFault, SimTruth
from gloc3_sitl.flight.mission_file import is_without_satellites, looks_down, place_for
from gloc3_sitl.flight.path_error import Sample
from gloc3_sitl.flight.sim_devices import NoCamera
from gloc3_sitl.flight.sim_imu import SimImu
from gloc3_sitl.flight.sim_rig import SIM_DEVICES, SimRig
from gloc3_sitl.physics.water import rough
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator
from gloc3_sitl.vehicles.table import style_of, vehicle_of
from gloc3_sitl.world import World

TRUTH_PERIOD_S: Final = 0.1
WEST_DEG: Final = 270.0
DEVICES: Final = (*HOST_DEVICES, *SIM_DEVICES, "imu")
"""What the onboard process of a flight has."""
SIMULATED: Final = "simulated"
"""What stands for the source of a sensor."""
FLUSH_S: Final = 1.0
"""How long a message stays in memory: in virtual time a second is over in some milliseconds."""
AUTOPILOT_CABLE: Final = Conditions(latency_s=0.002)
STATION_RADIO: Final = Conditions(latency_s=0.03)


class FlightPlan(msgspec.Struct, kw_only=True, frozen=True):
    """What is flown, and in which circumstances."""

    mission: str
    """A file, or the name of an example."""
    platform: str = "pelican_rtk"
    name: str = ""
    """What the platform is called, where several are of one kind; empty for the name in its file."""
    autopilot: str = ""
    """`px4` or `ardupilot`; empty for the usual one of the vehicle."""
    is_firmware: bool = False
    """That autopilot's real firmware flies, in place of one of ours; `autopilot` is `ardupilot` then."""
    seed: int = 0
    wind: Wind = CALM
    waves_m: float = 0.0
    """Significant height of the waves, from the west; of what swims."""
    current_m_s: float = 0.0
    """Of the water, to the north."""
    out: Path | None = None
    """Folder for the log and the pictures; None keeps nothing."""
    parameters: dict[str, float] = {}
    """Of the autopilot, that differ from its defaults."""
    battery: float = 1.0
    """Charge at the start, 1 to 0."""
    world: str = ""
    """A world's name or file; where it is empty, the one that the mission's frame belongs to."""
    is_plain_gps: bool = False
    has_station: bool = True
    """Whether it has a station of its own; in a fleet all are the fleet's."""
    station_link: Conditions = STATION_RADIO
    """Both ways between station and platform."""
    radio_depth_m: float = float("inf")
    """A vehicle that is deeper below its frame's origin is not reached by the station's radio."""
    modem_period_s: float = 0.0
    """How often a summary goes to the station by an acoustic modem; 0 where there is none."""
    cycle_cost_s: CycleCost | None = None
    """What a cycle of a component costs at a time, faults aside; None for nothing."""


class Flight:
    """One flight in virtual time; an asynchronous context."""

    def __init__(self, plan: FlightPlan) -> None:
        self.plan: Final = plan
        self.platform: Final[Platform] = _called(load_platform(plan.platform), plan.name)
        self.mission_file: Final = find_mission(plan.mission)
        self.mission: Final[Mission] = load_mission(plan.mission, Surroundings.of(self.platform))
        self.loop: Final = asyncio.get_running_loop()
        self.vehicle: Final = vehicle_of(self.platform)
        """What stands for the platform in the simulation."""
        self.clock: Final = Clock(self.loop)
        self.random: Final = Random(plan.seed)
        self.topics: Final = TopicTable.installed()
        self.exchange: Final = TappedExchange()
        self.sabotage: Final = Sabotage(self.loop, plan.cycle_cost_s)
        """What faults have the onboard process suffer."""
        self.samples: Final[list[Sample]] = []
        """True positions at 10 Hz, in the frame of the pose."""
        self.onboard: Onboard | None = None
        self._journal, self._progress, self._reports = MemoryRecords(), MemoryRecords(), MemoryRecords()
        self.log_path = plan.out / "log.mcap" if plan.out is not None else None
        """Of the log that is being written."""
        self.recorder = self._open_log()
        world = self._world()
        world.water = rough(world.water, waves_m=plan.waves_m, waves_from_deg=WEST_DEG, current_m_s=plan.current_m_s)
        self.simulator: Final = self._simulator(world)
        self.rig: Final = SimRig(world, self.loop, self.simulator.truth, plan.seed)
        self._pictures = PictureFolder(plan.out / "images", self.rig) if plan.out is not None else NoPictures()
        """The cameras and the laser scanner; they cost nothing until they are opened."""
        self.imu: Final = SimImu(self.loop, plan.seed)
        """The autopilot's inertial unit, as the onboard process gets it."""
        self.cable: Final = MemoryLink(self.loop, Random(plan.seed + 1), AUTOPILOT_CABLE)
        self.cable.a.on_data = self.simulator.attach(self.cable.a.send, LinkKind.COMPANION)
        self.radio: Final = MemoryLink(self.loop, Random(plan.seed + 2), plan.station_link)
        self._ground_boot = self.random.getrandbits(32)
        self.modem: Final = MemoryLink(self.loop, Random(plan.seed + 99), ACOUSTIC, is_half_duplex=True)
        """The acoustic modem's way; the station's end is `a`."""
        self._acoustic: AcousticLink | None = None
        self._further_radios: list[MemoryLink] = []
        self._further_links: list[StationLink] = []
        self._publisher = Publisher(self.exchange, self.platform.platform, "simulator", self.random.getrandbits(32))
        self.frame: TangentPlane | None = None
        """Of the pose, once one has told its origin."""
        self.is_below = False
        """Too deep for the radio."""
        self._truth_timer: asyncio.TimerHandle | None = None
        self.exchange.subscribe(f"{self.platform.platform}/pose", self._see_pose)

    @property
    def autopilot(self) -> str:
        """The autopilot's style."""
        return style_of(self.vehicle, self.plan.autopilot or None)

    # --- setting up ---

    def _open_log(self) -> Recorder | None:
        if self.log_path is None:
            return None
        self.log_path.parent.mkdir(parents=True, exist_ok=True)
        metadata = {"platform": self.platform.platform, "autopilot": self.autopilot, "seed": str(self.plan.seed)}
        recorder = Recorder(self.log_path, self.clock, self.topics, metadata, flush_s=FLUSH_S)
        recorder.attach_file(PLATFORM_FILE, "application/yaml", whole_text(self.plan.platform).encode())
        recorder.attach_file("mission.yaml", "application/yaml", self.mission.text.encode())
        recorder.attach(self.exchange, self.loop)
        return recorder

    def cut_log(self) -> None:
        """Ends the log that is being written, and begins the next."""
        if self.log_path is not None and self.recorder is not None:
            self.recorder.close()
            self.log_path = LogFiles(self.log_path.parent).next()
            self.recorder = self._open_log()

    def _shelf(self) -> Shelf:
        """The logs that the station may fetch."""
        if self.plan.out is None:
            return NoShelf()
        unfinished: Callable[[], set[Path]] = lambda: {self.log_path} if self.log_path is not None else set()  # noqa: E731
        return LogShelf(self.plan.out, unfinished, self.cut_log, AtOnce())

    def _world(self) -> World:
        """The world that is asked for, or the one that the mission's frame belongs to."""
        if self.plan.world:
            return _fitting(World.load(self.plan.world), self.mission)
        return World.load(*place_for(self.mission, self.platform, self.vehicle))

    def _simulator(self, world: World) -> Simulator | FirmwareInStep:
        plan, is_without_gps = self.plan, is_without_satellites(self.platform)
        if plan.is_firmware:
            settings = BodySettings(vehicle=self.vehicle, seed=plan.seed, wind=plan.wind, is_without_gps=is_without_gps)
            return FirmwareInStep(world, settings, plan.parameters, plan.out)
        return Simulator(
            world,
            vehicle=self.vehicle,
            style=plan.autopilot or None,
            seed=plan.seed,
            wind=plan.wind,
            is_plain_gps=plan.is_plain_gps,
            is_without_gps=is_without_gps,
            battery_remaining=plan.battery,
            parameters=plan.parameters,
        )

    async def __aenter__(self) -> Self:
        """Starts everything."""
        self.simulator.start(self.loop)
        self.start_onboard()
        if self.plan.has_station:
            self.start_station(self._ground_boot)
        self._tell_truth()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends everything; the log is closed whatever has happened."""
        if self._truth_timer is not None:
            self._truth_timer.cancel()
        if self.plan.has_station:
            await self.ground.close()
        self.kill_onboard()
        self.simulator.stop()
        if self.recorder is not None:
            self.recorder.close()

    def start_onboard(self) -> None:
        """Starts the onboard process, the first time or after it was killed."""
        platform, boot = self.platform, self.random.getrandbits(32)
        news = LinkNews(self.exchange, platform.platform, boot ^ 2, self.loop.time)
        authority = self._authority = ArmAuthority(self.exchange, platform.platform)
        self.autopilot_link = AutopilotLink(
            self.loop, self.clock, say=news.say, why_not_arm=lambda: authority.why_not(self.loop.time())
        )
        self.imu.wire(AutopilotImu(self.autopilot_link.sensors))
        self.station_link = StationLink(platform.platform, 1, self.loop, self.exchange, self.topics, boot)
        own = self.autopilot_link.own
        self.companion = Companion(own, platform, self.exchange, self.clock, self.loop, boot ^ 1)
        if self.plan.out is not None:
            self.companion.share(Folders({LOGS: SharedLogs(self.plan.out, is_writable=False)}), lambda: False)
        hear = self.companion.attach(self.station_link.send)
        self._heartbeat = HeartbeatSource(
            self.exchange,
            platform.platform,
            lambda: [
                self.station_link.send,
                self.autopilot_link.send_message,
                *(link.send for link in self._further_links),
            ],
        )
        context = HostContext(
            platform.platform, self.exchange, self.clock, self.loop, self.topics, self.random, self.sabotage.cost_s
        )
        sensors = self._sensors()
        devices = {
            "autopilot": AutopilotDevice(self.autopilot_link),
            "computer": SimulatedComputer(self.clock, self._watch(sensors).conditions),
            "rig": self.rig,
            **sensors,
            "pictures": self._pictures,
            "site": Site(platform, self._journal, self._progress, self._reports, boot, self._shelf()),
            "taps": ExchangeTaps(self.exchange, self.loop, platform.platform),
            "catalogue": Catalogue(platform, self.topics),
        }
        self.onboard = Onboard(platform, context, devices, self.sabotage.create)
        if self.plan.modem_period_s:
            self._acoustic = AcousticLink(
                platform.platform,
                self.exchange,
                self.loop,
                boot ^ 3,
                self.modem.b.send,
                period_s=self.plan.modem_period_s,
            )
            self.modem.b.on_data = self._acoustic.receive
        station_link = self.station_link

        def take(frames: list[Frame]) -> None:
            station_link.take(frames)
            hear(frames)

        station_link.open(self._routed(self.radio.b, take))
        for radio in self._further_radios:
            self._link_to(radio)
        self.autopilot_link.open(self._routed(self.cable.b, self.autopilot_link.take))
        self.onboard.begin()

    def start_station(self, boot: int) -> None:
        """Starts the ground station, the first time or after it was closed."""
        self.ground = GroundStation(StationSetup(boot=boot))
        self.ground.attach(self.radio.a)
        if self.plan.modem_period_s:
            self.ground.attach_modem(self.name, self.modem.a)

    def add_radio(self) -> MemoryLink:
        """One more link to a station; the station's end is `a`."""
        number = len(self._further_radios) + 3
        radio = MemoryLink(self.loop, Random(self.plan.seed + number), self.plan.station_link)
        self._further_radios.append(radio)
        if self.onboard is not None:
            self._link_to(radio)
        return radio

    def _link_to(self, radio: MemoryLink) -> None:
        link = StationLink(self.name, 1, self.loop, self.exchange, self.topics, self.random.getrandbits(32))
        link.open(self._routed(radio.b, link.take))
        self._further_links.append(link)

    def _routed(self, end: MemoryEnd, take: Callable[[list[Frame]], None]) -> RoutedLink:
        """A link in memory, from which nothing is passed on."""
        link = RoutedLink("udpin://0.0.0.0:14550", Router(self.autopilot_link.own), self.loop, take)
        end.on_data = link.receive
        link.open(end)
        return link

    def _sensors(self) -> dict[str, Any]:
        """The devices that samplers read."""
        ground = {} if looks_down(self.platform, self.mission) else {"ground_camera": NoCamera()}
        return {**self.rig.devices, **ground, "imu": self.imu}

    def _watch(self, sensors: Mapping[str, Any]) -> SensorWatch:
        """Looks at those that the platform has, but for a camera that is left out because nobody looks at its pictures."""
        used = {device for row in self.platform.components for device in row.devices.values()}
        if not looks_down(self.platform, self.mission):
            used.discard("ground_camera")
        watched = {name: device for name, device in sensors.items() if name in used}
        places = {name: NOWHERE if isinstance(device, NoCamera) else SIMULATED for name, device in watched.items()}
        return SensorWatch(places, watched, self.rig, self.loop.time)

    def kill_onboard(self) -> None:
        """The onboard process dies: no method is called, nothing is said."""
        if self.onboard is not None:
            self.onboard.close()
            self._heartbeat.close()
            self.companion.close()
            self._authority.close()
            self.autopilot_link.close()
            self.station_link.close()
            if self._acoustic is not None:
                self._acoustic.close()
            for link in self._further_links:
                link.close()
            self._further_links.clear()
            for radio in self._further_radios:
                radio.b.on_data = None
            self.cable.b.on_data = self.radio.b.on_data = None
            self.onboard = None

    def tell(self, fault: SimFault) -> None:
        """Has the log say that a fault begins or ends."""
        self._publisher.publish(f"{self.name}/sim/fault", fault, self.loop.time())

    # --- the truth ---

    def _see_pose(self, envelope: Envelope[Pose]) -> None:
        origin = envelope.payload.origin_geo
        if self.frame is None and origin is not None:
            self.frame = TangentPlane(GeoPoint(*origin))

    def _tell_truth(self) -> None:
        now_s = self.loop.time()
        if self.frame is not None:
            truth = self.simulator.truth()
            position = self.frame.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
            self.samples.append(Sample(truth.t_s, position))
            self._sink(position[2])
            message = SimTruth(
                position_ned_m=position,
                velocity_ned_m_s=truth.velocity_ned_m_s,
                ned_from_frd=truth.attitude_wxyz,
                wind_ned_m_s=truth.wind_ned_m_s,
            )
            self._publisher.publish(f"{self.name}/sim/truth", message, now_s, "ned")
        self._truth_timer = self.loop.call_later(TRUTH_PERIOD_S, self._tell_truth)

    def _sink(self, depth_m: float) -> None:
        """Water takes the radio away, and gives it back."""
        is_below = depth_m > self.plan.radio_depth_m
        if is_below != self.is_below:
            self.is_below = is_below
            self.radio.set_conditions(Conditions(loss=1.0) if is_below else self.plan.station_link)

    # --- the operator ---

    @property
    def name(self) -> str:
        """The platform's name."""
        return self.platform.platform

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
        lacks = await flights.await_ready(self.station, self.name, within_s)
        if lacks:
            raise Gloc3Error(f"{self.name} still lacks {', '.join(lacks)}")
        plan = Plan(name=self.mission_file.name, title=self.mission.name, text=self.mission.text)
        await flights.stream(self.station, self.name, plan)
        return await flights.start(self.station, self.name)

    async def await_end(self, follower: flights.Follower, within_s: float) -> End:
        """Follows the mission to its end.

        Raises:
            TimeoutError: it has not ended by then.
        """
        async with asyncio.timeout(within_s):
            return await flights.follow(self.station, self.name, follower)

    async def expect(self, topic: str, predicate: Callable[[Any], bool], within_s: float) -> Message:
        """Waits for a message on a topic (below the platform's name) that fits.

        Raises:
            TimeoutError: none has come by then; the text names the topic.
        """
        found: asyncio.Future[Message] = self.loop.create_future()

        def take(envelope: Envelope[Any]) -> None:
            if not found.done() and predicate(envelope.payload):
                found.set_result(envelope.payload)

        unsubscribe = self.exchange.subscribe(f"{self.name}/{topic}", take)
        try:
            async with asyncio.timeout(within_s):
                return await found
        except TimeoutError:
            raise TimeoutError(f"nothing fitting came on {topic} within {within_s:g} s") from None
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
        raise Refused(f"the mission is in frame {mission.frame!r}, and the world {world.name} has {world.frame_name!r}")
    return world
