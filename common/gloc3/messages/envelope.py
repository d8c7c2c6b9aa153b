"""The envelope of messages between components, and the messages that every component has (paper, Table II)."""

from enum import IntEnum, StrEnum
from typing import Any, Generic, TypeVar

import msgspec

from gloc3.component.lci import State


class Message(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Base of all published messages: immutable, passed by reference inside a process.

    Fields are only ever appended, with defaults. Units and frames are in the names.
    """

    def is_sound(self) -> bool:
        """Whether it can be worked with; inputs drop it otherwise, whoever has sent it."""
        return True


M = TypeVar("M", bound=Message)


class Source(msgspec.Struct, frozen=True, gc=False):
    """Publisher of a message: a component of a platform, in one of its lives."""

    platform: str
    component: str
    boot: int
    """A random number (32 bits) for each start of the component, so that receivers see a restart."""


class Envelope(msgspec.Struct, Generic[M], frozen=True):
    """A message in transit, the same on every middleware."""

    topic: str
    source: Source
    sequence: int
    """Counts from 0 for each topic and start of the component; a gap is a loss."""
    t_s: float
    """Time of validity, in seconds since boot of the platform's clock host."""
    frame: str
    """The frame that the payload's coordinates are in; empty where there are none."""
    type: str
    """The payload's type with the hash of its fixed part, `Name#hash`."""
    payload: M


class Kind(StrEnum):
    """The five types of component (paper §III-B)."""

    SAMPLER = "SS"
    PROCESSOR = "DP"
    CONTROLLER = "CC"
    DRIVER = "AD"
    COMMAND_INTERFACE = "CI"


class Severity(IntEnum):
    """Severity of an event; the numbers are MAVLink's MAV_SEVERITY."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class CommandRequest(Message, frozen=True):
    """A command to one component's LCI, sent by the platform's command interface server."""

    request_id: str
    command: str
    """A command of the LCI, or `create`, which creates an absent component from its row."""
    settings: dict[str, Any] | None = None
    """With `initialize`: the settings to adopt; None keeps those of the deployment's row."""
    then: tuple[str, ...] = ()
    """Commands to carry out right after it, with no cycle in between; there is one reply, at the end or at the first
    that is refused or fails. If the table has no row for one of them, none is carried out."""
    is_kept: bool = False
    """Once they are adopted, the settings take the place of the row's, also for later commands without any."""


class CommandReply(Message, frozen=True):
    """Result of a command."""

    request_id: str
    component: str
    command: str
    is_accepted: bool
    state: State | None
    """The state after the command; None is *absent*."""
    reason: str = ""


class FunctionRequest(Message, frozen=True):
    """A typed request to a component that is working or quiet."""

    request_id: str
    function: str
    arguments: dict[str, Any] = {}


class FunctionReply(Message, frozen=True):
    """The answer to a function request."""

    request_id: str
    component: str
    function: str
    is_accepted: bool
    reason: str = ""
    result: dict[str, Any] = {}


class ComponentStatus(Message, frozen=True):
    """The periodic report of one component's health (paper, Table II)."""

    name: str
    kind: Kind
    state: State | None
    """None is *absent*: the component has left the system."""
    rate_hz: float = 0.0
    """Cycles per second since the last periodic report."""
    nominal_rate_hz: float = 0.0
    """The same while its inputs come as they should; 0 for one that only works when something happens."""
    cycle_mean_s: float = 0.0
    """Mean cost of a cycle since the last periodic report."""
    cycle_max_s: float = 0.0
    cycles: int = 0
    overruns: int = 0
    """Cycles that were due while the one before had not ended."""
    errors: int = 0
    cause: str = ""
    """The last error's cause in a line."""
    cause_first_s: float = 0.0
    cause_last_s: float = 0.0
    dropped: int = 0
    """Messages that did not fit the component's bounded input queues."""
    is_required: bool = False
    standby_for: str = ""
    silent: list[str] = []
    """Topics (without the platform's name) that count as silent because nothing was reported on them for too long."""
    values: dict[str, float] = {}
    """What the component reports of itself beside, by the name of the `StatusField`."""


class Event(Message, frozen=True):
    """Something that happened once and that a person may want to read."""

    severity: Severity
    text: str
    details: str = ""
    """More lines, such as a traceback."""
    cause: str = ""
    """What it follows from, as a `gloc3.messages.summaries.Cause`; empty for what stands for itself."""


class InternalState(Message, frozen=True):
    """Record of the data logger at the end of a cycle: selected items of the component's internal state."""

    items: dict[str, Any]


class SignedMessage(Message, frozen=True):
    """A station's message on a network, signed by its member, so that forwarding it changes nothing."""

    data: bytes
    """The message's envelope, encoded."""
    certificate: bytes
    """Of its member: X.509, DER."""
    signature: bytes
    """ECDSA with SHA-256, DER."""
    until_s: float = 0.0
    """Latest time to use it, by the platform's clock; 0 where its sender has not learned that clock."""
    boot: int = 0
    """Of the command interface server that it is for; 0 where its sender has not heard it."""
    utc_s: float = 0.0
    """When it was signed, by its sender's clock."""


class Revocations(Message, frozen=True):
    """The newest list of revoked members that a member of a network has."""

    number: int
    """Of the list; 0 for none."""
    data: bytes = b""
    """The list, signed by the network's authority: X.509 CRL, DER."""
