"""State of one of a station's links at one moment."""

from typing import Final

import msgspec

REPORTED_LOSS: Final = 0.01


class LinkSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """One link."""

    url: str
    is_connected: bool
    """Whether there is a peer to send to, as far as can be known."""
    problem: str = ""
    """Why it is not connected, or its last failure."""
    bytes_in_s: float = 0.0
    """Bytes a second, over the last second."""
    bytes_out_s: float = 0.0
    frames_in: int = 0
    """Since it was opened."""
    frames_out: int = 0
    dropped: int = 0
    """Frames dropped for lack of room or connection."""
    received: tuple[str, ...] = ()
    """Whose heartbeats come in: `autopilot 1/1`."""
    platforms: tuple[str, ...] = ()
    """Vehicles whose command interface is behind it."""
    lost: int = 0
    """Missing frames, by gaps in their sequence numbers: lost, or dropped before a slow line."""
    refusals: dict[str, int] = {}
    """By reason, frames that were dropped since their signature is missing or wrong."""
    genuine: int = 0
    """Frames with a right signature."""
    forwards: str = ""
    """Which frames pass between another station there and the vehicles; empty for a link of vehicles."""

    def note(self) -> str:
        """Text about problems with its frames for users; empty without any."""
        parts = [f"{count:,} refused: {reason}" for reason, count in self.refusals.items()]
        share = self.lost / max(1, self.lost + self.frames_in)
        if share >= REPORTED_LOSS:
            parts.append(f"{share:.0%} lost or left out")
        return "; ".join(parts)
