"""What must hold in a deployment beyond its types: rows that fit their classes, the topics, and each other."""

import inspect
from collections.abc import Collection, Iterator, Sequence
from fnmatch import fnmatchcase
from typing import Any, Final, NamedTuple

from gloc3.component.component import Component
from gloc3.component.deployment import DEVICES, Begin, ComponentRow, OnFault
from gloc3.component.settings import load_settings
from gloc3.errors import Finding, Gloc3Error, InputError, nearest
from gloc3.installed import installed_points
from gloc3.messages.topics import TopicTable, matches

TOLD_BY_HOSTS: Final = ("status", "reply", "function_reply", "event", "internal")
"""What the host of every component publishes."""

Classes = dict[str, type[Component[Any]]]
"""The classes of the rows that could be loaded, by the component's name."""


class Problem(NamedTuple):
    """Something that is wrong (or doubtful) in a row, with its place there, so that a reader can tell line and column."""

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


def check_deployment(
    rows: Sequence[ComponentRow], topics: TopicTable, *, external: Collection[str] = ()
) -> list[Finding]:
    """Everything that is wrong with a deployment whose rows fit their types.

    Args:
        rows: the components of a platform.
        topics: the topics that are known.
        external: patterns of topics that come from elsewhere, such as from a station.
    """
    return [problem.finding(rows[problem.row].name) for problem in problems_of(rows, topics, external=external)]


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
    """The problems of a deployment, each with its place; see `check_deployment`.

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
            message = f"{component.__name__} takes no device {argument!r}"
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
                yield Problem(index, ("begin",), "a standby begins quiet", hint)
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


def _topic_problems(
    rows: Sequence[ComponentRow], classes: Classes, topics: TopicTable, external: Collection[str]
) -> Iterator[Problem]:
    produced = [topic for row in rows for _, topic in _topics_of(row, classes, "outputs")]
    produced += [f"components/{row.name}/{what}" for row in rows for what in TOLD_BY_HOSTS]
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
                    hint = f"bind {port!r} to a topic, or to [] if it is not needed here"
                    yield Problem(index, where, "the input is bound to no known topic", hint, is_warning=True)
                elif declared is None:
                    yield Problem(index, where, f"unknown topic {topic!r}", nearest(topic, known))
                elif not issubclass(ports[port].message, declared.message):
                    wanted, found = declared.message.__name__, ports[port].message.__name__
                    yield Problem(index, where, f"{topic!r} carries {wanted}, and the port {found}")
                elif kind == "inputs" and not any(
                    matches(topic, source) or matches(source, topic) for source in (*produced, *external)
                ):
                    hint = nearest(topic, produced)
                    yield Problem(index, where, f"nobody here brings {topic!r}", hint, is_warning=True)


def _topics_of(row: ComponentRow, classes: Classes, kind: str) -> Iterator[tuple[str, str]]:
    """The port and topic (a key as `*`) of every output or input of a row whose class is there."""
    component = classes.get(row.name)
    for port in getattr(component, kind, {}):
        for topic in row.topics(port):
            yield port, topic.replace("{key}", "*")
