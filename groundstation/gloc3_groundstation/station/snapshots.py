"""Immutable snapshots of a fleet as a station knows it, with the age of all data."""

from collections.abc import Iterator, Mapping
from typing import Final, Generic, TypeVar

import msgspec
from msgspec.structs import astuple

from gloc3.exchange.acoustic import AcousticSummary
from gloc3.messages.envelope import Kind, Message, Severity
from gloc3.messages.hosts import HostLine, HostNames
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.status_fields import ROW_FIELDS
from gloc3.messages.summaries import (
    ComponentLine,
    ComponentTable,
    ComponentTrouble,
    ContactSummary,
    ControlState,
    Health,
    MissionSummary,
    RegionSummary,
    Summary,
    VehicleLine,
    VehicleSummary,
)
from gloc3.messages.teleoperation import TeleoperationState
from gloc3.messages.vehicle import ObstacleScan
from gloc3.network.rights import MemberRights
from gloc3_groundstation.station.readings import Reading

M = TypeVar("M", bound=Message)

STALE_AFTER_S: Final[Mapping[type, float]] = {
    row.message: row.silent_after / row.rate_hz for row in TOPICS.values() if row.rate_hz
}
"""Age from which a message counts as stale, from the rate of its topic."""

ON_THE_GROUND: Final = ("unknown", "on_ground")
"""Landed states of a vehicle that does not fly."""
QUIET_LINK_S: Final = 3.0
"""Silence of a platform after which its length is shown to the operator."""

HEALTHS: Final = tuple(Health)
KINDS: Final = tuple(Kind)
_WORKING: Final = HEALTHS.index(Health.WORKING)
_QUIET: Final = HEALTHS.index(Health.QUIET)


class Timed(msgspec.Struct, Generic[M], frozen=True):
    """The last message of its type, and when it came."""

    value: M
    received_s: float
    """On the station's clock."""

    def age_s(self, now_s: float) -> float:
        """Seconds since it came."""
        return now_s - self.received_s

    def is_stale(self, now_s: float) -> bool:
        """Whether it is too old to count as current."""
        return now_s - self.received_s >= STALE_AFTER_S.get(type(self.value), float("inf"))


class LinkStatistics(msgspec.Struct, frozen=True):
    """Delivery statistics of a platform's status."""

    received: int = 0
    lost: int = 0
    """Gaps in the sequences of the periodic topics."""
    loss: float = 0.0
    """Share of them that does not arrive, 0 to 1, smoothed over some 40 messages: lost, or left out by a slow link."""
    sequences: Mapping[str, int] = {}
    """The last sequence of each topic."""


class ComponentSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """One component of a platform."""

    name: str
    kind: str
    """A `Kind`."""
    nominal_rate_hz: float
    is_required: bool
    standby_for: str
    is_triggered: bool = False
    """It reaches its rate only while its input comes."""
    health: Health | None
    """None until its first line came."""
    values: Mapping[str, int | None] = {}
    """By the name of the `StatusField`."""
    cause: str = ""
    """Its last error, in words."""
    is_stale: bool = False

    @property
    def errors(self) -> int:
        """How many there were, modulo 65536."""
        return self.values.get("errors") or 0

    @property
    def has_rate(self) -> bool:
        """Whether it has a nominal rate, and its actual rate is known."""
        return self.nominal_rate_hz > 0.0 and self.health is not None

    @property
    def is_well(self) -> bool:
        """Whether it works, or is on standby for another."""
        return self.health is Health.WORKING or (self.health is Health.QUIET and bool(self.standby_for))


class AutopilotSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Autopilot of a vehicle as received on a link of this station."""

    link: str
    """The link's URL."""
    system: int
    component: int
    firmware: str
    """`PX4`, `ArduPilot`, or the name that it reports."""
    vehicle_type: str = ""
    """`quadrotor`; empty where it does not say."""
    is_alive: bool = True
    """Whether its heartbeat comes."""
    restarted_s: float | None = None
    """When it has restarted, or another one has taken its address, on the station's clock; None where it has not."""
    fix_type: int = 0
    """GPS_FIX_TYPE of its first receiver; 0 where it is not known."""
    has_used_rtk: bool = False
    """Whether that was RTK (5 or 6) at any time."""
    readings: Mapping[str, Reading] = {}
    """By name, such as `gps`; what was never received is missing."""
    flight: str = ""
    """Time in the air, in words; empty while it has not flown."""
    home_geo: tuple[float, float, float] | None = None
    """Its home: latitude and longitude in degrees, altitude above the sea in m; None until it was received."""


class CorrectionsSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """RTK corrections that the station takes from a source and sends to vehicles."""

    source: str
    """Its address, without user and password."""
    problem: str = ""
    """Why nothing comes; empty otherwise."""
    rate_byte_s: float = 0.0
    """Of the corrections that come, over the last seconds."""
    received_s: float | None = None
    """When the last observations of the base came; None before the first."""
    types: tuple[int, ...] = ()
    """Numbers of the RTCM messages that come."""
    base_ecef_m: tuple[float, float, float] | None = None
    """Antenna of the base; None until it is told."""
    links: int = 0
    """Links that corrections are sent to."""
    damaged: int = 0
    """Frames with a wrong CRC; they are dropped."""
    oversized: int = 0
    """Frames that GPS_RTCM_DATA cannot hold; they are dropped."""
    left_out: int = 0
    """Frames that slow links had no room for."""

    def age_s(self, now_s: float) -> float | None:
        """Seconds since the last observations of the base came; None before the first."""
        return None if self.received_s is None else now_s - self.received_s


class TrafficContact(msgspec.Struct, frozen=True, kw_only=True):
    """Another aircraft or drone, as it was reported last."""

    key: str
    """Identity: `adsb` with its address, or `rid` with that of the sender of its Remote ID."""
    name: str = ""
    """Callsign or serial number; empty where it is not told."""
    place: tuple[float, float]
    """Latitude and longitude, degrees."""
    altitude_m: float | None = None
    """As reported: by pressure, or above the ellipsoid; it may differ from the vehicles' by 100 m."""
    velocity_ne_m_s: tuple[float, float] | None = None
    """To north and east; None where it is not told."""
    received_s: float
    """For which time its position is valid."""

    @property
    def label(self) -> str:
        """Name for people."""
        return self.name or self.key.partition(" ")[2][:12]


class Encounter(msgspec.Struct, frozen=True, kw_only=True):
    """Traffic near a vehicle; as text: `SWR123: 400 m away, 30 m above, closing`."""

    platform: str
    key: str
    """Of the contact."""
    name: str
    distance_m: float
    """Horizontal."""
    above_m: float | None
    """Height over the vehicle; None where the contact's is not told."""
    is_closing: bool
    """Whether it will pass close by soon, as both move now."""
    severity: Severity | None = None
    """Of the alert; None where it is none."""
    alert_s: float = 0.0
    """When it was last within the limits of that alert, on the station's clock."""

    def __str__(self) -> str:
        far = round(self.distance_m / 50.0) * 50 if self.distance_m >= 100.0 else 10 * round(self.distance_m / 10.0)
        away = f"{far} m" if far < 1000 else f"{far / 1000.0:.1f} km"
        if self.above_m is None:
            height = "height not told"
        elif abs(self.above_m) < 5.0:
            height = "same height"
        else:
            height = f"{abs(round(self.above_m, -1)):.0f} m {'above' if self.above_m > 0.0 else 'below'}"
        return f"{self.name}: {away} away, {height}{', closing' if self.is_closing else ''}"


class VehicleProblem(msgspec.Struct, frozen=True, kw_only=True):
    """A problem of a vehicle detected by the station, while it lasts."""

    what: str
    """Names it among the vehicle's problems: `system id`."""
    severity: Severity
    text: str
    """The problem, and what to do."""


DOUBLED_FOR_S: Final = 10.0
"""So long after it was seen last that two platforms have one name it is taken to be so."""


class ReportedSilence(msgspec.Struct, frozen=True, kw_only=True):
    """A planned silence of the platform's mission, as reported before it."""

    target: str
    """The task or action that states it."""
    until_s: float
    """When contact is due, in platform time."""
    due_s: float
    """The same on the station's clock."""
    due_text: str
    """The same for people: `14:03:20 UTC`."""


class PlatformSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Last known state of one platform."""

    name: str
    boot: int
    """Of its command interface server; 0 before its first message."""
    first_received_s: float
    received_s: float
    """When anything came from it last."""
    began_s: float = float("-inf")
    """When it was heard for the first time, again after a silence, or after its command interface has begun again."""
    former_process: int = 0
    """The onboard process of the life before, until the table tells whether it is still the same; 0 where it has."""
    vehicle: Timed[VehicleSummary] | None = None
    motion: Timed[MotionSummary] | None = None
    site: Timed[SiteSummary] | None = None
    teleoperation: Timed[TeleoperationState] | None = None
    """Its response to manual control."""
    obstacles: Timed[ObstacleScan] | None = None
    map: Timed[OccupancyMap] | None = None
    mission: Timed[MissionSummary] | None = None
    silence: ReportedSilence | None = None
    contact: Timed[ContactSummary] | None = None
    """Its first report after a silence."""
    acoustic: Timed[AcousticSummary] | None = None
    """Its last acoustic summary."""
    control: Timed[ControlState] | None = None
    rights: MemberRights = MemberRights()
    """What this station may do with it."""
    summary: Timed[Summary] | None = None
    """The last part of the summary that came; the components' own lines are in `lines`."""
    table: ComponentTable | None = None
    lines: Mapping[int, tuple[ComponentLine, float]] = {}
    """Index in the table to the last line and when it came."""
    columns: Mapping[str, list[int | None]] = {}
    """The last summary's."""
    troubles: Mapping[str, ComponentTrouble] = {}
    link: LinkStatistics = LinkStatistics()
    has_companion: bool = True
    """Whether a GLOC3 command interface is onboard; a bare vehicle has only an autopilot, and offers services."""
    autopilot: AutopilotSnapshot | None = None
    """None where no link of this station receives its autopilot."""
    problems: tuple[VehicleProblem, ...] = ()
    """What its links show to be wrong with it."""
    host_names: HostNames | None = None
    hosts: Mapping[int, tuple[HostLine, float]] = {}
    """Index in the names to the last line and when it came; empty for a platform of one process."""
    former: Mapping[int, int] = {}
    """Boots of former lives, the last one last, to how often each has spoken since: a life that is over does not."""
    doubled_s: float = float("-inf")
    """When a life that should be over spoke last."""

    @property
    def is_known(self) -> bool:
        """Whether this station has received it; otherwise it is known acoustically, or from before a restart."""
        return bool(self.boot) or not self.has_companion

    @property
    def is_incomplete(self) -> bool:
        """Whether its full state has to be requested: it is new, has restarted, or refers to another table."""
        return self.table is None

    @property
    def is_armed(self) -> bool:
        """Whether it was armed in its last state."""
        return self.vehicle is not None and self.vehicle.value.is_armed

    @property
    def is_flying(self) -> bool:
        """Whether it was armed and off the ground in its last state."""
        return self.vehicle is not None and self.is_armed and self.vehicle.value.landed not in ON_THE_GROUND

    def age_s(self, now_s: float) -> float:
        """Seconds since anything came from it."""
        return now_s - self.received_s

    def is_quiet_link(self, now_s: float) -> bool:
        """Whether nothing came for longer than it should."""
        return now_s - self.received_s >= QUIET_LINK_S

    def is_silent_as_planned(self, now_s: float) -> bool:
        """Whether nothing comes because its mission says so, and contact is not due yet."""
        return self.is_quiet_link(now_s) and self.silence is not None and now_s < self.silence.due_s

    def is_overdue(self, now_s: float) -> bool:
        """Whether nothing comes although its planned silence should be over."""
        return self.is_quiet_link(now_s) and self.silence is not None and now_s >= self.silence.due_s

    def is_doubled(self, now_s: float) -> bool:
        """Whether two platforms use its name."""
        return now_s - self.doubled_s < DOUBLED_FOR_S

    def is_all_well(self, now_s: float) -> bool:
        """Whether every component is healthy in current data: nearly always so, and fast to check."""
        rows = self.table.rows if self.table is not None else ()
        if not 0 < len(self.lines) == len(rows):
            return False
        since_s = now_s - STALE_AFTER_S[Summary]
        return all(
            received_s > since_s
            and (line.state == _WORKING or (line.state == _QUIET and bool(rows[index].standby_for)))
            for index, (line, received_s) in self.lines.items()
            if index < len(rows)
        )

    @property
    def component_names(self) -> tuple[str, ...]:
        """Of all its components; empty while they are not known."""
        return tuple(row.name for row in self.table.rows) if self.table is not None else ()

    @property
    def platform_digest(self) -> str:
        """The digest of its platform file; empty while it is not known, or not told."""
        return self.table.platform if self.table is not None else ""

    def components(self, now_s: float) -> tuple[ComponentSnapshot, ...]:
        """Its components in the order of the data: SS, DP, CC, AD, CI, each as in the platform file."""
        if self.table is None:
            return ()
        limit_s = STALE_AFTER_S[Summary]
        found = []
        for index, row in enumerate(self.table.rows):
            line, received_s = self.lines.get(index, (None, 0.0))
            problem = self.troubles.get(row.name)
            found.append(
                ComponentSnapshot(
                    name=row.name,
                    kind=row.kind,
                    nominal_rate_hz=row.nominal_rate_hz,
                    is_required=row.is_required,
                    standby_for=row.standby_for,
                    is_triggered=row.is_triggered,
                    health=None if line is None or line.state >= len(HEALTHS) else HEALTHS[line.state],
                    values=self._values(index, line),
                    cause=problem.cause if problem else "",
                    is_stale=line is not None and now_s - received_s >= limit_s,
                )
            )
        return tuple(sorted(found, key=lambda component: _ORDER.get(component.kind, len(_ORDER))))

    def _values(self, index: int, line: ComponentLine | None) -> dict[str, int | None]:
        """Of one component, by the name of the field."""
        row = (0,) * len(ROW_FIELDS) if line is None else astuple(line)[2:]
        further = {name: values[index] for name, values in self.columns.items() if index < len(values)}
        return {field.name: value for field, value in zip(ROW_FIELDS, row, strict=True)} | further


