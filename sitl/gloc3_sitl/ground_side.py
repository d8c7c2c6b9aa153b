"""A ground station at the other end of a flight's radio, as `gloc3 station` is one."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

from gloc3.exchange.mavlink import MavlinkExchange
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.happenings import Happening, Undelivered
from gloc3.exchange.tunnel.layout import Role
from gloc3.link.codec import Address, Encoder, Frame, MavlinkMessage, Parser
from gloc3.link.heartbeat import Heartbeat
from gloc3.topics import TopicTable
from gloc3_groundstation.station import Station

STATION_ID: Final = 255
STATION_COMPONENT: Final = 190


class GroundSide:
    """A station at the other end of the radio, as `gloc3 station` is one."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, topics: TopicTable, boot: int, system: int = STATION_ID
    ) -> None:
        own = Address(system, STATION_COMPONENT)
        self.own: Final = own
        self._listeners: list[Callable[[Frame], None]] = []
        self._encoder = Encoder(*own)
        self._parser = Parser(is_datagram=True)
        self._loop = loop
        self._endpoint: Any = None
        self.heartbeat = Heartbeat(own, vehicle_type=6)
        self.exchange = MavlinkExchange(TunnelEndpoint(Role.STATION, str(system), own, boot, topics), loop, self.send)
        self.station = Station(self.exchange, loop, str(system), boot)
        self.exchange.listen(self._happened)
        self._timer: asyncio.TimerHandle | None = None

    def open(self, endpoint: Any) -> None:
        """Begins to talk."""
        self._endpoint = endpoint
        endpoint.on_data = self._receive
        self._beat()

    def close(self) -> None:
        """Falls silent."""
        self.station.close()
        self.exchange.close()
        if self._timer is not None:
            self._timer.cancel()

    def _happened(self, happening: Happening) -> None:
        if isinstance(happening, Undelivered):
            self.station.client.undelivered(happening)

    def _beat(self) -> None:
        self.heartbeat.tick(self._loop.time())
        for message in self.heartbeat.outgoing():
            self.send(message)
        self._timer = self._loop.call_later(0.5, self._beat)

    def listen(self, listener: Callable[[Frame], None]) -> Callable[[], None]:
        """Is told every frame that is not of the command link, as services of the station are."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def forward(self, frame: Frame) -> None:
        """Sends a frame that was made in the station's name."""
        if self._endpoint is not None:
            self._endpoint.send(self._encoder.forward(frame))

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's."""
        if self._endpoint is not None:
            self._endpoint.send(self._encoder.encode(message))

    def _receive(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            message = frame.decode()
            if message is not None and message.name == "TUNNEL":
                self.exchange.receive(message, frame.sender)
            else:
                for listener in tuple(self._listeners):
                    listener(frame)
