"""Stations on UDP, TCP and a serial line at once: each reaches the autopilot through one onboard process, in its own way."""

import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from tests.onboard.onboard_scene import vehicle
from tests.onboard.qgc_sequences import AUTOPILOT, COMPANION, Station
from tests.sitl.dronekit_client import GUIDED, Vehicle

from gloc3.log.reader import LogReader
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

ALT_HOLD, LAND, RADIO_SYSTEM, WAIT_S = 2, 9, 252, 60.0
WAYPOINT = dialect.MAV_CMD_NAV_WAYPOINT


class Radio:
    """What sits at the other end of a serial line, and all that it has heard by name and component."""

    def __init__(self, line: int) -> None:
        self.received: dict[tuple[str, int], Any] = {}
        self._line = line
        self._came = threading.Condition()
        self._codec = dialect.MAVLink(None, srcSystem=RADIO_SYSTEM, srcComponent=190)
        self._codec.robust_parsing = True
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def send(self, message: Any) -> None:
        os.write(self._line, message.pack(self._codec))

    def receive(self, name: str, component: int, **fields: Any) -> None:
        """Waits until the last message of a name from there has these fields."""

        def has_come() -> bool:
            message = self.received.get((name, component))
            return message is not None and all(getattr(message, field) == value for field, value in fields.items())

        with self._came:
            assert self._came.wait_for(has_come, WAIT_S), f"no such {name} of {component}"

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._line, 4096)
            except OSError:  # the line is closed
                return
            with self._came:
                for message in self._codec.parse_buffer(data) or ():
                    self.received[message.get_type(), message.get_srcComponent()] = message
                self._came.notify_all()


@contextmanager
def serial_line() -> Iterator[tuple[Radio, str]]:
    """A radio, and the name of the line to it."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield Radio(master), os.ttyname(slave)
    finally:
        os.close(slave)
        os.close(master)


def test_each_has_its_way_to_the_autopilot_while_one_of_them_flies(tmp_path: Path) -> None:
    (tcp,) = free_ports(1, socket.SOCK_STREAM)
    with serial_line() as (radio, device), ExitStack() as stack:
        links = ("--station", f"tcpin://127.0.0.1:{tcp}", "--station", f"serial://{device}:57600")
        scene = stack.enter_context(vehicle(tmp_path, *links, style="ardupilot"))
        dronekit = stack.enter_context(closing(Vehicle(tcp, WAIT_S)))
        qgc = stack.enter_context(closing(Station(scene.port)))
        dronekit.connect()
        dronekit.upload((dialect.MAV_CMD_NAV_TAKEOFF, 0.0, 3.0), (WAYPOINT, 5.0, 3.0))
        assert [item.command for item in dronekit.download()[1:]] == [dialect.MAV_CMD_NAV_TAKEOFF, WAYPOINT]
        assert set(qgc.parameters()) == {AUTOPILOT, COMPANION}
        assert qgc.command(AUTOPILOT, dialect.MAV_CMD_DO_SET_MODE, 1.0, ALT_HOLD) == 0
        dronekit.wait(lambda: dronekit.mode == ALT_HOLD)
        dronekit.arm_and_take_off(2.0)

        radio.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        radio.receive("HEARTBEAT", COMPANION)
        radio.send(dialect.MAVLink_param_request_read_message(1, AUTOPILOT, b"PILOT_SPD_UP", -1))
        radio.receive("PARAM_VALUE", AUTOPILOT, param_id="PILOT_SPD_UP")
        radio.receive("HEARTBEAT", AUTOPILOT, custom_mode=GUIDED)
        assert ("COMMAND_ACK", AUTOPILOT) not in radio.received, "what is for another does not use its line up"
        dronekit.set_mode(LAND)
        dronekit.wait(lambda: not dronekit.is_armed)
    with LogReader(scene.out / "log.mcap") as log:
        last = list(log.entries("computer"))[-1].envelope.payload
    assert len(last.links) == 4
    assert all(link.traffic.frames_in and link.traffic.frames_out for link in last.links)
