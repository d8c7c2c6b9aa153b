"""Runs simulated vehicle, onboard process and ground station as three real processes over UDP on loopback."""

import asyncio
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Gloc3Error
from gloc3.exchange import LocalExchange
from gloc3.log.reader import LogReader, find_log
from gloc3.log.report.plot import plot_path
from gloc3.mission.model.model import Mission
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Platform
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.flight.mission_file import (
    FlightSite,
    FlyableMission,
    is_without_satellites,
    place_for,
    read_mission_file,
)
from gloc3_sitl.flight.outputs import recreate
from gloc3_sitl.flight.path_error import TruthSample
from gloc3_sitl.flight.report import as_json, as_lines, judge_within
from gloc3_sitl.flight.sim_rig import SIM_DEVICES
from gloc3_sitl.flight.watch import FlightWatch
from gloc3_sitl.vehicles.table import vehicle_of

STOP_S: Final = 15.0
"""Time allowed for a process to stop, s; the onboard process secures the vehicle first."""
READY_S: Final = 30.0
POLL_PERIOD_S: Final = 0.05
LAST_LINES: Final = 5
EXIT_FAILED: Final = 1
EXIT_INTERRUPTED: Final = 128 + signal.SIGINT
NOT_SERVED: Final = ("estimator", "lidar")
"""Simulated devices of flights in virtual time alone."""
DVL: Final = "dvl"
PATIENCE: Final = 3.0
"""Multiple of the estimated duration (plus two minutes) after which an unattended flight is aborted."""


PX4_COMPANION_PORT: Final = 14540
"""Where a real PX4 sends to companions."""


class DemoProcess:
    """A process that runs `gloc3 ARGUMENTS`."""

    def __init__(self, name: str, out: Path) -> None:
        self.name = name
        self._file = out / f"{name}.txt"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self, arguments: Sequence[str]) -> None:
        """Starts it out of reach of the terminal's Ctrl-C, with its output in the file."""
        with self._file.open("wb") as file:
            self._process = await asyncio.create_subprocess_exec(
                *_command(arguments),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )

    async def show(self, arguments: Sequence[str], *, is_interactive: bool) -> None:
        """Starts it on this process's output and, if interactive, on the terminal's input."""
        self._process = await asyncio.create_subprocess_exec(
            *_command(arguments),
            stdin=None if is_interactive else asyncio.subprocess.DEVNULL,
            start_new_session=not is_interactive,
        )

    async def wait(self) -> int:
        """Waits for its end."""
        assert self._process is not None
        return await self._process.wait()

    @property
    def is_running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self._process is not None and self._process.returncode is None

    async def await_line(self, text: str) -> str:
        """Waits for a line of its output.

        Raises:
            Gloc3Error: it ended first, or took too long; with its last words.
        """
        for _ in range(round(READY_S / POLL_PERIOD_S)):
            is_running = self.is_running
            for line in self._file.read_text(errors="replace").splitlines():
                if text in line:
                    return line
            if not is_running:
                break
            await asyncio.sleep(POLL_PERIOD_S)
        raise Gloc3Error(f"{self.name} did not start: {self.last_lines()}")

    def last_lines(self) -> str:
        """Returns the last lines of its output."""
        lines = self._file.read_text(errors="replace").splitlines() if self._file.exists() else []
        return "\n".join(lines[-LAST_LINES:]) or "no output"

    async def stop(self) -> None:
        """Terminates it, and kills it if it does not end in time; while still loading it ends at once."""
        process = self._process
        if process is None:
            return
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(STOP_S):
                await process.wait()
        except TimeoutError:
            self.kill()
            await process.wait()

    def kill(self) -> None:
        """Kills it."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()


def _command(arguments: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "gloc3", *arguments]


class DemoOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of the demonstration."""

    mission: Path
    """A file of any format."""
    out: Path
    platform: str = "pelican_rtk"
    autopilot: str = "px4"
    """Style of the simulated autopilot, or the name of the real firmware."""
    is_firmware: bool = False
    is_headless: bool = False


