"""A base station: its fleet's snapshot and its command client, on one exchange."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, Final

import msgspec

from gloc3.clock import Clock, passed
from gloc3.exchange.acoustic import AcousticSummary
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.messages.command_interface import Control, ControlVerb, Elsewhere, Hello, Outcome, ReadReports
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.motion import MotionSummary
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.software import own_software
from gloc3.messages.summaries import CiEvent, ContactSummary, MissionSummary
from gloc3.messages.vehicle import ObstacleScan
from gloc3.network.regions import topic_of as region_topic
from gloc3.network.rights import MemberRights
from gloc3.terrain import Terrain
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_groundstation.station.event_feed import EventFeed, FeedEvent, with_age
from gloc3_groundstation.station.fleet_monitor import FleetMonitor
from gloc3_groundstation.station.neighbours import NeighbourRelay
from gloc3_groundstation.station.regions import receive_region
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

RIGHTS_EVERY_S: Final = 10.0
HELLO_EVERY_S: Final = 3.0
NOTIFY_PERIOD_S: Final = 1.0
NOTIFY_FOR_S: Final = 120.0
"""How long an onboard process that is back is told what it has missed: longer than it takes to know its mission again."""

Listener = Callable[[Fleet, Fleet, float], None]
"""Called with the fleet before a change, the fleet after it, and the time."""


class Relay:
    """Relays the progress of a mission among the platforms in our control, as soon as anything is heard of one.

    What is not heard here is not passed on: a platform that falls silent does so for all.
    """

    def __init__(self, client: CommandClient) -> None:
        self._client: Final = client

    def pass_on(self, name: str, mission: MissionSummary, fleet: Fleet) -> None:
        """Forwards a platform's progress.

        Args:
            name: the platform.
            mission: its report.
            fleet: the present snapshot.
        """
        if not mission.digest:
            return
        for other in fleet:
            if other.name != name and self._waits_for(other, name, mission.digest):
                assert other.mission is not None
                theirs = [task for task, whose in other.mission.value.elsewhere.items() if whose == name]
                states = {task: mission.tasks[task] for task in theirs if task in mission.tasks}
                body = Elsewhere(platform=name, digest=mission.digest, state=mission.state, tasks=states)
                self._client.send(other.name, body)

    def _waits_for(self, platform: PlatformSnapshot, name: str, digest: str) -> bool:
        if platform.mission is None or platform.control is None:
            return False
        mission, holder = platform.mission.value, platform.control.value.holder
        return holder == self._client.station and mission.digest == digest and name in mission.elsewhere.values()


class Station:
    """Keeps the fleet's snapshot up to date and requests missing parts."""

    def __init__(
        self,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        station: str,
        boot: int,
        feed: EventFeed | None = None,
    ) -> None:
        """Creates a station; see `CommandClient` for the arguments.

        Args:
            exchange: reaches the platforms.
            loop: the event loop, for time and timers.
            station: the station's id.
            boot: a random number for this start of the station.
            feed: events that an earlier life of the station has shown; None without one.
        """
        self.fleet = Fleet(utc_offset_s=Clock(loop).utc_offset_s)
        self.client: Final = CommandClient(exchange, loop, station, boot)
        self.monitor: Final = FleetMonitor(exchange, loop, self.client)
        """Watches topics of platforms, as long as the station has a viewer for them."""
        self.now_s: Final[Callable[[], float]] = loop.time
        self.started_s: Final = loop.time()
        self.round_trip_s: Callable[[str], float | None] = lambda _: None
        """Round-trip time to a platform, s; set by the owner of the links."""
        self.terrain: Terrain | None = None
        """Heights of the ground, for missions and their profiles; set by the assembly, None without tiles."""
        self._loop = loop
        self._listeners: list[Listener] = []
        self._tasks: set[asyncio.Task[Any]] = set()
        self._relay = Relay(self.client)
        self._neighbours = NeighbourRelay(self.client)
        self.feed: Final = feed or EventFeed()
        """Up to where the events of each platform have been shown."""
        self._requested_s: dict[str, float] = {}
        self._untold: dict[str, str] = {}
        """What was commanded to the autopilots of silent onboard processes."""
        self.is_member = False
        """Whether platforms have rights for this station: it is a member of a network; set by the assembly."""
        self._rights_s: dict[str, float] = {}
        """When each platform is asked for the rights again."""
        self._unsubscribes: list[Unsubscribe] = [
            exchange.subscribe(f"*/{topic}", self._receive) for topic in reducers.CONTACT_TOPICS
        ]
        self._unsubscribes.append(exchange.subscribe("*/acoustic", self._receive_acoustic))
        self._unsubscribes.append(exchange.subscribe(region_topic("*"), self._receive_region))
        self._unsubscribes.append(self.monitor.listen(self._receive_watched))

    @property
    def id(self) -> str:
        """Id under which platforms know this station, such as `255`."""
        return self.client.station

    def listen(self, listener: Listener) -> Unsubscribe:
        """Registers a listener for all changes of the fleet, in order."""
        self._listeners.append(listener)

        def unlisten() -> None:
            if listener in self._listeners:  # else it was called before
                self._listeners.remove(listener)

        return unlisten

    def note(self, platform: str, severity: Severity, text: str) -> None:
        """Adds an event of the station's own."""
        now_s = self.now_s()
        self._change(reducers.note(self.fleet, platform, severity, text, now_s), now_s)

    def change(self, reduce: Callable[[Fleet, float], Fleet]) -> None:
        """Applies a change from a source other than the exchange.

        Args:
            reduce: computes the new fleet from the previous one and the time; the same object where nothing changes.
        """
        now_s = self.now_s()
        fleet = reduce(self.fleet, now_s)
        if fleet is not self.fleet:
            self._change(fleet, now_s)

    def close(self) -> None:
        """Stops receiving and requesting; platforms are left to their policies."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()
        for task in list(self._tasks):
            task.cancel()
        self.monitor.close()
        self.client.close()

    def notify_when_back(self, name: str, command: str) -> None:
        """Has an onboard process told, as soon as it is heard again, what was commanded to its autopilot meanwhile.

        Args:
            name: of the platform.
            command: the last one, in words; it takes the place of those before.
        """
        platform = self.fleet.get(name)
        is_back = platform is not None and not platform.is_quiet_link(self.now_s())
        if is_back:  # before the autopilot has answered
            self._start(self._notify(name, command))
        else:
            self._untold[name] = command

    async def _notify(self, name: str, command: str) -> None:
        """Tells it until it is accepted: a process that has just started takes some seconds to know its mission."""
        until_s = self.now_s() + NOTIFY_FOR_S
        while True:
            reply = await self.client.request(name, Control(verb=ControlVerb.OPERATED, command=command))
            if reply.outcome is Outcome.ACCEPTED:
                return
            if self.now_s() > until_s:
                text = f"was not told of the command {command!r} to its autopilot ({reply.reason})"
                self.note(name, Severity.WARNING, f"{text}: it takes it for a pilot's")
                return
            await passed(NOTIFY_PERIOD_S)

    def _receive(self, envelope: Envelope[Any]) -> None:
        now_s = self.now_s()
        name = envelope.topic.partition("/")[0]
        before = self.fleet.get(name)
        if before is not None and before.is_quiet_link(now_s):
            self.feed.note_contact(name, now_s)
            if (untold := self._untold.pop(name, None)) is not None:
                self._start(self._notify(name, untold))
        self._change(reducers.receive(self.fleet, envelope, now_s), now_s)
        if isinstance(envelope.payload, CiEvent) and envelope.payload.number:
            self._show(name, self.feed.event(name, envelope.payload, now_s))
        elif isinstance(envelope.payload, ContactSummary):
            self._add_platform(name, envelope.payload)
        self._show(name, self.feed.release(name, now_s))
        self._request_events(name, now_s)
        if isinstance(envelope.payload, MotionSummary):
            self._neighbours.pass_on(name, self.fleet, now_s, self.round_trip_s)
        if isinstance(envelope.payload, MissionSummary):
            self._relay.pass_on(name, envelope.payload, self.fleet)
        platform = self.fleet.get(name)
        if platform is not None and platform.is_incomplete and now_s >= self._requested_s.get(name, 0.0):
            self._requested_s[name] = now_s + HELLO_EVERY_S
            self._start(self.client.request(name, Hello(**own_software()._asdict()), HELLO_EVERY_S))
        if self.is_member and now_s >= self._rights_s.get(name, 0.0):
            self._rights_s[name] = now_s + RIGHTS_EVERY_S
            self._start(self._request_rights(name))

    def _receive_region(self, envelope: Envelope[Any]) -> None:
        self.change(lambda fleet, now_s: receive_region(fleet, envelope, now_s))

    async def _request_rights(self, name: str) -> None:
        """Requests what this station may do, and tells changes."""
        reply = await self.client.request(name, Hello(is_about_rights=True), RIGHTS_EVERY_S)
        platform = self.fleet.get(name)
        if reply.outcome is not Outcome.ACCEPTED or platform is None:
            return
        rights = msgspec.convert(reply.result, MemberRights)
        if rights.roles != platform.rights.roles:
            self.note(name, Severity.NOTICE, f"this station is {wording.roles(rights)}")
        self.change(lambda fleet, _: reducers.with_rights(fleet, name, rights))

    def _add_platform(self, name: str, contact: ContactSummary) -> None:
        """Shows the summary first, then the events since the last contact."""
        events, missed = self.feed.contact(name, contact), self.feed.missing(name)
        if contact.station == self.id and (contact.silent_s >= 0.0 or missed):
            self.note(name, Severity.NOTICE, wording.contact(contact, len(events) + missed))
        self._show(name, events)

    def _show(self, name: str, events: Sequence[FeedEvent]) -> None:
        """Notes events of a platform, in their order."""
        for event in events:
            text = with_age(event, wording.duration(event.age_s))
            now_s = self.now_s()
            fleet = reducers.note(self.fleet, name, event.severity, text, now_s, source=event.source, cause=event.cause)
            self._change(fleet, now_s)

    def _request_events(self, name: str, now_s: float) -> None:
        """Asks a platform for the events that are missing here."""
        wanted = self.feed.wanted(name, now_s)
        if wanted is not None:
            self._start(self._fetch(name, wanted))

    async def _fetch(self, name: str, wanted: ReadReports) -> None:
        while True:
            reply = await self.client.request(name, wanted)
            platform, now_s = self.fleet.get(name), self.now_s()
            vehicle = platform.vehicle if platform is not None else None
            platform_s = None if vehicle is None else vehicle.value.t_s + vehicle.age_s(now_s)
            self._show(name, self.feed.answered(name, wanted, reply, platform_s))
            more = self.feed.wanted(name, now_s)
            if more is None:
                return
            wanted = more

    def _receive_acoustic(self, envelope: Envelope[AcousticSummary]) -> None:
        name, now_s = envelope.topic.partition("/")[0], self.now_s()
        self._change(reducers.by_sound(self.fleet, name, envelope.payload, now_s), now_s)

    def _receive_watched(self, _: str, envelope: Envelope[Any]) -> None:
        """Stores watched obstacles and the map of a vehicle in its snapshot, for the station's map."""
        if isinstance(envelope.payload, ObstacleScan | OccupancyMap):
            now_s = self.now_s()
            self._change(reducers.receive(self.fleet, envelope, now_s), now_s)

    def _change(self, fleet: Fleet, now_s: float) -> None:
        before, self.fleet = self.fleet, fleet
        for listener in tuple(self._listeners):
            listener(before, fleet, now_s)

    def _start(self, work: Coroutine[Any, Any, Any]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
