"""The planned silences of platforms, on disk, so that a restarted station knows until when nothing is heard of them."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import utc_text
from gloc3_groundstation import fleet as reducers
from gloc3_groundstation.kept_file import read_kept, write_kept
from gloc3_groundstation.snapshots import PlannedSilence
from gloc3_groundstation.station import Station

FILE: Final = "silences.json"
LOOK_EVERY_S: Final = 1.0
HEARD_STEP_S: Final = 10.0
"""As exactly as that it is kept when a platform was heard last."""


class KeptSilence(msgspec.Struct, frozen=True, kw_only=True):
    """A planned silence, in the time of day."""

    target: str
    until_s: float
    """On the platform's clock."""
    due_utc_s: float
    heard_utc_s: float
    """When the platform was heard last."""


class SilenceFile:
    """Keeps the planned silences of a station's fleet in a file; those of its former life are known at once.

    Args:
        path: the file.
        station: whose fleet.
        loop: wakes it.
    """

    def __init__(self, path: Path, station: Station, loop: asyncio.AbstractEventLoop) -> None:
        self._path, self._station, self._loop = path, station, loop
        self._kept = self._read()
        self._remember()
        self._timer = loop.call_later(LOOK_EVERY_S, self._look)

    def close(self) -> None:
        """Writes what has changed."""
        self._timer.cancel()
        self._write()

    def _remember(self) -> None:
        offset_s = self._station.fleet.utc_offset_s
        for name, kept in self._kept.items():
            planned = PlannedSilence(
                target=kept.target,
                until_s=kept.until_s,
                due_s=kept.due_utc_s - offset_s,
                due_text=f"{utc_text(kept.due_utc_s, '%H:%M:%S')} UTC",
            )
            heard_s = kept.heard_utc_s - offset_s
            self._station.change(
                lambda fleet, now_s, name=name, planned=planned, heard_s=heard_s: reducers.remembered(  # type: ignore[misc]
                    fleet, name, planned, heard_s, now_s
                )
            )

    def _look(self) -> None:
        self._timer = self._loop.call_later(LOOK_EVERY_S, self._look)
        self._write()

    def _now(self) -> dict[str, KeptSilence]:
        offset_s = self._station.fleet.utc_offset_s
        return {
            platform.name: KeptSilence(
                target=planned.target,
                until_s=planned.until_s,
                due_utc_s=round(planned.due_s + offset_s, 3),
                heard_utc_s=(platform.heard_s + offset_s) // HEARD_STEP_S * HEARD_STEP_S,
            )
            for platform in self._station.fleet
            if (planned := platform.silence) is not None
        }

    def _read(self) -> dict[str, KeptSilence]:
        return read_kept(self._path, KeptSilence)

    def _write(self) -> None:
        now = self._now()
        if now == self._kept:
            return
        self._kept = now
        write_kept(self._path, now)
