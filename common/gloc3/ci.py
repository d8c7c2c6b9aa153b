"""What a station's command interface (client) and a platform's (server) say to each other (paper §V).

A request is known by `(sender, boot, sequence)`. The server executes each at most once and remembers its reply; a
repeat gets the same reply. After a break in link or process a sender asks `Query` what became of a request.

Topics, below the platform's name: `ci/request` (station to platform), `ci/reply`, `ci/summary`, `ci/mission`,
`ci/vehicle`, `contact`, `ci/event`, `ci/control` (platform to stations).
"""

from enum import StrEnum
from typing import Any, Final

import msgspec

from gloc3.lci import State
from gloc3.messages import Message, Severity
from gloc3.watch import Want

FORCE: Final = "force the command"
"""In the reason of a refusal: the same would be carried out with `CommandComponent.is_forced`."""


class Body(msgspec.Struct, frozen=True, kw_only=True, tag=True, array_like=True):
    """The base of what a station can ask for."""


class LoadMission(Body, frozen=True):
    """Checks a mission's text onboard and keeps it, in place of the one before."""

    name: str
    text: str


class ReadMission(Body, frozen=True):
    """Reads the loaded mission back, to compare it."""


class Verb(StrEnum):
    """What an operator does to a mission, task or action."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    SKIP = "skip"
    ABORT = "abort"
    RETRY = "retry"
    CLEAR = "clear"


class Steer(Body, frozen=True):
    """Start, pause, resume, skip or abort the mission, or one of its tasks or actions."""

    verb: Verb
    target: str = ""
    """Empty for the mission, `TASK`, or `TASK.ACTION`."""
    override: str = ""
    """With start: why it shall begin although checks are red; logged with the author."""
    author: str = ""
    """With an override: whose it is."""


class RequestTask(Body, frozen=True):
    """A high-level command: a single task, as the YAML of a mission that holds just this task."""

    text: str
    override: str = ""
    """As for a start."""
    author: str = ""


class RequestAction(Body, frozen=True):
    """A low-level command: a single action."""

    capability: str
    arguments: dict[str, Any] = {}
    override: str = ""
    """As for a start."""
    author: str = ""


class CommandComponent(Body, frozen=True):
    """A command for a component's LCI."""

    component: str
    command: str
    settings: dict[str, Any] | None = None
    is_forced: bool = False
    """Carry it out although a running action needs the component; the action then fails by its policy."""


class CallFunction(Body, frozen=True):
    """A function message for a component."""

    component: str
    function: str
    arguments: dict[str, Any] = {}


class ControlVerb(StrEnum):
    """How control of a platform changes hands."""

    REQUEST = "request"
    RELEASE = "release"
    GRANT = "grant"
    """The holder answers a request."""
    REFUSE = "refuse"
    TAKE_OVER = "take_over"
    """Take control without the holder's leave; recorded with its author."""


class Control(Body, frozen=True):
    """Control of the platform: one station holds it at a time."""

    verb: ControlVerb
    station: str = ""
    """With grant and refuse: whose request is answered."""
    version: str = ""
    """Of the station's software; told when it asks for control."""
    protocol: str = ""


class EmergencyVerb(StrEnum):
    """What the emergency key asks for."""

    HOLD = "hold"
    LAND = "land"
    DISARM = "disarm"


class Emergency(Body, frozen=True):
    """The emergency key: accepted from any authenticated operator, logged with its author."""

    verb: EmergencyVerb
    author: str = ""
    confirmation: str = ""
    """With disarm: the platform's name, typed."""


class Elsewhere(Body, frozen=True):
    """Tells a platform how far another one is in the mission that both have loaded; the holder of control passes it on.

    It needs no answer: the next one, a second later at the latest, says more.
    """

    platform: str
    """The other one."""
    digest: str
    """Of the mission's text."""
    state: str
    """Of its mission: an `ActionState`."""
    tasks: dict[str, str] = {}
    """Its tasks' states."""


class Query(Body, frozen=True):
    """Asks what became of an earlier request of the same sender."""

    boot: int
    sequence: int


