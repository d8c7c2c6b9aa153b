"""Which peer of an endpoint each system's autopilot is heard from."""

from collections.abc import Hashable
from typing import Final, NamedTuple

PINNED_S: Final = 3.0
"""Silence after which another peer may take an autopilot's place, s: it restarted with another port, or the route
changed."""
INTRUDER_REPORTED_S: Final = 30.0
"""How long a second peer that claims an autopilot's id is reported after its last frame, s."""
AUTOPILOT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1."""


class Pin(NamedTuple):
    """The peer of one system's autopilot."""

    peer: Hashable
    name: str
    heard_s: float


class AutopilotPins:
    """The first peer that sends as an autopilot counts as genuine, until it is silent or gone."""

    def __init__(self) -> None:
        self._pins: dict[int, Pin] = {}
        self._intruder, self._intruder_s = "", -INTRUDER_REPORTED_S

    def intruder(self, now_s: float) -> str:
        """The recent peer that claims the id of another peer's autopilot; empty without one."""
        return self._intruder if now_s < self._intruder_s + INTRUDER_REPORTED_S else ""

    def is_intruder(self, sender: tuple[int, int], peer: Hashable, name: str, now_s: float) -> bool:
        """Whether a frame claims to be from an autopilot that is heard from another peer.

        Args:
            sender: system and component of the frame.
            peer: who has sent it.
            name: host and port of that peer.
            now_s: the time.
        """
        system, component = sender
        if component != AUTOPILOT:
            return False
        pin = self._pins.get(system)
        if pin is None or pin.peer == peer or now_s - pin.heard_s >= PINNED_S:
            self._pins[system] = Pin(peer, name, now_s)
            return False
        if not self.intruder(now_s):  # one that changes its port all the time is told once
            self._intruder = (
                f"{name} claims to be autopilot {system}/{component}, which is heard from {pin.name}: messages of the "
                f"second one are dropped; give each vehicle an id and a port of its own"
            )
        self._intruder_s = now_s
        return True

    def release(self, peer: Hashable) -> None:
        """Forgets a peer that has gone: the next one may be the same autopilot, which connects again."""
        self._pins = {system: pin for system, pin in self._pins.items() if pin.peer != peer}
