"""Traffic counters of a router's link, as a message and in words."""

import msgspec

from gloc3.cli.counting import counted


class LinkTraffic(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Counts since the link was opened."""

    frames_in: int = 0
    """Frames that came and could be used."""
    frames_out: int = 0
    """Frames that have left."""
    bytes_in: int = 0
    bytes_out: int = 0
    bytes_in_s: float = 0.0
    """Bytes per second, since the last poll."""
    bytes_out_s: float = 0.0
    lost: int = 0
    """Gaps in the senders' sequence numbers: lost before they came here."""
    damaged_bytes: int = 0
    """Bytes that belong to no good frame."""
    waiting: int = 0
    """Frames that wait for the line to be free."""
    overtaken: int = 0
    """Telemetry that a newer frame of its kind took the place of."""
    dropped: dict[str, int] = {}
    """By class, frames dropped for lack of room; under `link` those without a connection."""
    returned: int = 0
    """Frames that came by another link before, or were our own."""
    unroutable: int = 0
    """Frames for an unknown address."""
    refused: dict[str, int] = {}
    """By reason, rejected frames: missing or invalid signatures, senders for whom there was no room."""
    genuine: int = 0
    """Frames with a right signature."""

    def describe(self) -> str:
        """Text with the traffic received, sent and dropped."""
        loss = f", {self.lost / (self.frames_in + self.lost):.1%} lost in transit" if self.lost else ""
        parts = [
            f"in {counted(self.frames_in, 'frame')}, {_size(self.bytes_in)}{loss}",
            f"out {counted(self.frames_out, 'frame')}, {_size(self.bytes_out)}",
        ]
        if self.dropped:
            parts.append(f"dropped {_listed(self.dropped)}")
        if self.overtaken:
            parts.append(f"{self.overtaken:,} overtaken by newer ones")
        if self.refused:
            parts.append(f"refused {_listed(self.refused)}")
        if self.genuine:
            parts.append(f"{self.genuine:,} rightly signed")
        return "; ".join(parts)


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(
        f"{count:,} {name}" if name != "link" else f"{count:,} without a route" for name, count in counts.items()
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB"