class Preflight(Body, frozen=True):
    """Asks for the list of checks before a start; what the autopilot is set to is read anew for it."""


class Hello(Body, frozen=True):
    """Asks for the full state: components' table, mission, control; the answer comes on the topics."""

    version: str = ""
    """Of the station's software."""
    protocol: str = ""
    """The hash of what it speaks, `gloc3.software`."""


class Watch(Body, frozen=True):
    """Everything that the station wants to see from now on, for `watch.LEASE_S`; asked again while somebody looks.

    The reply's result tells under `refused` the topics that cannot be looked at, each with the reason.
    """

    wants: list[Want] = []
    """Empty where nobody looks any more."""
    is_listing: bool = False
    """Somebody looks at the list of topics: how they speak is wanted, too."""


class ListTopics(Body, frozen=True):
    """Asks for the topics that can be looked at; the reply's result holds them as `TopicEntry`s under `topics`."""


class ReadReports(Body, frozen=True):
    """Asks for the events behind a number, oldest first; says also that all up to that number are here.

    The reply's result holds under `reports` for each its number, severity, source, text and time, and under `last` the
    highest number.
    """

    store: int
    after: int
    most: int = 40


class ListLogs(Body, frozen=True):
    """Asks for the logs onboard; the reply's result holds a `LogOnboard` for each under `logs`."""


class CutLog(Body, frozen=True):
    """Ends the log that is being written and begins the next, so that what was recorded so far can be fetched."""


class DigestLog(Body, frozen=True):
    """Has the SHA-256 digest of a log calculated; it is under `sha256` in the reply's result, in hexadecimal digits."""

    name: str


class ReadLog(Body, frozen=True):
    """Asks for a piece of a log, which comes as a `LogChunk` where the way to the station has room for it."""

    name: str
    offset: int
    size: int


class ConfirmLog(Body, frozen=True):
    """The station has the whole log, with this digest: it is deleted onboard if that is its own digest, too."""

    name: str
    sha256: str


AnyBody = (
    LoadMission
    | ReadMission
    | Steer
    | RequestTask
    | RequestAction
    | CommandComponent
    | CallFunction
    | Control
    | Emergency
    | Elsewhere
    | Query
    | Hello
    | Watch
    | ListTopics
    | Preflight
    | ReadReports
    | ListLogs
    | CutLog
    | DigestLog
    | ReadLog
    | ConfirmLog
)
AboutLogs = ListLogs | CutLog | DigestLog | ReadLog | ConfirmLog


LOOKS: Final = (ReadMission, Query, Hello, Watch, ListTopics, Preflight, ReadReports, ListLogs, DigestLog, ReadLog)
"""What only looks: everybody who may watch the platform may ask for it."""


class StationRole(StrEnum):
    """What a station may do."""

    OPERATOR = "operator"
    """Looks, and commands once it holds control."""
    OBSERVER = "observer"
    """Looks."""


class CiRequest(Message, frozen=True):
    """A request of a station."""

    sender: str
    """The station's id, such as `255`."""
    boot: int
    sequence: int
    body: AnyBody
    role: StationRole = StationRole.OPERATOR
    """Its sender's; set by the platform's end of the link that brought it, whatever was sent."""
    way: str = ""
    """How it came: set there too, for the record."""


class Outcome(StrEnum):
    """What became of a request."""

    ACCEPTED = "accepted"
    """Carried out, or (mission, task, action) begun."""
    REFUSED = "refused"
    EXPIRED = "expired"
    """Older than what the server remembers: not executed now, and not known whether before."""
    UNKNOWN = "unknown"
    """A query for a request that never arrived, or one whose end was lost with the process."""


class CiReply(Message, frozen=True):
    """The answer to a request."""

    sender: str
    boot: int
    sequence: int
    outcome: Outcome
    reason: str = ""
    text: str = ""
    """With `ReadMission`: the mission's text; with a failed check: the findings, one a line."""
    result: dict[str, Any] = {}
    """With `CallFunction`: the function's reply; with `Preflight`: the `PreflightReport`."""


