"""The command `gloc3 sitl`: the simulated vehicle on real sockets, in wall time."""

import asyncio
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.mavlink.links import Receive
from gloc3_sitl.cli.record import record
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.flight.truth_log import TruthLog
from gloc3_sitl.physics.water import rough
from gloc3_sitl.physics.wind import CALM, gusty
from gloc3_sitl.vehicles import MULTIROTORS
from gloc3_sitl.vehicles.dvl_server import MOST_PORT, DvlAddress, DvlServer, read_dvl
from gloc3_sitl.vehicles.sensor_server import SensorServer
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator
from gloc3_sitl.vehicles.table import check_sea, style_of, vehicle_named
from gloc3_sitl.world import World

DEFAULT_LINKS: Final = ("udpout://127.0.0.1:14550", "udpout://127.0.0.1:14540")
"""Where PX4's and ArduPilot's own simulations send, too: 14550 for ground stations, 14540 for companions and MAVSDK."""
ARDUPILOTS_LINK: Final = "station=tcpin://127.0.0.1:5760"
"""Where ArduPilot's own simulation listens, too: MAVProxy, dronekit and pymavlink look for it there."""

PELICAN: Final = "pelican"
INDOORS: Final = "hold"
"""The world of the paper's vehicle; the others are in that of missions on Earth."""
_COMPANION_PORTS: Final = range(14540, 14550)
_KINDS: Final = {"station": LinkKind.GROUND, "companion": LinkKind.COMPANION}

app = App(
    name="gloc3 sitl",
    help="""Run the simulated vehicle: physics, world and autopilot, on real sockets, until Ctrl-C.

    Without --link it sends to 127.0.0.1:14550, where ground stations listen (QGroundControl; MAVSDK as
    udpin://0.0.0.0:14550), and to 127.0.0.1:14540, where companions listen (MAVSDK as udpin://0.0.0.0:14540,
    gloc3 onboard); in ArduPilot's style it also listens on TCP 127.0.0.1:5760, where MAVProxy and pymavlink look.
    What it does and what the autopilot says goes to stderr.

    For example:

    - `gloc3 sitl`: the Pelican in a cargo hold, as `gloc3 onboard pelican_rtk` and `gloc3 station` look for it
    - `gloc3 sitl --autopilot ardupilot --world open --home 47.3977,8.5456,488,90 --wind 6`: for ground stations of others
    - `gloc3 sitl --vehicle boat --home 63.4396,10.399,0,0 --waves 0.3`: the Otter in the fjord, for `gloc3
      onboard boat`; `--vehicle rover` is a Jackal, `plane` an Aerosonde
    - `gloc3 sitl --vehicle auv --dvl a50://127.0.0.1:16171`: with its Doppler velocity log, for `gloc3 onboard
      auv --device dvl=a50://127.0.0.1:16171`; `--vehicle rov`, too
    - `gloc3 sitl --no-gps --sensors 7010`: with cameras and laser scanner, for `gloc3 onboard pelican --device`
    - `gloc3 sitl --firmware ardupilot`: a real ArduPilot in this world, see docs/firmware.md""",
    help_format="markdown",
    usage="gloc3 sitl [OPTIONS] | gloc3 sitl COMMAND",
    version_flags=[],
)


app.command(record)


class LinkRow(NamedTuple):
    """A link that was asked for."""

    url: str
    kind: LinkKind


class Extras(NamedTuple):
    """What else was asked for."""

    speed: float
    seconds: float | None
    sensor_port: int | None
    dvl: DvlAddress | None
    seed: int
    out: Path | None
    vehicle: str


def read_link(text: str) -> LinkRow:
    """Reads a link: a URL, with `station=` or `companion=` before it where the port does not tell.

    Raises:
        Refused: the word before the URL is neither.
    """
    word, equals, url = text.partition("=")
    if equals and "://" not in word:
        if word not in _KINDS:
            raise Refused(f"link {text!r}: {nearest(word, list(_KINDS))}")
        return LinkRow(url, _KINDS[word])
    port = text.rpartition(":")[2]
    is_companion = port.isdigit() and int(port) in _COMPANION_PORTS
    return LinkRow(text, LinkKind.COMPANION if is_companion else LinkKind.GROUND)


def read_home(text: str) -> tuple[GeoPoint, float]:
    """Reads LAT,LON,ALT,HEADING: degrees, metres above the sea, degrees clockwise from north.

    Raises:
        Refused: it is not four numbers, or not a place on Earth.
    """
    try:
        latitude, longitude, altitude, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise Refused(f"home {text!r} must be LAT,LON,ALT,HEADING, as 47.3977,8.5456,488,90") from None
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(altitude) < 1e5 and abs(heading) <= 360.0):
        raise Refused(f"home {text!r} is no place on Earth")
    return GeoPoint(latitude, longitude, altitude), heading


