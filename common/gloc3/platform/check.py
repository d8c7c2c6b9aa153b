"""Checks of a platform file beyond its types: references between names, classes, ports and settings."""

from collections.abc import Collection, Iterator
from contextlib import suppress
from typing import Any, Final

from gloc3.component.action import ActionPerformer
from gloc3.component.component import Component
from gloc3.component.deployment import ComponentRow, Problem, problems_of
from gloc3.documents import schema
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, Gloc3Error, nearest
from gloc3.messages.topics import TopicTable, matches
from gloc3.messages.vehicle import Manoeuvre, Setpoint
from gloc3.mission.model.arguments import argument_kinds
from gloc3.mission.model.model import ActionFile
from gloc3.platform.places import ProcessPlace, clock_host, host_names, place_of, tied_device
from gloc3.platform.platform import Platform

FROM_LINKS: Final = ("ci/request", "ci/heard", "velocity_demand", "host_presence")
"""Topics that the links to the stations bring, and to the other hosts."""

_POLICY_CAPABILITIES = ("hold", "land", "return_home")


def findings_of(
    platform: Platform, document: Document, *, is_loading_classes: bool, devices: Collection[str] | None = None
) -> list[Finding]:
    """All errors in a platform file whose types are valid."""
    found = [
        *_components(platform, document, is_loading_classes, devices),
        *_capabilities(platform, document),
        *_devices(platform, document),
        *_places(platform, document),
    ]
    if is_loading_classes:
        found += _logged(platform, document)
    if is_loading_classes:
        found += _needs(platform, document)
        found += _performers(platform, document)
    return found


def _components(
    platform: Platform, document: Document, is_loading_classes: bool, devices: Collection[str] | None
) -> Iterator[Finding]:
    topics = TopicTable.installed() if is_loading_classes else None
    for problem in problems_of(
        platform.components, topics, external=FROM_LINKS, devices=devices, is_loading_classes=is_loading_classes
    ):
        where = ("components", problem.row, *problem.path)
        if problem.path == ("settings",):
            yield from _settings(platform.components[problem.row], document, where)
        else:
            yield document.finding(
                where, problem.message, problem.hint, at_key=problem.is_key, is_warning=problem.is_warning
            )


def _devices(platform: Platform, document: Document) -> Iterator[Finding]:
    """Sources for devices that no component uses."""
    used = sorted({device for row in platform.components for device in row.devices.values()})
    for name, source in platform.devices.items():
        is_of_pair = any(url.startswith("pair:") and name in url for url in platform.devices.values())
        if name not in used and not is_of_pair:
            message = f"no component uses a device {name!r}, so {source} is not read"
            yield document.finding(("devices", name), message, nearest(name, used), at_key=True, is_warning=True)


def _logged(platform: Platform, document: Document) -> Iterator[Finding]:
    """Patterns that fit no topic."""
    known = sorted({*platform.topics(), *(name for name, _ in TopicTable.installed())})
    for pattern in platform.log:
        if not any(matches(pattern, topic) or matches(topic, pattern) for topic in known):
            message = f"no topic fits {pattern!r}, so nothing of it is recorded"
            yield document.finding(("log", pattern), message, nearest(pattern, known), at_key=True)


def _places(platform: Platform, document: Document) -> Iterator[Finding]:
    """Hosts and processes that do not exist, or lack something that a component needs."""
    for problem in _place_problems(platform):
        where = ("components", problem.row, *problem.path)
        yield document.finding(where, problem.message, problem.hint, is_warning=problem.is_warning)


def _place_problems(platform: Platform) -> Iterator[Problem]:
    """The problems of the rows' `host` and `process`, each with its place in the file."""
    known = host_names(platform)
    owners: dict[str, tuple[str, ProcessPlace]] = {}
    main = ProcessPlace(clock_host(platform))
    by_name = {row.name: row for row in platform.components}
    for index, row in enumerate(platform.components):
        if row.host and row.host not in known:
            hint = nearest(row.host, known) if platform.hosts else "list the computers under hosts:"
            yield Problem(index, ("host",), f"the platform has no host {row.host!r}", hint)
            continue
        place = place_of(platform, row)
        device = tied_device(platform, row)
        if device and place != main:
            path = ("process",) if place.host == main.host else ("host",) if row.host else ()
            where = f"the main process of {main.host}"
            yield Problem(
                index, path, f"{row.name} needs the device {device!r}, which only {where} has", f"not {place}"
            )
        for used in () if device else sorted(set(row.devices.values()) & set(platform.devices)):
            owner, there = owners.setdefault(used, (row.name, place))
            if there != place:
                message = f"{owner} has the device {used!r} open in {there}, and {row.name} runs in {place}"
                yield Problem(index, ("devices",), message, "a device belongs to one process: run both there")
        primary = by_name.get(row.standby_for or "")
        if primary is not None and row.process and place_of(platform, primary) == place:
            message = f"if the process {place} ends, {primary.name} and this standby of it both end"
            yield Problem(index, ("process",), message, "give it another process", is_warning=True)


