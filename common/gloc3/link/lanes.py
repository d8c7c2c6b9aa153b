"""What comes again and again on a link, plain and for all: it goes on before anything else is done with it.

Nearly all that a router passes on is telemetry, one frame in a datagram. Of such a frame system, component and message
say where it goes, as long as no route has changed: five bytes of its header. Only they, its checksum, and whether it has
come before are looked at. What it tells of its sender is counted, and settled now and then for all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec
from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.link.gaps import MOST_GAP
from gloc3.link.message import Shape
from gloc3.link.parser import MAGIC_2, Frame
from gloc3.link.router import Router, RouterLink, Sender

MOST_LANES: Final = 1024
_WHO_AND_WHAT: Final = slice(5, 10)
"""System, component and message in a MAVLink 2 header."""
_AROUND: Final = 12
_START: Final = 10


class _Lane(msgspec.Struct, gc=False):
    """Where frames of one kind go."""

    shape: Shape
    crc_extra: bytes
    sender: Sender
    ways: tuple[RouterLink, ...]
    sends: tuple[Callable[[bytes], None], ...]
    of: int
    """The router's `changes` when it was found."""
    frames: int = 0
    """Passed on since the last time that this was settled."""
    bytes: int = 0


class Lanes:
    """The lanes of one link on which whole frames come that need no look at their signature.

    Args:
        router: knows the ways.
        link: where the frames come in.
    """

    def __init__(self, router: Router, link: RouterLink) -> None:
        self._router, self._link = router, link
        self._lanes: dict[bytes, _Lane] = {}

    def pass_on(self, data: bytes) -> bool:
        """Passes a frame on whose lane is known; False for anything else, with which nothing has been done yet."""
        lane, router = self._lanes.get(data[_WHO_AND_WHAT]), self._router
        if (
            lane is None
            or lane.of != router.changes
            or data[0] != MAGIC_2
            or data[2]
            or len(data) != data[1] + _AROUND
            or checksum(lane.crc_extra, checksum(data[1:-2])) != data[-2] | data[-1] << 8
            or data in router.recent
            or data in router.before
        ):
            return False
        router.recent[data] = self._link
        for send in lane.sends:
            send(data)
        sender, sequence = lane.sender, data[4]
        if (gap := sequence - sender.sequence - 1 & 0xFF) and gap < MOST_GAP:
            self._link.counts.lost += gap
        sender.sequence = sequence
        lane.frames += 1
        lane.bytes += len(data)
        return True

    def frame(self, data: bytes) -> Frame:
        """What was just passed on, for who wants to read it."""
        lane = self._lanes[data[_WHO_AND_WHAT]]
        _, length, _, _, sequence, system, component = data[:7]
        return Frame(data, system, component, sequence, lane.shape.id, 0, _START, length, lane.shape)

    def learn(self, frame: Frame) -> None:
        """Finds the lane of frames like one that has just been routed, if they may have one."""
        found = self._router.lane(self._link, frame)
        if found is None or frame.shape is None or frame.flags or frame.raw[0] != MAGIC_2:
            return
        if len(self._lanes) >= MOST_LANES:
            self.settle(self._router.now_s)
            self._lanes.clear()
        sender, sends = found
        self._lanes[frame.raw[_WHO_AND_WHAT]] = _Lane(
            frame.shape, frame.shape.crc_extra, sender, sender.ways, sends, self._router.changes
        )

    def settle(self, now_s: float) -> None:
        """Counts what was passed on, remembers when its senders were heard, and ends lanes whose ways are to be looked up anew."""
        self._router.turn(now_s)
        for key, lane in tuple(self._lanes.items()):
            if lane.frames:
                self._router.passed(self._link, lane.sender, lane.ways, lane.frames, lane.bytes, now_s)
                lane.frames = lane.bytes = 0
            if now_s > lane.sender.ways_until_s:
                del self._lanes[key]
