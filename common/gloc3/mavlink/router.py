"""Passes MAVLink frames on between links, by their headers alone: the payload is never decoded, nothing is changed.

The rules are those of the MAVLink guide (mavlink.io, "Routing"): what is meant for all goes to every other link, what
has an address goes only where that system, and that component, has been heard. Signed frames and unknown messages pass
as they are; an unknown message counts as one for all. A frame never goes to a link on which its sender is heard, and
one that comes back over another link, because somebody else routes too, goes nowhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import msgspec

from gloc3.mavlink.gaps import MOST_GAP
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.services.fast_line import Outgoing
from gloc3.mavlink.services.passed_on import PassedOn
from gloc3.mavlink.tlog import SETUP_SIGNING

MOST_ADDRESSES: Final = 256
"""So many senders a link may have; a flood of invented ones finds no room, and costs nobody else's."""
MOVED_AFTER_S: Final = 10.0
"""A sender that is silent on a link for so long, and is heard on another, has moved there."""
FORGOTTEN_AFTER_S: Final = 300.0
"""A sender that is silent for so long makes room for others."""
REPEAT_S: Final = 0.5
"""A frame that comes by another link within this time of the first is the same one, come back."""
MOST_RECENT: Final = 20_000
"""So many frames are remembered at most, twice; in a flood for less time than that."""
LOOK_AGAIN_S: Final = 1.0
"""So long at most the ways of a sender are taken for right before they are looked up anew."""
_TURNS: Final = 2
"""After so many times that old frames were forgotten nothing is remembered of what came before."""
_SYSTEM_TIME: Final = 2
_BOOT_MS_AT: Final = slice(8, 12)
_RESTART_MS: Final = 1000
"""By so much a system's time since boot must fall; less is a frame that was overtaken."""


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


class Sender(msgspec.Struct, gc=False):
    """What is known of one address on one link."""

    heard_s: float
    last: bytearray
    """The number of its last frame, in one byte that a compiled line reaches."""
    boot_ms: int = 0
    ways: tuple[RouterLink, ...] = ()
    """Where what it says to all goes, as long as nothing has changed."""
    ways_of: int = -1
    """The router's `changes` when this was found out."""
    ways_until_s: float = 0.0


class RouterLink:
    """One link of a router.

    Args:
        name: for people.
        send: takes frames that are to leave, those together that have come together.
    """

    __slots__ = ("_send", "counts", "name", "outgoing", "post", "senders")

    def __init__(self, name: str, send: Callable[[Sequence[Frame]], None]) -> None:
        self.name = name
        self._send = send
        self.post: Callable[[bytes], None] | None = None
        """Sends frames as they are, from any thread, where nothing has to wait; None where something may."""
        self.outgoing: Callable[[], Sequence[Outgoing] | None] = lambda: None
        """Where what `post` sends goes; None where only it can tell."""
        self.counts = LinkCounts()
        self.senders: dict[int, Sender] = {}
        """By `system << 8 | component`."""

    def put(self, frames: Sequence[Frame]) -> None:
        """Has frames leave."""
        self._send(frames)
        counts = self.counts
        for frame in frames:
            counts.frames_out += 1
            counts.bytes_out += len(frame.raw)

    def has(self, system: int, component: int) -> bool:
        """Whether an address has been heard here; component 0 asks for any of the system."""
        if component:
            return system << 8 | component in self.senders
        return any(key >> 8 == system for key in self.senders)


