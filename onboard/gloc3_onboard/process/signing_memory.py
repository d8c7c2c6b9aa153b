"""Keeps over a restart how far the senders of signed frames have come, so that none of them is taken once more."""

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.mavlink.signing import MAY_BE_OFF, TICKS_PER_S, Signing, Stream, Streams, timestamp
from gloc3.store import RecordFile, RecordStore

AHEAD: Final = 4 * TICKS_PER_S
"""So much more than was heard is written down, so that it is not done with each frame: after a crash, who did not sleep
through it is heard again so much later."""


class SigningMemory:
    """What each key of a process has heard, in a file for each, which says nothing of the key.

    Args:
        folder: where the files are.
        clock: the process's clock.
        told: is told once where it cannot be kept.
    """

    def __init__(self, folder: Path, clock: Clock, reported: Callable[[str], None]) -> None:
        self._folder, self._clock, self._reported = folder, clock, reported
        self._kept: dict[bytes, _Kept] = {}

    def signing(self, key: bytes, link_id: int) -> Signing:
        """Signs and judges one link; all links with the same key know what the others have heard."""
        if key not in self._kept:
            name = sha256(b"streams of the key " + key).hexdigest()[:16]
            self._kept[key] = _Kept(self._folder / f"signing-{name}.state", self._clock, self._reported)
        return Signing(
            key,
            link_id=link_id,
            now=timestamp(self._clock.utc_s()),
            streams=self._kept[key].streams,
            is_clock_right=self._clock.is_utc_right,
        )

    def close(self) -> None:
        """Writes down how far it came to the frame."""
        for kept in self._kept.values():
            kept.write(ahead=0)


class _Kept:
    """One key's streams and their file."""

    def __init__(self, path: Path, clock: Clock, reported: Callable[[str], None]) -> None:
        self._path, self._reported = path, reported
        self._records = RecordStore(RecordFile(path), f"times of signed frames in {path}")
        self._written = self._read(clock)
        """In the file; a frame that is later is taken only after that is."""
        self.streams: Final = Streams(self._written, self._noted)

    def write(self, ahead: int) -> None:
        """Writes all streams, so much ahead of what was heard."""
        self._written = {stream: time + ahead for stream, time in self.streams.latest.items()}
        record = msgspec.msgpack.encode([(*stream, time) for stream, time in self._written.items()])
        self._records.rewrite([record], outlives_power_cut=not ahead)
        if self._records.problem:
            reported, self._reported = self._reported, lambda _: None
            reported(
                f"{self._records.problem}: after a restart, signed frames of the minute before it may be accepted again"
            )

    def _noted(self, stream: Stream) -> None:
        if self.streams.latest[stream] > self._written.get(stream, -1):
            self.write(AHEAD)

    def _read(self, clock: Clock) -> dict[Stream, int]:
        """What still matters: new streams of older times are refused anyway, and those of later ones."""
        records, rows = self._records.load(), list[tuple[int, int, int, int]]()
        problem = self._records.problem
        try:
            rows = msgspec.msgpack.decode(records[0], type=list[tuple[int, int, int, int]]) if records else []
        except msgspec.DecodeError as error:
            problem = f"{self._path} cannot be read: {error}"
        if problem:
            self._reported(f"{problem}: a new one is started")
        now, is_right = timestamp(clock.utc_s()), clock.is_utc_right()
        return {
            (system, component, link): time
            for system, component, link, time in rows
            if not is_right or abs(time - now) <= MAY_BE_OFF + AHEAD
        }
