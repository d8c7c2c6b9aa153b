"""Summaries that a platform sends to its stations: health, vehicle, mission, control, events (paper §V)."""

from enum import StrEnum
from typing import Final, Protocol

import msgspec

from gloc3.component.lci import State
from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Message, Severity


class Health(StrEnum):
    """A component's or the platform's condition, worst last; `absent` is a component that has left."""

    WORKING = "working"
    QUIET = "quiet"
    STANDBY = "standby"
    IDLE = "idle"
    ABSENT = "absent"
    FAULTY = "faulty"


WELL: Final = (Health.WORKING, Health.QUIET)
"""At work; quiet as a standby."""


def health_of(state: State | None) -> Health:
    """Health that follows from a component's state."""
    return Health.ABSENT if state is None else Health(state.value)


class Cause(StrEnum):
    """Causes of trouble that platforms and stations name alike: what follows from one carries its name."""

    LINK = "link"
    """Nothing is received of the vehicle: its link is down, or its process has stalled."""
    AUTOPILOT = "autopilot"
    BATTERY = "battery"
    POSITION = "position"
    PILOT = "pilot"
    FAILSAFE = "failsafe"
    EMERGENCY = "emergency"


class EventReport(Protocol):
    """Sends an event; `cause` names what it follows from, such as a `Cause`."""

    def __call__(self, severity: Severity, text: str, /, *, cause: str = "") -> None:
        """Sends it."""


def component_cause(name: str) -> str:
    """Name of the cause that a component is faulty or absent."""
    return f"component {name}"


class ComponentLine(msgspec.Struct, frozen=True, array_like=True):
    """One component in the summary, at most 16 bytes on the wire; after the state, the values of `ROW_FIELDS`."""

    index: int
    """Its row in the `ComponentTable`."""
    state: int
    """Index into `Health`."""
    rate_percent: int
    """Measured rate, in percent of the nominal one; 0 to 255, and 0 where there is none."""
    load_percent: int
    """Mean cycle cost, in percent of the period; 0 to 255."""
    overruns: int
    """Modulo 65536."""
    errors: int
    """Modulo 65536."""


class Summary(Message, frozen=True):
    """The state of a platform's components, many to a frame."""

    table: int
    """The number of the `ComponentTable` that the indices refer to."""
    health: Health
    """The platform's, from its required components."""
    lines: list[ComponentLine]
    columns: dict[str, list[int | None]] = {}
    """Of each of `COLUMN_FIELDS` that some component reports: a value for each row of the table, None where there is none."""


class TableRow(msgspec.Struct, frozen=True, array_like=True):
    """Properties of a component that do not change while it runs."""

    name: str
    kind: str
    nominal_rate_hz: float
    """0 where it only works when something happens."""
    is_required: bool
    standby_for: str
    is_triggered: bool = False
    """It reaches its rate only while its input comes: to be slower is no sign of trouble."""


class ComponentTable(Message, frozen=True):
    """Names behind the summary's indices; sent once, and on request."""

    table: int
    rows: list[TableRow]
    version: str = ""
    """Of the platform's software."""
    protocol: str = ""
    """Hash of its protocol, see `gloc3.messages.software`."""
    process: int = 0
    """A random number of the onboard process, which its command interface keeps when it alone begins again; 0: not told."""
    platform: str = ""
    """The digest of what missions are checked against, `Platform.digest`; empty: not told."""


class ComponentTrouble(Message, frozen=True):
    """A component's last error in words, sent when it changes."""

    name: str
    cause: str
    errors: int


class VehicleSummary(Message, frozen=True):
    """The vehicle at a glance."""

    t_s: float
    mode: str
    """The autopilot's own name of its mode."""
    is_armed: bool
    landed: str
    """A `LandedState`; `under_way` for the one in the air where the vehicle does not fly."""
    battery_percent: int
    """-1 where it is not known."""
    position_m: tuple[float, float, float]
    """x, y, height in the platform's local frame."""
    speed_m_s: float
    heading_deg: int
    """Clockwise from north; -1 where it is not known."""
    is_pose_valid: bool
    has_pilot_control: bool
    is_autopilot_connected: bool
    frame: str = ""
    geo: tuple[float, float, float] | None = None
    """Latitude, longitude in degrees, altitude above mean sea level in metres."""
    is_armable: bool = True
    """Whether the autopilot would arm now."""
    pose_sources: list[str] = []
    """Sources of the position."""
    pose_quality_percent: int = -1
    """How good the position is, 0 to 100; -1 where that is not known."""
    is_failsafe: bool = False
    """`has_pilot_control` because the autopilot's failsafe has chosen a mode, not a pilot."""
    is_operators: bool = False
    """`has_pilot_control` because an operator has commanded the autopilot itself while the process was silent."""


