"""Which of several peers a frame is for: as the MAVLink guide wants, those that were heard as the system it is meant for."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from typing import Final, TypeVar

from gloc3.mavlink.codec import Parser
from gloc3.mavlink.parser import MAGIC_1, MAGIC_2, SIGNATURE_LENGTH, SIGNED

P = TypeVar("P", bound=Hashable)

_AROUND_1: Final = 8
_AROUND_2: Final = 12
"""Bytes of a frame around its payload: header and checksum."""


def systems_in(datagram: bytes) -> Iterator[int]:
    """The systems that the frames of a datagram come from; what is damaged ends the search."""
    at, size = 0, len(datagram)
    while at + _AROUND_1 <= size:
        length = datagram[at + 1]
        if datagram[at] == MAGIC_2 and at + _AROUND_2 <= size:
            yield datagram[at + 5]
            at += length + _AROUND_2 + (SIGNATURE_LENGTH if datagram[at + 2] & SIGNED else 0)
        elif datagram[at] == MAGIC_1:
            yield datagram[at + 3]
            at += length + _AROUND_1
        else:
            return


class Routes:
    """Learns who is behind which peer, from what comes; one peer may stand for many systems, as a router does.

    It may be asked from any thread while one learns.
    """

    def __init__(self) -> None:
        self._systems: dict[Hashable, frozenset[int]] = {}
        self._parser = Parser(is_datagram=True)

    def learn(self, peer: Hashable, datagram: bytes) -> None:
        """Something has come from a peer."""
        known = self._systems.get(peer, frozenset())
        size = len(datagram)
        if size >= _AROUND_2 and datagram[0] == MAGIC_2 and size == datagram[1] + _AROUND_2 and datagram[5] in known:
            return  # one plain frame of somebody who is known, as nearly all are
        self._systems[peer] = known.union(systems_in(datagram))

    def forget(self, peer: Hashable) -> None:
        """A peer has gone."""
        self._systems.pop(peer, None)

    def ways(self, peers: Sequence[P], frames: bytes) -> Sequence[P]:
        """Those of the peers to whom frames are to be sent: all, unless every frame is for systems that are known."""
        targets = {frame.target_system for frame in self._parser.receive(frames)}
        if not targets or 0 in targets:
            return peers
        found = [peer for peer in peers if not targets.isdisjoint(self._systems.get(peer, ()))]
        known = {system for peer in found for system in self._systems.get(peer, ())}
        return found if targets <= known else peers
