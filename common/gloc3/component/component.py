"""The generic component (paper §IV): its author writes the intended function, its host provides the rest."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from typing import Any, ClassVar, Final, Generic, NamedTuple, TypeVar, cast, get_args, get_type_hints

from gloc3.component.ports import Inbox, Input, Output, Result, ports_of
from gloc3.component.settings import NoSettings, Settings
from gloc3.errors import Misuse
from gloc3.messages.envelope import Kind, Message

S = TypeVar("S", bound=Settings)
R = TypeVar("R", bound=Message)
F = TypeVar("F", bound=Callable[..., Message])


FUNCTION_MARK: Final = "__gloc3_function__"

RESERVED_FUNCTIONS: Final = ("set_rate", "set_logging")
"""What the host answers for every component."""


class FunctionEntry(NamedTuple):
    """A function that a component offers while it is working or quiet."""

    name: str
    method: str
    request: type[Message]
    reply: type[Message]
    doc: str


def function(name: str) -> Callable[[F], F]:
    """Marks a method `(self, request: RequestType, now_s: float) -> ReplyType` as answering function messages.

    The method runs between cycles. It raises `Refused` for arguments that it cannot take.
    """

    def mark(method: F) -> F:
        setattr(method, FUNCTION_MARK, name)
        return method

    return mark


def _functions_of(cls: type) -> dict[str, FunctionEntry]:
    entries: dict[str, FunctionEntry] = {}
    for attribute in dir(cls):
        method = getattr(cls, attribute, None)
        name = getattr(method, FUNCTION_MARK, None)
        if name is None or method is None:
            continue
        hints = get_type_hints(method)
        if not (_is_message(hints.get("request")) and _is_message(hints.get("return"))):
            raise Misuse(f"{cls.__name__}.{attribute} must be (self, request: Message, now_s: float) -> Message")
        if name in entries or name in RESERVED_FUNCTIONS:
            raise Misuse(f"{cls.__name__}.{attribute}: a function {name!r} already exists")
        entries[name] = FunctionEntry(
            name, attribute, hints["request"], hints["return"], (method.__doc__ or "").strip()
        )
    return entries


class Component(ABC, Generic[S]):
    """Base of every component of GLOC3. Derive from one of the five types below.

    The methods are called by the host, one at a time, never by other components. An exception in any of them makes the
    component *faulty*; `Refused`, raised by a method that has changed nothing, rejects the request. `work()` returns
    the component's results; a component never publishes, sleeps, names another component, or touches its own state.
    """

    kind: ClassVar[Kind]
    settings_type: ClassVar[type[Settings]] = NoSettings
    """What `initialize` is given: the type in brackets behind the base class, as in `SensorSampler[CameraSettings]`."""
    loggable: ClassVar[tuple[str, ...]] = ()
    """The attributes that the data logger may record at the end of a cycle."""

    status_values: Mapping[str, float] = {}
    """What it reports of itself in its status, by the name of the `StatusField`, such as the temperature of its device."""

    request_cycle: Callable[[], None] = staticmethod(lambda: None)
    """Requests a cycle soon; set by the host. Devices with new data call it, from any thread."""

    inputs: ClassVar[dict[str, Input[Any]]]
    needs_one_of: ClassVar[tuple[str, ...]] = ()
    """Inputs of which one at least has to come, or what it publishes becomes invalid; none where each alone is enough, or
    nothing is."""
    outputs: ClassVar[dict[str, Output[Any]]]
    functions: ClassVar[dict[str, "FunctionEntry"]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Collects the class's settings, ports and functions, so that mistakes show at import."""
        super().__init_subclass__(**kwargs)
        for base in cls.__dict__.get("__orig_bases__", ()):
            for argument in get_args(base):
                if isinstance(argument, type) and issubclass(argument, Settings):
                    cls.settings_type = argument
        cls.inputs, cls.outputs = ports_of(cls)
        cls.functions = _functions_of(cls)

    @cached_property
    def settings(self) -> S:
        """The settings that `initialize` has adopted last; before that, the defaults."""
        return cast("S", self.settings_type())

    def initialize(self, settings: S) -> None:
        """Adopts settings; called again to adopt others."""
        self.settings = settings

    def start(self) -> None:
        """Begins to provide the function; `work()` follows every cycle."""

    @abstractmethod
    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Runs one cycle of the function; returns its results.

        Args:
            now_s: seconds since boot of the clock host.
            inbox: messages received on the inputs.
        """

    def goquiet(self) -> None:
        """Withholds results from now on; the work continues."""

    def resume(self) -> None:
        """Results are reported again."""

    def stop(self) -> None:
        """Ends the function; a later `start()` starts from a clean state."""

    def finish(self) -> None:
        """Gives back what `initialize()` took."""


class SensorSampler(Component[S]):
    """SS: the interface with a physical sensor, sampled at the requested rate."""

    kind = Kind.SAMPLER

    @cached_property
    def until_stop(self) -> ExitStack:
        """What `start()` enters here, such as an open device, ends with `stop()`, or with the `start()` if that fails."""
        return ExitStack()

    def stop(self) -> None:
        """Ends what was begun."""
        self.until_stop.close()


class DataProcessor(Component[S]):
    """DP: estimates state from sensor data."""

    kind = Kind.PROCESSOR


class Controller(Component[S]):
    """CC: computes actuator commands from the processors' estimates."""

    kind = Kind.CONTROLLER


class ActuatorDriver(Component[S]):
    """AD: the interface with a physical actuator.

    `work()` returns the writes as `Actuation`s; the host calls `actuate()` with each, unless quiet.
    """

    kind = Kind.DRIVER

    @abstractmethod
    def actuate(self, write: Any) -> None:
        """Writes to the device what `work()` decided."""

    @abstractmethod
    def make_safe(self) -> None:
        """Leaves the device safe; called before going quiet, before a stop, and when the component turns faulty.

        Called only if the driver has worked since it last made the device safe, so that a takeover does not disturb it.
        """

    def check_leaving(self) -> None:
        """Called before `make_safe()` on a command to go quiet or stop; raises `Refused` if that is not allowed now."""


class CommandInterface(Component[S]):
    """CI: the communication between a base station (client) and a platform (server)."""

    kind = Kind.COMMAND_INTERFACE


def _is_message(annotation: object) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Message)