Links: TypeAlias = tuple[RouterLink, ...]
Posts: TypeAlias = tuple[Callable[[bytes], None], ...]


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
        self.recent: dict[bytes, RouterLink] = {}
        """Frames that came by which link lately."""
        self.before: dict[bytes, RouterLink] = {}
        self.now_s = 0.0
        """When frames were forgotten last."""
        self.changes = 0
        """Counts what makes ways that are known no longer right."""
        self.passed_on: Final = PassedOn()
        self._restart_turn = -_TURNS
        """When somebody was forgotten who may have been heard by several links just before."""

    def change(self) -> None:
        """Ways that are known are no longer right: when this returns, nothing leaves by them any more."""
        self.changes += 1
        self.passed_on.revoke()

    def attach(self, name: str, send: Callable[[Sequence[Frame]], None]) -> RouterLink:
        """Adds a link."""
        link = RouterLink(name, send)
        self.links.append(link)
        self.change()
        return link

    def route(self, source: RouterLink, frames: Sequence[Frame], now_s: float) -> None:
        """Passes on frames that have come in by a link together; where they go on together, they leave together."""
        if len(frames) == 1:
            for link in self._ways(source, frames[0], now_s):
                link.put(frames)
            return
        leaving: dict[RouterLink, list[Frame]] = {}
        for frame in frames:
            for link in self._ways(source, frame, now_s):
                leaving.setdefault(link, []).append(frame)
        for link, some in leaving.items():
            link.put(some)

    def lane(self, source: RouterLink, frame: Frame, now_s: float) -> tuple[Sender, Posts, Links] | None:
        """Who sends such frames, and what passes them all on, to which links; None where each must be looked at."""
        key = frame.system << 8 | frame.component
        sender, shape = source.senders.get(key), frame.shape
        if sender is None or shape is None or shape.target_system_at >= 0 or frame.message_id == _SYSTEM_TIME:
            return None
        if self.passed_on.elsewhere(key, source):
            return None
        ways = self._ways_to_all(source, sender, key, now_s)
        posts = tuple(link.post for link in ways if link.post is not None)
        return (sender, posts, ways) if len(posts) == len(ways) else None

    def outgoing(self, source: RouterLink, key: int, ways: Links, now_s: float) -> list[Outgoing] | None:
        """Where what somebody says leaves by some links, if a compiled line may send it there; otherwise None.

        It may not while the same sender is heard by another link, or has been until just now.
        """
        if self.passed_on.turn_number < self._restart_turn + _TURNS:
            return None
        for link in self.links:
            sender = None if link is source else link.senders.get(key)
            if sender is not None and now_s - sender.heard_s < MOVED_AFTER_S + LOOK_AGAIN_S:
                return None
        found: list[Outgoing] = []
        for link in ways:
            some = link.outgoing()
            if some is None:
                return None
            found += some
        return found

    @staticmethod
    def passed(
        source: RouterLink, sender: Sender, ways: Sequence[RouterLink], frames: int, size: int, now_s: float
    ) -> None:
        """Remembers frames of one sender that have been passed on meanwhile."""
        source.counts.frames_in += frames
        source.counts.bytes_in += size
        for link in ways:
            link.counts.frames_out += frames
            link.counts.bytes_out += size
        sender.heard_s = now_s

    def turn(self, now_s: float) -> None:
        """Forgets frames that came too long ago to come back."""
        if now_s - self.now_s > REPEAT_S or len(self.recent) > MOST_RECENT:
            self.before, self.recent, self.now_s = self.recent, {}, now_s
            self.passed_on.turn()

    def _ways(self, source: RouterLink, frame: Frame, now_s: float) -> Sequence[RouterLink]:
        """Where a frame is to go; keeps what it tells of its sender."""
        counts, raw = source.counts, frame.raw
        counts.frames_in += 1
        counts.bytes_in += len(raw)
        key = frame.system << 8 | frame.component
        if key == self._own or self._has_returned(source, key, raw, now_s):
            counts.returned += 1
            return ()
        sender, changes = source.senders.get(key), self.changes
        if frame.message_id == SETUP_SIGNING or (
            sender is None and (sender := self._meet(source, key, frame, now_s)) is None
        ):
            counts.refused += 1
            return ()
        self._remember(source, sender, key, frame, now_s)
        if self.changes != changes and self.passed_on.has(raw, key, source):
            counts.returned += 1  # a compiled line had it in hand until the change
            return ()
        shape = frame.shape
        if shape is not None and shape.target_system_at >= 0 and (system := frame.target_system):
            return self._ways_to(source, key, system, frame.target_component, now_s)
        return self._ways_to_all(source, sender, key, now_s)

    def _ways_to_all(self, source: RouterLink, sender: Sender, key: int, now_s: float) -> Links:
        """Where goes what somebody says to all."""
        if sender.ways_of != self.changes or now_s > sender.ways_until_s:
            sender.ways = tuple(link for link in self.links if link is not source and not _hears(link, key, now_s))
            sender.ways_of, sender.ways_until_s = self.changes, now_s + LOOK_AGAIN_S
        return sender.ways

    def _ways_to(self, source: RouterLink, key: int, system: int, component: int, now_s: float) -> Sequence[RouterLink]:
        """Where something goes that has an address."""
        if system << 8 | component == self._own:
            return ()
        there = [link for link in self.links if link is not source and link.has(system, component)]
        ways = [link for link in there if not _hears(link, key, now_s)]
        if not ways and not source.has(system, component):
            source.counts.unroutable += 1
        return ways

    def _has_returned(self, source: RouterLink, key: int, raw: bytes, now_s: float) -> bool:
        """Whether the very same frame has just come by another link."""
        self.turn(now_s)
        if self.passed_on.has(raw, key, source):
            return True
        recent = self.recent  # a line's thread may be here too: what is in one of the two is never overlooked
        first = self.before.get(raw) or recent.setdefault(raw, source)
        return first is not source

    def _meet(self, source: RouterLink, key: int, frame: Frame, now_s: float) -> Sender | None:
        """Takes in a sender that is new on this link; None if there is no room for one more."""
        if not _make_room(source, now_s):
            return None
        self.change()
        for link in self.links:
            if link is not source and key in link.senders and not _hears(link, key, now_s):
                del link.senders[key]
        sender = source.senders[key] = Sender(now_s, bytearray([frame.sequence - 1 & 0xFF]))
        return sender

    def _remember(self, source: RouterLink, sender: Sender, key: int, frame: Frame, now_s: float) -> None:
        """Keeps what a frame tells of its sender."""
        gap = frame.sequence - sender.last[0] - 1 & 0xFF
        if gap < MOST_GAP:
            source.counts.lost += gap
        if now_s - sender.heard_s >= MOVED_AFTER_S:
            self.change()
        sender.heard_s, sender.last[0] = now_s, frame.sequence
        if frame.message_id == _SYSTEM_TIME:
            boot_ms = int.from_bytes(frame.payload[_BOOT_MS_AT], "little")
            if boot_ms + _RESTART_MS < sender.boot_ms:
                self._forget(frame.system)
                source.senders[key] = sender
                self._restarted(frame.system)
            sender.boot_ms = boot_ms

    def _forget(self, system: int) -> None:
        self._restart_turn = self.passed_on.turn_number
        self.change()
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
