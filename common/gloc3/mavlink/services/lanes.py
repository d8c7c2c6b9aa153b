"""What comes again and again on a link, plain and for all: it goes on before anything else is done with it.

Nearly all that a router passes on is telemetry. Of such a frame system, component and message say where it goes, as long
as no route has changed: five bytes of its header. Only they, its checksum, and whether it has come before are looked at;
frames that came in one datagram leave in one. What they tell of their senders is counted, and settled now and then.

`pass_on` may be called from a thread of its own (see `gloc3.mavlink.services.direct_line`), one thread for each `Lanes`; it changes
nothing that another thread changes. All else is called from the loop's thread.
"""

from __future__ import annotations

from typing import Final

from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.mavlink.codec import Parser
from gloc3.mavlink.gaps import MOST_GAP
from gloc3.mavlink.message import Shape
from gloc3.mavlink.parser import MAGIC_2, Frame
from gloc3.mavlink.router import MOVED_AFTER_S, Links, Posts, Router, RouterLink, Sender
from gloc3.mavlink.services.fast_line import FastLine

MOST_LANES: Final = 1024
DATAGRAM_BYTES: Final = 1400
"""What every network carries in one piece."""
_WHO_AND_WHAT: Final = slice(5, 10)
"""System, component and message in a MAVLink 2 header."""
_AROUND: Final = 12
_START: Final = 10


class _Lane:
    """Where frames of one kind go."""

    __slots__ = (
        *("bytes", "compiled", "crc_extra", "frames", "is_fast"),
        *("key", "like", "lost", "of", "posts", "sender", "settled", "ways"),
    )

    def __init__(self, like: Frame, shape: Shape) -> None:
        self.like: Final = like
        self.key: Final = like.raw[_WHO_AND_WHAT]
        self.crc_extra: Final = shape.crc_extra
        self.frames = self.bytes = self.lost = 0
        """Passed on, and missed by their numbers."""
        self.compiled = (0, 0, 0)
        """The same of the compiled loop, as far as it has been asked."""
        self.is_fast = False
        """Whether the compiled loop knows of it."""
        self.settled = (0, 0, 0)
        """What of these three has been counted."""
        self.sender: Sender
        self.posts: Posts
        self.ways: Links
        self.of: int
        """The router's `changes` when these were found."""

    def find(self, router: Router, link: RouterLink, now_s: float) -> bool:
        """Looks up where it leads; False where each such frame must be looked at."""
        found = router.lane(link, self.like, now_s)
        if found is not None:
            self.is_fast = self.is_fast and self.of == router.changes and self.ways == found[2]
            self.sender, self.posts, self.ways = found
            self.of = router.changes
        return found is not None


