"""`gloc3 onboard` as a process of its own, told to stop by SIGTERM while the vehicle flies on its setpoints."""

import signal
import socket
from pathlib import Path
from typing import Any

import pytest
from tests.commands.programs import Program, program

from gloc3.log.reader import LogReader
from gloc3.messages.vehicle import FlightMode
from gloc3_onboard.process.runner import STOP_PATIENCE_S
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets


def in_flight(sitl: Program, onboard: Program, station: Program) -> None:
    sitl.await_line(lambda line: "companion link" in line)
    onboard.await_line(lambda line: "components; log in" in line)
    station.await_line(lambda line: "mode Offboard" in line)


def logged(folder: Path, topic: str) -> list[tuple[float, Any]]:
    with LogReader(folder / "out" / "log.mcap") as reader:
        assert reader.is_finished
        return [(entry.envelope.t_s, entry.envelope.payload) for entry in reader.entries(topic)]


def test_hold_is_confirmed_before_the_process_ends(tmp_path: Path) -> None:
    companion, ground = free_ports(2, socket.SOCK_DGRAM)
    autopilot, received = f"udpin://127.0.0.1:{companion}", f"udpin://127.0.0.1:{ground}"
    links = ["--autopilot", autopilot, "--station", f"udpout://127.0.0.1:{ground}"]
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{companion}", folder=tmp_path) as sitl,
        program("onboard", "pelican_rtk", *links, "--out", "out", folder=tmp_path) as onboard,
        program("station", "--headless", "--mission", "hop", "--link", received, folder=tmp_path) as station,
    ):
        in_flight(sitl, onboard, station)
        onboard.interrupt(signal.SIGTERM)
        assert onboard.end() == 0, onboard.text
        text = onboard.lines[onboard.lines.index("onboard: stopping") + 1 :]
        for url in (autopilot, f"udpout://127.0.0.1:{ground}"):
            traffic = [line for line in text if line.startswith(f"onboard: {url}: in ")]
            assert len(traffic) == 1, f"what has passed each link, once: {onboard.text}"
        station.interrupt()
        assert station.end() == 130
        sitl.interrupt()
        assert sitl.end() == 0
    left_s = next(t_s for t_s, status in logged(tmp_path, "components/autopilot_driver/status") if status.state is None)
    states = logged(tmp_path, "autopilot")
    guided_s = max(t_s for t_s, state in states if state.mode is FlightMode.GUIDED)
    held_s = [t_s for t_s, state in states if state.mode is FlightMode.HOLD and guided_s < t_s <= left_s]
    assert held_s, "the driver left before the autopilot confirmed hold"
    assert states[-1][1].is_armed
    assert left_s - held_s[0] < STOP_PATIENCE_S, "it left because of that, not because its patience had ended"
