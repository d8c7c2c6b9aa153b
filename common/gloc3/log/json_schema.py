"""JSON schemas of message types, in the simple form that Foxglove reads.

Foxglove (its `parseJsonSchema`) supports objects, arrays of objects or scalars, scalars, base64 text and enums of
numbers (`oneOf` with `const`); anything else makes the channel unreadable. The schemas of msgspec are reduced to that:
`$ref` is resolved, an optional field has its plain type, a tuple of numbers becomes an array. A field that cannot be
expressed is left out of the schema, not of the data.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec

from gloc3.messages.envelope import Message

Schema = dict[str, Any]

SCALARS: Final = ("boolean", "integer", "number", "string")


def describe_type(message_type: type[Message], title: str, beside: Mapping[str, Schema]) -> Schema:
    """JSON schema of a message's object.

    Args:
        message_type: the described type.
        title: the schema's name.
        beside: additional properties, before its own.
    """
    full = msgspec.json.schema(message_type)
    definitions = full["$defs"]
    own = _simple(full, definitions, ()) or {}
    return {
        "title": title,
        "description": own.get("description", ""),
        "type": "object",
        "properties": {**beside, **own.get("properties", {})},
    }


def _simple(node: Schema, definitions: Schema, inside: tuple[str, ...]) -> Schema | None:
    """A node in the simple form; None where it has none."""
    if "$ref" in node:
        name = str(node["$ref"]).rpartition("/")[2]
        return None if name in inside else _simple(definitions[name], definitions, (*inside, name))
    if "anyOf" in node:
        return _alternatives(node["anyOf"], definitions, inside)
    if "enum" in node:
        return {"type": "string" if all(isinstance(word, str) for word in node["enum"]) else "number"}
    kind = node.get("type")
    if kind == "object":
        properties = {
            name: simple
            for name, child in node.get("properties", {}).items()
            if (simple := _simple(child, definitions, inside)) is not None
        }
        text = {"description": node["description"]} if "description" in node else {}
        return {**text, "type": "object", "properties": properties}
    if kind == "array":
        return _array(node, definitions, inside)
    if kind in SCALARS:
        encoding = {"contentEncoding": "base64"} if node.get("contentEncoding") == "base64" else {}
        return {"type": kind, **encoding}
    return None


def _alternatives(options: list[Schema], definitions: Schema, inside: tuple[str, ...]) -> Schema | None:
    """Schema of a union: an optional value has its plain type; other unions are not supported."""
    found = [_simple(option, definitions, inside) for option in options if option.get("type") != "null"]
    return found[0] if len(found) == 1 else None


def _array(node: Schema, definitions: Schema, inside: tuple[str, ...]) -> Schema | None:
    """An array of one kind of item; tuples count when all their items are of the same kind."""
    given = node.get("prefixItems") or [node.get("items")]
    items = [_simple(item, definitions, inside) if isinstance(item, dict) else None for item in given]
    first = items[0]
    if first is None or first["type"] == "array" or "contentEncoding" in first or any(i != first for i in items):
        return None
    return {"type": "array", "items": first}
