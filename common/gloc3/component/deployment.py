"""Deployment rows: one component of a platform as data (name, class, rate, ports, settings, supervision)."""

from collections.abc import Mapping
from enum import StrEnum
from importlib import import_module
from typing import Annotated, Any, Final

import msgspec

from gloc3.component.component import Component
from gloc3.errors import Gloc3Error
from gloc3.installed import installed_points

DEVICES: Final = "gloc3.devices"
"""Entry points of devices that packages bring: a name to a class or function that makes one, without arguments."""

COMPONENTS: Final = "gloc3.components"
"""Entry points of component classes that packages bring: a short name to `package.module:Class`."""

Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)]


class Begin(StrEnum):
    """The state that a component is brought to when its host starts."""

    IDLE = "idle"
    STANDBY = "standby"
    WORKING = "working"
    QUIET = "quiet"


class FaultPolicy(StrEnum):
    """What a fault leads to when nothing else helps; the mission policies of DESIGN §6 and *ignore*."""

    IGNORE = "ignore"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"


class Reinitialize(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bring a faulty component up again."""

    times: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 3
    back_off_s: Seconds = 0.5
    """Pause before the first attempt; it doubles with each."""


class OnFault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the command interface server does when the component turns faulty, in this order."""

    standby: str | None = None
    """The quiet component that takes over within 100 ms."""
    reinitialize: Reinitialize | None = None
    then: FaultPolicy = FaultPolicy.IGNORE
    """When no standby took over and no attempt is left."""


class ComponentRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One component of a platform."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
    """Its name on the platform, in lower case."""
    class_name: str = msgspec.field(name="class")
    """`package.module:Class`."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None
    """Periodic cycles; None for a component that only works when `trigger` brings something."""
    trigger: str | list[str] | None = None
    """The input, or inputs, whose arrival begins a cycle; the periodic ones, if there is a rate, fill its silence."""
    ports: dict[str, str | list[str]] = {}
    """Port to topic where they differ; an input may be bound to several topics."""
    devices: dict[str, str] = {}
    """Constructor argument to the name of a device, of the host or of an installed package."""
    settings: dict[str, Any] = {}
    log: list[str] = []
    """Items of the internal state to record at the end of every cycle."""
    begin: Begin = Begin.WORKING
    standby_for: str | None = None
    """The primary component whose outputs this one also declares; it begins quiet."""
    required: bool = False
    """Whether the platform is unwell without it."""
    on_fault: OnFault | FaultPolicy = FaultPolicy.IGNORE
    timeout_s: Seconds = 5.0
    """Longest time that initialize, start, stop or finish may take."""
    status_period_s: Annotated[float, msgspec.Meta(ge=0.05, le=60.0)] = 1.0
    latency_s: Seconds = 0.0
    """Modelled time from a cycle's begin to its results, in virtual time, of a component with heavy work."""
    host: str = ""
    """The computer that it runs on, one of the platform's `hosts`; empty for the first of them."""
    process: Annotated[str, msgspec.Meta(pattern=r"^([a-z][a-z0-9_]{0,31})?$")] = ""
    """A process of its own on that host, shared with the rows that have the same word; empty for the host's main one."""

    @property
    def triggers(self) -> list[str]:
        """The inputs whose arrival begins a cycle."""
        return [] if self.trigger is None else [self.trigger] if isinstance(self.trigger, str) else self.trigger

    def topics(self, port: str) -> list[str]:
        """The topics (without the platform's name) that a port is bound to."""
        bound = self.ports.get(port, port)
        return [bound] if isinstance(bound, str) else bound

    def load_class(self) -> type[Component[Any]]:
        """The component's class.

        Raises:
            Gloc3Error: it cannot be imported, or is no component.
        """
        try:
            found = _load(self.class_name)
        except (ImportError, AttributeError, ValueError) as error:
            raise Gloc3Error(f"component {self.name}: cannot load {self.class_name!r}: {error}") from error
        if not (isinstance(found, type) and issubclass(found, Component)):
            raise Gloc3Error(f"component {self.name}: {self.class_name!r} is not a component class")
        return found

    def create(self, devices: Mapping[str, Any]) -> Component[Any]:
        """A new instance with its devices: those of the host, or new ones of installed packages.

        Raises:
            Gloc3Error: the class cannot be loaded, or a device is not there.
        """
        found = self.load_class()
        given = {argument: self._device(device, devices) for argument, device in self.devices.items()}
        try:
            return found(**given)
        except TypeError as error:
            raise Gloc3Error(f"component {self.name}: {found.__name__} takes other devices: {error}") from error

    def _device(self, name: str, devices: Mapping[str, Any]) -> Any:
        if name in devices:
            return devices[name]
        points = {point.name: point for point in installed_points(DEVICES)}
        if name not in points:
            known = sorted({*devices, *points})
            raise Gloc3Error(
                f"component {self.name}: the host has no device {name!r}; it has {', '.join(known) or 'none'}"
            )
        try:
            return points[name].load()()
        except (ImportError, AttributeError, OSError, TypeError) as error:
            raise Gloc3Error(f"component {self.name}: device {name!r} cannot be made: {error}") from error


def _load(path: str) -> Any:
    """What `package.module:Class` names; for an installed component, also after its module has moved in its package.

    Platform files and logs keep the path of the day on which they were written.
    """
    module_name, _, class_name = path.partition(":")
    try:
        return getattr(import_module(module_name), class_name)
    except ModuleNotFoundError:
        package = module_name.partition(".")[0]
        for point in installed_points(COMPONENTS):
            if point.module.partition(".")[0] == package and point.attr == class_name:
                return point.load()
        raise
