"""The onboard process of a flight in virtual time: the assembly of `gloc3 onboard`, on links and devices in memory."""

from collections.abc import Callable, Mapping
from errno import ENOSPC
from pathlib import Path
from random import Random
from typing import Any, Final

from msgspec.structs import replace

from gloc3.component.context import HostContext
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.mavlink.transport.memory import ACOUSTIC, Conditions, MemoryEnd, MemoryLink
from gloc3.mission.model.model import Mission
from gloc3.network.rights import Rights
from gloc3.platform.platform import Platform
from gloc3.platform.reader import find_platform
from gloc3.store import MemoryRecords
from gloc3.terrain import open_terrain
from gloc3_onboard.assembly import VehicleSide, watch_sensors
from gloc3_onboard.companion.acoustic_link import ModemSettings
from gloc3_onboard.companion.files import LOGS, Folders, LogFolder
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.inputs import KNOWN_MAP, Attachment, Hosting, Sensors, Storage, VehicleInputs, known_map
from gloc3_onboard.process.computer import SimulatedComputer
from gloc3_onboard.process.runner import Create, Onboard
from gloc3_onboard.process.storage import NoPictures, PictureFolder
from gloc3_onboard.sensors.registry import NOWHERE
from gloc3_onboard.sensors.sources.autopilot import AutopilotImu
from gloc3_sitl.flight.log import FlightRecording
from gloc3_sitl.flight.mission_file import faces_down, recordable_cameras
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.flight.sim_devices import NoDevice
from gloc3_sitl.flight.sim_imu import SimImu
from gloc3_sitl.flight.sim_rig import PROBE, SimRig

AUTOPILOT_CABLE: Final = Conditions(latency_s=0.002)
AUTOPILOT_URL: Final = "udpin://127.0.0.1:14540"
"""What the cable is called; the onboard process's usual one."""
BITS_PER_BYTE: Final = 10.0
SIMULATED: Final = "simulated"
"""Name of a simulated sensor's source."""


class FlightPictures(PictureFolder):
    """Colours pictures when they are written: most are only looked at, by processors of grey values."""

    def __init__(self, folder: Path, rig: SimRig, utc_offset_s: Callable[[], float | None]) -> None:
        super().__init__(folder, rig, utc_offset_s)
        self._sim_rig = rig

    def write(self, picture: RecordedPicture) -> None:
        """Writes a picture, in colour."""
        super().write(picture._replace(image=self._sim_rig.coloured(picture.image)))


class FlightRecords(MemoryRecords):
    """Records in memory on a disk that can be full."""

    def __init__(self, disk: "FlightDisk") -> None:
        super().__init__()
        self._disk = disk

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        """Adds a record."""
        self._disk.check()
        super().append(record, outlives_power_cut=outlives_power_cut)

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        """Replaces all records."""
        self._disk.check()
        super().rewrite(records, outlives_power_cut=outlives_power_cut)


class FlightDisk:
    """The disk of the onboard process, as far as its journal, its progress and its reports are kept there."""

    is_full = False

    def check(self) -> None:
        """Raises what a full disk raises."""
        if self.is_full:
            raise OSError(ENOSPC, "No space left on device")


class FlightLinks:
    """The links of a flight's onboard process, which survive its restart; end `b` of each belongs to it.

    Args:
        plan: the flight plan.
        context: the flight's context.
    """

    def __init__(self, plan: FlightPlan, context: HostContext) -> None:
        loop, seed = context.loop, plan.seed
        self.cable: Final = MemoryLink(loop, Random(seed + 1), AUTOPILOT_CABLE)
        """To the autopilot."""
        self.radio: Final = MemoryLink(loop, Random(seed + 2), plan.station_link)
        """To the flight's own station."""
        self.modem: Final = MemoryLink(loop, Random(seed + 99), ACOUSTIC, is_half_duplex=True)
        self.further: Final[list[MemoryLink]] = []
        """To more stations."""
        self.is_below = False
        """The vehicle is too deep for the radio."""
        self._plan = plan
        self._whole: Final = {self.cable: AUTOPILOT_CABLE, self.radio: plan.station_link}
        """How links are without a fault."""
        self._impairments: Final[dict[MemoryLink, list[dict[str, float]]]] = {self.cable: [], self.radio: []}

    def add_radio(self) -> MemoryLink:
        """One more link to a station."""
        loop, number = self.radio.loop, len(self.further) + 3
        radio = MemoryLink(loop, Random(self._plan.seed + number), self._plan.station_link)
        self.further.append(radio)
        return radio

    def sink(self, depth_m: float) -> None:
        """Cuts the radio under water and restores it above."""
        is_below = depth_m > self._plan.radio_depth_m
        if is_below != self.is_below:
            self.is_below = is_below
            self._whole[self.radio] = Conditions(loss=1.0) if is_below else self._plan.station_link
            self._set(self.radio)

    def impair(self, link: MemoryLink, **worse: float) -> Callable[[], None]:
        """Makes the cable or the radio worse in some of its `Conditions`; of several impairments the worst value counts.

        Returns:
            What takes this impairment away again.
        """
        self._impairments[link].append(worse)
        self._set(link)

        def end() -> None:
            self._impairments[link].remove(worse)
            self._set(link)

        return end

    def _set(self, link: MemoryLink) -> None:
        conditions = self._whole[link]
        for worse in self._impairments[link]:
            worst = {name: max(value, getattr(conditions, name)) for name, value in worse.items()}
            conditions = replace(conditions, **worst)
        link.set_conditions(conditions)


