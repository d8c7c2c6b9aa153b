"""The JSON Schema of platform files, from the reader's structures, the installed components and kinds of arguments."""

import inspect
from collections.abc import Collection
from typing import Any, Final, Literal

from gloc3.component.component import Component
from gloc3.component.description import find_class, installed
from gloc3.documents.format_version import schema_id
from gloc3.documents.json_schema import Schema, described, document, ref, struct_schema
from gloc3.errors import Gloc3Error
from gloc3.mission.model.arguments import argument_kinds
from gloc3.platform.bases import EXTENDS, base_files
from gloc3.platform.platform import Platform

ROW: Final = "ComponentRow"
WHOLE: Final = "whole "


def platform_schema() -> Schema:
    """JSON schema of a platform file; the contents of a component's row depend on its class.

    A file that extends another may omit required keys, and remove keys with null: the definitions allow both. The
    required keys of a self-contained file are in those called `whole …`.
    """
    root, definitions = described(Platform)
    kinds = argument_kinds()
    capability = definitions["Capability"]["properties"]
    capability["arguments"] = {"description": capability["arguments"]["description"], "enum": sorted(kinds)}
    for name, kind in sorted(kinds.items()):
        if claims := kind.claims():
            rule = {"properties": {"arguments": {"const": name}}, "required": ["arguments"]}
            needed = {"allOf": [{"contains": {"const": one}} for one in claims]}
            then: Schema = {"properties": {"claims": needed}, "required": ["claims"]}
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
    whole: dict[str, Schema] = {}
    _needs_below(ref("Platform"), definitions, whole)
    for definition in definitions.values():
        _allow_null(definition)
    extends = (
        "The base or installed platform, or the file beside this one, that this file extends: it says what differs."
    )
    names: Schema = {"anyOf": [{"enum": sorted(base_files())}, {"type": "string", "pattern": r"\.ya?ml$"}]}
    definitions["Platform"]["properties"][EXTENDS] = {"description": extends, **names}
    root |= {"if": {"required": [EXTENDS]}, "else": ref(WHOLE + "Platform")}
    return document(schema_id("platform"), "GLOC3 platform", "A platform file of GLOC3.", root, definitions | whole)


def _row_of(name: str, component: type[Component[Any]], definitions: dict[str, Schema]) -> Schema:
    """Schema of a class's row: its settings, ports, devices, and loggable items."""
    settings = struct_schema(component.settings_type, definitions)
    settings["additionalProperties"] = {"type": "null"}  # of a base's class that had other settings
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
    """A mapping with these keys only; null removes those of a base."""
    return {"properties": dict.fromkeys(sorted(names), True), "additionalProperties": {"type": "null"}}


def _taken_needs(schema: Schema, definitions: dict[str, Schema], whole: dict[str, Schema]) -> Schema:
    """What a mapping must hold, taken out of its schema."""
    needed = schema.pop("required", [])
    found: Schema = {"required": needed} if needed else {}
    inner = {name: _needs_below(child, definitions, whole) for name, child in schema.get("properties", {}).items()}
    rows = {name: ({"not": {"type": "null"}} if name in needed else {}) | needs for name, needs in inner.items()}
    if rows := {name: needs for name, needs in rows.items() if needs}:
        found["properties"] = rows
    rules = [
        {"if": rule["if"], "then": then}
        for rule in schema.get("allOf", [])
        if "then" in rule and (then := _taken_needs(rule["then"], definitions, whole))
    ]
    return found | ({"allOf": rules} if rules else {})


def _needs_below(schema: Schema | Literal[True], definitions: dict[str, Schema], whole: dict[str, Schema]) -> Schema:
    """What the values that a schema describes must hold: of the one alternative that is a mapping or a list of such."""
    if schema is True:
        return {}
    if "$ref" in schema:
        name = str(schema["$ref"]).rpartition("/")[2]
        if WHOLE + name not in whole and (needs := _taken_needs(definitions[name], definitions, whole)):
            whole[WHOLE + name] = needs
        return ref(WHOLE + name) if WHOLE + name in whole else {}
    found = [needs for one in schema.get("anyOf", []) if (needs := _needs_below(one, definitions, whole))]
    found += [
        {key: needs}
        for key in ("items", "additionalProperties")
        if isinstance(schema.get(key), dict) and (needs := _needs_below(schema[key], definitions, whole))
    ]
    return found[0] if found else {}


def _allow_null(schema: Schema) -> None:
    """Lets every entry of a mapping be null."""
    for name, child in schema.get("properties", {}).items():
        schema["properties"][name] = _nullable(child)
    if isinstance(schema.get("additionalProperties"), dict):
        schema["additionalProperties"] = _nullable(schema["additionalProperties"])
    for rule in schema.get("allOf", []):
        _allow_null(rule.get("then", {}))


def _nullable(schema: Schema | Literal[True]) -> Schema | Literal[True]:
    if schema is True:
        return True
    _allow_null(schema)
    if "anyOf" in schema:
        is_there = {"type": "null"} in schema["anyOf"]
        return schema if is_there else schema | {"anyOf": [*schema["anyOf"], {"type": "null"}]}
    if "enum" in schema:
        return schema if None in schema["enum"] else schema | {"enum": [*schema["enum"], None]}
    if isinstance(schema.get("type"), str) and schema["type"] != "null":
        return schema | {"type": [schema["type"], "null"]}
    if "$ref" in schema:
        kept = {key: value for key, value in schema.items() if key != "$ref"}
        return kept | {"anyOf": [{"$ref": schema["$ref"]}, {"type": "null"}]}
    return schema