class MissionSummary(Message, frozen=True):
    """The loaded mission and how far it is."""

    name: str
    digest: str
    """Of the mission's text; empty where none is loaded."""
    state: str
    """An `ActionState`; empty where none is loaded."""
    reason: str = ""
    tasks: dict[str, str] = {}
    """Task, and `TASK.ACTION`, to its state."""
    progress: dict[str, float] = {}
    """`TASK.ACTION` to 0..1, for what runs."""
    policy: str = ""
    """The policy that is being carried out, such as `return`; empty in normal flight."""
    reasons: dict[str, str] = {}
    """Task, and `TASK.ACTION`, to why it failed, or what it waits for besides its turn."""
    elsewhere: dict[str, str] = {}
    """The tasks that other platforms perform, each with its platform."""
    silence: str = ""
    """`TASK` or `TASK.ACTION` whose planned silence is under way; empty without one."""
    silent_until_s: float = 0.0
    """With a silence: when contact is due, in platform time."""
    repetitions: dict[str, tuple[int, int]] = {}
    """Tasks with repetitions that have begun: the current repetition, and their limit."""
    took_s: float = -1.0
    """Once it has ended: how long it ran, pauses left out; -1 before, and where it is not known."""
    took_m: float = -1.0
    """Distance travelled by the vehicle, once it has ended."""
    took_battery: float = -1.0
    """Once it has ended: the share of the battery that it took."""


class ControlState(Message, frozen=True):
    """Holder of control of the platform."""

    holder: str
    """Id of the station; empty without a holder."""
    requested_by: str = ""


class StationHeard(Message, frozen=True):
    """Onboard: a station has just been received."""

    station: str
    is_reached: bool = True
    """Whether messages to stations reach it; not yet while only its heartbeat was received."""
    member: str = ""
    """Of the network: whose rights it has; empty for a link that stands for none."""
    role: StationRole = StationRole.OPERATOR
    """Of all stations on its link."""


AUTOPILOT_SAYS: Final = "the autopilot says: "
"""Begins an event with what the autopilot has reported in its own words."""


class CiEvent(Message, frozen=True):
    """An event of the platform, for its stations."""

    severity: Severity
    source: str
    """The component."""
    text: str
    t_s: float
    number: int = 0
    """Counts all events of a platform, over its restarts; 0 where they are not kept."""
    store: int = 0
    """Identifies the numbering: a platform that has lost its stored events starts a new one."""
    cause: str = ""
    """What it follows from, such as a `Cause`: events with one cause are one alert; empty for what stands for itself."""


class ContactSummary(Message, frozen=True):
    """Summary of the state, sent first when a station is back in contact after a silence, before the missed events."""

    station: str
    """The station that is back in contact."""
    t_s: float
    silent_s: float
    """Duration of the silence; -1 if it was never in contact in this life of the onboard process."""
    health: Health
    mission: str
    """The loaded mission's name; empty where none is."""
    state: str
    """Of the mission."""
    doing: str
    """The actions under way: `dive.sweep 42 %`."""
    policy: str
    landed: str
    battery_percent: int
    position_m: tuple[float, float, float]
    """x, y, height in the platform's local frame."""
    geo: tuple[float, float, float] | None
    conditions: list[str]
    """What is wrong: `low battery`, `overdue`."""
    store: int
    last: int
    """The highest number of an event."""
    delivered: int
    """Number of the last event sent to stations."""
    worst: int = 7
    """The severity of the worst event behind that."""
    worst_text: str = ""


class VehicleLine(msgspec.Struct, frozen=True, array_like=True):
    """One vehicle in the summary of a region: some 60 bytes on the wire."""

    name: str
    age_s: float
    """Since the router has heard it last; -1 if it never has."""
    health: str = ""
    """A `Health`; empty where it is not known."""
    mode: str = ""
    is_armed: bool = False
    landed: str = ""
    """A `LandedState`; empty where it is not known."""
    battery_percent: int = -1
    mission: str = ""
    mission_state: str = ""
    """An `ActionState`; empty where no mission is loaded."""
    holder: str = ""
    """Station in control; empty for none."""


class RegionSummary(Message, frozen=True):
    """The health of all vehicles that connect to a router, for stations that do not watch them in detail."""

    vehicles: list[VehicleLine]
