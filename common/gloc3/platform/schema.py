"""The JSON Schema of platform files, from the reader's structures, the installed components and kinds of arguments."""

import inspect
from collections.abc import Collection
from typing import Any, Final

from gloc3.component.component import Component
from gloc3.component.description import find_class, installed
from gloc3.documents.json_schema import Schema, described, document, ref, struct_schema
from gloc3.errors import Gloc3Error
from gloc3.mission.model.arguments import argument_kinds
from gloc3.platform.platform import Platform

ROW: Final = "ComponentRow"


def platform_schema() -> Schema:
    """The schema of a platform file; what a component's row may hold depends on its class."""
    root, definitions = described(Platform)
    kinds = argument_kinds()
    capability = definitions["Capability"]["properties"]
    capability["arguments"] = {"description": capability["arguments"]["description"], "enum": sorted(kinds)}
    for name, kind in sorted(kinds.items()):
        if claims := kind.claims():
            rule = {"properties": {"arguments": {"const": name}}, "required": ["arguments"]}
            needed = {"allOf": [{"contains": {"const": one}} for one in claims]}
            then = {"properties": {"claims": needed}, "required": ["claims"]}
            definitions["Capability"].setdefault("allOf", []).append({"if": rule, "then": then})
    row = definitions[ROW]
    paths = []
    for name, path in sorted(installed().items()):
        try:
            component = find_class(path)
        except Gloc3Error:
            continue  # its package lacks something here, and is told so where it is used
        paths.append(path)
        rule = {"properties": {"class": {"const": path}}, "required": ["class"]}
        row.setdefault("allOf", []).append({"if": rule, "then": _row_of(name, component, definitions)})
    written = row["properties"]["class"]
    description = written.pop("description")
    row["properties"]["class"] = {"description": description, "anyOf": [{"enum": paths}, written]}
    return document("GLOC3 platform", "A platform file of GLOC3.", root, definitions)


def _row_of(name: str, component: type[Component[Any]], definitions: dict[str, Schema]) -> Schema:
    """What the row of a class may name: its settings, ports, devices, and what can be logged."""
    settings = struct_schema(component.settings_type, definitions)
    settings["description"] = (inspect.getdoc(component) or "").partition("\n")[0]
    definitions[f"settings of {name}"] = settings
    inputs = sorted(component.inputs)
    found: Schema = {
        "settings": ref(f"settings of {name}"),
        "ports": _keys((*component.inputs, *component.outputs)),
        "trigger": {"anyOf": [{"enum": inputs}, {"type": "array", "items": {"enum": inputs}}, {"type": "null"}]}
        if inputs
        else {"enum": [None, []]},
        "log": {"items": {"enum": sorted(component.loggable)}} if component.loggable else {"maxItems": 0},
    }
    devices = inspect.signature(component).parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in devices):
        return {"properties": found}
    needed = [one.name for one in devices if one.default is one.empty and one.kind is not one.VAR_POSITIONAL]
    found["devices"] = _keys([one.name for one in devices]) | {"required": needed}
    return {"properties": found, "required": ["devices"] if needed else []}


def _keys(names: Collection[str]) -> Schema:
    """A mapping with no other keys than these."""
    return {"propertyNames": {"enum": sorted(names)}} if names else {"maxProperties": 0}
