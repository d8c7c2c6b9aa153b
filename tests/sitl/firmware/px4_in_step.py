"""PX4 in lock-step at the autopilot's end of a cable in virtual time: bridge and peer on a real TCP connection.

Whoever waits for the other does so without the time going on, as in a simulation that is held up.
"""

import socket
from typing import Final

from tests.sitl.firmware.embedded_px4 import EmbeddedPx4
from tests.sitl.firmware.px4_peer import Px4Peer

from gloc3.clock import VIRTUAL_EPOCH_S, VirtualLoop
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.firmware.body import BodySettings, SensedBody
from gloc3_sitl.firmware.px4 import RATE_HZ, Px4Bridge
from gloc3_sitl.world import World

PERIOD_S: Final = 0.02
TIMEOUT_S: Final = 10.0


class Px4InStep:
    """One vehicle whose PX4 can be held up, switched off and on again.

    Args:
        loop: virtual time.
        end: of the MAVLink cable.
        origin: where on Earth it stands.
        parameters: of the autopilot, that differ from its defaults.
    """

    def __init__(
        self, loop: VirtualLoop, end: MemoryEnd, origin: tuple[float, float, float], parameters: dict[str, int]
    ) -> None:
        self.is_held_up = False
        """It reads nothing, and answers nothing."""
        self.body: Final = SensedBody(World.load("open", GeoPoint(*origin), 0.0), BodySettings(), RATE_HZ)
        self.bridge: Final = Px4Bridge(self.body, VIRTUAL_EPOCH_S)
        self.flights = 0
        """Times that it was switched on."""
        self._loop, self._end, self._parameters = loop, end, parameters
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._is_on = False
        self.switch_on()
        loop.call_later(PERIOD_S, self._turn)

    def switch_on(self) -> None:
        """Starts its program: it connects to the bridge."""
        self.flights += 1
        self.autopilot = EmbeddedPx4(self._end.send)
        for name, value in self._parameters.items():
            self.autopilot.autopilot.parameters.set(name, value)
        self._end.on_data = self.autopilot.receive
        self.peer = Px4Peer(control=self.autopilot)
        self._px4 = socket.create_connection(self._listener.getsockname(), TIMEOUT_S)
        self._ours, _ = self._listener.accept()
        for end in (self._px4, self._ours):
            end.settimeout(TIMEOUT_S)
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.bridge.connected()
        self._px4.sendall(self.peer.send_hello())
        self.bridge.receive(self._ours.recv(4096))
        self._begin_s = self._loop.time()
        self._is_on = True

    def switch_off(self) -> None:
        """Its program ends at once: the connection with it."""
        self._is_on = False
        self._end.on_data = None
        self._px4.close()
        self._ours.close()

    def close(self) -> None:
        """Ends everything."""
        self.switch_off()
        self._listener.close()

    def _turn(self) -> None:
        if self._is_on and not self.is_held_up:
            until_s = self._loop.time() - self._begin_s
            while self.bridge.now_s < until_s - 1e-9:
                self._step()
        self._loop.call_later(PERIOD_S, self._turn)

    def _step(self) -> None:
        bridge, peer = self.bridge, self.peer
        self._ours.sendall(bridge.step())
        while peer.now_us < round(bridge.now_s * 1e6):
            self._px4.sendall(peer.take(self._px4.recv(4096)))
        while bridge.answers < peer.answered:
            bridge.receive(self._ours.recv(4096))
