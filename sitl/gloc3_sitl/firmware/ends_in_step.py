"""The physics of a firmware in lockstep, without an event loop: one step after the other, as far as they are asked for."""

import select
import socket
from collections.abc import Callable
from typing import Final

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3.errors import Gloc3Error, Refused
from gloc3_sitl.firmware import ardupilot, px4
from gloc3_sitl.firmware.ardupilot import ArduPilotBridge
from gloc3_sitl.firmware.body import SensedBody
from gloc3_sitl.firmware.hil_server import DEFAULT_PORT
from gloc3_sitl.firmware.json_server import newest
from gloc3_sitl.firmware.px4 import Px4Bridge

INSTANCES: Final = 10
COMPANION_PORT: Final = 14540
"""Where the first PX4 sends to companions."""
_LARGEST: Final = 4096

Await = Callable[[socket.socket], None]
"""Waits until a socket can be read; raises `Gloc3Error` where the firmware has ended, or says nothing."""


class JsonEnd:
    """ArduPilot's JSON interface.

    Args:
        body: the vehicle.
    """

    title: Final = "ArduPilot"
    rate_hz: Final = ardupilot.RATE_HZ

    def __init__(self, body: SensedBody) -> None:
        self._bridge: Final = ArduPilotBridge(body)
        self._physics: Final = _datagrams(0)
        self.line: Final = _datagrams(0)
        """The MAVLink link."""
        self.port: Final = int(self._physics.getsockname()[1])
        self.links: Final = (f"udpout://127.0.0.1:{self.line.getsockname()[1]}",)
        self.parameters: Final[dict[str, float]] = {}

    def advance(self, now_s: float, wait: Await) -> None:
        """Simulates up to a time."""
        until = int(now_s * self.rate_hz + 1e-6)
        while self._bridge.steps < until:
            wait(self._physics)
            for data, sender in newest(self._physics):
                answer = self._bridge.receive(data, sender)
                if answer is not None:
                    self._physics.sendto(answer, sender)

    def close(self) -> None:
        """Ends it."""
        self._physics.close()
        self.line.close()


class HilEnd:
    """PX4's simulator interface.

    While PX4 boots, which it does by our time and without answering, the steps come at the pace of the wall clock.

    Args:
        body: the vehicle.

    Raises:
        Refused: all its ports are in use.
    """

    title: Final = "PX4"
    rate_hz: Final = px4.RATE_HZ

    def __init__(self, body: SensedBody) -> None:
        self._bridge: Final = Px4Bridge(body, VIRTUAL_EPOCH_S)
        self._client: socket.socket | None = None
        self._listener, self.line = _free_instance()
        self.port: Final = int(self._listener.getsockname()[1])
        self.links: Final = ()
        self.parameters: Final = {"MAV_SYS_ID": 1.0}
        """Its number as a vehicle is that of its ports otherwise."""

    def advance(self, now_s: float, wait: Await) -> None:
        """Simulates up to a time.

        Raises:
            Gloc3Error: PX4 has closed the connection.
        """
        if self._client is None:
            wait(self._listener)
            self._client, _ = self._listener.accept()
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client, bridge = self._client, self._bridge
        until = int(now_s * self.rate_hz + 1e-6)
        while bridge.steps < until:
            if not bridge.is_due:
                wait(client)
                self._receive(client)
                continue
            client.sendall(bridge.step())
            if not bridge.is_in_step and select.select([client], [], [], 1.0 / self.rate_hz)[0]:
                self._receive(client)

    def _receive(self, client: socket.socket) -> None:
        data = client.recv(_LARGEST)
        if not data:
            raise Gloc3Error("PX4 has closed the connection")
        self._bridge.receive(data)

    def close(self) -> None:
        """Ends it."""
        for opened in (self._client, self._listener, self.line):
            if opened is not None:
                opened.close()


def _free_instance() -> tuple[socket.socket, socket.socket]:
    """The port for a PX4's simulator, and that for its link to companions, which its start script counts together."""
    for instance in range(INSTANCES):
        try:
            listener = socket.create_server(("127.0.0.1", DEFAULT_PORT + instance))
        except OSError:
            continue
        try:
            return listener, _datagrams(COMPANION_PORT + instance)
        except OSError:
            listener.close()
    raise Refused(f"all TCP ports from {DEFAULT_PORT} and UDP ports from {COMPANION_PORT} for PX4 are in use")


def _datagrams(port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", port))
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    return opened
