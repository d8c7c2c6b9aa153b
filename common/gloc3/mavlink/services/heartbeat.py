"""HEARTBEAT: sends ours, and tracks which components are alive, are autopilots, or have restarted."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, Never

import msgspec

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice

PERIOD_S: Final = 1.0
EXPIRES_AFTER_S: Final = 4.5
"""Silence after which a peer counts as lost, s: four missed heartbeats, and half a one for latency."""
MOST_PEERS: Final = 64
AUTOPILOT_LATCH_S: Final = 3.0
"""So long the first autopilot must have been the only one before it is taken for the vehicle's."""
AUTOPILOT_INVALID: Final = 8
"""MAV_AUTOPILOT of everything that is not an autopilot."""
GROUND_STATION: Final = 6
"""MAV_TYPE_GCS."""
ARMED: Final = 128
"""MAV_MODE_FLAG_SAFETY_ARMED, of `base_mode`."""
_MAVLINK_VERSION: Final = 3


class Heartbeat(Microservice[Never]):
    """Sends our heartbeat once a second while it is ticked: it stops when the loop that it vouches for is stuck."""

    def __init__(
        self, own: Address, *, vehicle_type: int, autopilot: int = AUTOPILOT_INVALID, period_s: float = PERIOD_S
    ) -> None:
        super().__init__(own)
        self.vehicle_type = vehicle_type
        """MAV_TYPE."""
        self.autopilot = autopilot
        """MAV_AUTOPILOT."""
        self.base_mode = 0
        """MAV_MODE_FLAG bits."""
        self.custom_mode = 0
        self.system_status = 0
        """MAV_STATE."""
        self._period_s = period_s
        self._next_s = 0.0

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Nothing: it only sends."""

    def send_now(self) -> None:
        """Sends the next heartbeat at the next tick, because its contents have changed."""
        self._next_s = 0.0

    def tick(self, now_s: float) -> None:
        """Sends a heartbeat when it is time; late ones are not made up for."""
        if now_s < self._next_s:
            return
        self._next_s = max(self._next_s + self._period_s, now_s + self._period_s / 2)
        self._outgoing.append(self.message())

    def message(self) -> MavlinkMessage:
        """A current heartbeat."""
        return make(
            "HEARTBEAT",
            type=self.vehicle_type,
            autopilot=self.autopilot,
            base_mode=self.base_mode,
            custom_mode=self.custom_mode,
            system_status=self.system_status,
            mavlink_version=_MAVLINK_VERSION,
        )

    def next_tick_s(self) -> float | None:
        """When the next heartbeat is due."""
        return self._next_s


class PeerChange(StrEnum):
    """Changes of a peer."""

    APPEARED = "appeared"
    LOST = "gone"
    RETURNED = "returned"
    RESTARTED = "restarted"


class MavlinkPeer:
    """Another component on the link, from its heartbeats."""

    __slots__ = ("address", "boot_ms", "first_s", "heartbeat", "is_alive", "last_s")

    def __init__(self, address: Address, heartbeat: MavlinkMessage, now_s: float) -> None:
        self.address = address
        self.heartbeat = heartbeat
        """The last one."""
        self.first_s = self.last_s = now_s
        """Times of its first and last heartbeat."""
        self.is_alive = True
        self.boot_ms = 0
        """Its last reported time since boot (SYSTEM_TIME)."""

    @property
    def is_autopilot(self) -> bool:
        """Whether it is an autopilot, by its heartbeat, never by its id."""
        return bool(self.heartbeat.autopilot != AUTOPILOT_INVALID)


class PeerEvent(msgspec.Struct, frozen=True):
    """A change of a peer's presence."""

    change: PeerChange
    peer: MavlinkPeer


class MavlinkPeers(Microservice[PeerEvent]):
    """Peers by their heartbeats, with a bound on how many are kept."""

    handles = frozenset({"HEARTBEAT", "SYSTEM_TIME"})

    def __init__(self, own: Address, *, expires_after_s: float = EXPIRES_AFTER_S) -> None:
        super().__init__(own)
        self.refused = 0
        """Heartbeats of components for which there was no room."""
        self._expires_after_s = expires_after_s
        self._peers: dict[Address, MavlinkPeer] = {}

    def __getitem__(self, address: Address) -> MavlinkPeer:
        return self._peers[address]

    def __contains__(self, address: Address) -> bool:
        return address in self._peers

    @property
    def alive(self) -> list[MavlinkPeer]:
        """Live peers, in order of first contact."""
        return [peer for peer in self._peers.values() if peer.is_alive]

    @property
    def autopilots(self) -> list[MavlinkPeer]:
        """The autopilots that are there now."""
        return [peer for peer in self.alive if peer.is_autopilot]

    def autopilot(self, now_s: float) -> MavlinkPeer | None:
        """The autopilot, once one has been there alone for some seconds; None while there is none, or a choice."""
        found = self.autopilots
        return found[0] if len(found) == 1 and now_s - found[0].first_s >= AUTOPILOT_LATCH_S else None

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a heartbeat, or a time since boot that shows a restart."""
        peer = self._peers.get(sender)
        if message.name == "SYSTEM_TIME":
            if peer is not None:
                if message.time_boot_ms + 1000 < peer.boot_ms:
                    self._events.append(PeerEvent(PeerChange.RESTARTED, peer))
                peer.boot_ms = message.time_boot_ms
        elif peer is None:
            if sender == self.own or not self._has_room():
                self.refused += 1
                return
            peer = self._peers[sender] = MavlinkPeer(sender, message, now_s)
            self._events.append(PeerEvent(PeerChange.APPEARED, peer))
        else:
            peer.heartbeat, peer.last_s = message, now_s
            if not peer.is_alive:
                peer.is_alive, peer.first_s = True, now_s
                self._events.append(PeerEvent(PeerChange.RETURNED, peer))

    def tick(self, now_s: float) -> None:
        """Detects lost peers."""
        for peer in self._peers.values():
            if peer.is_alive and now_s >= peer.last_s + self._expires_after_s:
                peer.is_alive = False
                self._events.append(PeerEvent(PeerChange.LOST, peer))

    def stalled(self, by_s: float) -> None:
        """This process has stalled for so long: no peer could be received in that time."""
        for peer in self._peers.values():
            peer.last_s += by_s

    def next_tick_s(self) -> float | None:
        """When the next peer is lost unless it sends a heartbeat."""
        return min(
            (peer.last_s + self._expires_after_s for peer in self._peers.values() if peer.is_alive), default=None
        )

    def _has_room(self) -> bool:
        if len(self._peers) < MOST_PEERS:
            return True
        lost = min((p for p in self._peers.values() if not p.is_alive), key=lambda p: p.last_s, default=None)
        if lost is None:
            return False
        del self._peers[lost.address]
        return True
