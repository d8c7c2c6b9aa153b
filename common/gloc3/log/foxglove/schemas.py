"""Foxglove schemas of messages: the fields added to a message's own so that the app can show it.

A log record is a JSON object with the payload's own fields, so that it can be restored without loss. Where one of
Foxglove's schemas has the same meaning, its fields are added and the channel has its schema's name. The schema follows
from the message type's fields: any type with `position_ned_m` and `ned_from_frd` is a pose.
"""

from array import array
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.log.json_schema import Schema
from gloc3.log.pictures import FORMAT as PICTURE_FORMAT
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.frames import ENU_FROM_NED, IDENTITY, Quaternion, Vector3
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED

MAP_FRAME: Final = "map"
"""The frame that Foxglove's 3D panel shows upright: x east, y north, z up."""
NED_FRAME: Final = "ned"
MAP_FROM_NED: Final = ENU_FROM_NED

NUMBER: Final[Schema] = {"type": "number"}
TEXT: Final[Schema] = {"type": "string"}
INTEGER: Final[Schema] = {"type": "integer"}
TIME: Final[Schema] = {"type": "object", "title": "time", "properties": {"sec": INTEGER, "nsec": INTEGER}}
VECTOR: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Vector3",
    "properties": {"x": NUMBER, "y": NUMBER, "z": NUMBER},
}
QUATERNION: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Quaternion",
    "properties": {"x": NUMBER, "y": NUMBER, "z": NUMBER, "w": NUMBER},
}
POSE: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Pose",
    "properties": {"position": VECTOR, "orientation": QUATERNION},
}
NUMBERS: Final[Schema] = {"type": "array", "items": NUMBER}
XYZ_STRIDE: Final = 12
FLOAT32: Final = 7
"""Foxglove's number for that type of an element."""
UINT8: Final = 1
GRID_FIELDS: Final = ("occupancy", "top_dm")
"""Of a map's cell: 0 for free, 100 for occupied, 255 for unknown; height up to which it is occupied, 0 where it is not."""
_OCCUPANCY: Final = [255] * 256
"""The first of these by the state of a cell."""
_OCCUPANCY[CELL_FREE], _OCCUPANCY[CELL_OCCUPIED] = 0, 100
FAR: Final = 1e30
"""Greatest coordinate that fits such an element."""
_FIELD: Final[Schema] = {
    "type": "object",
    "title": "foxglove.PackedElementField",
    "properties": {"name": TEXT, "offset": INTEGER, "type": INTEGER},
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


def shown_pose(position: Vector3, rotation: Quaternion) -> dict[str, Any]:
    """A `foxglove.Pose`."""
    return {"position": _vector(position), "orientation": _quaternion(rotation)}


def body_frame(platform: str) -> str:
    """Name of the frame of a vehicle's body, which is forward, right, down."""
    return f"{platform}/body"


_XYZ: Final = {
    "pose": shown_pose((0.0, 0.0, 0.0), IDENTITY),
    "point_stride": XYZ_STRIDE,
    "fields": [{"name": axis, "offset": 4 * index, "type": FLOAT32} for index, axis in enumerate("xyz")],
}
"""Of a point cloud: three numbers a point, in the axes of its frame."""


def _pose(position: Vector3, rotation: Quaternion, frame: str) -> dict[str, Any]:
    return {"frame_id": frame or NED_FRAME, "pose": shown_pose(position, rotation)}


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


def _satellite_fix(envelope: Envelope[Any]) -> dict[str, Any]:
    latitude, longitude, altitude = envelope.payload.place_geo
    return {"frame_id": envelope.frame or NED_FRAME, "latitude": latitude, "longitude": longitude, "altitude": altitude}


def _log(envelope: Envelope[Any]) -> dict[str, Any]:
    event = envelope.payload
    name = getattr(event, "source", "") or envelope.source.component
    return {"level": _LEVEL_OF[event.severity], "message": event.text, "name": name, "file": "", "line": 0}


def _image(envelope: Envelope[Any]) -> dict[str, Any]:
    return {"frame_id": envelope.payload.camera, "format": PICTURE_FORMAT}


def _scan(envelope: Envelope[Any]) -> dict[str, Any]:
    scan = envelope.payload
    ranges = array("f", scan.ranges_m[: len(scan.ranges_m) // 4 * 4])
    return {
        "frame_id": scan.scanner,
        "pose": shown_pose((0.0, 0.0, 0.0), IDENTITY),
        "start_angle": scan.angle_min_rad,
        "end_angle": scan.angle_min_rad + scan.angle_step_rad * max(len(ranges) - 1, 0),
        "ranges": [each if isfinite(each) else scan.range_max_m for each in ranges],
        "intensities": [],
    }


def _depth(envelope: Envelope[Any]) -> dict[str, Any]:
    return {"frame_id": envelope.payload.camera, "encoding": "16UC1", "step": 2 * envelope.payload.width}


def _cloud(envelope: Envelope[Any]) -> dict[str, Any]:
    return {"frame_id": body_frame(envelope.source.platform), **_XYZ}


def _obstacles(envelope: Envelope[Any]) -> dict[str, Any]:
    scan = envelope.payload
    points = [each for north, east in scan.points_ne_m for each in (north, east, -scan.height_m)]
    return {
        "frame_id": NED_FRAME,
        **_XYZ,
        "data": array("f", [max(-FAR, min(FAR, each)) for each in points]).tobytes(),
    }


def _grid(envelope: Envelope[Any]) -> dict[str, Any]:
    """The layer of the vehicle, and how high each cell is occupied; nothing for a damaged map. North is x of the grid."""
    import numpy as np

    found = envelope.payload
    try:
        layers = found.layers()
    except ValueError:
        return {}
    states = np.frombuffer(b"".join(layers), np.uint8).reshape(len(layers), found.rows, found.columns)
    shown = np.zeros((found.columns, found.rows, 2), np.uint8)
    nearest = np.frombuffer(found.layer_of_vehicle() or bytes(found.rows * found.columns), np.uint8)
    shown[:, :, 0] = np.array(_OCCUPANCY, np.uint8)[nearest].reshape(found.rows, found.columns).T
    for level, cells in zip(found.levels, states, strict=True):
        top_dm = round(min(255.0, max(0.0, 10.0 * (level + 1) * found.layer_m)))
        shown[:, :, 1][cells.T == CELL_OCCUPIED] = top_dm
    north, east = found.corner_ne_m
    return {
        "frame_id": envelope.frame or NED_FRAME,
        "pose": shown_pose((north, east, -(found.level + 0.5) * found.layer_m), IDENTITY),
        "column_count": found.rows,
        "cell_size": {"x": found.cell_m, "y": found.cell_m},
        "row_stride": 2 * found.rows,
        "cell_stride": 2,
        "fields": [{"name": name, "offset": offset, "type": UINT8} for offset, name in enumerate(GRID_FIELDS)],
        "data": shown.tobytes(),
    }


_POSE_PROPERTIES: Final = {
    "timestamp": TIME,
    "frame_id": TEXT,
    "pose": POSE,
}
_CLOUD_PROPERTIES: Final = {
    **_POSE_PROPERTIES,
    "point_stride": INTEGER,
    "fields": {"type": "array", "items": _FIELD},
}
_FIX_PROPERTIES: Final = {
    "timestamp": TIME,
    "frame_id": TEXT,
    "latitude": NUMBER,
    "longitude": NUMBER,
    "altitude": NUMBER,
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
        frozenset({"camera", "width", "height", "data", "scale_m"}),
        FoxgloveView(
            "foxglove.RawImage",
            {"timestamp": TIME, "frame_id": TEXT, "encoding": TEXT, "step": INTEGER},
            _depth,
        ),
    ),
    (
        frozenset({"camera", "width", "height", "data"}),
        FoxgloveView(
            "foxglove.CompressedImage",
            {"timestamp": TIME, "frame_id": TEXT, "format": TEXT},
            _image,
        ),
    ),
    (
        frozenset({"latitude_deg", "longitude_deg", "altitude_m"}),
        FoxgloveView("foxglove.LocationFix", _FIX_PROPERTIES, _fix),
    ),
    (
        frozenset({"scanner", "ranges_m", "angle_min_rad", "angle_step_rad"}),
        FoxgloveView(
            "foxglove.LaserScan",
            {
                "timestamp": TIME,
                "frame_id": TEXT,
                "pose": POSE,
                "start_angle": NUMBER,
                "end_angle": NUMBER,
                "ranges": NUMBERS,
                "intensities": NUMBERS,
            },
            _scan,
        ),
    ),
    (
        frozenset({"points_ne_m", "height_m"}),
        FoxgloveView(
            "foxglove.PointCloud",
            {**_CLOUD_PROPERTIES, "data": {"type": "string", "contentEncoding": "base64"}},
            _obstacles,
        ),
    ),
    (
        frozenset({"data", "origin_frd_m"}),
        FoxgloveView("foxglove.PointCloud", _CLOUD_PROPERTIES, _cloud),
    ),
    (
        frozenset({"corner_ne_m", "cell_m", "levels", "cells"}),
        FoxgloveView(
            "foxglove.Grid",
            {
                "timestamp": TIME,
                "frame_id": TEXT,
                "pose": POSE,
                "column_count": INTEGER,
                "cell_size": {"type": "object", "title": "foxglove.Vector2", "properties": {"x": NUMBER, "y": NUMBER}},
                "row_stride": INTEGER,
                "cell_stride": INTEGER,
                "fields": {"type": "array", "items": _FIELD},
                "data": {"type": "string", "contentEncoding": "base64"},
            },
            _grid,
        ),
    ),
    (frozenset({"place_geo"}), FoxgloveView("foxglove.LocationFix", _FIX_PROPERTIES, _satellite_fix)),
    (frozenset({"geo"}), FoxgloveView("foxglove.LocationFix", _FIX_PROPERTIES, _location)),
    (
        frozenset({"severity", "text"}),
        FoxgloveView(
            "foxglove.Log",
            {
                "timestamp": TIME,
                "level": {"oneOf": [{"title": title, "const": level} for level, title in enumerate(_LEVELS)]},
                "message": TEXT,
                "name": TEXT,
                "file": TEXT,
                "line": INTEGER,
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
        "timestamp": TIME,
        "parent_frame_id": TEXT,
        "child_frame_id": TEXT,
        "translation": VECTOR,
        "rotation": QUATERNION,
    },
}


PATH_SCHEMA: Final[Schema] = {
    "title": "foxglove.PosesInFrame",
    "type": "object",
    "properties": {
        "timestamp": TIME,
        "frame_id": TEXT,
        "poses": {"type": "array", "items": POSE},
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
