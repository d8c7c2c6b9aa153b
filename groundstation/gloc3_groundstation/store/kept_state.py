"""State of platforms kept across restarts of the station: planned silences and event cursors."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final, Generic, TypeVar

import msgspec

from gloc3.clock import utc_text
from gloc3.store import DocumentFile
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.event_feed import Cursor, EventFeed
from gloc3_groundstation.station.snapshots import ReportedSilence
from gloc3_groundstation.station.station import Station

SHOWN: Final = "shown.json"
SILENCES: Final = "silences.json"
POLL_EVERY_S: Final = 1.0
CONTACT_STEP_S: Final = 10.0
"""Resolution of the kept time of a platform's last message."""

T = TypeVar("T")


class KeptSilence(msgspec.Struct, frozen=True, kw_only=True):
    """A planned silence, in the time of day."""

    target: str
    until_s: float
    """On the platform's clock."""
    due_utc_s: float
    heard_utc_s: float
    """Time of the platform's last message."""


class _StateFile(Generic[T]):
    """A file of values by platform, written on changes.

    A file that cannot be read is ignored: the platforms report again on contact. A folder that cannot be written is
    reported by the recording.

    Args:
        path: the file.
        type_: of the value for one platform.
        loop: the event loop, for timers.
    """

    def __init__(self, path: Path, type_: type[T], loop: asyncio.AbstractEventLoop) -> None:
        self._file: DocumentFile[dict[str, T]] = DocumentFile(path, dict[str, type_])  # type: ignore[valid-type]
        self._loop = loop
        self.kept: Final = self._file.read() or {}
        """Of the former life of the station."""

    def follow(self, state: Callable[[], dict[str, T]]) -> None:
        """Stores a state from now on."""
        self._state = state
        self._timer = self._loop.call_later(POLL_EVERY_S, self._poll)

    def close(self) -> None:
        """Writes pending changes."""
        self._timer.cancel()
        self._file.write(self._state())

    def _poll(self) -> None:
        self._timer = self._loop.call_later(POLL_EVERY_S, self._poll)
        self._file.write(self._state())


class FeedFile:
    """Keeps the cursors of an event feed, so that a restarted station shows no event twice.

    Args:
        path: the file.
        loop: wakes it.
    """

    def __init__(self, path: Path, loop: asyncio.AbstractEventLoop) -> None:
        self._file = _StateFile(path, Cursor, loop)
        self.feed: Final = EventFeed(self._file.kept)
        self._file.follow(self.feed.cursors)
        self.close: Final = self._file.close


class SilenceFile:
    """Stores the planned silences of a fleet, so that a restarted station knows how long each platform will be silent.

    Args:
        path: the file.
        station: owner of the fleet.
        loop: the event loop, for timers.
    """

    def __init__(self, path: Path, station: Station, loop: asyncio.AbstractEventLoop) -> None:
        self._station = station
        self._file = _StateFile(path, KeptSilence, loop)
        for name, kept in self._file.kept.items():
            self._restore(name, kept)
        self._file.follow(self._silences)
        self.close: Final = self._file.close

    def _restore(self, name: str, kept: KeptSilence) -> None:
        offset_s = self._station.fleet.utc_offset_s
        planned = ReportedSilence(
            target=kept.target,
            until_s=kept.until_s,
            due_s=kept.due_utc_s - offset_s,
            due_text=f"{utc_text(kept.due_utc_s, '%H:%M:%S')} UTC",
        )
        received_s = kept.heard_utc_s - offset_s
        self._station.change(lambda fleet, now_s: reducers.remembered(fleet, name, planned, received_s, now_s))

    def _silences(self) -> dict[str, KeptSilence]:
        offset_s = self._station.fleet.utc_offset_s
        return {
            platform.name: KeptSilence(
                target=planned.target,
                until_s=planned.until_s,
                due_utc_s=round(planned.due_s + offset_s, 3),
                heard_utc_s=(platform.received_s + offset_s) // CONTACT_STEP_S * CONTACT_STEP_S,
            )
            for platform in self._station.fleet
            if (planned := platform.silence) is not None
        }
