"""The operator's desk: available requests to a platform, and sending them with the outcome as an event."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from enum import StrEnum
from typing import Final

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import EmergencyVerb, Verb
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Cause
from gloc3.mission.model.states import ENDED, ActionState, allowed
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.autopilot_desk import AutopilotDesk
from gloc3_groundstation.desk.component_desk import ComponentDesk
from gloc3_groundstation.desk.events_desk import EventsDesk
from gloc3_groundstation.desk.fleet_desk import FleetDesk, LinkStore
from gloc3_groundstation.desk.flights import End, FarAway, Follower
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.desk.preflight_desk import PreflightDesk
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.desk.vehicle_commands import VehicleCommands
from gloc3_groundstation.joysticks.mapping import JoystickMapping
from gloc3_groundstation.missions.first_waypoint import far_away
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.plug_ins import PlugIns
from gloc3_groundstation.shared_missions.crew_desk import CrewDesk
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.alerts import Alerts
from gloc3_groundstation.station.snapshots import FleetEvent, PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.contact_queue import ContactQueue

PRESSED_AGAIN_S: Final = 20.0
"""A press of the emergency key within this time after an emergency command offers more than hold."""


class Move(StrEnum):
    """A request that the operator can make."""

    STREAM = "stream"
    CONTROL = "control"
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"


class Order(StrEnum):
    """A command to a selection of vehicles."""

    HOLD = "hold"
    PAUSE = "pause"
    RESUME = "resume"
    LAND = "land"
    START = "start"


class Desk:
    """Sends the operator's requests to one platform at a time; refusals become events, never exceptions."""

    def __init__(
        self,
        station: Station,
        plan: CheckedPlan | None = None,
        *,
        events: EventsDesk | None = None,
        services: ServicesDesk | None = None,
        links: LinkStore | None = None,
        queue: ContactQueue | None = None,
        author: str = "",
    ) -> None:
        """Creates a desk.

        Args:
            station: receives from and commands the platforms.
            plan: the selected mission, checked; None without one.
            events: stores the station's events; None to keep them in memory only.
            services: services of the vehicles' autopilots; None for a station without links.
            links: the station's links; None without any.
            queue: stores missions for the next contact; None to keep them in memory only.
            author: the operator's name, for logged actions.
        """
        self.station: Final = station
        self.events: Final = events or EventsDesk(station)
        self.fleet: Final = FleetDesk(station, links)
        self.missions: Final = MissionDesk(station, plan)
        self.crew: Final = CrewDesk(station, self.missions)
        """Missions whose tasks are for any platform."""
        self.components: Final = ComponentDesk(station)
        self.services: Final = services or ServicesDesk(station)
        self.autopilots: Final = AutopilotDesk(station, self.services)
        """Commands vehicles without a companion, or with a silent one."""
        self.commands: Final = VehicleCommands(station, self.autopilots, self.missions)
        """Commands of a script, each awaited until it is done."""
        self.plug_ins: Final = PlugIns(lambda text: station.note("", Severity.WARNING, text))
        self.preflight: Final = PreflightDesk(station)
        self.queue: Final = queue or ContactQueue(station)
        """Missions that wait for the next contact."""
        self._author = author
        self.gamepad = ""
        """The device of a joystick; empty for every joystick."""
        self.joysticks: dict[str, JoystickMapping] = {}
        """Mappings of joysticks, by the key of the device."""
        self.keep: Callable[[], bool] = lambda: False
        """Writes the configuration file; returns whether it could be written."""
        self._streamed: dict[str, tuple[int, str]] = {}
        self._far_ok: set[tuple[str, str]] = set()
        """Platforms and missions whose distance the operator has confirmed."""
        self._emergencies: dict[str, tuple[EmergencyVerb, float]] = {}
        """The last emergency command to each vehicle, and when it was given."""
        self._alerts = Alerts()

    @property
    def plan(self) -> CheckedPlan | None:
        """The selected mission; None without one, or while it must not fly."""
        return self.missions.plan

    def alerts(self) -> Alerts:
        """The current alerts."""
        before, self._alerts = self._alerts, self._updated()
        for alert in alerts.began(self._alerts, before, Cause.LINK):  # of all else the vehicle itself tells an event
            self.station.note(alert.platform, Severity.NOTICE, alert.text)
        return self._alerts

    def _updated(self) -> Alerts:
        fleet, now_s = self.station.fleet, self.station.now_s()
        return alerts.update(self._alerts, fleet, now_s, self.plug_ins.causes(fleet, now_s))

    def acknowledge(self, key: tuple[str, str] | None = None) -> None:
        """Acknowledges one alert, or all."""
        self._alerts = alerts.acknowledge(self._alerts, key)

    def dismiss(self, refusal: FleetEvent) -> None:
        """Ends the display of a refusal."""
        self._alerts = alerts.dismiss(self._alerts, refusal)

    def moves(self, platform: PlatformSnapshot) -> frozenset[Move]:
        """Actions that make sense in the platform's present state; none for a vehicle without a GLOC3 companion."""
        if not platform.has_companion:
            return frozenset()
        holds_control = platform.control is not None and platform.control.value.holder == self.station.id
        found = set() if holds_control else {Move.CONTROL}
        mission = platform.mission.value if platform.mission is not None else None
        state = mission.state if mission is not None else ""
        is_running = state in (ActionState.RUNNING, ActionState.PAUSED)
        if self.plan is not None and not is_running:
            found |= {Move.STREAM, Move.START}
        if self.plan is not None and self._is_silent(platform.name):  # it waits for contact
            found.add(Move.STREAM)
        if state in list(ActionState):
            found |= {Move(verb.value) for verb in allowed(ActionState(state)) if verb.value in list(Move)}
        return frozenset(found)

    def has_streamed(self, platform: PlatformSnapshot) -> bool:
        """Whether the selected mission has been sent to this life of the platform."""
        return self.plan is not None and self._streamed.get(platform.name) == (platform.boot, self.plan.text)

    def mission_to_start(self, platform: PlatformSnapshot) -> str:
        """Name of the mission that a start would fly: the selected one, else the one onboard, with a remark."""
        if self.plan is not None:
            return self.plan.title
        name = platform.mission.value.name if platform.mission is not None else ""
        return name if self.missions.draft is None else f"{name}, as loaded onboard (the open one has errors),"

    async def make(self, name: str, move: Move) -> None:
        """Asks a platform for something."""
        match move:
            case Move.STREAM:
                await self.stream(name)
            case Move.CONTROL:
                await self.request_control(name)
            case Move.START:
                await self.start(name)
            case Move.PAUSE | Move.RESUME | Move.ABORT:
                await self.steer(name, Verb(move.value))

    async def stream(self, name: str) -> bool:
        """Takes control and sends the selected mission."""
        plan = self.plan
        if plan is None:
            return False
        for one in self.crew_of(name):
            if self._is_silent(one):
                self.queue.add(one, plan)
                continue
            if not await self._do(one, "stream", self._send(one, plan)):
                return False
            platform = self.station.fleet.get(one)
            if platform is not None:
                self._streamed[one] = platform.boot, plan.text
        return True

    async def _send(self, name: str, plan: CheckedPlan) -> None:
        try:
            await flights.stream(self.station, name, plan, is_far_ok=(name, plan.text) in self._far_ok)
        except FarAway as refusal:
            raise FarAway(f"{refusal}; the key u asks whether to upload it all the same") from None

    def far_away(self, name: str, move: Move) -> str:
        """Says that the mission that a move would send begins kilometres from its vehicle; else empty."""
        plan = self.plan
        if plan is None or move not in (Move.STREAM, Move.START):
            return ""
        for one in self.crew_of(name):
            is_sent = move is Move.STREAM or self._needs_streaming(one)
            is_asked = is_sent and (one, plan.text) not in self._far_ok
            if is_asked and (distance := far_away(plan.text, plan.title, self.station.fleet.get(one))):
                return distance
        return ""

    def allow_far(self, name: str) -> None:
        """Confirms the distance of the selected mission."""
        if self.plan is not None:
            self._far_ok |= {(one, self.plan.text) for one in self.crew_of(name)}

    def _is_silent(self, name: str) -> bool:
        """Whether a platform that was in contact is silent."""
        platform = self.station.fleet.get(name)
        return platform is not None and platform.is_quiet_link(self.station.now_s())

    def crew_of(self, name: str) -> tuple[str, ...]:
        """Platforms that a start of the selected mission starts: those that it names, or the one selected for it."""
        return (self.plan.platforms if self.plan is not None else ()) or (name,)

    async def start(self, name: str, override: str = "") -> dict[str, Follower]:
        """Starts the mission; the selected one is sent first if it has not been sent, or has been flown.

        Args:
            name: the platform.
            override: reason to start although checks have failed; empty to refuse then.
        """
        crew = self.crew_of(name)
        for one in filter(self._is_silent, crew):
            text = "start: the vehicle is out of contact, and a start is never queued; u queues the mission for contact"
            self.station.note(one, Severity.ERROR, text)
            return {}
        if self.plan is not None and any(self._needs_streaming(one) for one in crew):
            if not await self.stream(name):
                return {}
        else:
            for one in crew:
                if not await self.request_control(one):
                    return {}
        followers: dict[str, Follower] = {}

        async def begin() -> None:
            followers.update(await flights.start_all(self.station, crew, override, self._author if override else ""))

        if await self._do(name, "start", begin()):
            self.crew.watch(self.plan, followers)
        for one in crew:
            self.preflight.invalidate(one)
        return followers

    def _needs_streaming(self, name: str) -> bool:
        platform = self.station.fleet.get(name)
        state = platform.mission.value.state if platform is not None and platform.mission is not None else ""
        return platform is not None and (state in ENDED or not self.has_streamed(platform))

    async def await_contact(self, plan: CheckedPlan, platform: str | None) -> str:
        """Waits for contact with the platforms that a mission goes to.

        Args:
            plan: the mission.
            platform: the one that the operator has named; None for that of the mission, else the only one in contact.

        Returns:
            The first of them; empty where several are in contact and none is named.
        """
        if plan.unassigned:
            return next(iter(await flights.await_platforms(self.station)))
        try:
            names = [await flights.await_platform(self.station, one) for one in flights.addressed(plan, platform)]
        except Refused as refusal:
            text = f"{plan.title!r} is not uploaded: {refusal}, or show one with v: u uploads it there"
            self.station.note("", Severity.ERROR, text)
            return ""
        return names[0]

    async def bring(self, name: str) -> bool:
        """Sends the selected mission as soon as the platform is ready for one."""
        for one in self.crew_of(name):
            missing = await flights.await_ready(self.station, one)
            if missing:
                self.station.note(one, Severity.WARNING, f"it still lacks {', '.join(missing)}")
        return await self.stream(name)

    async def fly(self, name: str) -> End | None:
        """Sends the selected mission, starts it and follows it to its end; None where it could not start."""
        if not await self.bring(name):
            return None
        followers = await self.start(name)
        return await flights.follow_all(self.station, followers) if followers else None

    async def request_control(self, name: str) -> bool:
        """Asks for control."""
        return await self._do(name, "control", flights.request_control(self.station, name))

    async def steer(self, name: str, verb: Verb) -> bool:
        """Pauses, resumes or aborts the mission."""

        async def request() -> None:
            await flights.request_control(self.station, name)
            await self.station.client.steer(name, verb)
            self.station.note(name, Severity.INFO, f"{verb}: accepted")

        return await self._do(name, verb.value, request())

    def armed_in_our_control(self) -> list[str]:
        """The platforms that would miss this station."""
        return [
            platform.name
            for platform in self.station.fleet
            if platform.is_armed and platform.control is not None and platform.control.value.holder == self.station.id
        ]

    def last_emergency(self, name: str) -> EmergencyVerb | None:
        """The emergency command that this platform has just been given, so that a further press means more."""
        verb, given_s = self._emergencies.get(name, (None, 0.0))
        return verb if self.station.now_s() - given_s < PRESSED_AGAIN_S else None

    async def emergency(self, name: str, verb: EmergencyVerb, confirmation: str = "") -> bool:
        """Requests hold, land or disarm, regardless of the holder of control."""
        platform = self.station.fleet.get(name)
        if verb is EmergencyVerb.HOLD or self.last_emergency(name) is not None:  # else not chosen by the key
            self._emergencies[name] = verb, self.station.now_s()
        self.station.note(name, Severity.NOTICE, f"emergency {verb}")
        if platform is not None and self.autopilots.is_its_own(platform):
            return await self.autopilots.emergency(platform, verb)
        work = self.station.client.emergency(name, verb, confirmation)
        return await self._do(name, f"emergency {verb}", work)

    async def order(self, names: Sequence[str], order: Order) -> list[str]:
        """Asks the same of several vehicles at once, each crew of a mission as one; returns those that accepted it."""
        crews = list(dict.fromkeys(self.crew_of(name) if order is Order.START else (name,) for name in names))
        names = [name for crew in crews for name in crew]

        async def one(name: str) -> bool:
            match order:
                case Order.HOLD | Order.LAND:
                    return await self.emergency(name, EmergencyVerb(order.value))
                case Order.PAUSE | Order.RESUME:
                    return await self.steer(name, Verb(order.value))
                case Order.START:
                    return bool(await self.start(name))

        done = await asyncio.gather(*(one(crew[0]) for crew in crews))
        accepted = [name for crew, is_done in zip(crews, done, strict=True) if is_done for name in crew]
        if len(names) > 1:
            others = [name for name in names if name not in accepted]
            text = f"{order}: accepted by {len(accepted)} of {len(names)}" + (
                f", not {', '.join(others)}" * bool(others)
            )
            self.station.note("", Severity.WARNING if others else Severity.INFO, text)
        return accepted

    async def _do(self, name: str, what: str, work: Awaitable[None]) -> bool:
        try:
            await work
        except Gloc3Error as error:
            self.station.note(name, Severity.ERROR, f"{what}: {error}")
            return False
        return True
