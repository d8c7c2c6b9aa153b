"""The JSON Schema of mission files, from the reader's structures and the kinds of arguments that are installed."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, Final

from gloc3.documents.format_version import schema_id
from gloc3.documents.json_schema import Schema, described, document, or_null, ref, struct_schema
from gloc3.mission.checking.checker import Circumstances
from gloc3.mission.model.abilities import nameable
from gloc3.mission.model.arguments import Arguments, argument_kinds
from gloc3.mission.model.model import GEO, ActionFile, MissionFile
from gloc3.platform.platform import Capability, Platform

PARAMETER: Final = "Parameter"
_OPEN: Final = "Open"
_MISSING: Final = "an action names exactly one capability"
"""Error shown by editors that support the keyword `errorMessage`, instead of a request for the first capability."""
_OWNERS: Final = {"TaskFile": "Action", "DefinitionFile": f"{_OPEN}Action"}
"""What has `actions`, and what these are there."""


def mission_schema(platform: Platform | None = None) -> Schema:
    """JSON schema of a mission file.

    Args:
        platform: provides capabilities, cameras and frames; None for every installed kind.
    """
    root, definitions = described(MissionFile)
    _add_action(definitions, Circumstances(platform=platform).capabilities())
    for owner, action in _OWNERS.items():
        _set_actions(definitions[owner]["properties"], action)
    definitions["TaskFile"]["anyOf"] = [{"required": ["actions"]}, {"required": ["use"]}]
    _add_open(definitions)
    if platform is None:
        return document(schema_id("mission"), "GLOC3 mission", "A mission file of GLOC3.", root, definitions)
    frames = [*platform.frames, GEO]
    written = definitions["MissionFile"]["properties"]["frame"]
    text = written.pop("description", "")
    definitions["MissionFile"]["properties"]["frame"] = {"description": text, "anyOf": [{"enum": frames}, written]}
    _free_other_platforms(definitions["TaskFile"], platform.platform)
    urn = schema_id("mission", variant=platform.platform)
    return document(urn, "GLOC3 mission", f"A mission file of GLOC3 for {platform.platform}.", root, definitions)


def _add_action(definitions: dict[str, Schema], rows: Mapping[str, Capability]) -> None:
    """An action holds exactly one capability with its arguments, beside what every action takes."""
    action = struct_schema(ActionFile, definitions)
    kinds = argument_kinds()
    for name, row in sorted(nameable(rows).items()):
        kind = kinds[row.arguments]
        arguments = _arguments(kind, row.options, definitions)
        definitions[f"capability {name}"] = arguments
        shown = {"description": arguments["description"]}
        needed = ref(f"capability {name}")
        action["properties"][name] = shown | (needed if arguments["required"] or kind.one_of else or_null(needed))
    action["oneOf"] = [{"required": [name], "errorMessage": _MISSING} for name in sorted(rows)]
    definitions["Action"] = action


def _arguments(kind: type[Arguments], options: Mapping[str, tuple[str, ...]], definitions: dict[str, Schema]) -> Schema:
    found = struct_schema(kind, definitions)
    found["description"] = f"{found['description'].partition('. ')[0].removesuffix('.')}. Such as {kind.example}"
    for group in kind.one_of:
        given = [{"required": [name], "properties": {name: {"not": {"type": "null"}}}} for name in group]
        found.setdefault("allOf", []).append({"oneOf": given})
    for name, possible in options.items():
        if name in found["properties"]:
            found["properties"][name] = {"enum": list(possible), **_text_of(found["properties"][name])}
    return found


def _text_of(schema: Schema) -> Schema:
    return {key: schema[key] for key in ("description", "default") if key in schema}


def _set_actions(properties: Schema, action: str) -> None:
    """Sets the schema of a mapping of actions, whether the mapping is optional or not."""
    actions = properties["actions"]
    for one in (actions, *actions.get("anyOf", ())):
        if one.get("type") == "object":
            one["additionalProperties"] = ref(action)


def _free_other_platforms(task: Schema, platform: str) -> None:
    """Permits capabilities that this platform lacks in the tasks of other platforms."""
    strict = task["properties"]["actions"]
    task["properties"]["actions"] = _text_of(strict) | {"type": ["object", "null"]}
    others = {"required": ["platform"], "properties": {"platform": {"type": "string", "not": {"const": platform}}}}
    task["if"], task["else"] = others, {"properties": {"actions": strict}}


def _add_open(definitions: dict[str, Schema]) -> None:
    """Permits a parameter in place of every value in a definition."""
    definitions[PARAMETER] = {
        "description": "A parameter of the definition: $NAME.",
        "type": "string",
        "pattern": r"^\$(\{[A-Za-z][A-Za-z0-9_-]*\}|[A-Za-z][A-Za-z0-9_-]*)$",
    }
    waiting = ["Action"]
    while waiting:
        name = waiting.pop()
        if _OPEN + name not in definitions:
            definitions[_OPEN + name] = _opened(definitions[name], waiting)


def _opened(schema: Schema, named: list[str]) -> Schema:
    """A copy in which each value below may be a parameter; the names that it refers to are appended."""
    made = deepcopy(schema)
    for key in ("properties", "additionalProperties", "items", "prefixItems", "anyOf", "allOf", "oneOf", "$ref"):
        if key not in made:
            continue
        inner = made[key]
        match key:
            case "properties":
                made[key] = {name: _or_parameter(one, named) for name, one in inner.items()}
            case "prefixItems":
                made[key] = [_or_parameter(one, named) for one in inner]
            case "anyOf":
                made[key] = [_opened(one, named) for one in inner]
            case "$ref":
                name = inner.rpartition("/")[2]
                named.append(name)
                made[key] = ref(_OPEN + name)["$ref"]
            case "allOf" | "oneOf":
                pass  # they tell which keys must be there
            case _ if isinstance(inner, dict):
                made[key] = _or_parameter(inner, named)
    return made


def _or_parameter(schema: Schema, named: list[str]) -> Schema:
    text = _text_of(schema)
    rest: dict[str, Any] = {key: value for key, value in _opened(schema, named).items() if key not in text}
    return text | {"anyOf": [rest, ref(PARAMETER)]}
