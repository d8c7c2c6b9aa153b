"""A build of the real PX4 with its own physics (SIH), and the programs of a user around it."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Self

from tests.commands.programs import Program, program

HOME: Final = {"LAT": "47.397742", "LON": "8.545594", "ALT": "488"}
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
        self,
        folder: Path,
        model: str = "sihsim_quadx",
        instance: int = 3,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        found = build_tree()
        assert found is not None, "no px4 of a build tree is on PATH: see docs/firmware.md"
        self._binary, self._root = found
        self.folder, self.instance, self._model = folder, instance, model
        self.said: Final = folder / "px4.txt"
        link = f"udpin://127.0.0.1:{14540 + instance}"
        self.autopilot: Final = ("--autopilot", link, "--system-id", str(instance + 1))
        self.station_port: Final = 14700 + 2 * instance
        self.other_link: Final = f"--station=udpin://127.0.0.1:{self.station_port + 50}"
        """Of the onboard process, for somebody else's station."""
        self._process: subprocess.Popen[bytes] | None = None
        self.write_mission(MISSION)
        lines = [f"param set {name} {value:g}\n" for name, value in (PARAMETERS | dict(parameters or {})).items()]
        (folder / "px4-rc.params").write_text("".join(lines))

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def write_mission(self, text: str, name: str = "mission.yaml") -> None:
        """What the station flies."""
        (self.folder / name).write_text(text)

    def start(self) -> None:
        """Starts it, and waits until it says that it is ready."""
        environment = {
            **os.environ,
            "PATH": os.pathsep.join([str(self.folder), str(self._root.parent / "bin"), os.environ["PATH"]]),
            "PX4_SIM_MODEL": self._model,
            "PX4_SIMULATOR": "sihsim",
            **{f"PX4_HOME_{name}": value for name, value in HOME.items()},
        }
        command = [str(self._binary), "-d", "-i", str(self.instance), "-w", str(self.folder), str(self._root)]
        with self.said.open("wb") as output:
            self._process = subprocess.Popen(
                command, cwd=self.folder, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        try:
            limit_s = time.monotonic() + READY_S
            while READY not in self.said.read_text(errors="replace"):
                assert self._process.poll() is None, self.said.read_text(errors="replace")
                assert time.monotonic() < limit_s, self.said.read_text(errors="replace")
                time.sleep(STEP_S)
        except BaseException:
            self.kill()
            raise

    def kill(self) -> None:
        """Ends it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def shell(self, command: str, *words: str) -> str:
        """Runs one of PX4's own commands; what it said."""
        tool = [str(self._binary.parent / f"px4-{command}"), "--instance", str(self.instance), *words]
        return subprocess.run(tool, check=True, capture_output=True, timeout=20.0, text=True).stdout

    def make_platform(self) -> str:
        """`gloc3 platform new`, with leave to arm."""
        words = ("platform", "new", "--yes", "--arm", "--name", PLATFORM, *self.autopilot)
        with program(*words, folder=self.folder) as new:
            assert new.end() == 0, new.text
        return (self.folder / f"{PLATFORM}.yaml").read_text()

    @contextmanager
    def onboard(self, *more: str, platform: str = f"{PLATFORM}.yaml") -> Iterator[Program]:
        """The onboard process, with links to two stations, which ends well."""
        links = [f"--station=udpout://127.0.0.1:{self.station_port + number}" for number in (0, 1)]
        with program(
            "onboard", platform, *self.autopilot, *links, *more, "--out", "out", folder=self.folder
        ) as running:
            yield running
            if running.process.poll() is None:
                running.interrupt()
                assert running.end() == 0, running.text

    @contextmanager
    def station(self, *more: str, mission: str = "mission.yaml") -> Iterator[Program]:
        """A station that flies the mission, and is told commands."""
        words = ["--headless", "--mission", mission, "--link", f"udpin://127.0.0.1:{self.station_port}", "--commands"]
        with program("station", *words, *more, folder=self.folder, is_told=True) as running:
            yield running

    @contextmanager
    def watcher(self) -> Iterator[Program]:
        """Another station, which commands nothing."""
        link = f"udpin://127.0.0.1:{self.station_port + 1}"
        with program("station", "--headless", "--link", link, "--station-id", "254", folder=self.folder) as running:
            yield running

    def fly(self) -> Program:
        """One mission, whole."""
        with self.station() as station:
            assert station.end() == 0, station.text
        return station


def under_way(station: Program, action: str = "go.way", after_s: float = 4.0) -> None:
    """Some seconds into the path."""
    station.await_line(lambda line: f"action {action}: running" in line, 180.0)
    time.sleep(after_s)
