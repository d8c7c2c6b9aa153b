"""Updates of a fleet's snapshot by messages: pure functions of snapshot, message and time."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from msgspec.structs import replace

from gloc3.clock import utc_text
from gloc3.exchange.acoustic import AcousticSummary
from gloc3.messages.command_interface import CiReply
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.hosts import HostNames, HostSummary
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import (
    CiEvent,
    ComponentTable,
    ComponentTrouble,
    ContactSummary,
    ControlState,
    MissionSummary,
    Summary,
    VehicleSummary,
)
from gloc3.messages.teleoperation import TeleoperationState
from gloc3.messages.vehicle import ObstacleScan
from gloc3.network.rights import MemberRights
from gloc3_groundstation.station.snapshots import (
    QUIET_LINK_S,
    Fleet,
    FleetEvent,
    LinkStatistics,
    PlatformSnapshot,
    ReportedSilence,
    Timed,
)

EVENTS_KEPT: Final = 500
SMOOTHING: Final = 0.05

CONTACT: Final = "contact"
CONTACT_TOPICS: Final = (
    *(name for name in TOPICS if name.startswith("ci/") and name != "ci/request"),
    CONTACT,
)
"""What a station listens to, below a platform's name."""
BESIDE: Final = ("ci/hosts", "ci/host_names", "ci/teleoperation")
"""Of these, topics that do not come from the command interface itself: their source is another component."""

FORMER_KEPT: Final = 3
LATE_MESSAGES: Final = 5
"""So many messages of a life that is over may come late."""
RESTARTED: Final = (
    "its onboard process has restarted: in flight it follows the mission's on_restart; look at mission and checks before "
    "it continues"
)
INTERFACE_RESTARTED: Final = (
    "its command interface has begun again; the onboard process and its other components have run on"
)
_COUNTED: Final = frozenset(name for name in CONTACT_TOPICS if TOPICS[name].rate_hz and name != "ci/motion")
"""Periodic topics: gaps in their sequences are losses, and a message older than the latest is dropped.

Motion is excluded because a slow link skips it on purpose.
"""


def receive(fleet: Fleet, envelope: Envelope[Any], now_s: float) -> Fleet:
    """The fleet after a message; one that is not for stations changes nothing.

    Args:
        fleet: the previous snapshot.
        envelope: the message, on a topic `PLATFORM/ci/...`, or a requested sample of another topic.
        now_s: the station's time.
    """
    reduce = _REDUCERS.get(type(envelope.payload))
    if reduce is None:
        return fleet
    name, _, topic = envelope.topic.partition("/")
    known, boot = fleet.get(name), envelope.source.boot
    if topic in BESIDE or (
        not topic.startswith("ci/") and topic != CONTACT
    ):  # of another component, with a boot of its own
        return fleet if known is None else with_platform(fleet, reduce(known, envelope.payload, now_s))
    if known is None:
        platform = PlatformSnapshot(name=name, boot=boot, first_received_s=now_s, received_s=now_s, began_s=now_s)
        fleet = note(fleet, name, Severity.INFO, "is heard", now_s)
    elif not known.is_known:
        platform = replace(known, boot=boot, began_s=now_s)
        text = "is heard" + (f" again after {_silent(known, now_s)}" if known.silence is not None else "")
        fleet = note(fleet, name, Severity.NOTICE, text, now_s)
    elif known.boot != boot and boot in known.former and not known.is_quiet_link(now_s):
        return with_platform(fleet, _spoken_by_another(known, boot, now_s))
    elif known.boot != boot:
        platform = _restarted(known, boot, now_s)
        if not platform.former_process:  # it does not tell its process, or its table was still to come
            fleet = note(fleet, name, Severity.WARNING, RESTARTED, now_s)
    else:
        platform = known
        if known.is_quiet_link(now_s):
            platform = replace(known, began_s=now_s)
            fleet = note(fleet, name, Severity.NOTICE, f"is heard again after {_silent(known, now_s)}", now_s)
    if topic in _COUNTED:
        link = _counted(platform.link, topic, envelope.sequence)
        if link is None:
            return with_platform(fleet, replace(platform, received_s=now_s))
        platform = replace(platform, link=link)
    platform = reduce(replace(platform, received_s=now_s), envelope.payload, now_s)
    if isinstance(envelope.payload, ComponentTable) and platform.former_process:
        is_same = envelope.payload.process == platform.former_process
        severity, text = (Severity.NOTICE, INTERFACE_RESTARTED) if is_same else (Severity.WARNING, RESTARTED)
        fleet = note(fleet, name, severity, text, now_s)
        platform = replace(platform, former_process=0)
    if isinstance(envelope.payload, MissionSummary):
        platform = replace(platform, silence=_planned(platform, envelope, fleet.utc_offset_s, now_s))
    if isinstance(envelope.payload, CiEvent) and not envelope.payload.number:  # others have their turn: `EventFeed`
        event = envelope.payload
        fleet = note(fleet, name, event.severity, event.text, now_s, source=event.source, cause=event.cause)
    return with_platform(fleet, platform)


