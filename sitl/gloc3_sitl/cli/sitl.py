"""The command `gloc3 sitl`: the simulated vehicle on real sockets, in real time."""

import asyncio
import signal
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.mavlink.links import Receive
from gloc3_sitl.cli.record import record
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.flight.truth_log import TruthLog
from gloc3_sitl.physics.water import rough
from gloc3_sitl.physics.wind import CALM, Wind, gusty
from gloc3_sitl.sensors.gimbal import SimulatedGimbal
from gloc3_sitl.vehicles import MULTIROTORS
from gloc3_sitl.vehicles.dvl_server import MOST_PORT, DvlAddress, DvlServer, exposure, read_dvl
from gloc3_sitl.vehicles.line_server import field_server
from gloc3_sitl.vehicles.sensor_server import SensorServer
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.vehicles.table import check_sea, style_of, vehicle_named
from gloc3_sitl.world import World

DEFAULT_LINKS: Final = ("udpout://127.0.0.1:14550", "udpout://127.0.0.1:14540")
"""Where PX4's and ArduPilot's own simulations send, too: 14550 for ground stations, 14540 for companions and MAVSDK."""
ARDUPILOTS_LINK: Final = "station=tcpin://127.0.0.1:5760"
"""Listening address of ArduPilot's own simulation, which MAVProxy, dronekit and pymavlink expect."""

ADVICE: Final = "listen on 127.0.0.1 if only this computer is meant"
PELICAN: Final = "pelican"
INDOORS: Final = "hold"
"""World of the paper's vehicle; other vehicles use that of missions on Earth."""
_COMPANION_PORTS: Final = range(14540, 14550)
_KINDS: Final = {"station": LinkKind.GROUND, "companion": LinkKind.COMPANION}

app = App(
    name="gloc3 sitl",
    help="""Run the simulated vehicle: physics, world and autopilot, on real sockets, until Ctrl-C.

    Without --link it sends to 127.0.0.1:14550, where ground stations listen (QGroundControl; MAVSDK as
    udpin://127.0.0.1:14550), and to 127.0.0.1:14540, where companions listen (MAVSDK as udpin://127.0.0.1:14540,
    gloc3 onboard); in ArduPilot's style it also listens on TCP 127.0.0.1:5760, where MAVProxy and pymavlink connect.
    Narration and the autopilot's status texts go to stderr.

    For example:

    - `gloc3 sitl`: the Pelican in a cargo hold, on the default ports of `gloc3 onboard pelican_rtk` and `gloc3 station`
    - `gloc3 sitl --autopilot ardupilot --world open --home 47.3977,8.5456,488,90 --wind 6`: for other ground stations
    - `gloc3 sitl --vehicle boat --home 63.4396,10.399,0,0 --waves 0.3`: the Otter in the fjord, for `gloc3
      onboard boat`; `--vehicle rover` is a Jackal, `plane` an Aerosonde
    - `gloc3 sitl --vehicle auv --dvl a50://127.0.0.1:16171`: with its Doppler velocity log, for `gloc3 onboard
      auv --device dvl=a50://127.0.0.1:16171`; also with `--vehicle rov`
    - `gloc3 sitl --no-gps --sensors 7010`: with cameras and laser scanner, for `gloc3 onboard pelican --device`
    - `gloc3 sitl --firmware ardupilot`: a real ArduPilot in this world; see docs/firmware.md""",
    help_format="markdown",
    usage="gloc3 sitl [OPTIONS] | gloc3 sitl COMMAND",
    version_flags=[],
)


app.command(record)


class LinkRow(NamedTuple):
    """A requested MAVLink link."""

    url: str
    kind: LinkKind


def read_link(text: str) -> LinkRow:
    """Reads a link: a URL, with `station=` or `companion=` before it where the port does not imply one.

    Raises:
        Refused: the word before the URL is neither, or the URL is wrong.
    """
    word, equals, url = text.partition("=")
    if equals and "://" not in word:
        if word not in _KINDS:
            raise Refused(f"link {text!r}: {nearest(word, list(_KINDS))}")
        parse_url(url).check_unkeyed("gloc3 sitl")
        return LinkRow(url, _KINDS[word])
    parse_url(text).check_unkeyed("gloc3 sitl")
    port = text.rpartition(":")[2]
    is_companion = port.isdigit() and int(port) in _COMPANION_PORTS
    return LinkRow(text, LinkKind.COMPANION if is_companion else LinkKind.GROUND)


