"""Ports: the inputs and outputs that a component class declares, and the inbox that a cycle reads."""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any, Generic, TypeVar

import msgspec

from gloc3.errors import Misuse
from gloc3.messages.envelope import Envelope, Message

M = TypeVar("M", bound=Message)


class Keep(StrEnum):
    """Policy of a full input queue; dropped messages are counted."""

    LATEST = "latest"
    """Holds only the newest message; those that it replaces unread are not losses."""
    ALL = "all"
    """Holds every message up to its depth, then refuses new ones."""


class Port(Generic[M]):
    """A named place of a component where messages of one type come in or go out."""

    def __init__(self, message: type[M]) -> None:
        self.message = message
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class Input(Port[M]):
    """A port that takes messages: `imu = Input(ImuSample)`.

    Platform files in which no component publishes to it get a warning, unless it is optional. An optional input whose name
    is no topic is off until a platform file binds it.
    """

    def __init__(
        self, message: type[M], keep: Keep = Keep.LATEST, depth: int = 64, *, is_optional: bool = False
    ) -> None:
        super().__init__(message)
        self.is_optional = is_optional
        self.keep = keep
        self.depth = depth if keep is Keep.ALL else 1


class Output(Port[M]):
    """A port that publishes messages: `height = Output(HeightAboveGround)`.

    A topic with `{key}` makes a keyed port, which reaches many topics (only command interfaces have these).
    """

    def __init__(self, message: type[M], frame: str = "") -> None:
        super().__init__(message)
        self.frame = frame

    def report(self, message: M, *, t_s: float | None = None, key: str = "") -> "PortReport":
        """A result for this port; needed where a class has two ports of one type, or to state the time of validity."""
        return PortReport(self.name, message, t_s, key)


class PortGroup:
    """Ports that belong to one part of a component: `observed = ObservedPorts` in the component's class.

    The ports keep their own names: those of all groups and of the class itself must differ.
    """


class PortReport(msgspec.Struct, frozen=True, gc=False):
    """A result addressed to a port of its component."""

    port: str
    message: Message
    t_s: float | None = None
    """Time of validity; None means the cycle's own time."""
    key: str = ""


class Actuation(msgspec.Struct, frozen=True):
    """A write to a device, decided by `work()`; the host has it carried out, unless the component is quiet."""

    write: Any


Result = Message | PortReport | Actuation
"""What `work()` returns."""


class Inbox:
    """What came in since the last cycle, and the last of each input."""

    __slots__ = ("_latest", "_new")

    def __init__(self, new: dict[str, Sequence[Envelope[Any]]], latest: dict[str, Envelope[Any]]) -> None:
        self._new = new
        self._latest = latest

    def new(self, port: Input[M]) -> Sequence[Envelope[M]]:
        """The messages since the last cycle, oldest first (at most one where the port keeps the latest)."""
        return self._new.get(port.name, ())

    def latest(self, port: Input[M]) -> Envelope[M] | None:
        """Last message received on a port, whatever its age; None before the first."""
        return self._latest.get(port.name)

    def is_fresh(self, port: Input[M], now_s: float, limit_s: float) -> bool:
        """Whether the age of the last message of a port is at most `limit_s`."""
        latest = self._latest.get(port.name)
        return latest is not None and now_s - latest.t_s <= limit_s


def inbox_of(**messages: Envelope[Any] | Sequence[Envelope[Any]]) -> Inbox:
    """An inbox for tests: port name to one message or several."""
    new = {name: (given,) if isinstance(given, Envelope) else tuple(given) for name, given in messages.items()}
    return Inbox(dict(new), {name: given[-1] for name, given in new.items() if given})


def ports_of(cls: type) -> tuple[dict[str, Input[Any]], dict[str, Output[Any]]]:
    """Inputs and outputs that a class declares, those of its bases first, those of port groups in declaration order."""
    declared: dict[str, Port[Any]] = {}
    for base in reversed(cls.__mro__):
        own: dict[str, Port[Any]] = {}
        for owner, name, port in _declared_in(base):
            if name in own:
                raise Misuse(f"{owner.__name__}.{name}: {cls.__name__} has a port {name!r} already")
            if not isinstance(port, Input | Output):
                raise Misuse(f"{owner.__name__}.{name} is neither Input nor Output")
            own[name] = port
        declared |= own
    return (
        {name: port for name, port in declared.items() if isinstance(port, Input)},
        {name: port for name, port in declared.items() if isinstance(port, Output)},
    )


def _declared_in(cls: type) -> Iterator[tuple[type, str, Port[Any]]]:
    for name, value in vars(cls).items():
        if isinstance(value, Port):
            yield cls, name, value
        elif isinstance(value, type) and issubclass(value, PortGroup):
            yield from _declared_in(value)