def by_sound(fleet: Fleet, name: str, summary: AcousticSummary, now_s: float) -> Fleet:
    """The fleet with an acoustic summary of a platform; on other links it stays silent."""
    known = fleet.get(name)
    if known is None:
        known = PlatformSnapshot(
            name=name, boot=0, first_received_s=now_s, received_s=now_s - QUIET_LINK_S, began_s=now_s
        )
        fleet = note(fleet, name, Severity.NOTICE, "is heard by acoustic modem only", now_s)
    return with_platform(fleet, replace(known, acoustic=Timed(summary, now_s)))


def remembered(fleet: Fleet, name: str, silence: ReportedSilence, received_s: float, now_s: float) -> Fleet:
    """The fleet with a platform whose planned silence had begun before the station was started."""
    known = PlatformSnapshot(
        name=name, boot=0, first_received_s=now_s, received_s=min(received_s, now_s - QUIET_LINK_S), silence=silence
    )
    fleet = note(
        fleet, name, Severity.NOTICE, f"was silent as planned ({silence.target}), due {silence.due_text}", now_s
    )
    return with_platform(fleet, known)


def note(
    fleet: Fleet, platform: str, severity: Severity, text: str, now_s: float, *, source: str = "", cause: str = ""
) -> Fleet:
    """The fleet with one more event; without a source it is the station's own."""
    number = fleet.event_count + 1
    event = FleetEvent(
        number=number,
        platform=platform,
        received_s=now_s,
        severity=severity,
        source=source,
        text=text,
        cause=cause,
    )
    return replace(fleet, events=(*fleet.events[1 - EVENTS_KEPT :], event), event_count=number)


def with_platform(fleet: Fleet, platform: PlatformSnapshot) -> Fleet:
    """The fleet with a platform as it is now; a new one comes last."""
    return replace(fleet, platforms={**fleet.platforms, platform.name: platform})


def with_rights(fleet: Fleet, name: str, rights: MemberRights) -> Fleet:
    """The fleet with what this station may do with a platform."""
    platform = fleet.get(name)
    return (
        fleet
        if platform is None or platform.rights == rights
        else with_platform(fleet, replace(platform, rights=rights))
    )


def without(fleet: Fleet, name: str) -> Fleet:
    """The fleet without a platform."""
    platforms = {key: platform for key, platform in fleet.platforms.items() if key != name}
    return replace(fleet, platforms=platforms, renamed={old: new for old, new in fleet.renamed.items() if old != name})


def renamed(fleet: Fleet, before: str, name: str, now_s: float) -> Fleet:
    """The fleet after a vehicle that was known by its autopilot only is known by another name, and that noted."""
    fleet = without(fleet, before)
    fleet = replace(fleet, renamed={**fleet.renamed, before: name})
    return note(fleet, name, Severity.INFO, f"was shown as {before} so far", now_s)


def _silent(platform: PlatformSnapshot, now_s: float) -> str:
    """Text for the length of a silence that has just ended, and whether it was planned."""
    text = f"{platform.age_s(now_s):.0f} s of silence"
    if platform.silence is None:
        return text
    late_s = now_s - platform.silence.due_s
    return text + (f", {late_s:.0f} s overdue" if late_s > 0.0 else ", as planned")


def _planned(
    platform: PlatformSnapshot, envelope: Envelope[Any], utc_offset_s: float, now_s: float
) -> ReportedSilence | None:
    """Planned silence in a mission summary, on the station's clock; computed once, so that it stays constant."""
    reported: MissionSummary = envelope.payload
    if not reported.silence:
        return None
    if platform.silence is not None and platform.silence.until_s == reported.silent_until_s:
        return platform.silence
    due_s = now_s + reported.silent_until_s - envelope.t_s
    text = f"{utc_text(due_s + utc_offset_s, '%H:%M:%S')} UTC"
    return ReportedSilence(target=reported.silence, until_s=reported.silent_until_s, due_s=due_s, due_text=text)


def _restarted(platform: PlatformSnapshot, boot: int, now_s: float) -> PlatformSnapshot:
    """The part of a platform's snapshot that stays valid after its command interface has restarted."""
    return PlatformSnapshot(
        name=platform.name,
        boot=boot,
        first_received_s=platform.first_received_s,
        received_s=now_s,
        began_s=now_s,
        former_process=platform.table.process if platform.table is not None else platform.former_process,
        vehicle=platform.vehicle,
        site=platform.site,
        link=replace(platform.link, sequences={}),
        autopilot=platform.autopilot,
        problems=platform.problems,
        former={**dict(list(platform.former.items())[-FORMER_KEPT:]), platform.boot: 0},
    )


