"""Foxglove's own description of its messages, against which ours are parsed."""

from functools import cache
from typing import Any

import foxglove.messages
from google.protobuf import descriptor_pool, json_format, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp

from gloc3.log.foxglove.schemas import VIEWS

OWN_FIELDS = {
    "foxglove.CompressedImage": {"data"},
    "foxglove.PointCloud": {"data"},
    "foxglove.RawImage": {"data", "height", "width"},
}
"""Fields of a message that are those of Foxglove's schema, too."""
BESIDE = {view.schema: set(view.properties) for _, view in VIEWS}


def foxglove_fields(schema: str, values: dict[str, Any], *, is_ours: bool) -> dict[str, Any]:
    """What Foxglove reads of a record; a message of ours has its own fields, too."""
    wanted = BESIDE.get(schema, set()) | OWN_FIELDS.get(schema, set())
    return {name: value for name, value in values.items() if name in wanted} if is_ours else values


def parsed(schema: str, values: dict[str, Any]) -> Any:
    """The message as Foxglove's SDK describes it.

    Raises:
        json_format.ParseError: a field is not in the schema, or of another type.
    """
    kind, pool = _described(schema)
    return json_format.ParseDict(_timed(values), kind(), descriptor_pool=pool)


@cache
def _described(schema: str) -> tuple[Any, Any]:
    described = getattr(foxglove.messages, schema.removeprefix("foxglove.")).get_schema()
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(described.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema)), pool


def _timed(value: Any) -> Any:
    """The same with times as Protobuf has them in JSON."""
    if isinstance(value, dict):
        if value.keys() == {"sec", "nsec"}:
            time = Timestamp()
            time.FromNanoseconds(value["sec"] * 1_000_000_000 + value["nsec"])
            return time.ToJsonString()
        return {name: _timed(inner) for name, inner in value.items()}
    return [_timed(inner) for inner in value] if isinstance(value, list) else value
