"""Foxglove schemas of messages: the fields added to a message's own so that the app can show it.

A log record is a JSON object with the payload's own fields, so that it can be restored without loss. Where one of
Foxglove's schemas has the same meaning, its fields are added and the channel has its schema's name. The schema follows
from the message type's fields: any type with `position_ned_m` and `ned_from_frd` is a pose.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.log.json_schema import Schema
from gloc3.log.pictures import FORMAT as PICTURE_FORMAT
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.frames import ENU_FROM_NED, IDENTITY, Quaternion, Vector3

MAP_FRAME: Final = "map"
"""The frame that Foxglove's 3D panel shows upright: x east, y north, z up."""
NED_FRAME: Final = "ned"
MAP_FROM_NED: Final = ENU_FROM_NED

_NUMBER: Final[Schema] = {"type": "number"}
_TEXT: Final[Schema] = {"type": "string"}
_INTEGER: Final[Schema] = {"type": "integer"}
_TIME: Final[Schema] = {"type": "object", "title": "time", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
_VECTOR: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Vector3",
    "properties": {"x": _NUMBER, "y": _NUMBER, "z": _NUMBER},
}
_QUATERNION: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Quaternion",
    "properties": {"x": _NUMBER, "y": _NUMBER, "z": _NUMBER, "w": _NUMBER},
}
_POSE: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Pose",
    "properties": {"position": _VECTOR, "orientation": _QUATERNION},
}
_LEVELS: Final = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")
_LEVEL_OF: Final[Mapping[Severity, int]] = {
    Severity.EMERGENCY: 5,
    Severity.ALERT: 5,
    Severity.CRITICAL: 5,
    Severity.ERROR: 4,
    Severity.WARNING: 3,
    Severity.NOTICE: 2,
    Severity.INFO: 2,
    Severity.DEBUG: 1,
}


class FoxgloveView(NamedTuple):
    """One of Foxglove's schemas, and how its fields follow from a message."""

    schema: str
    properties: Mapping[str, Schema]
    """The fields that are written beside the message's own."""
    fields: Callable[[Envelope[Any]], dict[str, Any]]
    """Their values, but for `timestamp`."""


def _vector(vector: Vector3) -> dict[str, float]:
    x, y, z = vector
    return {"x": x, "y": y, "z": z}


def _quaternion(rotation: Quaternion) -> dict[str, float]:
    w, x, y, z = rotation
    return {"x": x, "y": y, "z": z, "w": w}


def _pose(position: Vector3, rotation: Quaternion, frame: str) -> dict[str, Any]:
    return {
        "frame_id": frame or NED_FRAME,
        "pose": {"position": _vector(position), "orientation": _quaternion(rotation)},
    }


def _location(envelope: Envelope[Any]) -> dict[str, Any]:
    geo = envelope.payload.geo
    if geo is None:
        return {}
    latitude, longitude, altitude = geo
    return {"frame_id": envelope.frame or NED_FRAME, "latitude": latitude, "longitude": longitude, "altitude": altitude}


def _fix(envelope: Envelope[Any]) -> dict[str, Any]:
    fix = envelope.payload
    return {
        "frame_id": envelope.frame or NED_FRAME,
        "latitude": fix.latitude_deg,
        "longitude": fix.longitude_deg,
        "altitude": fix.altitude_m,
    }


def _log(envelope: Envelope[Any]) -> dict[str, Any]:
    event = envelope.payload
    name = getattr(event, "source", "") or envelope.source.component
    return {"level": _LEVEL_OF[event.severity], "message": event.text, "name": name, "file": "", "line": 0}


def _image(envelope: Envelope[Any]) -> dict[str, Any]:
    return {"frame_id": envelope.payload.camera, "format": PICTURE_FORMAT}


_POSE_PROPERTIES: Final = {
    "timestamp": _TIME,
    "frame_id": _TEXT,
    "pose": _POSE,
}
_FIX_PROPERTIES: Final = {
    "timestamp": _TIME,
    "frame_id": _TEXT,
    "latitude": _NUMBER,
    "longitude": _NUMBER,
    "altitude": _NUMBER,
}

VIEWS: Final[tuple[tuple[frozenset[str], FoxgloveView], ...]] = (
    (
        frozenset({"position_ned_m", "ned_from_frd"}),
        FoxgloveView(
            "foxglove.PoseInFrame",
            _POSE_PROPERTIES,
            lambda e: _pose(e.payload.position_ned_m, e.payload.ned_from_frd, e.frame),
        ),
    ),
    (
        frozenset({"position_ned_m", "attitude_wxyz"}),
        FoxgloveView(
            "foxglove.PoseInFrame",
            _POSE_PROPERTIES,
            lambda e: _pose(e.payload.position_ned_m, e.payload.attitude_wxyz, e.frame),
        ),
    ),
    (
        frozenset({"camera", "width", "height", "data"}),
        FoxgloveView(
            "foxglove.CompressedImage",
            {"timestamp": _TIME, "frame_id": _TEXT, "format": _TEXT},
            _image,
        ),
    ),
    (
        frozenset({"latitude_deg", "longitude_deg", "altitude_m"}),
        FoxgloveView("foxglove.LocationFix", _FIX_PROPERTIES, _fix),
    ),
    (frozenset({"geo"}), FoxgloveView("foxglove.LocationFix", _FIX_PROPERTIES, _location)),
    (
        frozenset({"severity", "text"}),
        FoxgloveView(
            "foxglove.Log",
            {
                "timestamp": _TIME,
                "level": {"oneOf": [{"title": title, "const": level} for level, title in enumerate(_LEVELS)]},
                "message": _TEXT,
                "name": _TEXT,
                "file": _TEXT,
                "line": _INTEGER,
            },
            _log,
        ),
    ),
)
"""The fields that a message type must have for a view; the first row that fits counts."""

TRANSFORM_SCHEMA: Final[Schema] = {
    "title": "foxglove.FrameTransform",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "parent_frame_id": _TEXT,
        "child_frame_id": _TEXT,
        "translation": _VECTOR,
        "rotation": _QUATERNION,
    },
}


PATH_SCHEMA: Final[Schema] = {
    "title": "foxglove.PosesInFrame",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": _TEXT,
        "poses": {"type": "array", "items": _POSE},
    },
}


def view_of(message_type: type[msgspec.Struct]) -> FoxgloveView | None:
    """Foxglove's view of a message type; None where it has no schema for it."""
    names = {field.encode_name for field in msgspec.structs.fields(message_type)}
    for needed, view in VIEWS:
        if needed <= names and names.isdisjoint(view.properties):
            return view
    return None


def timestamp(publish_ns: int) -> dict[str, int]:
    """Foxglove's form of a time."""
    seconds, nanoseconds = divmod(publish_ns, 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}


def transform(parent: str, child: str, translation_m: Vector3, parent_from_child: Quaternion) -> dict[str, Any]:
    """Where a frame hangs in another, as a `foxglove.FrameTransform` without its time."""
    return {
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": _vector(translation_m),
        "rotation": _quaternion(parent_from_child),
    }


def path(points_ned_m: Sequence[Vector3]) -> dict[str, Any]:
    """The corners of a path, as a `foxglove.PosesInFrame` without its time."""
    poses = [{"position": _vector(point), "orientation": _quaternion(IDENTITY)} for point in points_ned_m]
    return {"frame_id": NED_FRAME, "poses": poses}