async def run_demo(options: DemoOptions, platform: Platform) -> int:
    """Flies the mission and writes the report; the exit code is the ground station's.

    Args:
        options: mission, vehicle and output.
        platform: the platform file.

    Raises:
        InputError: the mission may not fly.
        Gloc3Error: the folder cannot be created, or a process did not start.
    """
    begin_s = Clock.cost_s()
    recreate(options.out)
    mission = read_mission_file(options.mission, platform, options.out)
    for warning in mission.warnings:
        narrate(str(warning))
    demo = Demo(options, platform, mission)
    loop = asyncio.get_running_loop()
    flying = loop.create_task(demo.fly())
    presses = 0

    def interrupt() -> None:
        nonlocal presses
        presses += 1
        if presses == 1:
            if options.is_headless:
                narrate("gloc3 demo: interrupted; ending the processes")
            flying.cancel()
        else:
            demo.kill()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, interrupt)
    try:
        code = await flying
    except asyncio.CancelledError:
        code = EXIT_INTERRUPTED
    finally:
        await demo.stop()
    _report(options, mission.mission, platform.limits, Clock.cost_s() - begin_s)
    return code


class Demo:
    """The three processes."""

    def __init__(self, options: DemoOptions, platform: Platform, mission: FlyableMission) -> None:
        self._options, self._name, self._mission = options, platform.platform, mission
        self._platform = platform
        self._vehicle, self._onboard, self._station = (
            DemoProcess(name, options.out) for name in ("sitl", "onboard", "station")
        )

    async def fly(self) -> int:
        """Flies the mission; returns the ground station's exit code.

        Raises:
            Gloc3Error: a process did not start.
        """
        options, vehicle, onboard = self._options, self._vehicle, self._onboard
        to_companion, to_station = free_ports(2, socket.SOCK_DGRAM)
        link = ["--link", f"companion=udpout://127.0.0.1:{to_companion}"]
        if options.is_firmware and options.autopilot == "px4":  # whose start script opens its links
            to_companion, link = PX4_COMPANION_PORT, []
        sensors, dvl = free_ports(2, socket.SOCK_STREAM)
        kind = vehicle_of(self._platform)
        has_dvl = DVL in _used(self._platform)
        await vehicle.start(
            [
                *("sitl", "--vehicle", kind),
                *_place(place_for(self._mission.mission, self._platform, kind, self._mission.home)),
                *(["--dvl", f"a50://127.0.0.1:{dvl}"] if has_dvl else []),
                *(["--no-gps"] if is_without_satellites(self._platform) else []),
                *("--firmware" if options.is_firmware else "--autopilot", options.autopilot),
                *link,
                *("--sensors", str(sensors)),
                *("--out", str(options.out)),
            ]
        )
        await onboard.start(
            [
                *("onboard", options.platform),
                *("--autopilot", f"udpin://127.0.0.1:{to_companion}"),
                *("--station", f"udpout://127.0.0.1:{to_station}"),
                *(word for device in sensed(self._platform, sensors, dvl) for word in ("--device", device)),
                *("--out", str(options.out)),
            ]
        )
        await vehicle.await_line("sensors tcp")
        await onboard.await_line("components")
        received = [
            *("--link", f"udpin://127.0.0.1:{to_station}"),
            *("--mission", self._mission.file),
            *("--platform", self._name),
            "--no-record",
        ]
        mode = ["--headless"] if options.is_headless else ["--start", "--exit-when-done"]
        await self._station.show(["station", *mode, *received], is_interactive=not options.is_headless)
        return await self._end()

    async def _end(self) -> int:
        """Waits for the station to end; aborts a flight that can no longer end."""
        ends = {asyncio.ensure_future(child.wait()): child for child in (self._station, self._onboard, self._vehicle)}
        limit_s = PATIENCE * self._mission.duration_s + 120.0 if self._options.is_headless else None
        done, pending = await asyncio.wait(ends, timeout=limit_s, return_when=asyncio.FIRST_COMPLETED)
        for other in pending:
            other.cancel()
        for end in done:
            if ends[end] is self._station:
                return end.result()
            narrate(f"gloc3 demo: {ends[end].name} ended unexpectedly: {ends[end].last_lines()}")
        if not done:
            narrate(f"gloc3 demo: not ended within {limit_s:.0f} s")
        return EXIT_FAILED

    async def stop(self) -> None:
        """Stops all processes, the vehicle last."""
        for child in (self._station, self._onboard, self._vehicle):
            await child.stop()

    def kill(self) -> None:
        """Kills all processes."""
        for child in (self._station, self._onboard, self._vehicle):
            child.kill()