class Lanes:
    """The lanes of one peer whose datagrams hold whole frames that need no look at their signature.

    Args:
        router: knows the ways.
        link: where the frames come in.
    """

    def __init__(self, router: Router, link: RouterLink) -> None:
        self._router, self._link = router, link
        self._lanes: dict[bytes, _Lane] = {}
        self._ended: list[_Lane] = []
        """Lanes that are no more, of which the last frames are not yet counted."""
        self._parser = Parser(is_datagram=True)
        self._fast: FastLine | None = None

    def hasten(self, fast: FastLine) -> None:
        """Has a compiled loop, which receives what comes, pass on what it may before `pass_on` is asked."""
        self._fast = fast
        self._router.passed_on.add(fast, self._link)

    def end(self) -> None:
        """Has the compiled loop, if there is one, pass on nothing any more; when this returns, it does not."""
        if self._fast is None:
            return
        self._router.passed_on.remove(self._fast)
        for key, lane in self._lanes.items():
            self._take(lane, self._fast.end(key))
            lane.is_fast = False
        self._fast = None

    def pass_on(self, data: bytes) -> bool:
        """Passes a datagram on whose lanes are known; False for anything else, of which nothing has gone on then."""
        lane = self._lanes.get(data[_WHO_AND_WHAT])
        if lane is None:
            return False
        if len(data) != data[1] + _AROUND:
            return self._pass_several(data)
        if not self._is_new(lane, data):
            return False
        for post in lane.posts:
            post(data)
        _count(lane, data)
        return True

    def _is_new(self, lane: _Lane, raw: bytes) -> bool:
        """Whether this is a whole frame for a lane that still leads the right way, and has not come before."""
        router = self._router
        recent = router.recent  # before `before` is looked at, which it may become just now
        return (
            lane.of == router.changes
            and raw[0] == MAGIC_2
            and not raw[2]
            and checksum(lane.crc_extra, checksum(raw[1:-2])) == raw[-2] | raw[-1] << 8
            and raw not in router.before
            and recent.setdefault(raw, self._link) is self._link
        )

    def _pass_several(self, data: bytes) -> bool:
        """Passes several frames on that came together, if all go the same way."""
        size, at, lanes = len(data), 0, self._lanes
        if size > DATAGRAM_BYTES:
            return False
        found: list[tuple[_Lane, bytes]] = []
        while at < size:
            raw = data[at : at + data[at + 1] + _AROUND] if at + _AROUND <= size else b""
            lane = lanes.get(raw[_WHO_AND_WHAT])
            if lane is None or len(raw) != raw[1] + _AROUND or not self._is_new(lane, raw):
                return False
            found.append((lane, raw))
            at += len(raw)
        posts = found[0][0].posts
        if any(lane.posts != posts for lane, _ in found):
            return False
        for post in posts:
            post(data)
        for lane, raw in found:
            _count(lane, raw)
        return True

    def learn(self, data: bytes, now_s: float) -> None:
        """Finds the lanes of frames like those that have just been routed, where they may have one."""
        for frame in self._parser.receive(data):
            if frame.flags or frame.raw[0] != MAGIC_2 or frame.shape is None:
                continue
            lane = _Lane(frame, frame.shape)
            if lane.find(self._router, self._link, now_s):
                self._end(lane.key)
                if len(self._lanes) >= MOST_LANES:
                    for other in tuple(self._lanes):
                        self._end(other)
                self._lanes[lane.key] = lane
                self._hasten(lane, now_s)

    def settle(self, now_s: float) -> None:
        """Counts what was passed on, remembers when its senders were heard, and looks up anew ways that are not sure any more."""
        self._router.turn(now_s)
        ended, self._ended = self._ended, []
        for lane in ended:
            self._settle(lane, now_s)
        for lane in tuple(self._lanes.values()):
            self._settle(lane, now_s)
        for key, lane in tuple(self._lanes.items()):
            is_heard = now_s - lane.sender.heard_s < MOVED_AFTER_S
            if is_heard and lane.find(self._router, self._link, now_s):
                self._hasten(lane, now_s)
            else:
                self._end(key)
        if self._fast is not None:
            self._fast.settle()

    def _hasten(self, lane: _Lane, now_s: float) -> None:
        """Has the compiled loop take frames of a kind, if it may."""
        if self._fast is None or lane.is_fast:
            return
        key = lane.like.system << 8 | lane.like.component
        ways = self._router.outgoing(self._link, key, lane.ways, now_s)
        if ways is not None and self._fast.put(lane.key, lane.crc_extra[0], lane.sender.last, ways):
            self._router.passed_on.begin(key, self._fast)
            lane.is_fast = True
        else:
            self._take(lane, self._fast.end(lane.key))

    @staticmethod
    def _take(lane: _Lane, passed: tuple[int, int, int]) -> None:
        frames, size, lost = lane.compiled
        lane.compiled = (frames + passed[0], size + passed[1], lost + passed[2])

    def _settle(self, lane: _Lane, now_s: float) -> None:
        if self._fast is not None and self._lanes.get(lane.key) is lane:
            self._take(lane, self._fast.take(lane.key))
        more = lane.compiled
        passed = (lane.frames + more[0], lane.bytes + more[1], lane.lost + more[2])
        frames, size, lost = (now - before for now, before in zip(passed, lane.settled, strict=True))
        lane.settled = passed
        if frames:
            self._router.passed(self._link, lane.sender, lane.ways, frames, size, now_s)
            self._link.counts.lost += lost

    def _end(self, key: bytes) -> None:
        """Takes a lane away; a thread may still be on it, so it is settled once more."""
        lane = self._lanes.pop(key, None)
        if lane is not None:
            if self._fast is not None:
                self._take(lane, self._fast.end(key))
            self._ended.append(lane)


def _count(lane: _Lane, raw: bytes) -> None:
    """Remembers a frame that was passed on."""
    sequence, last = raw[4], lane.sender.last
    if (gap := sequence - last[0] - 1 & 0xFF) and gap < MOST_GAP:
        lane.lost += gap
    last[0] = sequence
    lane.bytes += len(raw)
    lane.frames += 1
