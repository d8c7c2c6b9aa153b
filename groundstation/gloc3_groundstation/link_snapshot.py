"""What a station knows of one of its links at one moment."""

import msgspec


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
    heard: tuple[str, ...] = ()
    """Whose heartbeats come in: `autopilot 1/1`."""
    platforms: tuple[str, ...] = ()
    """The vehicles whose command interface is behind it."""