def read_parameter(text: str) -> tuple[str, float]:
    """Reads NAME=VALUE.

    Raises:
        Refused: it has another form.
    """
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise Refused(f"parameter {text!r} must be NAME=NUMBER") from None


@app.default
def sitl(
    *,
    vehicle: str = PELICAN,
    autopilot: str | None = None,
    world: str | None = None,
    home: str | None = None,
    speed: float = 1.0,
    seed: int = 0,
    wind: float = 0.0,
    wind_from: float = 0.0,
    waves: float = 0.0,
    current: float = 0.0,
    plain_gps: bool = False,
    no_gps: Annotated[bool, Parameter(negative=())] = False,
    battery: float = 1.0,
    param: Annotated[list[str] | None, Parameter(negative=())] = None,
    link: Annotated[list[str] | None, Parameter(negative=())] = None,
    seconds: float | None = None,
    sensors: int | None = None,
    dvl: str | None = None,
    out: Path | None = None,
    firmware: str | None = None,
    firmware_binary: Path | None = None,
    firmware_running: Annotated[bool, Parameter(negative=())] = False,
    firmware_port: int | None = None,
) -> int:
    """Run the simulated vehicle until Ctrl-C.

    Args:
        vehicle: Model of the vehicle.
        autopilot: Style of the autopilot: px4 or ardupilot; else the usual one of the vehicle.
        world: World to be in: the name of one of ours, or a world file; else hold for the Pelican, bay for what dives,
            and open for the others.
        home: Place of departure as LAT,LON,ALT,HEADING; for worlds that can be moved.
        speed: How many times faster than real time.
        seed: Seed of sensor noise and turbulence.
        wind: Mean speed of a gusty wind, in m/s.
        wind_from: Bearing that the wind blows from, in degrees.
        waves: Significant height of waves from there, in metres, for what swims.
        current: Of the water in m/s, to the north, for what swims.
        plain_gps: Metre-level fixes in place of RTK-grade ones.
        no_gps: No satellites: the autopilot is set to fly by the ODOMETRY that it is sent.
        battery: Charge at the start, 1 to 0.
        param: An autopilot parameter as NAME=VALUE; may be given again.
        link: Where MAVLink goes, as udpout://HOST:PORT, udpin://, tcpin://, tcpout:// or serial://; may be given again.
            `station=` or `companion=` before the URL chooses which telemetry begins by itself; ports 14540 to 14549 are
            companions' without it.
        seconds: End after so much simulated time.
        sensors: TCP port on 127.0.0.1 that serves cameras and laser scanner (0: any), as sources tcp://127.0.0.1:PORT of
            `gloc3 onboard --device`.
        dvl: Where a Doppler velocity log is served, as a50://HOST:PORT or pd6://HOST:PORT: the same is the source of `gloc3
            onboard auv --device dvl=…`.
        out: Folder for truth.mcap, the log of where the vehicle truly was.
        firmware: A real autopilot, ardupilot or px4, in place of ours; see docs/firmware.md.
        firmware_binary: Its program; else arducopter or px4 on PATH.
        firmware_running: It is started by somebody else, and waited for.
        firmware_port: Where our physics listens for it, in place of UDP 9002 (ArduPilot) or TCP 4560 (PX4).
    """
    autopilot = style_of(vehicle, autopilot)
    if not 0.0 < speed <= 1000.0:
        raise Refused("--speed must be above 0, and 1000 at most")
    if not 0.0 <= wind <= 30.0:
        raise Refused("--wind must be from 0 to 30 m/s")
    check_sea(vehicle, waves, current)
    if not 0.0 <= battery <= 1.0:
        raise Refused("--battery must be from 0 to 1")
    if seed < 0:
        raise Refused("--seed must be 0 or more")
    if seconds is not None and not seconds > 0.0:
        raise Refused("--seconds must be above 0")
    if sensors is not None and not 0 <= sensors <= MOST_PORT:
        raise Refused(f"--sensors must be a port from 0 to {MOST_PORT}")
    if firmware_port is not None and not 0 <= firmware_port <= MOST_PORT:
        raise Refused(f"--firmware-port must be a port from 0 to {MOST_PORT}")
    dvl_address = None if dvl is None else read_dvl(dvl)
    place, heading = (None, None) if home is None else read_home(home)
    air = gusty(wind, wind_from) if wind > 0.0 else CALM
    there = World.load(world or (INDOORS if vehicle in MULTIROTORS else vehicle_named(vehicle).world), place, heading)
    there.water = rough(there.water, waves_m=waves, waves_from_deg=wind_from, current_m_s=current)
    parameters = dict(read_parameter(text) for text in param or ())
    if firmware is not None:
        if battery != 1.0:
            raise Refused("--battery: a real firmware simulates its own battery; see docs/firmware.md")
        from gloc3_sitl.firmware.run import FirmwareOptions, run_firmware

        return asyncio.run(
            run_firmware(
                FirmwareOptions(
                    firmware=firmware,
                    world=there,
                    body=BodySettings(
                        vehicle=vehicle, seed=seed, wind=air, is_without_gps=no_gps, is_plain_gps=plain_gps
                    ),
                    parameters=parameters,
                    links=tuple(read_link(text).url for text in link or ()),
                    binary=firmware_binary,
                    is_running=firmware_running,
                    port=firmware_port,
                    speed=speed,
                    seconds=seconds,
                    sensor_port=sensors,
                    dvl=dvl_address,
                    out=out,
                )
            )
        )
    if firmware_binary is not None or firmware_running or firmware_port is not None:
        raise Refused("--firmware-binary, -running and -port need --firmware ardupilot or --firmware px4")
    simulator = Simulator(
        there,
        vehicle=vehicle,
        style=autopilot,
        seed=seed,
        wind=air,
        is_plain_gps=plain_gps,
        is_without_gps=no_gps,
        battery_remaining=battery,
        parameters=parameters,
    )
    usual = (*DEFAULT_LINKS, ARDUPILOTS_LINK) if autopilot == "ardupilot" else DEFAULT_LINKS
    links = [read_link(text) for text in link or usual]
    title = f"{vehicle}, {autopilot}, world {simulator.world.name}"
    return asyncio.run(_run(simulator, links, Extras(speed, seconds, sensors, dvl_address, seed, out, vehicle), title))


