"""MAVProxy, unmodified and in an environment of its own, through our router: at the autopilot, then at the companion."""

import os
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest
from tests.onboard.onboard_scene import LATITUDE_DEG, LONGITUDE_DEG, vehicle

from gloc3.log.reader import LogReader

PYTHON = os.environ.get("MAVPROXY_PYTHON", "")
pytestmark = [
    pytest.mark.sockets,
    pytest.mark.flight,
    pytest.mark.skipif(not PYTHON, reason="MAVPROXY_PYTHON does not name the Python of an environment with MAVProxy"),
]

WAIT_S = 30.0
WAYPOINTS = f"""QGC WPL 110
0 1 0 16 0 0 0 0 {LATITUDE_DEG} {LONGITUDE_DEG} 2 1
1 0 3 22 0 0 0 0 0 0 3 1
2 0 3 16 0 0 0 0 {LATITUDE_DEG + 3e-5} {LONGITUDE_DEG} 3 1
3 0 3 21 0 0 0 0 0 0 0 1
""".replace(" ", "\t").replace("QGC\tWPL\t110", "QGC WPL 110")


class Mavproxy:
    """A running MAVProxy, and what it has said."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.lines: list[str] = []
        self._process = process
        self._said = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def report(self, line: str) -> None:
        """Types a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def receive(self, text: str, is_it: Callable[[str], bool] = lambda _: True) -> str:
        """Waits for a line with a text, and takes away all up to it."""

        def find() -> int:
            return next((at for at, line in enumerate(self.lines) if text in line and is_it(line)), -1)

        with self._said:
            assert self._said.wait_for(lambda: find() >= 0, WAIT_S), f"no {text!r} in:\n" + "\n".join(self.lines)
            at = find()
            line, self.lines = self.lines[at], self.lines[at + 1 :]
            return line

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._said:
                self.lines.append(line.rstrip())
                self._said.notify_all()


@contextmanager
def mavproxy(port: int, folder: Path) -> Iterator[Mavproxy]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    process = subprocess.Popen(
        [
            *(PYTHON, str(Path(PYTHON).with_name("mavproxy.py")), f"--master=udpout:127.0.0.1:{port}"),
            *(f"--state-basedir={folder}", "--source-system=250", "--default-modules=link,cmdlong,mode,param,wp,arm"),
        ],
        cwd=folder,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield Mavproxy(process)
    finally:
        process.terminate()
        process.communicate(timeout=60)


def test_it_links_fetches_parameters_uploads_a_mission_and_changes_the_mode(tmp_path: Path) -> None:
    (tmp_path / "plan.txt").write_text(WAYPOINTS)
    with vehicle(tmp_path, style="ardupilot") as scene, mavproxy(scene.port, tmp_path) as proxy:
        proxy.receive("online system 1")
        count = int(proxy.receive("Received ", lambda line: "parameters" in line).split()[-2])
        assert count > 50
        proxy.report("wp load plan.txt")
        proxy.receive("MISSION_ACK: TYPE_MISSION: ACCEPTED")
        proxy.report("mode GUIDED")
        proxy.receive("COMMAND_ACK: DO_SET_MODE: ACCEPTED")
        proxy.receive("Mode GUIDED")

        proxy.report("set target_component 191")
        proxy.report("wp load plan.txt")
        proxy.receive("MISSION_ACK: TYPE_MISSION: ACCEPTED")
        proxy.report("wp list")
        proxy.receive("16 3 39.55283")
        proxy.report("param fetch")
        assert int(proxy.receive("Received ", lambda line: "parameters" in line).split()[-2]) != count
        proxy.report("param show FTP_WRITE")
        proxy.receive("FTP_WRITE        1.0")
        proxy.report("long 400 1")
        proxy.receive("COMPONENT_ARM_DISARM of station 250 refused: the onboard computer does not arm by command")
        proxy.report("long 300")
        proxy.receive("COMMAND_ACK: MISSION_START: ACCEPTED")
        proxy.report("set target_component 1")
        proxy.receive("ARMED")
        proxy.receive("DISARMED")
    with LogReader(scene.out / "log.mcap") as log:
        poses_s = [entry.envelope.t_s for entry in log.entries("pose")]
        states = [entry.envelope.payload.state for entry in log.entries("ci/mission")]
    assert states[-1] == "done"
    seldom = [late - early for early, late in pairwise(poses_s[40:]) if late - early > 0.4]
    assert not seldom, "it asks for all streams at 4 Hz every 15 seconds; those that we need do not suffer"
