"""Puts a node on a link in tests: bytes in, bytes out, and woken when one of its services wants to be."""

from __future__ import annotations

from collections.abc import Callable

from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.transport.memory import Scheduler


class NodeRunner:
    """Runs one node on one link, in wall or virtual time.

    Args:
        node: what is run.
        loop: gives the time and wakes it.
        send: takes the frames that go out.
        is_datagram: whether what is heard comes as whole datagrams.
        after: called with the time after each message and tick, before what the services send is collected; here the
            program around them drains their events and answers.
    """

    def __init__(
        self,
        node: MavlinkComponent,
        loop: Scheduler,
        send: Callable[[bytes], None],
        *,
        is_datagram: bool = True,
        after: Callable[[float], None] | None = None,
    ) -> None:
        self.node = node
        self.after = after
        self.encoder = Encoder(*node.own)
        self.parser = Parser(is_datagram=is_datagram)
        self._loop = loop
        self._send = send
        self._wake_s: float | None = None
        self._is_running = True

    def on_data(self, data: bytes) -> None:
        """Takes in what came over the link."""
        if not self._is_running:
            return
        for frame in self.parser.receive(data):
            self.node.receive(frame, self._loop.time())
        self.settle()

    def settle(self) -> None:
        """Sends what is to be sent and sets the alarm; to be called after a service was used from outside."""
        now_s = self._loop.time()
        if self.after is not None:
            self.after(now_s)
        for message in self.node.outgoing():
            self._send(self.encoder.encode(message))
        next_s = self.node.next_tick_s()
        if next_s is not None and (self._wake_s is None or next_s < self._wake_s):
            self._wake_s = max(next_s, now_s)
            self._loop.call_at(self._wake_s, self._tick, self._wake_s)

    def stop(self) -> None:
        """Neither hears nor sends from now on."""
        self._is_running = False

    def _tick(self, wake_s: float) -> None:
        if wake_s != self._wake_s or not self._is_running:
            return  # an alarm that an earlier one has made useless
        self._wake_s = None
        self.node.tick(self._loop.time())
        self.settle()
