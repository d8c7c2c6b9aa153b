"""Runs real firmware on the simulated vehicle until it is stopped, as `gloc3 sitl --firmware` does."""

import asyncio
import signal
import tempfile
from collections.abc import Sequence
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Final

import msgspec

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3_sitl.firmware.ardupilot import ArduPilotBridge
from gloc3_sitl.firmware.body import BodySettings, SensedBody
from gloc3_sitl.firmware.hil_server import HilServer
from gloc3_sitl.firmware.json_server import JsonServer
from gloc3_sitl.firmware.kinds import FirmwareKind, FirmwareOptionsWanted, kind_named, start_program
from gloc3_sitl.firmware.program import FirmwareProcess, find_binary
from gloc3_sitl.firmware.px4 import Px4Bridge
from gloc3_sitl.flight.truth_log import TruthLog
from gloc3_sitl.vehicles.dvl_server import DvlAddress, DvlServer, exposure
from gloc3_sitl.vehicles.line_server import field_server
from gloc3_sitl.vehicles.sensor_server import SensorServer
from gloc3_sitl.world import World

EXIT_FAILED: Final = 1
TOO_SLOW: Final = "this computer is too slow or too busy for this speed: the flight repeatedly falls behind real time"
CATCHING_UP: Final = 4.0
"""Speed at which the firmware may catch up after a delay, as a multiple of the pace."""
SILENT_S: Final = 2.0
"""Wall time without a step after which a warning is printed, s."""
SLIPS: Final = 3
"""Number of slips before a warning: one or two happen at start."""
_POLL_PERIOD_S: Final = 0.1


class FirmwareOptions(msgspec.Struct, frozen=True, kw_only=True):
    """The options of `gloc3 sitl --firmware`."""

    firmware: str
    world: World
    body: BodySettings
    parameters: dict[str, float]
    links: Sequence[str]
    binary: Path | None = None
    is_running: bool = False
    """Whether the program is started externally."""
    port: int | None = None
    speed: float = 1.0
    seconds: float | None = None
    sensor_port: int | None = None
    dvl: DvlAddress | None = None
    field_port: int | None = None
    out: Path | None = None


async def run_firmware(options: FirmwareOptions) -> int:
    """Opens the servers, starts the firmware, and runs until a signal or its end.

    Raises:
        Refused: something cannot be had; the text says what.
    """
    kind = kind_named(options.firmware)
    vehicle = options.body.vehicle
    programs = kind.programs_for(vehicle)
    if options.is_running and (options.links or options.parameters or options.binary is not None):
        raise Refused(
            f"--firmware-running: {kind.title} keeps its own links and parameters; omit --link, --param and binary"
        )
    if options.body.is_plain_gps and not kind.uses_fixes:
        raise Refused(f"--plain-gps: {kind.title} simulates its own satellite receiver; see docs/firmware.md")
    binary = None if options.is_running else find_binary(programs, options.binary)
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    body = SensedBody(options.world, options.body, kind.rate_hz)
    server = _server(options, body, loop)
    async with AsyncExitStack() as stack:
        stack.push_async_callback(server.close)
        await server.open(kind.port if options.port is None else options.port)
        if options.sensor_port is not None:
            sensors = SensorServer(body, loop, options.body.seed)
            stack.push_async_callback(sensors.close)
            await sensors.open(options.sensor_port)
            _narrate(f"sensors tcp://127.0.0.1:{sensors.port}: {', '.join(sensors.feeds)}")
        if options.dvl is not None:
            dvl = DvlServer(body, loop, options.body.seed, options.dvl)
            stack.push_async_callback(dvl.close)
            _narrate(f"Doppler velocity log {(await dvl.open()).url}")
            if warning := exposure(options.dvl):
                _narrate(warning, Severity.WARNING)
        if options.field_port is not None:
            fields = field_server(body, loop, options.body.seed, options.field_port)
            stack.push_async_callback(fields.close)
            _narrate(f"fields {(await fields.open()).url}: {', '.join(options.world.file.fields)}")
        if options.out is not None:
            truth = TruthLog(body, loop, options.out, vehicle)
            stack.callback(truth.close)
        program = None
        if binary is not None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gloc3-firmware-")))
            if options.out is not None:
                folder = options.out.absolute() / "firmware"
                folder.mkdir(parents=True, exist_ok=True)
            program = _program(options, kind, binary, server.port, folder)
            stack.push_async_callback(program.stop)
            if kind.opens:
                _narrate(f"{kind.title} itself {kind.opens}; a firewall keeps a network out", Severity.WARNING)
            _narrate(f"{kind.title} {binary.name} started on simulated {vehicle}, world {options.world.name}")
        else:
            _narrate(f"waiting for {kind.title} on port {server.port}: {kind.by_hand.format(port=server.port)}")
        code = await _Watch(body, server, program, kind).until(stopped, options.seconds)
    _narrate(f"ended after {body.now_s:.1f} s of simulated time")
    return code