async def _run(simulator: Simulator, links: Sequence[LinkRow], extras: Extras, title: str) -> int:
    """Opens the links and lets the time run, until a signal or the end."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    endpoints: list[Endpoint] = []
    server = SensorServer(simulator, loop, extras.seed) if extras.sensor_port is not None else None
    dvl = DvlServer(simulator, loop, extras.seed, extras.dvl) if extras.dvl is not None else None
    truth = TruthLog(simulator, loop, extras.out, extras.vehicle) if extras.out is not None else None
    try:
        for row in links:
            endpoints.append(await _open(simulator, row, loop))  # noqa: PERF401 # those opened are closed if one fails
        latitude, longitude, altitude = simulator.world.home
        _tell(f"{title}; home {latitude:.7f}, {longitude:.7f}, {altitude:.1f} m; {extras.speed:g} times real time")
        for row, endpoint in zip(links, endpoints, strict=True):
            port = "" if endpoint.local_port is None else f", port {endpoint.local_port}"
            _tell(f"{row.kind} link {row.url}{port}")
        if server is not None and extras.sensor_port is not None:
            await server.open(extras.sensor_port)
            _tell(f"sensors tcp://127.0.0.1:{server.port}: {', '.join(server.feeds)}")
        if dvl is not None:
            _tell(f"Doppler velocity log {(await dvl.open()).url}")
        simulator.autopilot.utc_offset_s = Clock(loop).utc_offset_s + loop.time()
        simulator.start(loop, extras.speed)
        await _watch(simulator, endpoints, stopped, extras.seconds)
    finally:
        simulator.stop()
        if server is not None:
            await server.close()
        if dvl is not None:
            await dvl.close()
        if truth is not None:
            truth.close()
        for endpoint in endpoints:
            await endpoint.close()
    _tell(f"ended after {simulator.now_s:.1f} s of simulated time")
    return 0


async def _open(simulator: Simulator, row: LinkRow, loop: asyncio.AbstractEventLoop) -> Endpoint:
    """Opens one link and connects it."""
    receive: Receive | None = None

    def take(data: bytes) -> None:
        if receive is not None:
            receive(data)

    opened = await open_endpoint(row.url, loop, take)
    receive = simulator.attach(opened.send, row.kind, is_datagram=opened.is_datagram)
    return opened


async def _watch(
    simulator: Simulator, endpoints: Sequence[Endpoint], stopped: asyncio.Event, seconds: float | None
) -> None:
    """Tells what the autopilot says and what keeps a link from working, until it is over."""
    told = 0
    late = 0
    problems: dict[str, str] = {}
    while not stopped.is_set():
        with suppress(TimeoutError):
            await asyncio.wait_for(stopped.wait(), 0.1)
        new = min(simulator.texts_said - told, len(simulator.texts))
        told = simulator.texts_said
        for t_s, severity, text in list(simulator.texts)[len(simulator.texts) - new :]:
            _tell(f"{t_s:8.2f} s  {severity.name.lower()}: {text}")
        for endpoint in endpoints:
            if endpoint.problem != problems.get(endpoint.url, ""):
                _tell(f"{endpoint.url}: {endpoint.problem or 'connected'}")
            problems[endpoint.url] = endpoint.problem
        if simulator.late > late and late == 0:
            late = simulator.late
            _tell("this computer is too slow for the speed asked for; simulated time goes slower")
        if simulator.is_off:
            _tell("the autopilot was shut down")
            return
        if seconds is not None and simulator.now_s >= seconds:
            return


def _tell(text: str) -> None:
    narrate(f"sitl: {text}")
