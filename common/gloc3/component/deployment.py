"""Deployment rows: one component of a platform as data (name, class, rate, ports, settings, supervision)."""

import inspect
from collections.abc import Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from fnmatch import fnmatchcase
from importlib import import_module
from typing import Annotated, Any, Final, NamedTuple

import msgspec

from gloc3.component.component import Component
from gloc3.component.settings import load_settings
from gloc3.errors import Finding, Gloc3Error, InputError, nearest
from gloc3.installed import installed_points
from gloc3.messages.envelope import Kind
from gloc3.messages.topics import TopicTable, matches

DEVICES: Final = "gloc3.devices"
"""Entry points of devices in installed packages: a name and a class or function that creates one, without arguments."""

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
    """Name on the platform, in lower case."""
    class_name: str = msgspec.field(name="class")
    """`package.module:Class`."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None
    """Periodic cycles; None for a component that only works when `trigger` brings something."""
    trigger: str | list[str] | None = None
    """Input or inputs whose arrival triggers a cycle; with a rate, periodic cycles fill the gaps."""
    ports: dict[str, str | list[str]] = {}
    """Port to topic where they differ; an input may be bound to several topics."""
    devices: dict[str, str] = {}
    """Constructor argument to the name of a device, of the host or of an installed package."""
    settings: dict[str, Any] = {}
    log: list[str] = []
    """Items of the internal state to record at the end of every cycle."""
    begin: Begin = Begin.WORKING
    standby_for: str | None = None
    """Primary component whose outputs this one also declares; it starts quiet."""
    required: bool = False
    """Whether the platform is unwell without it."""
    on_fault: OnFault | FaultPolicy = FaultPolicy.IGNORE
    timeout_s: Seconds = 5.0
    """Longest time that initialize, start, stop or finish may take."""
    status_period_s: Annotated[float, msgspec.Meta(ge=0.05, le=60.0)] = 1.0
    latency_s: Seconds = 0.0
    """Modelled time from a cycle's begin to its results, in virtual time, of a component with heavy work."""
    host: str = ""
    """Computer that it runs on, one of the platform's `hosts`; empty for the first of them."""
    process: Annotated[str, msgspec.Meta(pattern=r"^([a-z][a-z0-9_]{0,31})?$")] = ""
    """Separate process on that host, shared by the rows with the same value; empty for the host's main process."""

    @property
    def triggers(self) -> list[str]:
        """Inputs whose arrival triggers a cycle."""
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
            raise Gloc3Error(f"component {self.name}: {found.__name__} needs other devices: {error}") from error

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
    """Imports `package.module:Class`; an installed component is found even if its module has moved in its package.

    Platform files and logs keep the path from when they were written.
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


PUBLISHED_BY_HOSTS: Final = ("status", "reply", "function_reply", "event", "internal")
"""What the host of every component publishes."""

Classes = dict[str, type[Component[Any]]]
"""The classes of the rows that could be loaded, by the component's name."""


class Problem(NamedTuple):
    """A definite or doubtful error in a row, with its path there, so that a reader can find line and column."""

    row: int
    """Index of the row."""
    path: tuple[str | int, ...]
    """Where in the row, such as `("ports", "height")`; empty for the row itself."""
    message: str
    hint: str = ""
    is_key: bool = False
    """Whether the name at the path is meant, and not the value under it."""
    is_warning: bool = False

    def finding(self, name: str) -> Finding:
        """The problem as a finding about a component."""
        place = ".".join(str(part) for part in self.path)
        text = f"{place}: {self.message}" if place else self.message
        return Finding(file=f"component {name}", message=text, hint=self.hint, is_warning=self.is_warning)


def check_row(row: ComponentRow, component: type[Component[Any]]) -> list[Finding]:
    """What in a row does not fit its class; settings are checked when the component initializes."""
    return [problem.finding(row.name) for problem in _class_problems(0, row, component)]


def problems_of(
    rows: Sequence[ComponentRow],
    topics: TopicTable | None,
    *,
    external: Collection[str] = (),
    devices: Collection[str] | None = None,
    is_loading_classes: bool = True,
) -> Iterator[Problem]:
    """The problems of a deployment, each with its place.

    Args:
        rows: the components of a platform.
        topics: the topics that are known; None does not check topics.
        external: patterns of topics that come from elsewhere.
        devices: patterns of the devices that the host has, besides those of installed packages; None does not check.
        is_loading_classes: whether the classes are imported, and the rows checked against them.
    """
    yield from _row_problems(rows)
    yield from _relation_problems(rows)
    if not is_loading_classes:
        return
    classes: Classes = {}
    for index, row in enumerate(rows):
        try:
            classes[row.name] = row.load_class()
        except Gloc3Error as error:
            yield Problem(index, ("class",), str(error), "is the package installed?")
            continue
        yield from _class_problems(index, row, classes[row.name])
        yield from _settings_problems(index, row, classes[row.name])
        yield from _device_problems(index, row, classes[row.name])
        yield from _host_problems(index, row, devices)
    yield from _shared_outputs(rows, classes)
    yield from _deaf_standbys(rows, classes)
    if topics is not None:
        yield from _topic_problems(rows, classes, topics, external)


