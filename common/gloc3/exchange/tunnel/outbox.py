"""Chooses the next frame to send, and when: answers first, then by urgency.

The order: acknowledgements and refusals; hellos, requests for table rows and their answers; emergencies, and
repeats of the few short messages that are open; status, as far as its share goes; other requests and replies; large
messages; unrequested repeats; samples for viewers, as far as their share goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import MAX_ECHOES, TunnelFrame, TunnelHello, TunnelTable
from gloc3.exchange.tunnel.layout import DUTIES, Lane, TunnelRole
from gloc3.exchange.tunnel.pacing import Bucket, Pacer
from gloc3.exchange.tunnel.peers import Peer, TunnelPeers
from gloc3.exchange.tunnel.status import StatusSender
from gloc3.exchange.tunnel.table import OwnTable
from gloc3.mavlink.message import Address

EVERYBODY: Final = Address(0, 0)
HELLO_PERIOD_S: Final = {TunnelRole.STATION: 0.5, TunnelRole.PLATFORM: 1.0}
"""Period of hellos. A station sends two a second, because a silent one that holds control has lost the link."""
LONELY_PERIOD_S: Final = 0.5
"""Period of hellos while there is no live peer."""
HELLO_SPACING_S: Final = 0.25
BUSY_AFTER_S: Final = 3.0
"""So long after the last of a large message best effort keeps to its smaller share: often another one follows."""

VIEWS: Final = (Lane.VIEW,)

Chosen = tuple[Address, TunnelFrame, Bucket | None]
"""Receiver, frame, and the share of the line that it uses."""


class Outbox:
    """Outgoing messages of one end.

    Args:
        role: of this end.
        name: of this end.
        pacer: the link's budget.
        peers: the receivers, with the messages that wait for each.
        table: the numbers of this end.
        counters: where dropped messages are counted.
    """

    def __init__(
        self,
        role: TunnelRole,
        name: str,
        pacer: Pacer,
        peers: TunnelPeers,
        table: OwnTable,
        counters: Counters,
    ) -> None:
        self._role = role
        self._name = name
        self._pacer = pacer
        self._peers = peers
        self._table = table
        self.status: Final = StatusSender(counters)
        """Best-effort messages to all peers."""
        self.views: Final = StatusSender(counters)
        """Samples for viewers; sent after everything else."""
        self._hello_s = 0.0
        self._last_hello_s = -HELLO_SPACING_S
        self._turn = 0
        self._busy_until_s = 0.0
        self._view_turn = 0
        self.changes: list[int] = []
        """Rows of the table that have not been sent yet."""
        self.tokens: list[int] = []
        """Table numbers of this end's liveliness tokens."""

    def send_hello_soon(self) -> None:
        """Schedules this end's next hello as soon as the spacing allows."""
        self._hello_s = min(self._hello_s, self._last_hello_s + HELLO_SPACING_S)

    def next_s(self) -> float:
        """When there will be something to send."""
        line_s = self._pacer.line.open_s()
        times_s = [self._hello_s]
        if self.changes:
            return line_s
        if self.status.is_waiting:
            times_s.append(self._pacer.status.open_s())
        view_s = self._view_s()
        if view_s is not None:
            times_s.append(max(view_s, self._pacer.views.open_s()))
        for peer in self._peers:
            sender = peer.sender
            is_idle = sender.is_idle
            if peer.receiver.has_refusal or peer.wanted or (not is_idle and any(map(sender.has_work, DUTIES))):
                return line_s
            copy_s = None if is_idle or not peer.is_alive else sender.copy_s()
            times_s += [t_s for t_s in (peer.receiver.ack_s(), peer.request_s(), copy_s) if t_s is not None]
        return max(line_s, min(times_s))

    def _view_s(self) -> float | None:
        """Next time at which a sample for viewers can be sent, if its share allows; None without any."""
        if self.views.is_waiting or any(peer.sender.has_work(Lane.VIEW) for peer in self._peers):
            return 0.0
        times_s = [
            peer.sender.copy_s(VIEWS) for peer in self._peers if peer.is_alive and peer.sender.is_open(Lane.VIEW)
        ]
        return min((t_s for t_s in times_s if t_s is not None), default=None)

    def is_busy(self, now_s: float) -> bool:
        """Whether a large message is under way, or was within `BUSY_AFTER_S`."""
        if any(peer.sender.is_open(Lane.BULK) or peer.receiver.is_receiving_bulk(now_s) for peer in self._peers):
            self._busy_until_s = now_s + BUSY_AFTER_S
        return now_s < self._busy_until_s

    def choose(self, now_s: float) -> Chosen | None:
        """What leaves next."""
        first = self._answer(now_s) or self._introduce(now_s)
        if first is not None or all(peer.sender.is_idle for peer in self._peers):
            return first or self._best_effort() or self._view(now_s)
        return (
            self._data(Lane.URGENT, now_s)
            or self._copy(now_s, is_idle=False)
            or self._best_effort()
            or self._data(Lane.ORDINARY, now_s)
            or self._data(Lane.BULK, now_s)
            or self._copy(now_s, is_idle=True)
            or self._view(now_s)
        )

    def _answer(self, now_s: float) -> Chosen | None:
        for peer in self._peers:
            ack_s = peer.receiver.ack_s()
            if ack_s is not None and now_s >= ack_s:
                return peer.address, peer.receiver.ack(peer.boot, now_s), None
            refusal = peer.receiver.next_refusal(peer.boot)
            if refusal is not None:
                return peer.address, refusal, None
        return None

    def _introduce(self, now_s: float) -> Chosen | None:
        if now_s >= self._hello_s:
            is_lonely = not any(peer.is_alive for peer in self._peers)
            self._hello_s = now_s + (LONELY_PERIOD_S if is_lonely else HELLO_PERIOD_S[self._role])
            self._last_hello_s = now_s
            return EVERYBODY, self._hello(now_s), None
        if self.changes:
            return EVERYBODY, self._rows(self.changes), None
        for peer in self._peers:
            request_s = peer.request_s()
            if request_s is not None and now_s >= request_s:
                return peer.address, peer.request(now_s), None
            if peer.wanted:
                return peer.address, self._rows(peer.wanted), None
        return None

    def _hello(self, now_s: float) -> TunnelHello:
        alive = sorted((peer for peer in self._peers if peer.is_alive), key=lambda peer: -peer.received_s)
        echoes = [echo for peer in alive if (echo := peer.echo(now_s)) is not None][:MAX_ECHOES]
        return TunnelHello(
            self._role, self._name, len(self._table), round(now_s * 1000.0), tuple(echoes), tuple(self.tokens)
        )

    def _rows(self, numbers: list[int]) -> TunnelTable:
        rows, count = self._table.frame_of(numbers)
        del numbers[:count]
        return TunnelTable(rows)

    def _best_effort(self) -> Chosen | None:
        if not self._pacer.status.is_open:
            return None
        frame = self.status.next_frame()
        return None if frame is None else (EVERYBODY, frame, self._pacer.status)

    def _view(self, now_s: float) -> Chosen | None:
        """Large samples and small ones; where both wait, two frames of the large ones to one of the small."""
        share = self._pacer.views
        if not share.is_open:
            return None
        self._view_turn = (self._view_turn + 1) % 3
        frame = self.views.next_frame() if self._view_turn == 0 else None
        chosen = None if frame is not None else self._data(Lane.VIEW, now_s)
        if frame is None and chosen is None:
            frame = self.views.next_frame()
        if frame is not None:
            return EVERYBODY, frame, share
        chosen = chosen or self._copy(now_s, is_idle=True, lanes=VIEWS)
        return None if chosen is None else (chosen[0], chosen[1], share)

    def _data(self, lane: Lane, now_s: float) -> Chosen | None:
        for peer in self._in_turn():
            if peer.sender.has_work(lane):
                data = peer.sender.next_data(lane, now_s)
                if data is not None:
                    return peer.address, data, None
        return None

    def _copy(self, now_s: float, *, is_idle: bool, lanes: Sequence[Lane] = DUTIES) -> Chosen | None:
        for peer in self._in_turn():
            if peer.is_alive:
                data = peer.sender.next_copy(now_s, is_idle=is_idle, lanes=lanes)
                if data is not None:
                    return peer.address, data, None
        return None

    def _in_turn(self) -> list[Peer]:
        """The peers that wait for something, beginning with another one each time."""
        peers = [peer for peer in self._peers if not peer.sender.is_idle]
        if len(peers) < 2:
            return peers
        self._turn = (self._turn + 1) % len(peers)
        return peers[self._turn :] + peers[: self._turn]