def read_home(text: str) -> tuple[GeoPoint, float]:
    """Reads LAT,LON,ALT,HEADING: degrees, metres above the sea, degrees clockwise from north.

    Raises:
        Refused: the text is not four numbers, or not a position on Earth.
    """
    try:
        latitude, longitude, altitude, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise Refused(f"home {text!r} must be LAT,LON,ALT,HEADING, such as 47.3977,8.5456,488,90") from None
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(altitude) < 1e5 and abs(heading) <= 360.0):
        raise Refused(f"home {text!r} is not a place on Earth")
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


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SitlOptions:
    """The options of `gloc3 sitl`, one field each."""

    vehicle: str = PELICAN
    """Vehicle model."""
    autopilot: str | None = None
    """Autopilot style: px4 or ardupilot; by default the vehicle's usual one."""
    world: str | None = None
    """World: the name of a built-in one, or a world file; by default hold for multirotors, bay for underwater
    vehicles, and open for the others."""
    home: str | None = None
    """Home position as LAT,LON,ALT,HEADING; for worlds without a fixed place on Earth."""
    speed: float = 1.0
    """Simulation speed, as a multiple of real time."""
    seed: int = 0
    """Seed of sensor noise and turbulence."""
    wind: float = 0.0
    """Mean speed of a gusty wind, in m/s."""
    wind_from: float = 0.0
    """Bearing that the wind blows from, in degrees."""
    waves: float = 0.0
    """Significant height of waves from the same bearing, in metres; for boats and underwater vehicles."""
    current: float = 0.0
    """Water current to the north, in m/s; for boats and underwater vehicles."""
    plain_gps: bool = False
    """Metre-level fixes instead of RTK-grade ones. Corrections make them RTK-grade (gloc3 station --rtk)."""
    no_gps: Annotated[bool, Parameter(negative=())] = False
    """No satellites: the autopilot's parameters are set for external odometry (ODOMETRY)."""
    battery: float = 1.0
    """Battery charge at the start, 0 to 1."""
    param: Annotated[list[str] | None, Parameter(negative=())] = None
    """An autopilot parameter as NAME=VALUE; may be repeated."""
    link: Annotated[list[str] | None, Parameter(negative=())] = None
    """A MAVLink link, as udpout://HOST:PORT, udpin://, tcpin://, tcpout:// or serial://; may be repeated.
    `station=` or `companion=` before the URL chooses the default telemetry streams; without it, ports 14540 to
    14549 are companion links."""
    seconds: float | None = None
    """Simulated time after which to end, in seconds."""
    sensors: int | None = None
    """TCP port on 127.0.0.1 that serves cameras and laser scanner (0: any free one); `gloc3 onboard --device` reads
    them from tcp://127.0.0.1:PORT."""
    dvl: str | None = None
    """Address that serves a Doppler velocity log, as a50://HOST:PORT or pd6://HOST:PORT; the same URL is the source in
    `gloc3 onboard auv --device dvl=…`."""
    fields: int | None = None
    """TCP port on 127.0.0.1 that serves the world's fields, such as gases (0: any free one); the source of a device
    co2_probe in `gloc3 onboard --device` is lines://127.0.0.1:PORT#co2."""
    gimbal: Annotated[bool, Parameter(negative=())] = False
    """With a gimbal (MAVLink component 154) and a camera on it, which --sensors serves as `gimbal`."""
    out: Path | None = None
    """Folder for truth.mcap, the log of the vehicle's true motion."""
    firmware: str | None = None
    """Real firmware, ardupilot or px4, instead of the embedded autopilot; see docs/firmware.md."""
    firmware_binary: Path | None = None
    """The firmware's program; by default arducopter or px4 (or the vehicle's ArduPilot program) on PATH."""
    firmware_running: Annotated[bool, Parameter(negative=())] = False
    """Wait for a firmware that you start yourself."""
    firmware_port: int | None = None
    """Port on which the physics waits for it, instead of UDP 9002 (ArduPilot) or TCP 4560 (PX4)."""