def _row_problems(rows: Sequence[ComponentRow]) -> Iterator[Problem]:
    for index, row in enumerate(rows):
        if row.rate_hz is None and not row.triggers:
            hint = "give rate_hz, or trigger with the name of an input"
            yield Problem(index, (), f"component {row.name} would never work", hint)


def _class_problems(index: int, row: ComponentRow, component: type[Component[Any]]) -> Iterator[Problem]:
    ports = sorted((*component.inputs, *component.outputs))
    for port in row.ports:
        if port not in ports:
            hint = nearest(port, ports)
            yield Problem(index, ("ports", port), f"{component.__name__} has no port {port!r}", hint, is_key=True)
        elif port in component.outputs and not row.topics(port):
            yield Problem(index, ("ports", port), "bound to no topic", f"leave the line out for {port!r} itself")
    inputs = sorted(component.inputs)
    for position, trigger in enumerate(row.triggers):
        if trigger not in inputs:
            place = ("trigger",) if isinstance(row.trigger, str) else ("trigger", position)
            yield Problem(index, place, f"{component.__name__} has no input {trigger!r}", nearest(trigger, inputs))
    if row.triggers and row.rate_hz is None and component.kind in (Kind.CONTROLLER, Kind.DRIVER):
        message = f"it stops permanently when {' and '.join(row.triggers)} stops, since nothing else triggers it"
        yield Problem(index, ("trigger",), message, "give it a rate_hz, too, such as 5", is_warning=True)
    for position, item in enumerate(row.log):
        if item not in component.loggable:
            hint = nearest(item, component.loggable)
            yield Problem(index, ("log", position), f"{component.__name__} cannot log {item!r}", hint)


def _settings_problems(index: int, row: ComponentRow, component: type[Component[Any]]) -> Iterator[Problem]:
    try:
        load_settings(component.settings_type, row.settings, row.name)
    except InputError as error:
        for finding in error.findings:
            yield Problem(index, ("settings",), finding.message, finding.hint)


def _device_problems(index: int, row: ComponentRow, component: type[Component[Any]]) -> Iterator[Problem]:
    parameters = inspect.signature(component).parameters.values()
    known = sorted(parameter.name for parameter in parameters)
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return
    for argument in row.devices:
        if argument not in known:
            hint = nearest(argument, known)
            message = f"{component.__name__} has no device {argument!r}"
            yield Problem(index, ("devices", argument), message, hint, is_key=True)
    for parameter in parameters:
        is_needed = parameter.default is parameter.empty and parameter.kind is not parameter.VAR_POSITIONAL
        if is_needed and parameter.name not in row.devices:
            hint = f"add it under devices: {parameter.name}: NAME"
            yield Problem(index, ("devices",), f"{component.__name__} needs a device {parameter.name!r}", hint)


def _host_problems(index: int, row: ComponentRow, devices: Collection[str] | None) -> Iterator[Problem]:
    if devices is None:
        return
    known = sorted({*devices, *(point.name for point in installed_points(DEVICES))})
    for argument, name in row.devices.items():
        if not any(fnmatchcase(name, pattern) for pattern in known):
            yield Problem(index, ("devices", argument), f"the host has no device {name!r}", nearest(name, known))


def _relation_problems(rows: Sequence[ComponentRow]) -> Iterator[Problem]:
    names = [row.name for row in rows]
    by_name = {row.name: row for row in reversed(rows)}
    for index, row in enumerate(rows):
        if row.name in names[:index]:
            yield Problem(index, ("name",), f"a second component {row.name!r}", "names are unique on a platform")
        others = [name for name in names if name != row.name]
        if row.standby_for is not None:
            if row.standby_for not in others:
                hint = nearest(row.standby_for, others)
                yield Problem(index, ("standby_for",), f"no other component {row.standby_for!r}", hint)
            elif by_name[row.standby_for].standby_for is not None:
                hint = f"name the primary: {by_name[row.standby_for].standby_for}"
                yield Problem(index, ("standby_for",), f"{row.standby_for!r} is itself a standby", hint)
            elif row.begin is not Begin.QUIET:
                hint = "at most one of a primary and its standbys is not quiet"
                yield Problem(index, ("begin",), "a standby starts quiet", hint)
        standby = row.on_fault.standby if isinstance(row.on_fault, OnFault) else None
        if standby is not None:
            place = ("on_fault", "standby")
            if standby not in others:
                yield Problem(index, place, f"no other component {standby!r}", nearest(standby, others))
            elif by_name[standby].standby_for != row.name:
                hint = f"give {standby} the row entry standby_for: {row.name}"
                yield Problem(index, place, f"{standby!r} is no standby for it", hint)


