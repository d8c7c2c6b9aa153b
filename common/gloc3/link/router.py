"""Passes MAVLink frames on between links, by their headers alone: the payload is never decoded, nothing is changed.

The rules are those of the MAVLink guide (mavlink.io, "Routing"): what is meant for all goes to every other link, what
has an address goes only where that system, and that component, has been heard. Signed frames and unknown messages pass
as they are; an unknown message counts as one for all. A frame never goes to a link on which its sender is heard, and
one that comes back over another link, because somebody else routes too, goes nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from gloc3.link.message import Address
from gloc3.link.parser import Frame
from gloc3.link.tlog import SETUP_SIGNING

MOST_ADDRESSES: Final = 256
"""So many senders a link may have; a flood of invented ones finds no room, and costs nobody else's."""
MOVED_AFTER_S: Final = 10.0
"""A sender that is silent on a link for so long, and is heard on another, has moved there."""
FORGOTTEN_AFTER_S: Final = 300.0
"""A sender that is silent for so long makes room for others."""
REPEAT_S: Final = 0.5
"""A frame that comes by another link within this time of the first is the same one, come back."""
_SYSTEM_TIME: Final = 2
_BOOT_MS_AT: Final = slice(8, 12)
_RESTART_MS: Final = 1000
"""By so much a system's time since boot must fall; less is a frame that was overtaken."""
_MOST_LOST: Final = 128
"""A larger step of the sequence is a restart or a late frame."""


class LinkCounts(msgspec.Struct):
    """What has passed one link."""

    frames_in: int = 0
    frames_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    lost: int = 0
    """Gaps in the senders' sequence numbers: lost before they came here."""
    returned: int = 0
    """Frames that had come by another link already, or were our own."""
    unroutable: int = 0
    """Frames for an address that has been heard nowhere else."""
    refused: int = 0
    """Frames of senders for whom there was no room, and keys: nobody passes these on."""


class _Sender(msgspec.Struct, gc=False):
    """What is known of one address on one link."""

    heard_s: float
    sequence: int
    boot_ms: int = 0


class RouterLink:
    """One link of a router.

    Args:
        name: for people.
        send: takes whole frames that are to leave.
    """

    __slots__ = ("counts", "name", "send", "senders")

    def __init__(self, name: str, send: Callable[[Frame], None]) -> None:
        self.name = name
        self.send = send
        self.counts = LinkCounts()
        self.senders: dict[int, _Sender] = {}
        """By `system << 8 | component`."""

    def has(self, system: int, component: int) -> bool:
        """Whether an address has been heard here; component 0 asks for any of the system."""
        if component:
            return system << 8 | component in self.senders
        return any(key >> 8 == system for key in self.senders)


class Router:
    """Any number of links. It has no clock and does no I/O: frames come in with their time, and go out at once.

    Args:
        own: the address of this process; frames for it alone are not passed on.
        restarted: told of a system whose time since boot has fallen. Its routes are forgotten.
    """

    def __init__(self, own: Address, restarted: Callable[[int], None] = lambda _: None) -> None:
        self.links: Final[list[RouterLink]] = []
        self._own = own.system << 8 | own.component
        self._restarted = restarted
        self._recent: dict[bytes, RouterLink] = {}
        self._before: dict[bytes, RouterLink] = {}
        self._turned_s = 0.0

    def attach(self, name: str, send: Callable[[Frame], None]) -> RouterLink:
        """Adds a link."""
        link = RouterLink(name, send)
        self.links.append(link)
        return link

    def route(self, source: RouterLink, frame: Frame, now_s: float) -> None:
        """Passes on one frame that has come in by a link."""
        counts, raw = source.counts, frame.raw
        counts.frames_in += 1
        counts.bytes_in += len(raw)
        key = frame.system << 8 | frame.component
        if key == self._own or self._has_returned(source, raw, now_s):
            counts.returned += 1
            return
        if frame.message_id == SETUP_SIGNING or not self._learn(source, key, frame, now_s):
            counts.refused += 1
            return
        system, component = frame.target_system, frame.target_component
        if system and system << 8 | component == self._own:
            return
        was_sent = False
        for link in self.links:
            if link is source or (system and not link.has(system, component)) or _hears(link, key, now_s):
                continue
            link.counts.frames_out += 1
            link.counts.bytes_out += len(raw)
            link.send(frame)
            was_sent = True
        if system and not was_sent and not source.has(system, component):
            counts.unroutable += 1

    def _has_returned(self, source: RouterLink, raw: bytes, now_s: float) -> bool:
        """Whether the very same frame has just come by another link."""
        if now_s - self._turned_s > REPEAT_S:
            self._before, self._recent, self._turned_s = self._recent, {}, now_s
        first = self._recent.get(raw) or self._before.get(raw)
        if first is None:
            self._recent[raw] = source
            return False
        return first is not source

    def _learn(self, source: RouterLink, key: int, frame: Frame, now_s: float) -> bool:
        """Remembers where a sender is; False if there is no room for one more."""
        sender = source.senders.get(key)
        if sender is None:
            if not _make_room(source, now_s):
                return False
            for link in self.links:
                if link is not source and key in link.senders and not _hears(link, key, now_s):
                    del link.senders[key]
            source.senders[key] = sender = _Sender(now_s, frame.sequence)
        else:
            gap = frame.sequence - sender.sequence - 1 & 0xFF
            if gap < _MOST_LOST:
                source.counts.lost += gap
            sender.heard_s, sender.sequence = now_s, frame.sequence
        if frame.message_id == _SYSTEM_TIME:
            boot_ms = int.from_bytes(frame.payload[_BOOT_MS_AT], "little")
            if boot_ms + _RESTART_MS < sender.boot_ms:
                self._forget(frame.system)
                source.senders[key] = sender
                self._restarted(frame.system)
            sender.boot_ms = boot_ms
        return True

    def _forget(self, system: int) -> None:
        for link in self.links:
            for key in [key for key in link.senders if key >> 8 == system]:
                del link.senders[key]


def _hears(link: RouterLink, key: int, now_s: float) -> bool:
    """Whether a sender is heard on a link now, so that nothing of its own is sent there."""
    sender = link.senders.get(key)
    return sender is not None and now_s - sender.heard_s < MOVED_AFTER_S


def _make_room(link: RouterLink, now_s: float) -> bool:
    if len(link.senders) < MOST_ADDRESSES:
        return True
    for key in [key for key, sender in link.senders.items() if now_s - sender.heard_s > FORGOTTEN_AFTER_S]:
        del link.senders[key]
    return len(link.senders) < MOST_ADDRESSES
