"""State of one of a station's links at one moment."""

from typing import Final

import msgspec

REPORTED_LOSS: Final = 0.01


class LinkSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """One link."""

    url: str
    is_connected: bool
    """Whether there is somebody to send to, as far as one can know."""
    problem: str = ""
    """Why it is not connected, or its last failure."""
    bytes_in_s: float = 0.0
    """Bytes a second, over the last second."""
    bytes_out_s: float = 0.0
    frames_in: int = 0
    """Since it was opened."""
    frames_out: int = 0
    dropped: int = 0
    """What found no room, or no way."""
    received: tuple[str, ...] = ()
    """Whose heartbeats come in: `autopilot 1/1`."""
    platforms: tuple[str, ...] = ()
    """The vehicles whose command interface is behind it."""
    lost: int = 0
    """Frames that did not come, told by the gaps in their numbers: lost, or left out before a slow line."""
    refusals: dict[str, int] = {}
    """By reason, frames that were dropped since their signature is missing or wrong."""
    genuine: int = 0
    """Frames with a right signature."""

    def note(self) -> str:
        """What a person should know of its frames; empty where all is well."""
        parts = [f"{count:,} refused: {reason}" for reason, count in self.refusals.items()]
        share = self.lost / max(1, self.lost + self.frames_in)
        if share >= REPORTED_LOSS:
            parts.append(f"{share:.0%} lost or left out")
        return "; ".join(parts)
