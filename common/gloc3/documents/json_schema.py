"""JSON Schema (draft 2020-12) of YAML files, with which editors complete, explain and check them.

Types, bounds and defaults come from the structures that the readers use. The description of a field is its docstring,
with the unit from its name.
"""

import typing
from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec

from gloc3.component.settings import field_docs
from gloc3.messages.units import split_unit

Schema = dict[str, Any]

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_REF: Final = "#/$defs/"


def described(kind: Any) -> tuple[Schema, dict[str, Schema]]:
    """Schema of a type that msgspec supports, and the definitions that it refers to, all with descriptions.

    Args:
        kind: a structure, or any other type.
    """
    (schema,), definitions = msgspec.json.schema_components((kind,), ref_template=_REF + "{name}")
    for struct in _structs(kind, set()):
        if struct.__name__ in definitions:
            _describe(definitions[struct.__name__], struct)
    for node in definitions.values():
        node.pop("title", None)  # an editor would show the name of a class
    return schema, definitions


def ref(name: str) -> Schema:
    """A reference to a definition."""
    return {"$ref": _REF + name}


def struct_schema(struct: type[msgspec.Struct], definitions: dict[str, Schema]) -> Schema:
    """Schema of the structure itself; the types it refers to are added to the definitions."""
    _, found = described(struct)
    own = found.pop(struct.__name__)
    definitions |= found
    return own


def document(urn: str, title: str, description: str, root: Schema, definitions: Mapping[str, Schema]) -> Schema:
    """A whole schema file; `urn` is its `$id`."""
    return {
        "$schema": DIALECT,
        "$id": urn,
        "title": title,
        "description": description,
        **root,
        "$defs": {name: definitions[name] for name in sorted(definitions)},
    }


def as_text(schema: Schema) -> str:
    """A schema as it is written to a file."""
    return msgspec.json.format(msgspec.json.encode(schema), indent=2).decode() + "\n"


def or_null(schema: Schema) -> Schema:
    """The same, or nothing at all."""
    return {"anyOf": [schema, {"type": "null"}]}


def _describe(node: Schema, struct: type[msgspec.Struct]) -> None:
    docs = field_docs(struct)
    node["description"] = " ".join((struct.__doc__ or "").split())
    for field in msgspec.structs.fields(struct):
        unit = split_unit(field.encode_name)[1]
        words = [" ".join(docs.get(field.name, "").split()), f"[{unit}]" if unit else ""]
        if text := " ".join(word for word in words if word):
            node["properties"][field.encode_name]["description"] = text


def _structs(kind: Any, seen: set[Any]) -> Iterator[type[msgspec.Struct]]:
    """All structures that a type is made of."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        if kind not in seen:
            seen.add(kind)
            yield kind
            for field in msgspec.structs.fields(kind):
                yield from _structs(field.type, seen)
        return
    for part in typing.get_args(kind):
        yield from _structs(part, seen)
