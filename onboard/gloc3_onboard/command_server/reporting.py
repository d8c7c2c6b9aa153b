"""Reports to the stations: summaries, events and contacts, sent once their content is on disk."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup, Result
from gloc3.messages.command_interface import CiReply
from gloc3.messages.envelope import Event, Message, Severity
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.summaries import (
    CiEvent,
    ComponentTable,
    ComponentTrouble,
    ContactSummary,
    MissionSummary,
    Summary,
    VehicleSummary,
)
from gloc3.messages.vehicle import GeoFence, Home, MotionLimits
from gloc3_onboard.command_server.authority import AuthorityPorts, ControlAuthority
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.mission_host import MissionHost
from gloc3_onboard.command_server.observing import Observing
from gloc3_onboard.command_server.site import Mark, ServerSettings, Site
from gloc3_onboard.command_server.summaries import (
    geofence_of,
    mission_summary,
    motion_limits,
    motion_summary,
    site_summary,
    vehicle_summary,
)

COMPARE_S: Final = 0.2
"""Period at which summaries are compared with the last ones while nothing is requested, s."""
AT_ONCE_S: Final = 0.02
"""A disk that is done so soon is waited for in the cycle itself; no setpoint is late for that."""
LONGEST_S: Final = 1.0
"""Longest delay of a report for a slow disk, s."""
REPORTED_EVENTS: Final = (CiReply, CiEvent, MissionSummary)


class ReportingPorts(PortGroup):
    """Inputs and outputs of the reports."""

    event = Input(Event, Keep.ALL, depth=256)

    summary = Output(Summary)
    table = Output(ComponentTable)
    trouble = Output(ComponentTrouble)
    vehicle = Output(VehicleSummary)
    motion = Output(MotionSummary)
    whereabouts = Output(SiteSummary)
    mission = Output(MissionSummary)
    ci_event = Output(CiEvent)
    contact = Output(ContactSummary)
    limits = Output(MotionLimits)
    home = Output(Home)
    geofence = Output(GeoFence)


class EventQueue:
    """Events waiting to be sent to stations."""

    def __init__(self, site: Site) -> None:
        self.now_s = 0.0
        """The time of the cycle."""
        self._reports = site.reports
        self._events: list[CiEvent] = []

    def report(self, severity: Severity, text: str, /, source: str = "mission", *, cause: str = "") -> None:
        """Adds an event of this server."""
        self.add(CiEvent(severity=severity, source=source, text=text, t_s=self.now_s, cause=cause))

    def report_supervision(self, severity: Severity, text: str, /, *, cause: str = "") -> None:
        """Adds an event of the supervision."""
        self.report(severity, text, "supervision", cause=cause)

    def add(self, event: CiEvent) -> None:
        """Adds an event."""
        self._events.append(event)

    def take(self) -> list[CiEvent]:
        """The events since the last time, numbered and kept."""
        events, self._events = self._events, []
        return [self._reports.add(event) for event in events]


class Reporting:
    """Makes the reports, and holds them back until their causes are on disk.

    Args:
        site: the platform and its files.
        settings: the server's settings.
        events: queue of events.
        contacts: stations in contact.
    """

    def __init__(self, site: Site, settings: ServerSettings, events: EventQueue, contacts: Contacts) -> None:
        self._site, self._settings, self._events, self._contacts = site, settings, events, contacts
        self._reports = ReportQueue()
        self._held_back = HeldBack(site)
        self._compared_s = -math.inf
        self._unkept = site.problems()
        """Last reported storage problems."""
        for problem in filter(None, (site.problem, *self._unkept)):
            events.report(Severity.ERROR, problem)

    def observe(self, now_s: float, inbox: Inbox) -> None:
        """Takes in which stations are reached, and components' events."""
        for received in inbox.new(AuthorityPorts.heard):
            if received.payload.is_reached:
                self._contacts.note_contact(received.payload.station, now_s)
        for envelope in inbox.new(ReportingPorts.event):
            event = envelope.payload
            if event.severity <= self._settings.event_severity:
                component = envelope.source.component
                kept = CiEvent(
                    severity=event.severity, source=component, text=event.text, t_s=envelope.t_s, cause=event.cause
                )
                self._events.add(kept)

    def repeat_all(self) -> None:
        """Reports everything again, for a new station."""
        self._reports.invalidate("site")

    def report(
        self, now_s: float, observing: Observing, control: ControlAuthority, host: MissionHost, *, is_eventful: bool
    ) -> list[Result]:
        """The reports of this cycle.

        Args:
            now_s: the time.
            observing: state of the components and the vehicle.
            control: holder of control.
            host: the mission host.
            is_eventful: whether the server or its executor has handled a request.
        """
        platform, snapshot, reports, settings = self._site.platform, observing.snapshot, self._reports, self._settings
        results: list[Result] = [*self._contact(now_s, observing, host), *observing.book.new_problems()]
        results += self._events.take()
        is_slow = reports.is_due("slow", 1.0, now_s)
        if is_slow:
            self._report_what_is_not_kept()
        if is_slow or is_eventful or now_s - self._compared_s >= COMPARE_S - 1e-6:
            self._compared_s = now_s
            results += self._changes(observing, control, host, is_slow=is_slow)
        if reports.is_due("grant", settings.grant_period_s, now_s):
            results.append(host.granted)
        if reports.is_due("summary", settings.summary_period_s, now_s):
            vehicle = vehicle_summary(platform, snapshot, now_s, is_operators=host.is_operators)
            results += [observing.book.summary(observing.health, now_s), vehicle]
        if reports.is_due("motion", settings.motion_period_s, now_s):
            motion = motion_summary(platform, snapshot, now_s)
            results += [] if motion is None else [motion]
        if reports.is_due("site", settings.site_period_s, now_s):
            position = site_summary(platform, snapshot)
            results += [] if position is None else [position]
        return results

    def release(self, results: Sequence[Result], now_s: float) -> list[Result]:
        """Reports that may be sent now, of this and earlier cycles."""
        return self._held_back.pass_on(results, now_s)

    def _report_what_is_not_kept(self) -> None:
        """Reports a full or broken disk: the flight continues, but a restart would find an older state."""
        problems = [*self._site.problems(), *filter(None, [self._held_back.problem])]
        for problem in problems:
            if problem not in self._unkept:
                self._events.report(Severity.ERROR, f"{problem}; a restart would know an older state")
        if self._unkept and not problems:
            self._events.report(Severity.NOTICE, "the state is written to disk again")
        self._unkept = problems

    def _contact(self, now_s: float, observing: Observing, host: MissionHost) -> list[ContactSummary]:
        """First reports for a station after a silence; without contact, the state is stored from time to time."""
        contacts = self._contacts
        is_silent = observing.snapshot.is_airborne and contacts.is_alone(now_s)
        if not contacts.has_reports and not contacts.is_due(now_s, is_silent=is_silent):
            return []
        vehicle = vehicle_summary(self._site.platform, observing.snapshot, now_s, is_operators=host.is_operators)
        mission = mission_summary(host.executor, host.counts)
        if is_silent:
            self._events.add(contacts.status(vehicle, mission, now_s))
        wrong = [str(condition) for condition in host.executor.board.conditions] if host.executor is not None else []
        return contacts.collect(observing.health, vehicle, mission, wrong, now_s)

    def _changes(
        self, observing: Observing, control: ControlAuthority, host: MissionHost, *, is_slow: bool
    ) -> list[Result]:
        """Reports sent on change and once a second."""
        results: list[Result] = []
        reports, snapshot = self._reports, observing.snapshot
        if not host.is_mission_unknown:
            results += reports.of(mission_summary(host.executor, host.counts), is_due=is_slow)
            results += reports.of(geofence_of(self._site.platform, host.executor), is_due=is_slow)
        results += reports.of(control.state(), is_due=is_slow)
        results += reports.of(observing.book.table(), is_due=False)
        results += reports.of(motion_limits(self._site.platform, snapshot, host.executor), is_due=is_slow)
        if is_slow and snapshot.home is not None:
            results.append(Home(position_ned_m=snapshot.home.position_ned_m))
        return results


