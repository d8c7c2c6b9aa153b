"""Forwards MAVLink frames between links by their headers: payloads are neither decoded nor changed.

The rules are those of the MAVLink guide (mavlink.io, "Routing"): broadcast frames go to every other link, addressed
ones only to links on which that system, and that component, has been received. Signed frames and unknown messages pass
unchanged; an unknown message counts as a broadcast. A frame is never sent to a link on which its sender is received,
and a frame that returns over another link, because of a second router, is dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from gloc3.mavlink.fair_share import to_evict
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.tlog import SETUP_SIGNING

MOST_GAP: Final = 128
"""A larger step of the sequence is a restart or a late frame."""
MOST_SENDERS: Final = 256


class Gaps:
    """Counts gaps in each sender's sequence; the number of senders is bounded, against floods of invented ones."""

    def __init__(self) -> None:
        self.lost = 0
        self._last: dict[int, int] = {}

    def receive(self, frame: Frame) -> None:
        """A frame has come."""
        key = frame.system << 8 | frame.component
        last = self._last.get(key)
        if last is not None and (gap := frame.sequence - last - 1 & 0xFF) < MOST_GAP:
            self.lost += gap
        if last is not None or len(self._last) < MOST_SENDERS:
            self._last[key] = frame.sequence


MOST_ADDRESSES: Final = 256
"""So many senders a link may have. A flood of invented ones costs nobody else's room: behind the peer that has most of
it, the newest makes room for a newcomer behind another one, and one that was heard but for a moment for a newcomer behind
the same."""
LASTING_S: Final = 1.0
"""A sender that is heard for so long has come to stay; one that was heard but once may be invented."""
MOVED_AFTER_S: Final = 10.0
"""Silence on a link after which a sender that is received on another link has moved there, s."""
FORGOTTEN_AFTER_S: Final = 300.0
"""Silence after which a sender may be removed to make room for others, s."""
REPEAT_S: Final = 0.5
"""A frame that comes by another link within this time of the first is the same one, come back."""
MOST_RECENT: Final = 20_000
"""So many frames are remembered at most, twice; in a flood for less time than that."""
POLL_AGAIN_S: Final = 1.0
"""Longest time for which the cached routes of a sender are used, s."""
AUTOPILOT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1."""
_SYSTEM_TIME: Final = 2
_BOOT_MS_AT: Final = slice(8, 12)
_RESTART_MS: Final = 1000
"""Decrease of a system's time since boot that means a restart, ms; less is a frame out of order."""


@dataclass(slots=True)
class LinkCounts:
    """What has passed one link."""

    frames_in: int = 0
    frames_out: int = 0
    lost: int = 0
    """Gaps in the senders' sequence numbers: lost before they came here."""
    returned: int = 0
    """Frames that had come by another link already, or were our own."""
    unroutable: int = 0
    """Frames for an address that has not been received on any other link."""
    refused: int = 0
    """Frames of senders for whom there was no room, of stations in our autopilot's name, and keys: nobody passes these on."""


@dataclass(slots=True)
class KnownSender:
    """State of one address on one link."""

    heard_s: float
    expected: int
    """The number of its next frame."""
    since_s: float
    """When it was first heard."""
    boot_ms: int = 0
    routes: tuple[RouterLink, ...] = ()
    """Links to which its broadcasts are forwarded, cached until something changes."""
    routes_of: int = -1
    """The router's count of changes when this was found out."""
    routes_until_s: float = 0.0
    origin: str = ""
    """Behind which peer of the link it was heard first."""


class RouterLink:
    """One link of a router.

    Args:
        name: for people.
        send: takes frames that are to leave, those together that have come together, and counts them.
    """

    __slots__ = ("counts", "is_to_stations", "name", "origin", "send", "senders")

    def __init__(self, name: str, send: Callable[[Sequence[Frame]], None]) -> None:
        self.name = name
        self.send: Final = send
        self.counts = LinkCounts()
        self.senders: dict[int, KnownSender] = {}
        """By `system << 8 | component`, oldest first."""
        self.is_to_stations = False
        """Whether our own autopilot is never behind it, whoever says so there."""
        self.origin: Callable[[], str] = lambda: ""
        """Tells the peer that what comes in comes from; empty where peers are not told apart."""

    def has(self, system: int, component: int) -> bool:
        """Whether an address has been received here; component 0 matches any component of the system."""
        if component:
            return system << 8 | component in self.senders
        return any(key >> 8 == system for key in self.senders)


Links: TypeAlias = tuple[RouterLink, ...]


