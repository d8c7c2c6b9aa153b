"""Traffic that a station knows of: kept from the frames of all links, bounded, and compared with its vehicles once a second."""

import asyncio
from collections.abc import Callable, Sequence
from math import hypot
from typing import Final, Protocol

from msgspec.structs import replace

from gloc3.exchange.base import Unsubscribe
from gloc3.mavlink.parser import Frame
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3_groundstation.station.snapshots import Encounter, Fleet, TrafficContact
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.traffic.encounters import encounters_of
from gloc3_groundstation.traffic.reports import MESSAGES, TrafficReport, read_reports

POLL_PERIOD_S: Final = 1.0
KEPT_S: Final = 45.0
"""Age at which a contact is dropped, s."""
MOST_CONTACTS: Final = 200
"""So many are kept, those nearest to a vehicle: a peer may invent thousands."""
MOST_FRAMES: Final = 500
"""Frames a second that are read; further ones are counted and dropped."""
ANNOUNCE_AGAIN_S: Final = 60.0
"""The same encounter is an event again after this time, s."""


class FrameSource(Protocol):
    """The part of a link that traffic needs."""

    def listen(self, listener: Callable[[Frame], None]) -> Unsubscribe:
        """Registers a listener for all received frames."""


class Traffic:
    """Keeps traffic for one station.

    Args:
        station: owner of the fleet, to which contacts and encounters are added.
        links: returns the URLs and the open links.
    """

    def __init__(self, station: Station, links: Callable[[], Sequence[tuple[str, FrameSource]]]) -> None:
        self.dropped = 0
        """Reports that came too fast, or of contacts farther away than those that are kept."""
        self._station, self._links = station, links
        self._loop = asyncio.get_running_loop()
        self._lines: dict[FrameSource, Unsubscribe] = {}
        self._contacts: dict[str, TrafficContact] = {}
        self._names: dict[str, str] = {}
        """Of senders of Remote ID whose position has not come."""
        self._planes: list[TangentPlane] = []
        """At the vehicles, as of the last second."""
        self._away_m: dict[str, float] = {}
        """Distance of each contact to the nearest vehicle."""
        self._frames = 0
        self._announced: dict[tuple[str, str], tuple[Severity, float]] = {}
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)

    def close(self) -> None:
        """Receives nothing more."""
        self._timer.cancel()
        for unlisten in self._lines.values():
            unlisten()

    def _receive_frame(self, frame: Frame) -> None:
        if frame.message_id not in MESSAGES:
            return
        self._frames += 1
        message = frame.decode() if self._frames <= MOST_FRAMES else None
        if message is None:
            self.dropped += 1
            return
        for report in read_reports(message):
            self._handle(report)

    def _handle(self, report: TrafficReport) -> None:
        now_s, known = self._station.now_s(), self._contacts.get(report.key)
        if report.place is None:
            if known is not None and report.name:
                self._contacts[report.key] = replace(known, name=report.name)
            elif report.name and len(self._names) < MOST_CONTACTS:
                self._names[report.key] = report.name
            return
        if report.age_s >= KEPT_S:
            return
        name = report.name or (known.name if known is not None else self._names.pop(report.key, ""))
        contact = TrafficContact(
            key=report.key,
            name=name,
            place=report.place,
            altitude_m=report.altitude_m,
            velocity_ne_m_s=report.velocity_ne_m_s,
            received_s=now_s - report.age_s,
        )
        away_m = _distance_m(contact, self._planes)
        if known is None and len(self._contacts) >= MOST_CONTACTS and not self._make_room(away_m):
            self.dropped += 1
            return
        self._contacts[report.key], self._away_m[report.key] = contact, away_m

    def _make_room(self, away_m: float) -> bool:
        """Drops the contact that is farthest from all vehicles; false where a newcomer at that distance is."""
        farthest = max(self._away_m, key=self._away_m.__getitem__)
        if away_m >= self._away_m[farthest]:
            return False
        del self._contacts[farthest], self._away_m[farthest]
        return True

    def _poll(self) -> None:
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)
        present = {link for _, link in self._links()}
        for link in set(self._lines) - present:
            self._lines.pop(link)()
        for link in present - set(self._lines):
            self._lines[link] = link.listen(self._receive_frame)
        self._frames = 0
        self._names.clear()
        now_s = self._station.now_s()
        vehicles = (platform.vehicle for platform in self._station.fleet)
        self._planes = [TangentPlane(GeoPoint(*one.value.geo)) for one in vehicles if one is not None and one.value.geo]
        self._contacts = {key: one for key, one in self._contacts.items() if now_s - one.received_s < KEPT_S}
        self._away_m = {key: _distance_m(one, self._planes) for key, one in self._contacts.items()}
        self._station.change(self._shown)
        for encounter in self._station.fleet.encounters:
            self._announce(encounter, now_s)
        self._announced = {key: seen for key, seen in self._announced.items() if now_s - seen[1] < ANNOUNCE_AGAIN_S}

    def _shown(self, fleet: Fleet, now_s: float) -> Fleet:
        contacts = tuple(self._contacts.values())
        before = fleet.encounters
        found = tuple(one for platform in fleet for one in encounters_of(platform, contacts, now_s, before))
        if (contacts, found) == (fleet.traffic, fleet.encounters):
            return fleet
        return replace(fleet, traffic=contacts, encounters=found)

    def _announce(self, encounter: Encounter, now_s: float) -> None:
        """Makes an event of an encounter that is an alert, and again if it becomes worse."""
        if encounter.severity is None:
            return
        key = encounter.platform, encounter.key
        known = self._announced.get(key)
        worst = encounter.severity if known is None else min(known[0], encounter.severity)
        if known is None or worst < known[0]:
            self._station.note(encounter.platform, Severity.NOTICE, f"traffic {encounter}")
        self._announced[key] = worst, now_s


def _distance_m(contact: TrafficContact, planes: Sequence[TangentPlane]) -> float:
    """To the nearest vehicle, m; infinite without one."""
    return min(
        (hypot(*plane.ned_from_geo(*contact.place, plane.origin.altitude_m)[:2]) for plane in planes),
        default=float("inf"),
    )
