"""Messages between a station's command interface (client) and a platform's (server) (paper §V).

A request is identified by `(sender, boot, sequence)`. The server executes each at most once and remembers its reply; a
repeat gets the same reply. After an interruption of the link or process, a sender gets the outcome of a request with
`Query`.

Topics, below the platform's name: `ci/request` (station to platform), `ci/reply`, `ci/summary`, `ci/mission`,
`ci/vehicle`, `contact`, `ci/event`, `ci/control` (platform to stations).
"""

from enum import StrEnum
from typing import Any, Final

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.watch import Want
from gloc3.messages.wire import wire_name

OURSELVES: Final = "onboard"
"""As whom a platform asks for its own mission, for other people's software."""
FORCE: Final = "force the command"
"""In the reason of a refusal: the same would be carried out with `CommandComponent.is_forced`."""


class RequestBody(msgspec.Struct, frozen=True, kw_only=True, tag=wire_name, array_like=True):
    """Base of all station requests."""


class LoadMission(RequestBody, frozen=True):
    """Checks a mission's text onboard and keeps it, in place of the one before."""

    name: str
    text: str
    amends: str = ""
    """Digest of the running mission that goes on by this text; empty where none does."""


class ReadMission(RequestBody, frozen=True):
    """Reads the loaded mission back, to compare it."""


class Verb(StrEnum):
    """Commands of an operator to a mission, task or action."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    SKIP = "skip"
    ABORT = "abort"
    RETRY = "retry"
    CLEAR = "clear"


class Steer(RequestBody, frozen=True):
    """Start, pause, resume, skip or abort the mission, or one of its tasks or actions."""

    verb: Verb
    target: str = ""
    """Empty for the mission, `TASK`, or `TASK.ACTION`."""
    override: str = ""
    """With start: why it shall begin although checks are red; logged with the author."""
    author: str = ""
    """With an override: its author."""


class RequestTask(RequestBody, frozen=True):
    """A high-level command: a single task, as the YAML of a mission that holds just this task."""

    text: str
    override: str = ""
    """As for a start."""
    author: str = ""


class RequestAction(RequestBody, frozen=True):
    """A low-level command: a single action."""

    capability: str
    arguments: dict[str, Any] = {}
    override: str = ""
    """As for a start."""
    author: str = ""


class CommandComponent(RequestBody, frozen=True):
    """A command for a component's LCI."""

    component: str
    command: str
    settings: dict[str, Any] | None = None
    is_forced: bool = False
    """Carry it out although a running action needs the component; the action then fails by its policy."""


class CallFunction(RequestBody, frozen=True):
    """A function message for a component."""

    component: str
    function: str
    arguments: dict[str, Any] = {}


class ControlVerb(StrEnum):
    """Requests about control of a platform."""

    REQUEST = "request"
    RELEASE = "release"
    GRANT = "grant"
    """The holder answers a request."""
    REFUSE = "refuse"
    TAKE_OVER = "take_over"
    """Take control without the holder's leave; recorded with its author."""
    APPOINT = "appoint"
    """A commander gives a member a role for some time."""
    DISMISS = "dismiss"
    """And takes it back."""
    OPERATED = "operated"
    """Tells an onboard process that is back what the station has sent to the autopilot while that was silent."""


class Control(RequestBody, frozen=True):
    """Control of the platform: one station holds it at a time."""

    verb: ControlVerb
    station: str = ""
    """With grant and refuse: the station whose request is answered; with appoint and dismiss: the member."""
    version: str = ""
    """Of the station's software; sent with a request for control."""
    protocol: str = ""
    role: str = ""
    """With appoint."""
    for_s: float = 0.0
    """With appoint: for how long, s."""
    command: str = ""
    """With operated, in words: `return`, `go to 47.4, 8.5, 20`."""


class EmergencyVerb(StrEnum):
    """Requests of the emergency key."""

    HOLD = "hold"
    LAND = "land"
    DISARM = "disarm"


class Emergency(RequestBody, frozen=True):
    """The emergency key: accepted from any authenticated operator, logged with its author."""

    verb: EmergencyVerb
    author: str = ""
    confirmation: str = ""
    """With disarm: the platform's name, typed."""