class Router:
    """Any number of links. It has no clock and does no I/O: frames come in with their time, and go out at once.

    Args:
        own: the address of this process; frames for it alone are not passed on.
        restarted: told of a system whose time since boot has fallen. Its routes on the link that told so are forgotten.
    """

    def __init__(self, own: Address, restarted: Callable[[int], None] = lambda _: None) -> None:
        self.links: Final[list[RouterLink]] = []
        self._own = {own.system << 8 | own.component}
        self._autopilot = own.system << 8 | AUTOPILOT
        self._restarted = restarted
        self._recent: dict[bytes, RouterLink] = {}
        """Frames that came by which link lately."""
        self._before: dict[bytes, RouterLink] = {}
        """Those that came somewhat earlier."""
        self._recent_until_s = REPEAT_S
        """When frames are discarded next."""
        self._changes = 0
        """Counts changes that invalidate cached routes."""

    def add_own(self, address: Address) -> None:
        """Adds an address of this process."""
        self._own.add(address.system << 8 | address.component)

    def attach(self, name: str, send: Callable[[Sequence[Frame]], None]) -> RouterLink:
        """Adds a link."""
        link = RouterLink(name, send)
        self.links.append(link)
        self._changes += 1
        return link

    def route(self, source: RouterLink, frames: Sequence[Frame], now_s: float) -> None:
        """Forwards frames that a link has received together; where they share a destination, they are sent together."""
        count = len(frames)
        source.counts.frames_in += count
        if now_s > self._recent_until_s or len(self._recent) > MOST_RECENT:
            self._discard_recent(now_s)
        if count == 1:
            for link in self._routes(source, frames[0], now_s):
                link.send(frames)
            return
        leaving: dict[RouterLink, list[Frame]] = {}
        for frame in frames:
            for link in self._routes(source, frame, now_s):
                leaving.setdefault(link, []).append(frame)
        for link, some in leaving.items():
            link.send(some)

    def _routes(self, source: RouterLink, frame: Frame, now_s: float) -> Sequence[RouterLink]:
        """Where a frame is to go; keeps what it tells of its sender.

        Every frame passes here: what nearly all have in common is done in place, what few need is called. So are
        comprehensions: a function's own variables in them cost each of its calls.
        """
        raw, message_id, key = frame.raw, frame.message_id, frame.system << 8 | frame.component
        if key in self._own or (self._before.get(raw) or self._recent.setdefault(raw, source)) is not source:
            source.counts.returned += 1
            return ()
        if message_id == SETUP_SIGNING or (
            (sender := source.senders.get(key) or self._add_peer(source, key, frame, now_s)) is None
        ):
            source.counts.refused += 1
            return ()
        sequence = frame.sequence
        if sequence != sender.expected and (gap := sequence - sender.expected & 0xFF) < MOST_GAP:
            source.counts.lost += gap
        if now_s - sender.heard_s >= MOVED_AFTER_S:
            self._changes += 1
        sender.heard_s, sender.expected = now_s, sequence + 1 & 0xFF
        if message_id == _SYSTEM_TIME:
            self._check_restart(source, sender, key, frame)
        shape = frame.shape
        if shape is not None and shape.target_system_at >= 0 and (system := frame.target_system):
            return self._routes_to(source, key, system, frame.target_component, now_s)
        if sender.routes_of != self._changes or now_s > sender.routes_until_s:
            self._renew(sender, source, key, now_s)
        return sender.routes

    def _renew(self, sender: KnownSender, source: RouterLink, key: int, now_s: float) -> None:
        """Finds out where the broadcasts of a sender are to go."""
        sender.routes = tuple(link for link in self.links if link is not source and not _accepts(link, key, now_s))
        sender.routes_of, sender.routes_until_s = self._changes, now_s + POLL_AGAIN_S

    def _routes_to(
        self, source: RouterLink, key: int, system: int, component: int, now_s: float
    ) -> Sequence[RouterLink]:
        """Where something goes that has an address."""
        if system << 8 | component in self._own:
            return ()
        there = [link for link in self.links if link is not source and link.has(system, component)]
        routes = [link for link in there if not _accepts(link, key, now_s)]
        if not routes and not source.has(system, component):
            source.counts.unroutable += 1
        return routes

    def _discard_recent(self, now_s: float) -> None:
        """Discards the frames that came too long ago for one that comes now to be one of them, come back."""
        self._before = self._recent if now_s <= self._recent_until_s + REPEAT_S else {}
        self._recent, self._recent_until_s = {}, now_s + REPEAT_S

    def _add_peer(self, source: RouterLink, key: int, frame: Frame, now_s: float) -> KnownSender | None:
        """Takes in a sender that is new on this link; None if it has no room, or claims to be our autopilot among stations."""
        origin = source.origin()
        if (source.is_to_stations and key == self._autopilot) or not _make_room(source, origin, now_s):
            return None
        self._changes += 1
        for link in self.links:
            if link is not source and key in link.senders and not _accepts(link, key, now_s):
                del link.senders[key]
        sender = source.senders[key] = KnownSender(now_s, frame.sequence, now_s, origin=origin)
        return sender

    def _check_restart(self, source: RouterLink, sender: KnownSender, key: int, frame: Frame) -> None:
        """Drops the routes of a system whose SYSTEM_TIME says that it has started anew, on the link that says so."""
        boot_ms = int.from_bytes(frame.payload[_BOOT_MS_AT], "little")
        if boot_ms + _RESTART_MS < sender.boot_ms:
            self._changes += 1
            for other in [other for other in source.senders if other >> 8 == frame.system and other != key]:
                del source.senders[other]
            self._restarted(frame.system)
        sender.boot_ms = boot_ms


def _accepts(link: RouterLink, key: int, now_s: float) -> bool:
    """Whether a sender is now received on a link, so that its frames are not sent there."""
    sender = link.senders.get(key)
    return sender is not None and now_s - sender.heard_s < MOVED_AFTER_S


def _make_room(link: RouterLink, origin: str, now_s: float) -> bool:
    if len(link.senders) < MOST_ADDRESSES:
        return True
    for key in [key for key, sender in link.senders.items() if now_s - sender.heard_s > FORGOTTEN_AFTER_S]:
        del link.senders[key]
    if len(link.senders) < MOST_ADDRESSES:
        return True
    evicted = to_evict({key: sender.origin for key, sender in link.senders.items()}, origin)
    if evicted is None:
        passing = (key for key, sender in link.senders.items() if _is_passing(sender, origin))
        evicted = next(passing, None)
    if evicted is None:
        return False
    del link.senders[evicted]
    return True


def _is_passing(sender: KnownSender, origin: str) -> bool:
    """Whether a sender behind a peer was heard but for a moment."""
    return sender.origin == origin and sender.heard_s - sender.since_s < LASTING_S
