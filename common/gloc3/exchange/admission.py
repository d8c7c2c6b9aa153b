"""Which connections a listening node admits while their handshake is not complete: limits by address, and for all."""

from collections import deque
from ipaddress import IPv6Address, ip_address, ip_network
from typing import Final

OF_ADDRESS: Final = (16, 10.0)
"""So many connections of an address may be without a handshake; one that fails counts for some time more, s."""
OF_ALL: Final = (64, 20.0)
"""So many of all addresses; an address that has completed a handshake before is admitted beyond that."""
KNOWN: Final = 1000
"""Addresses that are remembered for that."""


class HandshakeSlots:
    """Slots for connections without a handshake; one that fails keeps its slot for a while.

    Args:
        most: number of slots.
        held_s: how long a failed connection keeps its slot.
    """

    def __init__(self, most: int, held_s: float) -> None:
        self._most, self._held_s = most, held_s
        self._open = 0
        self._failed = deque[float]()

    def taken(self, now_s: float) -> int:
        """Number of slots that are taken."""
        while self._failed and self._failed[0] <= now_s:
            self._failed.popleft()
        return self._open + len(self._failed)

    def has_room(self, now_s: float) -> bool:
        """Whether a slot is free."""
        return self.taken(now_s) < self._most

    def enter(self) -> None:
        """A connection takes a slot."""
        self._open += 1

    def leave(self, now_s: float, *, is_complete: bool) -> None:
        """A connection has completed its handshake, or has failed."""
        self._open -= 1
        if not is_complete:
            self._failed.append(now_s + self._held_s)


class Admission:
    """Decides which connections are admitted; time is handed to it."""

    def __init__(self) -> None:
        self._all = HandshakeSlots(*OF_ALL)
        self._by_caller: dict[str, HandshakeSlots] = {}
        self._known: dict[str, None] = {}

    def enter(self, caller: str, now_s: float) -> bool:
        """Whether a connection is admitted; if so, it has to `leave`."""
        slots = self._by_caller.get(caller) or HandshakeSlots(*OF_ADDRESS)
        if not slots.has_room(now_s) or not (caller in self._known or self._all.has_room(now_s)):
            return False
        self._by_caller[caller] = slots
        slots.enter()
        self._all.enter()
        return True

    def leave(self, caller: str, now_s: float, *, is_complete: bool) -> None:
        """A connection that was admitted has completed its handshake, or has failed."""
        for slots in (self._by_caller[caller], self._all):
            slots.leave(now_s, is_complete=is_complete)
        if is_complete:
            self._known.pop(caller, None)
            self._known[caller] = None
            if len(self._known) > KNOWN:
                del self._known[next(iter(self._known))]
        self._by_caller = {one: slots for one, slots in self._by_caller.items() if slots.taken(now_s)}


def caller_of(address: str) -> str:
    """Who is at an IP address: of IPv6 its network of 64 bits, since one computer may have all of that."""
    ip = ip_address(address.partition("%")[0])
    if not isinstance(ip, IPv6Address):
        return str(ip)
    if ip.ipv4_mapped is not None:
        return str(ip.ipv4_mapped)
    if ip.is_link_local or ip.is_loopback:
        return str(ip)
    return str(ip_network((ip, 64), strict=False))
