"""A build of the real PX4 with its own physics (SIH), and the programs of a user around it."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Final

from tests.commands.programs import Program, program
from tests.onboard.real_vehicle import station as station_on

from gloc3.messages.command_interface import Verb
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

HOME: Final = (47.397742, 8.545594, 488.0)
PLATFORM: Final = "heron"
PARAMETERS: Final = {"COM_OBL_RC_ACT": 5.0}
"""A vehicle without a transmitter holds when its companion is gone."""
READY: Final = "Ready for takeoff"
READY_S: Final = 90.0
STEP_S: Final = 0.1
MISSION: Final = """\
mission: a corner
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
on_restart: continue
tasks:
  depart: {actions: {climb: {take_off: {height_m: 3}}}}
  go: {after: [depart], actions: {way: {follow_waypoints: {waypoints_m: [[8, 0, 3], [8, 8, 3]], speed_m_s: 1.5}}}}
  recover: {after: [go], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


def build_tree() -> tuple[Path, Path] | None:
    """The program `px4` of a build tree on PATH, and its root file system; None where there is none."""
    found = shutil.which("px4")
    if found is None:
        return None
    binary = Path(found).resolve()
    root = binary.parent.parent / "etc"
    return (binary, root) if (root / "init.d-posix" / "rcS").is_file() else None


class RealPx4:
    """The firmware in a folder, a platform file that was made from it, and a mission.

    Args:
        folder: where it works.
        model: which of its vehicles.
        instance: shifts its ports.
        parameters: beside those that a vehicle without a transmitter needs.
    """

    def __init__(
        self, folder: Path, model: str = "sihsim_quadx", instance: int = 3, parameters: Mapping[str, float] | None = None
    ) -> None:
        found = build_tree()
        assert found is not None, "no px4 of a build tree is on PATH: see docs/firmware.md"
        self._binary, self._root = found
        self.folder, self.instance, self._model = folder, instance, model
        self.autopilot: Final = ("--autopilot", f"udpin://127.0.0.1:{14540 + instance}", "--system-id", str(instance + 1))
        self._station: Final = 14760 + 2 * instance
        self._process: subprocess.Popen[bytes] | None = None
        (folder / "mission.yaml").write_text(MISSION)
        lines = [f"param set {name} {value:g}\n" for name, value in (PARAMETERS | dict(parameters or {})).items()]
        (folder / "px4-rc.params").write_text("".join(lines))

    def __enter__(self) -> "RealPx4":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Starts it, and waits until it says that it is ready."""
        environment = {
            **os.environ,
            "PATH": os.pathsep.join([str(self.folder), str(self._root.parent / "bin"), os.environ["PATH"]]),
            "PX4_SIM_MODEL": self._model,
            "PX4_SIMULATOR": "sihsim",
            **{f"PX4_HOME_{name}": str(value) for name, value in zip(("LAT", "LON", "ALT"), HOME, strict=True)},
        }
        command = [str(self._binary), "-d", "-i", str(self.instance), "-w", str(self.folder), str(self._root)]
        said = self.folder / "px4.txt"
        with said.open("wb") as output:
            self._process = subprocess.Popen(command, cwd=self.folder, env=environment, stdout=output, stderr=output)
        try:
            limit_s = time.monotonic() + READY_S
            while READY not in said.read_text(errors="replace"):
                assert self._process.poll() is None, said.read_text(errors="replace")
                assert time.monotonic() < limit_s, said.read_text(errors="replace")
                time.sleep(STEP_S)
        except BaseException:
            self.kill()
            raise

    def kill(self) -> None:
        """Ends it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    @property
    def tool_names(self) -> list[str]:
        """PX4's own commands that can be run beside it."""
        return sorted(file.name.removeprefix("px4-") for file in self._binary.parent.glob("px4-*"))

    def shell(self, command: str, *words: str) -> str:
        """Runs one of PX4's own commands; what it said."""
        tool = [str(self._binary.parent / f"px4-{command}"), "--instance", str(self.instance), *words]
        done = subprocess.run(tool, check=True, capture_output=True, timeout=20.0, text=True)
        return done.stdout

    def make_platform(self) -> str:
        """`gloc3 platform new`, with leave to arm."""
        words = ("platform", "new", "--yes", "--arm", "--name", PLATFORM, *self.autopilot)
        with program(*words, folder=self.folder) as new:
            assert new.end() == 0, new.text
        return (self.folder / f"{PLATFORM}.yaml").read_text()

    @contextmanager
    def onboard(self, platform: str = f"{PLATFORM}.yaml", *more: str) -> Iterator[Program]:
        """The onboard process with links to two stations, which ends well."""
        links = [word for url in self.station_urls("udpout") for word in ("--station", url)]
        with program("onboard", platform, *self.autopilot, *links, *more, "--out", "out", folder=self.folder) as running:
            yield running
            if running.process.poll() is None:
                running.interrupt()
                assert running.end() == 0, running.text

    def station_urls(self, scheme: str) -> list[str]:
        """The links to the first and to the second station."""
        return [f"{scheme}://127.0.0.1:{self._station + number}" for number in (0, 1)]

    @contextmanager
    def station(self, *more: str) -> Iterator[Program]:
        """A station that flies the mission."""
        words = ("--headless", "--mission", "mission.yaml", "--link", self.station_urls("udpin")[0], *more)
        with program("station", *words, folder=self.folder) as running:
            yield running

    def fly(self) -> Program:
        """One mission, whole."""
        with self.station() as station:
            assert station.end() == 0, station.text
        return station

    @asynccontextmanager
    async def operator(self) -> AsyncIterator["Operator"]:
        """Another station, which takes control when it commands."""
        async with station_on(self.station_urls("udpin")[1], 254) as made:
            yield Operator(made)


class Operator:
    """Somebody at a second station."""

    def __init__(self, station: Station) -> None:
        self.station = station

    @property
    def known(self) -> PlatformSnapshot | None:
        """What is known of the platform."""
        return self.station.fleet.get(PLATFORM)

    @property
    def state(self) -> str:
        """The mission's state; empty while none is known."""
        mission = self.known.mission if self.known is not None else None
        return str(mission.value.state) if mission is not None else ""

    @property
    def speed_m_s(self) -> float:
        """The vehicle's speed; infinite while it is not known."""
        vehicle = self.known.vehicle if self.known is not None else None
        return float(vehicle.value.speed_m_s) if vehicle is not None else float("inf")

    async def take_control(self) -> None:
        """Has control from now on."""
        await self.station.client.request_control(PLATFORM, is_take_over=True)

    async def steer(self, verb: Verb, path: str = "") -> None:
        """Pauses, resumes, skips or aborts the mission, or a task or action of it."""
        await self.station.client.steer(PLATFORM, verb, path)


def under_way(station: Program) -> None:
    """Some seconds into the path."""
    station.await_line(lambda line: "action go.way: running" in line)
    time.sleep(4.0)


def line_with(running: Program, *words: str) -> str:
    """The last line that holds all the words, as an operator reads it; empty where there is none."""
    said = [line for line in running.lines if all(word in line for word in words)]
    return said[-1] if said else ""


__all__ = ["HOME", "MISSION", "PLATFORM", "Callable", "Operator", "RealPx4", "build_tree", "line_with", "signal", "under_way"]