def _server(options: FirmwareOptions, body: SensedBody, loop: asyncio.AbstractEventLoop) -> JsonServer | HilServer:
    if options.firmware == "ardupilot":
        return JsonServer(ArduPilotBridge(body), loop, options.speed)
    return HilServer(Px4Bridge(body, Clock(loop).utc_offset_s + loop.time()), loop, options.speed)


def _program(options: FirmwareOptions, kind: FirmwareKind, binary: Path, port: int, folder: Path) -> FirmwareProcess:
    return start_program(
        kind,
        binary,
        FirmwareOptionsWanted(
            world=options.world,
            vehicle=options.body.vehicle,
            port=port,
            links=options.links or kind.links,
            speedup=CATCHING_UP * options.speed,
            is_without_gps=options.body.is_without_gps,
            parameters=options.parameters,
            folder=folder,
        ),
    )


class _Watch:
    """Narrates the state of the firmware."""

    def __init__(
        self, body: SensedBody, server: JsonServer | HilServer, program: FirmwareProcess | None, kind: FirmwareKind
    ) -> None:
        self._body, self._server, self._program = body, server, program
        self._title, self._problem = kind.title, kind.problem

    async def until(self, stopped: asyncio.Event, seconds: float | None) -> int:
        """Waits for a signal, the end of the firmware, or a duration; returns an exit code."""
        body, server, program = self._body, self._server, self._program
        loop = asyncio.get_running_loop()
        last_s, received_s, is_stepping, is_slow = body.now_s, loop.time(), False, False
        while not stopped.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(stopped.wait(), _POLL_PERIOD_S)
            if server.failure is not None:
                _narrate(str(server.failure))
                return EXIT_FAILED
            if program is not None and program.exit_code is not None:
                _narrate(f"{self._title} exited with code {program.exit_code}: {program.last_lines()}")
                return EXIT_FAILED
            if body.now_s < last_s:
                _narrate(f"{self._title} restarted: the vehicle is at home again and its time starts at 0")
            if body.now_s != last_s:
                if not is_stepping:
                    _narrate(f"{self._title} connected; it drives the simulated time")
                    if program is not None and (problem := self._problem(program.output())):
                        _narrate(f"{self._title}: {problem}")
                        return EXIT_FAILED
                last_s, received_s, is_stepping = body.now_s, loop.time(), True
            elif is_stepping and loop.time() - received_s > SILENT_S:
                is_stepping = False
                _narrate(f"{self._title} no longer responds: simulated time is stopped at {body.now_s:.1f} s")
            if server.slips >= SLIPS and not is_slow:
                is_slow = True
                _narrate(f"{TOO_SLOW}; see docs/firmware.md")
            if seconds is not None and body.now_s >= seconds:
                break
        return 0


def _narrate(text: str, severity: Severity = Severity.INFO) -> None:
    narrate(f"sitl: {text}", severity)