_ORDER: Final[Mapping[str, int]] = {kind.value: place for place, kind in enumerate(KINDS)}


class FleetEvent(msgspec.Struct, frozen=True, kw_only=True):
    """An event, reported by a platform or detected by the station."""

    number: int
    """Counts from 1 over all events of the fleet."""
    platform: str
    received_s: float
    severity: Severity
    source: str
    """The component; empty for an event of the station itself."""
    text: str
    cause: str = ""
    """What it follows from, see `gloc3.messages.summaries.Cause`; empty for what stands for itself."""


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """Every platform known to a station, and recent events."""

    utc_offset_s: float = 0.0
    """Add it to the station's time for seconds since 1970."""
    platforms: Mapping[str, PlatformSnapshot] = {}
    """By name, in order of first contact."""
    events: tuple[FleetEvent, ...] = ()
    """The last ones, oldest first."""
    corrections: CorrectionsSnapshot | None = None
    """RTK corrections; None where the station takes none."""
    traffic: tuple[TrafficContact, ...] = ()
    """Other aircraft and drones."""
    encounters: tuple[Encounter, ...] = ()
    """Those near vehicles: of each vehicle the worst and nearest first."""
    regions: Mapping[str, Timed[RegionSummary]] = {}
    """By router: the health of the vehicles that connect to it."""
    event_count: int = 0
    """Of all events so far, those that are no longer kept included."""
    renamed: Mapping[str, str] = {}
    """Names that vehicles had before their companions were heard, each with the name of the vehicle now."""

    def __iter__(self) -> Iterator[PlatformSnapshot]:
        return iter(self.platforms.values())

    def elsewhere(self) -> list[tuple[str, float, VehicleLine]]:
        """Vehicles that are known by summaries of regions only: router, when it was received, and the vehicle."""
        return [
            (router, region.received_s, line)
            for router, region in self.regions.items()
            for line in region.value.vehicles
            if line.name not in self.platforms
        ]

    def get(self, name: str) -> PlatformSnapshot | None:
        """A platform by name."""
        return self.platforms.get(name)

    def changed_since(self, before: "Fleet") -> list[tuple[PlatformSnapshot | None, PlatformSnapshot]]:
        """Changed platforms, each after its previous snapshot; called for every message, so it is fast."""
        was, now = before.platforms, self.platforms
        if len(was) == len(now):
            pairs = [
                (previous, new) for previous, new in zip(was.values(), now.values(), strict=True) if previous is not new
            ]
            if all(
                previous.name == new.name for previous, new in pairs
            ):  # in the same order, as but after one has gone
                return [*pairs]
        return [(was.get(name), platform) for name, platform in now.items() if was.get(name) is not platform]

    def events_after(self, number: int) -> tuple[FleetEvent, ...]:
        """The kept events that came after the one of that number."""
        new = min(self.event_count - number, len(self.events))
        return self.events[-new:] if new > 0 else ()