def _spoken_by_another(platform: PlatformSnapshot, boot: int, now_s: float) -> PlatformSnapshot:
    """A life that is over has spoken: once it may be late, but then it is another platform of that name."""
    times = platform.former[boot] + 1
    former = {**platform.former, boot: times}
    return replace(platform, former=former, doubled_s=now_s if times > LATE_MESSAGES else platform.doubled_s)


def _counted(link: LinkStatistics, topic: str, sequence: int) -> LinkStatistics | None:
    """Statistics after a message; None where it is older than the last.

    A long summary comes in several messages of one sequence, each with different rows.
    """
    last = link.sequences.get(topic)
    if last is not None and sequence < last:
        return None
    if sequence == last:
        return link
    gap = 0 if last is None else sequence - last - 1
    kept = (1.0 - SMOOTHING) ** gap
    loss = (1.0 - (1.0 - link.loss) * kept) * (1.0 - SMOOTHING)
    return LinkStatistics(
        received=link.received + 1, lost=link.lost + gap, loss=loss, sequences={**link.sequences, topic: sequence}
    )


def _vehicle(platform: PlatformSnapshot, message: VehicleSummary, now_s: float) -> PlatformSnapshot:
    return replace(platform, vehicle=Timed(message, now_s))


def _motion(platform: PlatformSnapshot, message: MotionSummary, now_s: float) -> PlatformSnapshot:
    if platform.motion is not None and message.t_s < platform.motion.value.t_s:
        return platform
    return replace(platform, motion=Timed(message, now_s))


def _site(platform: PlatformSnapshot, message: SiteSummary, now_s: float) -> PlatformSnapshot:
    return replace(platform, site=Timed(message, now_s))


def _obstacles(platform: PlatformSnapshot, message: ObstacleScan, now_s: float) -> PlatformSnapshot:
    return replace(platform, obstacles=Timed(message, now_s))


def _map(platform: PlatformSnapshot, message: OccupancyMap, now_s: float) -> PlatformSnapshot:
    return replace(platform, map=Timed(message, now_s))


def _mission(platform: PlatformSnapshot, message: MissionSummary, now_s: float) -> PlatformSnapshot:
    return replace(platform, mission=Timed(message, now_s))


def _control(platform: PlatformSnapshot, message: ControlState, now_s: float) -> PlatformSnapshot:
    return replace(platform, control=Timed(message, now_s))


def _summary(platform: PlatformSnapshot, message: Summary, now_s: float) -> PlatformSnapshot:
    """Takes the lines over; those of a table that is not here are kept until the table comes."""
    platform = replace(platform, summary=Timed(message, now_s))
    lines = {**platform.lines, **{line.index: (line, now_s) for line in message.lines}}
    if platform.table is not None and platform.table.table != message.table:
        lines = {line.index: (line, now_s) for line in message.lines}
        return replace(platform, table=None, lines=lines, columns=message.columns)
    return replace(platform, lines=lines, columns=message.columns or platform.columns)


def _table(platform: PlatformSnapshot, message: ComponentTable, now_s: float) -> PlatformSnapshot:  # noqa: ARG001
    return replace(platform, table=message)


def _problem(platform: PlatformSnapshot, message: ComponentTrouble, now_s: float) -> PlatformSnapshot:  # noqa: ARG001
    return replace(platform, troubles={**platform.troubles, message.name: message})


def _contact(platform: PlatformSnapshot, message: ContactSummary, now_s: float) -> PlatformSnapshot:
    return replace(platform, contact=Timed(message, now_s))


def _hosts(platform: PlatformSnapshot, message: HostSummary, now_s: float) -> PlatformSnapshot:
    return replace(platform, hosts={**platform.hosts, **{line.index: (line, now_s) for line in message.lines}})


def _host_names(platform: PlatformSnapshot, message: HostNames, now_s: float) -> PlatformSnapshot:  # noqa: ARG001
    return replace(platform, host_names=message)


def _teleoperation(platform: PlatformSnapshot, message: TeleoperationState, now_s: float) -> PlatformSnapshot:
    return replace(platform, teleoperation=Timed(message, now_s))


def _received(platform: PlatformSnapshot, message: CiEvent | CiReply, now_s: float) -> PlatformSnapshot:  # noqa: ARG001
    return platform


_REDUCERS: Final[Mapping[type, Callable[[PlatformSnapshot, Any, float], PlatformSnapshot]]] = {
    VehicleSummary: _vehicle,
    MotionSummary: _motion,
    SiteSummary: _site,
    ObstacleScan: _obstacles,
    OccupancyMap: _map,
    TeleoperationState: _teleoperation,
    MissionSummary: _mission,
    ControlState: _control,
    Summary: _summary,
    ComponentTable: _table,
    ComponentTrouble: _problem,
    ContactSummary: _contact,
    HostSummary: _hosts,
    HostNames: _host_names,
    CiEvent: _received,
    CiReply: _received,
}