def free_ports(count: int, kind: socket.SocketKind) -> list[int]:
    """Returns free ports on loopback."""
    sockets = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    for opened in sockets:
        opened.bind(("127.0.0.1", 0))
    ports = [int(opened.getsockname()[1]) for opened in sockets]
    for opened in sockets:
        opened.close()
    return ports


def sensed(platform: Platform, port: int, dvl_port: int) -> list[str]:
    """Returns the URLs of the platform's simulated sensors, as NAME=URL.

    Args:
        platform: the platform file.
        port: port of the simulated cameras and laser scanner.
        dvl_port: port of the simulated Doppler velocity log.
    """
    used = _used(platform)
    places = dict.fromkeys(SIM_DEVICES, f"tcp://127.0.0.1:{port}")
    places |= {"imu": "autopilot://", DVL: f"a50://127.0.0.1:{dvl_port}", **dict.fromkeys(NOT_SERVED, "none://")}
    return [f"{name}={place}" for name, place in places.items() if name in used]


def _used(platform: Platform) -> set[str]:
    return {device for row in platform.components for device in row.devices.values()}


def _place(place: FlightSite) -> list[str]:
    """The place as the options of `gloc3 sitl`."""
    if place.home is None:
        return ["--world", place.world]
    home, heading = place.home, place.heading_deg or 0.0
    where = f"{home.latitude_deg:.8f},{home.longitude_deg:.8f},{home.altitude_m:.2f},{heading:.2f}"
    return ["--world", place.world, f"--home={where}"]


def _report(options: DemoOptions, mission: Mission, limits: Limits, total_s: float) -> None:
    """Writes the report from the logs, as far as there are any."""
    try:
        lines = write_report(options.out, mission, limits, options.autopilot, total_s)
    except Gloc3Error as error:
        narrate(f"gloc3 demo: no report, because there was no flight: {error}")
        return
    print("\n".join(lines))  # noqa: T201


def write_report(out: Path, mission: Mission, limits: Limits, autopilot: str, total_s: float) -> list[str]:
    """Writes `report.json` and `path.svg`; returns the readable summary.

    Raises:
        InputError: a log is missing, or is none.
    """
    exchange = LocalExchange()
    with LogReader(find_log(out)) as reader:
        watch = FlightWatch(exchange, reader.platform, mission.name, autopilot)
        last_s = 0.0
        for entry in reader.entries():
            last_s = entry.envelope.t_s
            if not isinstance(entry.envelope.payload, dict):
                exchange.publish(entry.envelope)
        watch.land(last_s)
    with LogReader(out / "truth.mcap") as reader:
        samples = [
            TruthSample(entry.envelope.t_s, entry.envelope.payload.position_ned_m)
            for entry in reader.entries("sim/truth")
            if isinstance(entry.envelope.payload, SimTruth)
        ]
    report = watch.report
    if report.mission_state in ("waiting", "running", "paused"):
        report.reason = f"interrupted while it was {report.mission_state}"
        report.mission_state = "aborted"
    judge_within(limits, report, samples, watch.path.flights)
    report.wall = {"total_s": round(total_s, 3), "real_time_factor": 1.0}
    (out / "report.json").write_bytes(as_json(report))
    flown = [sample.position_ned_m for sample in samples]
    home = flown[0] if flown else None
    plot_path(flown, watch.path.points_ned_m, out / "path.svg", home=home, fence=mission.fence, title=mission.name)
    kept = "log.mcap, truth.mcap, report.json, path.svg" + (", images" if report.images else "")
    return [*as_lines(report), f"  kept     {kept} in {out}"]