def _shared_outputs(rows: Sequence[ComponentRow], classes: Classes) -> Iterator[Problem]:
    owners: dict[str, ComponentRow] = {}
    for index, row in enumerate(rows):
        for port, topic in _topics_of(row, classes, "outputs"):
            owner = owners.setdefault(topic, row)
            if owner.name != row.name and (owner.standby_for or owner.name) != (row.standby_for or row.name):
                hint = f"bind {port!r} to another topic, or say standby_for: {owner.name}"
                yield Problem(index, ("ports", port), f"{topic!r} is an output of {owner.name} already", hint)


def unread_by_standby(primary: ComponentRow, standby: ComponentRow) -> dict[str, list[str]]:
    """Inputs that a primary reads and its standby does not: after a take-over nothing that comes there has an effect.

    Args:
        primary: of a class that can be loaded.
        standby: of the same or another such class.

    Returns:
        Port of the primary to its topics that the standby reads on no port.
    """
    read = {topic for port in standby.load_class().inputs for topic in standby.topics(port)}
    read.update(topic for port in primary.load_class().outputs for topic in primary.topics(port))
    unread = {
        port: [topic for topic in primary.topics(port) if topic not in read] for port in primary.load_class().inputs
    }
    return {port: topics for port, topics in unread.items() if topics}


def _deaf_standbys(rows: Sequence[ComponentRow], classes: Classes) -> Iterator[Problem]:
    """Standbys that read less than their primaries. What samples or estimates may be meant to do with less."""
    by_name = {row.name: row for row in reversed(rows)}
    for index, row in enumerate(rows):
        primary = by_name.get(row.standby_for or "")
        if primary is None or row.name not in classes or primary.name not in classes:
            continue
        kind = classes[primary.name]
        for port, topics in unread_by_standby(primary, row).items():
            where = ("ports", port) if port in row.ports else ("ports",) if row.ports else ()
            message = f"{row.name} does not read {', '.join(topics)}, which {primary.name} reads as {port!r}"
            hint = f"bind {port!r} as {primary.name} does: after a take-over nothing else reads it"
            is_warning = kind.kind not in (Kind.CONTROLLER, Kind.DRIVER)
            yield Problem(index, where, message, hint, is_warning=is_warning)


def _topic_problems(
    rows: Sequence[ComponentRow], classes: Classes, topics: TopicTable, external: Collection[str]
) -> Iterator[Problem]:
    produced = [topic for row in rows for _, topic in _topics_of(row, classes, "outputs")]
    produced += [f"components/{row.name}/{what}" for row in rows for what in PUBLISHED_BY_HOSTS]
    known = sorted({*(topic for topic in produced if topics.row(f"platform/{topic}")), *(topic for topic, _ in topics)})
    for index, row in enumerate(rows):
        if row.name not in classes:
            continue
        component = classes[row.name]
        for kind, ports in (("outputs", component.outputs), ("inputs", component.inputs)):
            for port, topic in _topics_of(row, classes, kind):
                where = ("ports", port)
                declared = topics.row(f"platform/{topic}")
                if declared is None and kind == "inputs" and port not in row.ports:
                    if not component.inputs[port].is_optional:
                        hint = f"bind {port!r} to a topic, or to [] if it is not needed here"
                        yield Problem(index, where, "the input is bound to no known topic", hint, is_warning=True)
                elif declared is None:
                    yield Problem(index, where, f"unknown topic {topic!r}", nearest(topic, known))
                elif not issubclass(ports[port].message, declared.message):
                    wanted, found = declared.message.__name__, ports[port].message.__name__
                    yield Problem(index, where, f"{topic!r} carries {wanted}, and the port {found}")
                elif (
                    kind == "inputs"
                    and not component.inputs[port].is_optional
                    and not any(matches(topic, source) or matches(source, topic) for source in (*produced, *external))
                ):
                    hint = nearest(topic, produced)
                    yield Problem(index, where, f"no component publishes {topic!r}", hint, is_warning=True)


def _topics_of(row: ComponentRow, classes: Classes, kind: str) -> Iterator[tuple[str, str]]:
    """Port and topic (a key as `*`) of every output or input of a row whose class could be loaded."""
    component = classes.get(row.name)
    for port in getattr(component, kind, {}):
        for topic in row.topics(port):
            yield port, topic.replace("{key}", "*")