def _settings(row: ComponentRow, document: Document, where: Where) -> Iterator[Finding]:
    """Errors in settings, each with its line."""
    findings: list[Finding] = []
    schema.check(document.node(where), row.load_class().settings_type, document.file, findings)
    yield from findings


def _capabilities(platform: Platform, document: Document) -> Iterator[Finding]:
    kinds = argument_kinds()
    names = [row.name for row in platform.components]
    for name, row in platform.capabilities.items():
        where = ("capabilities", name)
        if row.arguments not in kinds:
            hint = nearest(row.arguments, sorted(kinds))
            yield document.finding((*where, "arguments"), f"unknown kind of arguments {row.arguments!r}", hint)
        elif missing := [one for one in kinds[row.arguments].claims() if one not in row.claims]:
            claims = ", ".join([*row.claims, *missing])
            message = f"{name} does not claim {', '.join(missing)}, which {row.arguments} always needs for itself"
            yield document.finding(where, message, f"claims: [{claims}]", at_key=True)
        if name in ActionFile.__struct_fields__:
            hint = "give it another name"
            yield document.finding(where, f"{name!r} is a key of every action, not a capability", hint, at_key=True)
        if row.performed_by not in names and (row.performed_by or row.arguments != "wait"):
            hint = nearest(row.performed_by, names)
            yield document.finding((*where, "performed_by"), f"no component {row.performed_by!r}", hint)
    if any("motion" in row.claims for row in platform.capabilities.values()):
        for name in _POLICY_CAPABILITIES:
            if name not in platform.capabilities:
                yield document.finding(
                    ("capabilities",),
                    f"the capability {name!r} is missing",
                    "mission policies use it",
                )


def _needs(platform: Platform, document: Document) -> Iterator[Finding]:
    known = sorted({*platform.topics(), *platform.capabilities, *(row.name for row in platform.components)})
    for name, row in platform.capabilities.items():
        for index, need in enumerate(row.needs):
            if need not in known:
                where = ("capabilities", name, "needs", index)
                yield document.finding(where, f"no topic, capability or component {need!r}", nearest(need, known))


def _performers(platform: Platform, document: Document) -> Iterator[Finding]:
    """Capabilities whose component does not perform them, or whose motion nobody reads."""
    classes = _classes(platform)
    rows = {row.name: row for row in platform.components}
    read = {topic for name, kind in classes.items() for port in kind.inputs for topic in rows[name].topics(port)}
    for name, capability in platform.capabilities.items():
        kind = classes.get(capability.performed_by)
        if kind is None:
            continue
        where, by = ("capabilities", name, "performed_by"), capability.performed_by
        performed = sorted(kind.performs) if issubclass(kind, ActionPerformer) else []
        if (capability.performed_as or name) not in performed:
            what = f"it performs {', '.join(performed)}" if performed else f"{kind.__name__} performs no actions"
            yield document.finding(where, f"{by} does not perform {name}", what)
        elif "motion" in capability.claims:
            topics = [
                topic
                for port, output in kind.outputs.items()
                if issubclass(output.message, (Setpoint, Manoeuvre))
                for topic in rows[by].topics(port)
            ]
            for topic in topics:
                if topic not in read:
                    message = f"nothing reads {topic!r}, by which {by} moves the vehicle"
                    yield document.finding(where, message, f"list {topic} in the ports of the limiter")


def _classes(platform: Platform) -> dict[str, type[Component[Any]]]:
    """The classes of the components that can be loaded."""
    found = {}
    for row in platform.components:
        with suppress(Gloc3Error):  # told with the row
            found[row.name] = row.load_class()
    return found