@app.default
def sitl(options: SitlOptions = SitlOptions()) -> int:
    """Run the simulated vehicle until Ctrl-C."""
    style = style_of(options.vehicle, options.autopilot)
    _check(options)
    dvl = None if options.dvl is None else read_dvl(options.dvl)
    air = gusty(options.wind, options.wind_from) if options.wind > 0.0 else CALM
    world = _world(options)
    parameters = dict(read_parameter(text) for text in options.param or ())
    if options.firmware is not None:
        return _run_firmware(options.firmware, options, world, air, dvl)
    if options.firmware_binary is not None or options.firmware_running or options.firmware_port is not None:
        raise Refused("--firmware-binary, --firmware-running and --firmware-port need --firmware ardupilot or px4")
    simulator = Simulator(
        world,
        SimulatorSettings(
            vehicle=options.vehicle,
            style=style,
            seed=options.seed,
            wind=air,
            is_plain_gps=options.plain_gps,
            is_without_gps=options.no_gps,
            battery_remaining=options.battery,
            parameters=parameters,
        ),
    )
    usual = (*DEFAULT_LINKS, ARDUPILOTS_LINK) if style == "ardupilot" else DEFAULT_LINKS
    links = [read_link(text) for text in options.link or usual]
    title = f"{options.vehicle}, {style}, world {simulator.world.name}"
    return asyncio.run(_run(simulator, links, options, dvl, title))


def _check(options: SitlOptions) -> None:
    """Checks that the options are within their bounds.

    Raises:
        Refused: one is not.
    """
    if not 0.0 < options.speed <= 1000.0:
        raise Refused("--speed must be above 0 and at most 1000")
    if not 0.0 <= options.wind <= 30.0:
        raise Refused("--wind must be from 0 to 30 m/s")
    check_sea(options.vehicle, options.waves, options.current)
    if not 0.0 <= options.battery <= 1.0:
        raise Refused("--battery must be from 0 to 1")
    if options.seed < 0:
        raise Refused("--seed must be 0 or more")
    if options.seconds is not None and not options.seconds > 0.0:
        raise Refused("--seconds must be above 0")
    if options.sensors is not None and not 0 <= options.sensors <= MOST_PORT:
        raise Refused(f"--sensors must be a port from 0 to {MOST_PORT}")
    if options.fields is not None and not 0 <= options.fields <= MOST_PORT:
        raise Refused(f"--fields must be a port from 0 to {MOST_PORT}")
    if options.firmware_port is not None and not 0 <= options.firmware_port <= MOST_PORT:
        raise Refused(f"--firmware-port must be a port from 0 to {MOST_PORT}")


def _world(options: SitlOptions) -> World:
    place, heading = (None, None) if options.home is None else read_home(options.home)
    usual = INDOORS if options.vehicle in MULTIROTORS else vehicle_named(options.vehicle).world
    world = World.load(options.world or usual, place, heading)
    world.water = rough(
        world.water, waves_m=options.waves, waves_from_deg=options.wind_from, current_m_s=options.current
    )
    return world


def _run_firmware(firmware: str, options: SitlOptions, world: World, air: Wind, dvl: DvlAddress | None) -> int:
    """Runs a real autopilot on the simulated physics, until Ctrl-C."""
    if options.battery != 1.0:
        raise Refused("--battery: a real firmware simulates its own battery; see docs/firmware.md")
    if options.gimbal:
        raise Refused("--gimbal needs the embedded autopilot; connect a gimbal to a port of the real firmware instead")
    from gloc3_sitl.firmware.run import FirmwareOptions, run_firmware

    body = BodySettings(
        vehicle=options.vehicle,
        seed=options.seed,
        wind=air,
        is_without_gps=options.no_gps,
        is_plain_gps=options.plain_gps,
    )
    run = FirmwareOptions(
        firmware=firmware,
        world=world,
        body=body,
        parameters=dict(read_parameter(text) for text in options.param or ()),
        links=tuple(read_link(text).url for text in options.link or ()),
        binary=options.firmware_binary,
        is_running=options.firmware_running,
        port=options.firmware_port,
        speed=options.speed,
        seconds=options.seconds,
        sensor_port=options.sensors,
        dvl=dvl,
        field_port=options.fields,
        out=options.out,
    )
    return asyncio.run(run_firmware(run))