class FlightProcess:
    """The onboard process of a flight, which may be killed and started again.

    Args:
        plan: the flight plan.
        platform: the platform file.
        mission: the mission.
        context: the flight's context.
        create: creates the components.
        rig: the simulated sensors.
        log: the flight's log.
    """

    def __init__(
        self,
        plan: FlightPlan,
        platform: Platform,
        mission: Mission,
        context: HostContext,
        create: Create,
        rig: SimRig,
        log: FlightRecording,
    ) -> None:
        self._plan, self._platform, self._context, self._create, self._rig = plan, platform, context, create, rig
        self._log = log
        self._looks_down = faces_down(platform, mission)
        log.on_select = self._use_colours
        self._use_colours()
        self.links: Final = FlightLinks(plan, context)
        self.imu: Final = SimImu(context.loop, plan.seed)
        """The autopilot's inertial unit, as the process gets it."""
        self._ends: list[MemoryEnd] = []
        self.disk: Final = FlightDisk()
        self.storage: Final = Storage(
            journal=FlightRecords(self.disk),
            progress=FlightRecords(self.disk),
            reports=FlightRecords(self.disk),
            memory=FlightRecords(self.disk),
            log_store=log.log_store(),
            pictures=NoPictures()
            if plan.out is None
            else FlightPictures(plan.out / "images", rig, context.clock.utc_offset),
        )
        """What outlives the process."""
        clock = context.clock
        self.rights: Final = Rights(platform.platform, clock.utc_s, clock.now_s)
        """Of a network's members; all have all of them until a file is adopted."""
        self._inputs = VehicleInputs(
            platform=platform,
            context=context,
            rights=self.rights,
            member_of=lambda _url, _number: plan.member,
            terrain=open_terrain(plan.terrain),
        )
        self.vehicle: VehicleSide
        """Its parts, in the life that is or was the last."""
        self.onboard: Onboard | None = None
        """Its components; None while it is dead."""

    def _use_colours(self) -> None:
        """Has pictures that the log records taken in colour: it costs as much again. Others get it when they are written."""
        name, cameras = self._platform.platform, recordable_cameras(self._platform)
        self._rig.use_colour([camera for camera in cameras if self._log.records(f"{name}/camera/{camera}")])

    def start(self) -> None:
        """Starts it, the first time or after it was killed."""
        vehicle, links, plan = VehicleSide(self._inputs, AUTOPILOT_URL), self.links, self._plan
        self.vehicle = vehicle
        self.imu.wire(AutopilotImu(vehicle.autopilot.sensors))
        self._open(links.cable.b, vehicle.attach_autopilot())
        if plan.has_station:
            self._open_station(links.radio)
        for radio in links.further:
            self._open_station(radio)
        if plan.modem_period_s:
            self._open(links.modem.b, vehicle.attach_modem(ModemSettings(period_s=plan.modem_period_s)))
        if plan.out is not None:
            vehicle.share(Folders({LOGS: LogFolder(plan.out, is_writable=False)}))
        sensors = self._sensors()
        watch = watch_sensors(vehicle.parts, sensors, self._context.loop.time)
        computer = SimulatedComputer(self._context.clock, watch.conditions, self._log)
        self.onboard = vehicle.host(sensors, computer, self.storage, Hosting(create=self._create))
        vehicle.begin()

    def kill(self) -> None:
        """The process dies: no method is called, nothing is sent."""
        if self.onboard is not None:
            self.vehicle.close()
            for end in self._ends:
                end.on_data = None
            self._ends.clear()
            self.onboard = None

    def add_radio(self) -> MemoryLink:
        """One more link to a station; the station's end is `a`."""
        radio = self.links.add_radio()
        if self.onboard is not None:
            self._open_station(radio)
        return radio

    def _open(self, end: MemoryEnd, attachment: Attachment) -> None:
        self._ends.append(end)
        end.on_data = attachment.receive
        attachment.open(end)

    def _open_station(self, radio: MemoryLink) -> None:
        """Opens the station link; a radio with a bandwidth is paced accordingly, others only for our own frames."""
        number, conditions = len(self.vehicle.stations) + 1, self._plan.station_link
        url = f"udpout://station-{number}:14550"
        budget: LinkBudget | None = RADIO
        if conditions.bandwidth_bit_s is not None:
            rate_bit_s = round(conditions.bandwidth_bit_s / conditions.bits_per_byte * BITS_PER_BYTE)
            url, budget = f"{url}?rate={rate_bit_s}", None
        self._open(radio.b, self.vehicle.attach_station(url, budget))

    def _sensors(self) -> Sensors:
        """The simulated sensors; a downward camera that no action needs renders nothing.

        A probe of what is no field of this world is not plugged in.
        """
        ground = {} if self._looks_down else {"ground_camera": NoDevice()}
        used = {device for row in self._platform.components for device in row.devices.values()}
        probes = {name: NoDevice() for name in sorted(used) if name.endswith(PROBE)}
        devices: Mapping[str, Any] = {**probes, **self._rig.devices, **ground, "imu": self.imu}
        devices = {**devices, KNOWN_MAP: known_map(self._platform, find_platform(self._plan.platform).parent)}
        if not self._looks_down:
            used.discard("ground_camera")
        urls = {
            name: NOWHERE if isinstance(device, NoDevice) else SIMULATED
            for name, device in devices.items()
            if name in used
        }
        return Sensors(devices, urls, self._rig)