class ReportQueue:
    """Keeps when each report was last sent."""

    def __init__(self) -> None:
        self._at_s: dict[str, float] = {}
        self._last: dict[type, Message] = {}

    def is_due(self, what: str, period_s: float, now_s: float) -> bool:
        """Whether a period has passed since the last time."""
        if now_s - self._at_s.get(what, -math.inf) < period_s - 1e-6:
            return False
        self._at_s[what] = now_s
        return True

    def of(self, message: Message, *, is_due: bool) -> Sequence[Message]:
        """The message, if it is due or differs from the last one of its type."""
        if not is_due and self._last.get(type(message)) == message:
            return ()
        self._last[type(message)] = message
        return (message,)

    def invalidate(self, what: str) -> None:
        """Makes a report due again, for a new station."""
        self._last.clear()
        self._at_s.pop(what, None)


class _Held(NamedTuple):
    mark: Mark
    until_s: float
    results: Sequence[Result]


class HeldBack:
    """Holds replies, events and the mission's state back until their causes are on disk.

    Args:
        site: the platform's files.
    """

    def __init__(self, site: Site) -> None:
        self.problem = ""
        """Reason why a report was sent before its cause was stored; empty if none."""
        self._site = site
        self._held: deque[_Held] = deque()

    def pass_on(self, results: Sequence[Result], now_s: float) -> list[Result]:
        """Reports that may be sent now, of this and earlier cycles."""
        reported = [result for result in results if isinstance(result, REPORTED_EVENTS)]
        if reported:
            self._held.append(_Held(self._site.mark(), now_s + LONGEST_S, reported))
        passed: list[Result] = []
        timeout_s = AT_ONCE_S if len(self._held) == 1 and reported else 0.0
        while self._held:
            held = self._held[0]
            is_kept = self._site.wait(held.mark, timeout_s)
            if not is_kept and now_s < held.until_s:
                break
            self.problem = "" if is_kept else "the disk takes more than a second for each write"
            passed += self._held.popleft().results
        return [*passed, *(result for result in results if not isinstance(result, REPORTED_EVENTS))]