async def _run(
    simulator: Simulator, links: Sequence[LinkRow], options: SitlOptions, dvl_at: DvlAddress | None, title: str
) -> int:
    """Opens the links and runs the simulation, until a signal or the end."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    endpoints: list[Endpoint] = []
    gimbal = SimulatedGimbal(simulator, partial(simulator.attach, kind=LinkKind.BARE), loop) if options.gimbal else None
    server = SensorServer(simulator, loop, options.seed, gimbal) if options.sensors is not None else None
    dvl = DvlServer(simulator, loop, options.seed, dvl_at) if dvl_at is not None else None
    fields = field_server(simulator, loop, options.seed, options.fields) if options.fields is not None else None
    truth = TruthLog(simulator, loop, options.out, options.vehicle) if options.out is not None else None
    try:
        for row in links:
            endpoints.append(await _open(simulator, row, loop))  # noqa: PERF401 # those opened are closed if one fails
        latitude, longitude, altitude = simulator.world.home
        _narrate(f"{title}; home {latitude:.7f}, {longitude:.7f}, {altitude:.1f} m; {options.speed:g} times real time")
        for row, endpoint in zip(links, endpoints, strict=True):
            port = "" if endpoint.local_port is None else f", port {endpoint.local_port}"
            _narrate(f"{row.kind} link {row.url}{port}")
            if warning := parse_url(row.url).warning(is_signed=False, advice=ADVICE):
                _narrate(warning, Severity.WARNING)
        if server is not None and options.sensors is not None:
            await server.open(options.sensors)
            _narrate(f"sensors tcp://127.0.0.1:{server.port}: {', '.join(server.feeds)}")
        if dvl is not None:
            _narrate(f"Doppler velocity log {(await dvl.open()).url}")
            if dvl_at is not None and (warning := exposure(dvl_at)):
                _narrate(warning, Severity.WARNING)
        if fields is not None:
            _narrate(f"fields {(await fields.open()).url}: {', '.join(simulator.world.file.fields)}")
        simulator.autopilot.utc_offset_s = Clock(loop).utc_offset_s + loop.time()
        simulator.start(loop, options.speed)
        if gimbal is not None:
            gimbal.start()
        await _watch(simulator, endpoints, stopped, options.seconds)
    finally:
        simulator.stop()
        if gimbal is not None:
            gimbal.stop()
        if server is not None:
            await server.close()
        if dvl is not None:
            await dvl.close()
        if fields is not None:
            await fields.close()
        if truth is not None:
            truth.close()
        for endpoint in endpoints:
            await endpoint.close()
    _narrate(f"ended after {simulator.now_s:.1f} s of simulated time")
    return 0


async def _open(simulator: Simulator, row: LinkRow, loop: asyncio.AbstractEventLoop) -> Endpoint:
    """Opens one link and connects it."""
    receive: Receive | None = None

    def handle(data: bytes) -> None:
        if receive is not None:
            receive(data)

    opened = await open_endpoint(row.url, loop, handle)
    receive = simulator.attach(opened.send, row.kind, is_datagram=opened.is_datagram)
    return opened


async def _watch(
    simulator: Simulator, endpoints: Sequence[Endpoint], stopped: asyncio.Event, seconds: float | None
) -> None:
    """Narrates the autopilot's status texts and the links' problems, until the end."""
    reported = 0
    late = 0
    problems: dict[str, str] = {}
    while not stopped.is_set():
        with suppress(TimeoutError):
            await asyncio.wait_for(stopped.wait(), 0.1)
        new = min(simulator.text_count - reported, len(simulator.texts))
        reported = simulator.text_count
        for t_s, severity, text in list(simulator.texts)[len(simulator.texts) - new :]:
            _narrate(f"{t_s:8.2f} s  {severity.name.lower()}: {text}")
        for endpoint in endpoints:
            if endpoint.problem != problems.get(endpoint.url, ""):
                _narrate(f"{endpoint.url}: {endpoint.problem or 'connected'}")
            problems[endpoint.url] = endpoint.problem
        if simulator.late > late and late == 0:
            late = simulator.late
            _narrate("this computer is too slow for the requested speed; simulated time falls behind")
        if simulator.is_off:
            _narrate("the autopilot was shut down")
            return
        if seconds is not None and simulator.now_s >= seconds:
            return


def _narrate(text: str, severity: Severity = Severity.INFO) -> None:
    narrate(f"sitl: {text}", severity)