class LogOnboard(msgspec.Struct, frozen=True, array_like=True):
    """A log as it lies onboard."""

    name: str
    size: int
    """In bytes."""
    is_open: bool
    """It is still being written."""


class LogChunk(Message, frozen=True):
    """A piece of a log, for the station that has asked for it."""

    station: str
    name: str
    offset: int
    data: bytes
    reason: str = ""
    """Why there is no data."""


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
    """The condition that a component's state stands for."""
    return Health.ABSENT if state is None else Health(state.value)


class ComponentLine(msgspec.Struct, frozen=True, array_like=True):
    """One component in the summary: at most 16 bytes on the wire."""

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


class TableRow(msgspec.Struct, frozen=True, array_like=True):
    """What of a component does not change while it runs."""

    name: str
    kind: str
    nominal_rate_hz: float
    """0 where it only works when something happens."""
    is_required: bool
    standby_for: str
    is_triggered: bool = False
    """It reaches its rate only while its input comes: to be slower is no sign of trouble."""


class ComponentTable(Message, frozen=True):
    """The names behind the summary's indices; sent once, and on request."""

    table: int
    rows: list[TableRow]
    version: str = ""
    """Of the platform's software."""
    protocol: str = ""
    """The hash of what it speaks, `gloc3.software`."""


class ComponentTrouble(Message, frozen=True):
    """A component's last error in words, sent when it changes."""

    name: str
    cause: str
    errors: int


class VehicleSummary(Message, frozen=True):
    """The vehicle at a glance."""

    t_s: float
    mode: str
    """The autopilot's mode in its own words."""
    is_armed: bool
    landed: str
    """A `LandedState`; `under_way` for the one in the air where the vehicle does not fly."""
    battery_percent: int
    """-1 where it is not known."""
    position_m: tuple[float, float, float]
    """x, y, height in the platform's local frame."""
    speed_m_s: float
    heading_deg: int
    is_pose_valid: bool
    has_pilot_control: bool
    is_autopilot_connected: bool
    frame: str = ""
    geo: tuple[float, float, float] | None = None
    """Latitude, longitude in degrees, altitude above mean sea level in metres."""
    is_armable: bool = True
    """Whether the autopilot would arm now."""
    pose_sources: list[str] = []
    """What the position rests on."""
    pose_quality_percent: int = -1
    """How good the position is, 0 to 100; -1 where that is not known."""


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
    """Task, and `TASK.ACTION`, to why it failed, or what it waits for beside its turn."""
    elsewhere: dict[str, str] = {}
    """The tasks that other platforms perform, each with its platform."""
    silence: str = ""
    """The `TASK` or `TASK.ACTION` whose planned silence has begun and is not over; empty where none has."""
    silent_until_s: float = 0.0
    """With a silence: when contact is due, on the platform's clock."""
    repetitions: dict[str, tuple[int, int]] = {}
    """The tasks that are done several times and have begun: for which time, and how often at most."""
    took_s: float = -1.0
    """Once it has ended: how long it ran, pauses left out; -1 before, and where it is not known."""
    took_m: float = -1.0
    """Once it has ended: the way that the vehicle made."""
    took_battery: float = -1.0
    """Once it has ended: the share of the battery that it took."""


class ControlState(Message, frozen=True):
    """Who holds control of the platform."""

    holder: str
    """The station's id; empty where nobody does."""
    requested_by: str = ""


class StationHeard(Message, frozen=True):
    """Onboard: something has just been heard of a station."""

    station: str
    is_reached: bool = True
    """What is told to stations reaches it, too; not yet while only its heartbeat was heard."""


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
    """Tells which numbers these are: a platform that has lost what it kept counts anew."""


class ContactSummary(Message, frozen=True):
    """The state in a nutshell, told first of all when a station is heard after a silence, before the events meanwhile."""

    station: str
    """The one that is heard again."""
    t_s: float
    silent_s: float
    """For how long it was not heard; -1 where it never was in this life of the onboard process."""
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
    """Up to here stations have been told of events."""
    worst: int = 7
    """The severity of the worst event behind that."""
    worst_text: str = ""
