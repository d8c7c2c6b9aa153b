"""The main job: simulated vehicle, onboard process and ground station as three real processes over UDP on loopback."""

import asyncio
import shutil
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.errors import Gloc3Error
from gloc3.mission.checker import Circumstances, check_file
from gloc3.mission.model import Mission
from gloc3.platform import load_platform
from gloc3_sitl.earth import as_yaml, home_of

STOP_S: Final = 10.0
READY_S: Final = 30.0


class DemoOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What the demonstration flies."""

    mission: str
    out: Path
    platform: str = "pelican"
    autopilot: str = "px4"
    is_headless: bool = False


class Child:
    """One of the processes, with its output in a file of its own."""

    def __init__(self, name: str, out: Path) -> None:
        self.name = name
        self._log = out / f"{name}.txt"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self, arguments: Sequence[str], *, is_shown: bool = False) -> None:
        """Starts `gloc3 ARGUMENTS`; what it says goes to the file, or to this terminal."""
        command = [sys.executable, "-m", "gloc3", *arguments]
        if is_shown:
            self._process = await asyncio.create_subprocess_exec(*command)
            return
        with self._log.open("wb") as file:
            self._process = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True
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
        """Waits until it has said something.

        Raises:
            Gloc3Error: it ended first, or took too long; with its last words.
        """
        for _ in range(round(READY_S / 0.1)):
            said = self._log.read_text(errors="replace")
            for line in said.splitlines():
                if text in line:
                    return line
            if not self.is_running:
                break
            await asyncio.sleep(0.1)
        raise Gloc3Error(f"{self.name} did not start: {self.last_words() or 'it said nothing'}")

    def last_words(self) -> str:
        """The last lines that it has said."""
        return "\n".join(self._log.read_text(errors="replace").splitlines()[-5:])

    async def stop(self) -> None:
        """Ends it: asks first, then does not ask."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        process.send_signal(signal.SIGINT)
        try:
            async with asyncio.timeout(STOP_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


def free_udp_ports(count: int) -> list[int]:
    """UDP ports on loopback that nobody has."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for opened in sockets:
        opened.bind(("127.0.0.1", 0))
    ports = [int(opened.getsockname()[1]) for opened in sockets]
    for opened in sockets:
        opened.close()
    return ports


async def run_demo(options: DemoOptions) -> int:
    """Flies the mission; the exit code is the ground station's.

    Raises:
        InputError: the mission may not fly.
        Gloc3Error: a process did not start.
    """
    begin_s = Clock.cost_s()
    platform = load_platform(options.platform)
    if options.out.exists():
        shutil.rmtree(options.out)
    options.out.mkdir(parents=True)
    name = as_yaml(options.mission, platform.limits.speed_m_s, options.out)
    mission = check_file(name, Circumstances(platform=platform)).flyable()
    vehicle, onboard, station = (Child(name, options.out) for name in ("sitl", "onboard", "station"))
    to_companion, to_station = free_udp_ports(2)
    try:
        await vehicle.start(
            [
                "sitl",
                *_place(mission),
                *("--autopilot", options.autopilot),
                *("--link", f"companion=udpout://127.0.0.1:{to_companion}"),
                *("--camera", "0"),
                *("--out", str(options.out)),
            ]
        )
        camera = (await vehicle.await_line("ground camera")).rpartition(" ")[2]
        await onboard.start(
            [
                *("onboard", options.platform),
                *("--autopilot", f"udpin://127.0.0.1:{to_companion}"),
                *("--station", f"udpout://127.0.0.1:{to_station}"),
                *("--camera", f"ground={camera}"),
                *("--out", str(options.out)),
            ]
        )
        await onboard.await_line("components")
        heard = [
            "--link",
            f"udpin://127.0.0.1:{to_station}",
            "--mission",
            options.mission,
            "--platform",
            options.platform,
        ]
        if options.is_headless:
            await station.start(["station", "--headless", *heard], is_shown=True)
        else:
            await station.start(["station", "--start", "--exit-when-done", *heard], is_shown=True)
        code = await station.wait()
    finally:
        await station.stop()
        await onboard.stop()
        await vehicle.stop()
    from gloc3_sitl.demo_report import write_report

    for line in write_report(options.out, mission, options.autopilot, Clock.cost_s() - begin_s):
        print(line)  # noqa: T201
    return code


def _place(mission: Mission) -> list[str]:
    """The world for a mission: the hold, or open ground at its own place on Earth."""
    if mission.frame != "geo":
        return ["--world", "hold"]
    home = home_of(mission)
    return ["--world", "open", f"--home={home.latitude_deg:.8f},{home.longitude_deg:.8f},{home.altitude_m:.2f},0"]
