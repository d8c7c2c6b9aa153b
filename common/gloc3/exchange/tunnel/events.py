"""Events that the tunnel reports to the layer above, and its counters."""

from __future__ import annotations

from typing import Any

import msgspec

from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.mavlink.message import Address
from gloc3.messages.envelope import Envelope


class Delivered(msgspec.Struct, frozen=True):
    """A message came."""

    envelope: Envelope[Any]
    peer: Address


class Acknowledged(msgspec.Struct, frozen=True):
    """A reliable message was handed over at the other end."""

    envelope: Envelope[Any]
    peer: Address


class Undelivered(msgspec.Struct, frozen=True):
    """A reliable message was given up."""

    envelope: Envelope[Any]
    peer: Address | None
    """None where no receiver was found."""
    is_certain: bool
    """It was not handed over and will not be; False where that is *unknown*."""
    reason: str


class PeerChanged(msgspec.Struct, frozen=True):
    """A peer appeared, went silent, or came back."""

    peer: Address
    name: str
    role: TunnelRole
    is_alive: bool
    is_restarted: bool = False
    """It came back as another process."""


class TokenChanged(msgspec.Struct, frozen=True):
    """Something at a peer came or went."""

    token: str
    is_alive: bool


class TunnelTrouble(msgspec.Struct, frozen=True):
    """A problem for the operator, reported once: versions differ, two peers of one name."""

    peer: Address
    text: str


Happening = Delivered | Acknowledged | Undelivered | PeerChanged | TokenChanged | TunnelTrouble


class Counters(msgspec.Struct):
    """What was sent, received and thrown away."""

    sent_frames: int = 0
    sent_bytes: int = 0
    """On the wire, with MAVLink's part."""
    status_bytes: int = 0
    """Of these: best effort, greetings and tables."""
    view_bytes: int = 0
    """Of these: samples for viewers."""
    received_frames: int = 0
    foreign: int = 0
    """Not of this kind, not for us, or from our own role."""
    damaged: int = 0
    other_version: int = 0
    other_life: int = 0
    """From or for a process that is no more, or not known yet."""
    unknown_number: int = 0
    """Messages that came before the table's row."""
    versions_differ: int = 0
    """Messages whose type differs between the ends."""
    not_accepted: int = 0
    """Messages on topics that this end does not accept from that peer."""
    too_many_peers: int = 0
    delivered: int = 0
    acknowledged: int = 0
    undelivered: int = 0
    repeated_requests: int = 0
    """Repeated requests while the first was still under way."""
    replaced: int = 0
    """Best-effort messages replaced by newer ones before they were sent."""
    too_long: int = 0
    """Best-effort messages with too many parts."""
    late: int = 0
    """Best-effort frames that came twice or after something newer."""
    incomplete: int = 0
    """Best-effort messages of which parts were missing."""
    repeats: int = 0
    """Fragments that were sent again."""
    duplicates: int = 0
    """Fragments that had come before."""
    beyond_window: int = 0
    """Fragments for which there was no place."""
