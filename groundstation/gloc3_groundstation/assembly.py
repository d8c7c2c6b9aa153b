"""Assembly of a ground station without its screens, from links, storage and a network; the only place of wiring.

`gloc3 station`, the commands that connect to a vehicle, and a flight in virtual time build their stations here. They
differ in the links (sockets, or ends in memory), in the storage (a folder, or none) and in the event loop, whose clock
is the station's. `NOT_IN_FLIGHTS` lists what a flight leaves out, with the reasons.
"""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from gloc3.clock import Clock, utc_now
from gloc3.errors import Gloc3Error
from gloc3.exchange import LocalExchange
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3.messages.envelope import Severity
from gloc3.messages.topics import TopicTable
from gloc3.terrain import Terrain
from gloc3_groundstation.corrections.corrections import Corrections
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.events_desk import EventsDesk
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.links.acoustic_route import Modem, attach_modem, open_modem
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.links.links import Links
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.vehicles import Vehicles
from gloc3_groundstation.store.contact_queue import FILE as QUEUE_FILE
from gloc3_groundstation.store.contact_queue import ContactQueue
from gloc3_groundstation.store.event_store import EventStore
from gloc3_groundstation.store.kept_state import SHOWN, SILENCES, FeedFile, SilenceFile
from gloc3_groundstation.store.recording import SessionRecording
from gloc3_groundstation.traffic.traffic import Traffic

if TYPE_CHECKING:
    from gloc3.network.file import Membership

DESCRIPTIONS: Final = "descriptions"
"""Folder for descriptions of parameters that vehicles have sent, in that of the records."""
NOT_IN_FLIGHTS: Final[Mapping[str, str]] = {
    "SessionRecording": "a flight's log already holds both ends; a test may give a folder",
    "FeedFile": "needs a folder that outlives the station; a test may give one",
    "SilenceFile": "needs a folder that outlives the station; a test may give one",
    "NetworkRoute": "Zenoh has threads, sockets and a clock of its own",
    "LiveView": "the Foxglove server has a thread and a socket of its own",
    "StationApp": "the terminal draws in wall time; tests open it on a flight's station by themselves",
    "Headless": "narrates on stderr; a flight's test gives the commands",
    "WebServer": "serves the terminal on a socket",
}
"""Parts of `gloc3 station` that a flight's station does not have, each with the reason."""


class StationSetup(msgspec.Struct, frozen=True, kw_only=True):
    """Identity and folders of a station."""

    boot: int
    """A random number for this start."""
    system: int = 255
    """Its MAVLink system."""
    record: Path | None = None
    """Folder of records, with a subfolder for each session; None to record nothing."""
    downloads: Path = Path()
    """Folder for downloads from vehicles, and base of file names that the operator types."""
    signing_key: bytes | None = None
    """Signs all links; None for links that are not signed."""
    terrain: Terrain | None = None
    """Heights of the ground; None without tiles."""
    network: "Membership | None" = None
    """The network file of this station; None for MAVLink alone."""

    @property
    def name(self) -> str:
        """Name under which platforms know the station."""
        return str(self.system) if self.network is None else self.network.file.member


def read_membership(file: Path | None) -> "Membership | None":
    """A station's network file; without one, neither Zenoh nor cryptography is loaded.

    Raises:
        InputError: it cannot be read.
    """
    if file is None:
        return None
    from gloc3.network.file import read_network

    return read_network(file.expanduser(), utc_now())


