"""`docs/reference/{mission,platform}-file.md` and `station-lines.md`: the published JSON Schemas as tables."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.house.table import table

FOLDER: Final = Path(__file__).parents[2] / "docs" / "schema"
_REF: Final = "#/$defs/"
_LINKS: Final = {"capability ": "capabilities.md", "settings of ": "components.md"}
"""Beginnings of the names of definitions that have a page of their own."""
_OPEN: Final = "Open"
"""Beginning of the name of a definition whose values may be parameters."""
_LEFT_OUT: Final = (_OPEN, "whole ", "row of ", *_LINKS)
"""Definitions that repeat others, with parameters or with all that is required."""
_FORMS: Final[dict[str, str]] = {"string": "text", "integer": "whole number", "boolean": "`true` or `false`"}

Node = dict[str, Any]


def mission() -> Iterator[str]:
    """Mission files."""
    yield (
        "[missions.md](../missions.md) explains them. In a [definition](../missions.md#reusable-task-definitions) every value may be a "
        "parameter, `$NAME`. The arguments of each capability are [here](capabilities.md).\n"
    )
    yield from _page("mission", "MissionFile")


def platform() -> Iterator[str]:
    """Platform files."""
    yield (
        "[vehicles.md](../vehicles.md) explains them. A file with `extends` needs none of the keys, and removes a key by "
        "`null`. The settings of each component are [here](components.md).\n"
    )
    yield from _page("platform", "Platform")


def station_lines() -> Iterator[str]:
    """JSON lines of the station."""
    yield (
        "The lines of [`gloc3 station --headless --json`](../ground-station.md#without-a-terminal): all have the fields of "
        "`line event`, and `data` by their kind.\n"
    )
    yield from _page("station-lines", "line event")


def _page(name: str, first: str) -> Iterator[str]:
    """A schema: where its file is, and its definitions."""
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text(encoding="utf-8"))
    yield f"JSON Schema: [{name}.schema.json](../schema/{name}.schema.json).\n"
    definitions = schema["$defs"]
    shown = [one for one in definitions if one != first and not one.startswith(_LEFT_OUT)]
    whole = definitions.get(f"whole {first}", {})
    for one in (first, *shown):
        node = definitions[one]
        yield f"## {one}\n"
        yield f"{node.get('description', '')}\n"
        required = definitions.get(f"whole {one}", whole if one == first else {}).get("required", [])
        required = [*required, *node.get("required", [])]
        if "enum" in node:
            yield f"{_kind(node)}\n"
        elif rows := [_row(key, value, key in required) for key, value in node.get("properties", {}).items()]:
            yield from table(("field", "type", "bounds", "default", "meaning"), rows)


def _row(name: str, node: Node, is_required: bool) -> tuple[str, str, str, str, str]:
    default = "required" if is_required else _default(node)
    return f"`{name}`", _kind(node), _bounds(node), default, node.get("description", "")


def _default(node: Node) -> str:
    """The default value; a structure's is that of its fields."""
    return f"`{json.dumps(node['default'])}`" if "default" in node and not isinstance(node["default"], dict) else ""


def _kind(node: Node) -> str:
    """The type of a value, in words."""
    if "$ref" in node:
        return _link(node["$ref"].removeprefix(_REF))
    if "const" in node:
        return f"`{node['const']}`"
    if "enum" in node:
        return ", ".join(f"`{json.dumps(one).strip(chr(34))}`" for one in node["enum"])
    if "anyOf" in node:
        return " or ".join(dict.fromkeys(_kind(one) for one in node["anyOf"] if one.get("type") != "null"))
    kinds = node.get("type", "anything")
    kind = next((one for one in kinds if one != "null"), "") if isinstance(kinds, list) else kinds
    if kind == "array" and node.get("prefixItems"):
        return f"[{', '.join(_kind(one) for one in node['prefixItems'])}]"
    if kind == "array":
        return f"list of {_kind(node['items'])}" if isinstance(node.get("items"), dict) else "list"
    if kind == "object":
        values = node.get("additionalProperties")
        return f"names, each with {_kind(values)}" if isinstance(values, dict) and values else "mapping"
    return _FORMS.get(kind, kind)


def _link(name: str) -> str:
    name = name.removeprefix(_OPEN)
    for begin, page in _LINKS.items():
        if name.startswith(begin):
            own = name.removeprefix(begin)
            return f"[{own}]({page}#{own})"
    return f"[{name}](#{name.lower().replace(' ', '-')})"


def _bounds(node: Node) -> str:
    """The bounds of a number, or of the numbers in a list."""
    for part in (node, *node.get("anyOf", []), *node.get("prefixItems", [])):
        signs = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
        found = [f"{sign} {part[key]:g}" for key, sign in signs.items() if key in part]
        if found:
            return ", ".join(found)
    items = node.get("items")
    return _bounds(items) if isinstance(items, dict) else ""