class NearbyVehicle(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """Another vehicle in the air near a platform."""

    name: str
    geo: tuple[float, float, float]
    """Latitude and longitude in degrees, altitude above mean sea level in metres."""
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    age_s: float = 0.0
    """Of its position, when the message arrives."""
    is_traffic: bool = False
    """Whether it is none of the station's vehicles: the platform gives way to it."""


class Elsewhere(RequestBody, frozen=True):
    """Progress of another platform in the same mission, or places of vehicles, passed on by the holder of control.

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
    vehicles: list[NearbyVehicle] = []
    """Instead of all that: the vehicles near the platform, for its limiter."""


class Query(RequestBody, frozen=True):
    """Asks what became of an earlier request of the same sender."""

    boot: int
    sequence: int


class Preflight(RequestBody, frozen=True):
    """Requests the pre-flight checks; the autopilot's setup is read again for them."""


class Hello(RequestBody, frozen=True):
    """Requests the full state: components' table, mission, control; it is published on the topics.

    The reply's result is the `MemberRights` of the station, where its network has rights.
    """

    version: str = ""
    """Of the station's software."""
    protocol: str = ""
    """Hash of its protocol, see `gloc3.messages.software`."""
    is_about_rights: bool = False
    """The reply is all that is wanted."""
    is_about_inventory: bool = False
    """The reply is all that is wanted, and its result holds an `Inventory` under `inventory`."""


class Watch(RequestBody, frozen=True):
    """Topics that the station wants to watch, a complete list for `watch.LEASE_S`; repeated while they are displayed.

    The reply's result lists under `refused` the topics that cannot be watched, each with the reason.
    """

    wants: list[Want] = []
    """Empty to end watching."""
    is_listing: bool = False
    """The list of topics is displayed: their activity is wanted, too."""


class ListTopics(RequestBody, frozen=True):
    """Requests the topics that can be watched; the reply's result holds them as `TopicEntry`s under `topics`."""


class ReadReports(RequestBody, frozen=True):
    """Asks for the events behind a number, oldest first; says also that all up to that number are here.

    The reply's result holds under `reports` for each its number, severity, source, text and time, and under `last` the
    highest number.
    """

    store: int
    after: int
    most: int = 40


class ListLogs(RequestBody, frozen=True):
    """Asks for the logs onboard; the reply's result holds a `LogOnboard` for each under `logs`."""


class CutLog(RequestBody, frozen=True):
    """Ends the current log and begins the next, so that the recording so far can be downloaded."""


class DigestLog(RequestBody, frozen=True):
    """Has the SHA-256 digest of a log calculated; it is under `sha256` in the reply's result, in hexadecimal digits."""

    name: str


class ReadLog(RequestBody, frozen=True):
    """Requests a piece of a log, which is sent as a `LogChunk` when the link to the station has room."""

    name: str
    offset: int
    size: int


class ConfirmLog(RequestBody, frozen=True):
    """Confirms that the station has the whole log: it is deleted onboard if its digest there is the same."""

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


QUERIES: Final = (ReadMission, Query, Hello, Watch, ListTopics, Preflight, ReadReports, ListLogs, DigestLog, ReadLog)
"""Read-only requests, permitted to all observers of the platform."""


class StationRole(StrEnum):
    """Permissions of a station."""

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
    until_s: float = 0.0
    """Latest time to carry it out, by the platform's clock; 0 where its sender has not learned that clock. What somebody
    holds back on the way is not carried out when it comes."""
    member: str = ""
    """Of the network: whose rights it has; set by the platform's end of the link, empty for a link that stands for none."""
    objection: str = ""
    """Why the platform's end of the link has it refused; set there."""


class Outcome(StrEnum):
    """Outcomes of a request."""

    ACCEPTED = "accepted"
    """Executed, or (mission, task, action) started."""
    REFUSED = "refused"
    EXPIRED = "expired"
    """Too old for the server's memory: not executed now, and unknown whether it was before."""
    UNKNOWN = "unknown"
    """A query for a request that never arrived, or one whose outcome was lost with the process."""


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
    """With `CallFunction`: the function's reply; with `Hello`: what the station may do, `Rights.summary`; with `Preflight`: the `PreflightReport`; with a start that red checks
    refused: `may_settle`, whether each of them often passes by itself."""


class Inventory(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle's versions, digests, hours and battery."""

    version: str
    """Of its software."""
    protocol: str
    """Hash of its protocol, see `gloc3.messages.software`."""
    platform_digest: str
    """Of what missions are checked against, `Platform.digest`."""
    components: int
    hosts: list[str] = []
    """The other hosts that were heard."""
    firmware: str = ""
    """Of the autopilot: its style and version; empty until they are known."""
    powered_s: float = 0.0
    """How long the onboard process has run in all, s."""
    armed_s: float = 0.0
    """How long it was armed in all, s."""
    armings: int = 0
    """How often it was armed."""
    battery_percent: int = -1
    """-1 where it is not known."""
    battery_v: float = 0.0
    """0 where it is not known."""


class LogOnboard(msgspec.Struct, frozen=True, array_like=True):
    """A log as it lies onboard."""

    name: str
    size: int
    """In bytes."""
    is_open: bool
    """It is still being written."""


class LogChunk(Message, frozen=True):
    """A piece of a log, for the station that requested it."""

    station: str
    name: str
    offset: int
    data: bytes
    reason: str = ""
    """Why there is no data."""