class GroundStation:
    """A station that is active as soon as it has a link.

    Args:
        setup: its setup.
        report: called with text about the links for users; None to use the station's events.
    """

    def __init__(self, setup: StationSetup, report: Callable[[str], None] | None = None) -> None:
        self.setup: Final = setup
        self.loop: Final = asyncio.get_running_loop()
        self.topics: Final = TopicTable.installed()
        self.exchange: Final = LocalExchange(self.topics)
        self._feed_file = None if setup.record is None else FeedFile(self._kept_in(setup.record, SHOWN), self.loop)
        feed = None if self._feed_file is None else self._feed_file.feed
        self.station: Final = Station(self.exchange, self.loop, setup.name, setup.boot, feed)
        self.station.terrain = setup.terrain
        if setup.network is not None:
            from gloc3_groundstation.links.network_route import role_of

            self.station.client.role, self.station.is_member = role_of(setup.network), True
        self._silences = self._begin_silences()
        self._recording = self._begin_recording()
        events = None if self._recording is None else self._recording.events
        self.events: Final = EventsDesk(self.station, EventStore(events, Clock(self.loop).utc_offset_s))
        self.links: Final = Links(self._link_context(report or self._warn), setup.signing_key)
        self.station.round_trip_s = self.links.round_trip_s
        self.vehicles: Final = Vehicles(self.station, self.links.routes)
        self.traffic: Final = Traffic(self.station, self.links.routes)
        self.corrections: Final = Corrections(self.station, self.vehicles.best_links)
        descriptions = None if setup.record is None else setup.record / DESCRIPTIONS
        self.services: Final = ServicesDesk(self.station, self.vehicles.reach, setup.downloads, descriptions)
        self._modems: list[Modem] = []
        self._queue: ContactQueue | None = None
        if self._recording is not None:
            self._recording.attach(self.exchange)

    async def open(self, urls: Iterable[str], modems: Iterable[tuple[str, str]] = ()) -> None:
        """Joins the network, and opens links and modems on sockets and serial lines.

        Args:
            urls: of the links.
            modems: acoustic modems: the platform that each leads to, and its URL.

        Raises:
            Gloc3Error: a URL is wrong, or an address is not available.
        """
        if self.setup.network is not None:
            self.links.join(self.setup.network)
        for url in urls:
            await self.links.add(url)
        for platform, url in modems:
            self._modems.append(await open_modem(platform, url, self.station, self.exchange, self.setup.boot))

    def attach(self, end: MemoryEnd) -> StationLinkCore:
        """Opens a link in memory."""
        return self.links.attach(end)

    def attach_modem(self, platform: str, end: MemoryEnd) -> None:
        """Opens an acoustic modem in memory that leads to a platform."""
        self._modems.append(attach_modem(platform, end, self.station, self.exchange, self.setup.boot))

    def begin_queue(self, *, is_kept: bool) -> ContactQueue:
        """Begins to bring missions over at the next contact.

        Args:
            is_kept: what waits is kept over restarts, where there is a folder for it.
        """
        folder = self.setup.record if is_kept else None
        self._queue = ContactQueue(self.station, None if folder is None else self._kept_in(folder, QUEUE_FILE))
        return self._queue

    def desk(self, plan: CheckedPlan | None = None, *, is_queue_kept: bool = False, author: str = "") -> Desk:
        """The operator's desk of the terminal, of scripts, and of a run without a screen.

        Args:
            plan: the selected mission, checked; None without one.
            is_queue_kept: missions that wait for contact are kept over restarts, where there is a folder for them.
            author: the operator's name, for logged actions.
        """
        queue = self.begin_queue(is_kept=is_queue_kept)
        desk = Desk(
            self.station,
            plan,
            events=self.events,
            services=self.services,
            links=self.links,
            queue=queue,
            author=author,
        )
        desk.fleet.corrections = self.corrections
        return desk

    def parts(self) -> tuple[str, ...]:
        """The names of the parts that this station has, in the order in which they were made."""
        found = (part for value in vars(self).values() for part in (value if isinstance(value, list) else [value]))
        own = (type(part) for part in found if part is not self.setup)
        return tuple(one.__name__ for one in own if one.__module__.startswith("gloc3_groundstation."))

    async def close(self) -> None:
        """Closes everything; vehicles are left to their policies."""
        self.traffic.close()
        await self.corrections.stop()
        self.vehicles.close()
        if self._queue is not None:
            self._queue.close()
        for modem in self._modems:
            await modem.close()
        await self.services.close()
        if self._silences is not None:
            self._silences.close()
        self.station.close()
        if self._feed_file is not None:
            self._feed_file.close()
        await self.links.close()
        if self._recording is not None:
            self._recording.close()
        self.events.store.close()

    def _warn(self, text: str) -> None:
        self.station.note("", Severity.WARNING, text)

    def _kept_in(self, folder: Path, file: str) -> Path:
        return folder / f"{self.setup.name}-{file}"

    def _link_context(self, report: Callable[[str], None]) -> LinkContext:
        tap = (lambda _: None) if self._recording is None else self._recording.frame
        return LinkContext(
            loop=self.loop,
            exchange=self.exchange,
            topics=self.topics,
            boot=self.setup.boot,
            system=self.setup.system,
            name=self.setup.name,
            report=report,
            undelivered=self.station.client.undelivered,
            tap=tap,
        )

    def _begin_silences(self) -> SilenceFile | None:
        folder = self.setup.record
        return None if folder is None else SilenceFile(self._kept_in(folder, SILENCES), self.station, self.loop)

    def _begin_recording(self) -> SessionRecording | None:
        """The logs of this session; without a place for them the station works all the same, and says so."""
        if self.setup.record is None:
            return None
        try:
            return SessionRecording(
                self.setup.record, Clock(self.loop), self.loop, self.topics, self.station.id, self._warn
            )
        except Gloc3Error as error:
            self._warn(str(error))
            return None
