"""A vehicle's links as one: the best one carries what is sent, all of them what comes back.

A vehicle that is reached on several links, such as by its companion and by a telemetry radio of its own, answers on the
one that its autopilot or a router chooses, or on all of them.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from gloc3.errors import Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3_groundstation.services.machines import Wire

REMEMBERED: Final = 64
"""Frames among which the same one from another link is found."""

FrameKey = tuple[int, int, int, int, bytes]


class VehicleWire:
    """The links that lead to one vehicle; without any, nothing is sent."""

    def __init__(self) -> None:
        self._wires: tuple[Wire, ...] = ()
        self._unlisten: dict[Wire, Unsubscribe] = {}
        self._listeners: list[Callable[[Frame], None]] = []
        self._recent: deque[tuple[FrameKey, Wire]] = deque(maxlen=REMEMBERED)

    @property
    def best(self) -> Wire:
        """The link that carries what is sent.

        Raises:
            Refused: none is open.
        """
        if not self._wires:
            raise Refused("no link leads to this vehicle any more")
        return self._wires[0]

    @property
    def own(self) -> Address:
        """Address of the station there."""
        return self.best.own

    def use(self, wires: Sequence[Wire]) -> None:
        """Takes the links that lead to the vehicle now, the best one first."""
        for gone in [wire for wire in self._unlisten if wire not in wires]:
            self._unlisten.pop(gone)()
        for wire in wires:
            if wire not in self._unlisten:
                self._unlisten[wire] = wire.listen(partial(self._receive, wire))
        self._wires = tuple(wires)

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's by the best link."""
        if self._wires:
            self.best.send(message)

    def listen(self, listener: Callable[[Frame], None]) -> Unsubscribe:
        """Registers a listener for all frames of all links, each once."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def _receive(self, wire: Wire, frame: Frame) -> None:
        if len(self._wires) > 1 and self._is_known(wire, frame):
            return
        for listener in tuple(self._listeners):
            listener(frame)

    def _is_known(self, wire: Wire, frame: Frame) -> bool:
        """Whether another link has brought the same frame; signatures and the order of arrival may differ."""
        key = frame.system, frame.component, frame.sequence, frame.message_id, frame.payload
        if any(known == key and other is not wire for known, other in self._recent):
            return True
        self._recent.append((key, wire))
        return False
