"""What must hold in a platform file beyond its types: names that refer to each other, classes, ports and settings."""

from collections.abc import Iterator

from gloc3 import schema
from gloc3.deployment import ComponentRow, OnFault
from gloc3.document import Document
from gloc3.errors import Finding, Gloc3Error, nearest
from gloc3.mission.arguments import argument_kinds
from gloc3.platform import Platform
from gloc3.yaml_nodes import Node

_POLICY_CAPABILITIES = ("hold", "land", "return_home")


def findings_of(platform: Platform, document: Document, *, is_loading_classes: bool) -> list[Finding]:
    """Everything that is wrong with a platform whose types fit."""
    found = [*_components(platform, document), *_capabilities(platform, document)]
    if is_loading_classes:
        for index, row in enumerate(platform.components):
            found += _class(row, index, document)
        found += _needs(platform, document)
    return found


def _components(platform: Platform, document: Document) -> Iterator[Finding]:
    names = [row.name for row in platform.components]
    for index, row in enumerate(platform.components):
        where = ("components", index)
        if row.name in names[:index]:
            yield document.finding(
                (*where, "name"), f"a second component {row.name!r}", "names are unique on a platform"
            )
        if row.standby_for is not None and (row.standby_for not in names or row.standby_for == row.name):
            hint = nearest(row.standby_for, [name for name in names if name != row.name])
            yield document.finding((*where, "standby_for"), f"no other component {row.standby_for!r}", hint)
        standby = row.on_fault.standby if isinstance(row.on_fault, OnFault) else None
        if standby is not None:
            target = platform.component(standby)
            if target is None:
                yield document.finding(
                    (*where, "on_fault", "standby"), f"no component {standby!r}", nearest(standby, names)
                )
            elif target.standby_for != row.name:
                hint = f"give {standby} the row entry standby_for: {row.name}"
                yield document.finding((*where, "on_fault", "standby"), f"{standby!r} is no standby for it", hint)
        if row.rate_hz is None and row.trigger is None:
            hint = "give rate_hz, or trigger with the name of an input"
            yield document.finding(where, f"component {row.name} would never work", hint)


def _capabilities(platform: Platform, document: Document) -> Iterator[Finding]:
    kinds = sorted(argument_kinds())
    names = [row.name for row in platform.components]
    for name, row in platform.capabilities.items():
        where = ("capabilities", name)
        if row.arguments not in kinds:
            hint = nearest(row.arguments, kinds)
            yield document.finding((*where, "arguments"), f"unknown kind of arguments {row.arguments!r}", hint)
        if row.performed_by not in names and (row.performed_by or row.arguments != "wait"):
            hint = nearest(row.performed_by, names)
            yield document.finding((*where, "performed_by"), f"no component {row.performed_by!r}", hint)
    if any("motion" in row.claims for row in platform.capabilities.values()):
        for name in _POLICY_CAPABILITIES:
            if name not in platform.capabilities:
                yield document.finding(
                    ("capabilities",),
                    f"the capability {name!r} is missing",
                    "the policies of missions are flown with it",
                )


def _class(row: ComponentRow, index: int, document: Document) -> Iterator[Finding]:
    where = ("components", index)
    try:
        found = row.load_class()
    except Gloc3Error as error:
        yield document.finding((*where, "class"), str(error), "is the package installed?")
        return
    ports = sorted((*found.inputs, *found.outputs))
    for port in row.ports:
        if port not in ports:
            yield document.finding(
                (*where, "ports", port), f"{found.__name__} has no port {port!r}", nearest(port, ports), at_key=True
            )
    if row.trigger is not None and row.trigger not in found.inputs:
        hint = nearest(row.trigger, sorted(found.inputs))
        yield document.finding((*where, "trigger"), f"{found.__name__} has no input {row.trigger!r}", hint)
    for position, item in enumerate(row.log):
        if item not in found.loggable:
            hint = nearest(item, list(found.loggable))
            yield document.finding((*where, "log", position), f"{found.__name__} cannot log {item!r}", hint)
    findings: list[Finding] = []
    node = document.node(where)
    given = node.children.get("settings", Node({}, node.line, node.column))
    schema.check(given, found.settings_type, document.file, findings, "settings")
    yield from findings


def _needs(platform: Platform, document: Document) -> Iterator[Finding]:
    known = sorted({*platform.topics(), *platform.capabilities, *(row.name for row in platform.components)})
    for name, row in platform.capabilities.items():
        for index, need in enumerate(row.needs):
            if need not in known:
                where = ("capabilities", name, "needs", index)
                yield document.finding(where, f"nothing here is called {need!r}", nearest(need, known))
