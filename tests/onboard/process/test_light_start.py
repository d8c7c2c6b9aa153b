"""What the process of a vehicle without cameras loads at its start, and what it needs of a small computer."""

import os
import socket
from collections.abc import Collection
from pathlib import Path
from typing import Final

import pytest
from tests.commands.programs import program

from gloc3.mavlink.codec import Parser, enums
from gloc3.mavlink.transport.endpoints import LOOPBACK

pytestmark = pytest.mark.sockets

UNUSED: Final = {
    "PIL": "pictures of a report",
    "cryptography": "a network's certificates: it is a member of none",
    "cv2": "vision",
    "filterpy": "pose fusion",
    "gloc3_groundstation": "another program",
    "gloc3_onboard.algorithms.scan_matching": "laser odometry",
    "gloc3_onboard.datasets": "recorded data as a sensor",
    "http": "downloads",
    "jsbsim": "the simulator",
    "matplotlib": "plots",
    "mavsdk": "vehicles without a companion",
    "pyarrow": "tables of a log",
    "rich": "pages of help",
    "scipy": "laser odometry and pose fusion",
    "textual": "the station's screens",
    "zenoh": "other processes: it is the only one",
}
"""Packages and what they are for, which `pelican_rtk` does not have."""
MOST_MB: Final = 95.0
FIRST_PROCESSOR_S: Final = 2.0
"""Processor time until the first heartbeat: four times what it takes where nothing else runs."""
MOST_PROCESSOR_S: Final = 2.5
"""Likewise until all components work."""


def test_a_vehicle_without_cameras_loads_only_what_it_uses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")  # the interpreter names each module that it imports
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind((LOOPBACK, 0))
        station.settimeout(60.0)
        links = ("--autopilot", "udpin://127.0.0.1:0", "--station", f"udpout://127.0.0.1:{station.getsockname()[1]}")
        with program("onboard", "pelican_rtk", *links, "--out", str(tmp_path / "out"), folder=tmp_path) as onboard:
            _await_heartbeat(station, range(enums.MAV_STATE_ACTIVE + 1))
            first_processor_s, _ = _usage(onboard.process.pid)
            _await_heartbeat(station, (enums.MAV_STATE_ACTIVE,))
            processor_s, memory_mb = _usage(onboard.process.pid)
            onboard.interrupt()
            assert onboard.end() == 0, onboard.text
    imported = {line.rpartition("|")[2].strip() for line in onboard.lines if line.startswith("import time:")}
    assert "gloc3_onboard.assembly" in imported
    assert {name for name in imported if any(f"{name}.".startswith(f"{unused}.") for unused in UNUSED)} == set()
    assert memory_mb < MOST_MB
    assert first_processor_s < FIRST_PROCESSOR_S
    assert processor_s < MOST_PROCESSOR_S


def _await_heartbeat(station: socket.socket, states: Collection[int]) -> None:
    """Waits for a heartbeat of the companion with one of these states; active means that all of its components work."""
    parser = Parser(is_datagram=True)
    while True:
        messages = [frame.decode() for frame in parser.receive(station.recv(4096))]
        if any(said is not None and said.name == "HEARTBEAT" and said.system_status in states for said in messages):
            return


def _usage(pid: int) -> tuple[float, float]:
    """Processor seconds and resident megabytes of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    processor_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return processor_s, pages * os.sysconf("SC_PAGE_SIZE") / 1e6
