"""The receiving end of a plan transfer, for upload and download: requests the items one by one.

Lost items are requested again after a time that adapts to the link's round trip. Losses are limited for the whole
transfer and not for an item, so that a long plan on a bad link fares no worse than a short one. A lost peer is detected
by its silence.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from gloc3.mavlink.round_trip import RESTLESS_S, RoundTrip
from gloc3.mavlink.services.plan import PlanItem

SILENT_S: Final = 9.0
"""Silence after which a peer counts as lost, s."""


class Need(Enum):
    """Next step that the receiver needs."""

    NOTHING = "wait"
    REQUEST = "ask for the next item"
    SILENT = "give up: the peer is gone"
    EXHAUSTED = "give up: too much was lost"


class ItemReceiver:
    """Collects `count` items (at least one) in order."""

    __slots__ = ("_attempts", "_budget", "_received_s", "_requested_s", "_round_trip", "count", "items")

    def __init__(self, count: int, round_trip: RoundTrip, now_s: float) -> None:
        self.count = count
        self.items: list[PlanItem] = []
        self._round_trip = round_trip
        self._budget = 100 + 3 * count
        self._received_s = now_s
        self._requested_s = now_s
        self._attempts = 0

    @property
    def is_complete(self) -> bool:
        """Whether all items are there."""
        return len(self.items) == self.count

    @property
    def silent_since_s(self) -> float:
        """When the peer's last message was received."""
        return self._received_s

    def next_request(self, now_s: float) -> int:
        """Number of the item to request now."""
        if self._attempts:
            self._budget -= 1
        self._attempts += 1
        self._requested_s = now_s
        return len(self.items)

    def receive(self, number: int, item: PlanItem, now_s: float) -> bool:
        """Takes an item that has come; False if it is not the one that is next."""
        self._received_s = now_s
        if number != len(self.items):
            return False
        if self._attempts == 1:
            self._round_trip.answered(now_s - self._requested_s)
        self.items.append(item)
        self._attempts = 0
        return True

    def need(self, now_s: float) -> Need:
        """What is due."""
        if now_s >= self._received_s + SILENT_S:
            return Need.SILENT
        if now_s < self._retry_s():
            return Need.NOTHING
        if self._budget <= 0:
            return Need.EXHAUSTED
        self._round_trip.missed()
        return Need.REQUEST

    def next_s(self) -> float:
        """When something is due."""
        return min(self._retry_s(), self._received_s + SILENT_S)

    def _retry_s(self) -> float:
        """Delay before a repeat: short after the first miss, which works better on a slow and lossy link."""
        timeout_s = self._round_trip.timeout_s
        return self._requested_s + (timeout_s if self._attempts <= 1 else min(timeout_s, RESTLESS_S))
