"""What Foxglove's 3D panel shows beside the messages: frames, fence, requested path, obstacles, cameras.

Every value is a message of one of Foxglove's schemas, as a JSON object; each has its schema's name and properties.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import cos, sin, tau
from typing import Any, Final, NamedTuple

from gloc3.camera.model import CameraModel, Lens
from gloc3.log.foxglove.schemas import (
    INTEGER,
    NED_FRAME,
    NUMBER,
    NUMBERS,
    POSE,
    QUATERNION,
    TEXT,
    TIME,
    VECTOR,
    body_frame,
    shown_pose,
    transform,
)
from gloc3.log.json_schema import Schema
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import IDENTITY, Vector3
from gloc3.messages.vehicle import MotionLimits, ObstacleScan, Pose
from gloc3.mission.model.fence import Area, Fence

FRAMES: Final = "frames"
SCENE: Final = "scene"
CIRCLE_CORNERS: Final = 36
Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, 0 to 1."""
FENCE_COLOUR: Final[Colour] = (0.2, 0.6, 0.9, 1.0)
KEEP_OUT_COLOUR: Final[Colour] = (0.85, 0.2, 0.15, 1.0)
REQUESTED_COLOUR: Final[Colour] = (0.6, 0.6, 0.6, 1.0)
OBSTACLE_COLOUR: Final[Colour] = (0.95, 0.5, 0.1, 0.8)
OBSTACLE_M: Final = 0.3
"""Diameter of the sphere that marks the nearest point of an object."""
LINE_STRIP: Final = 0
LINE_LIST: Final = 2
DISTORTIONS: Final = {Lens.PINHOLE: "", Lens.RADTAN: "plumb_bob", Lens.EQUIDISTANT: "kannala_brandt"}

_COLOUR: Final[Schema] = {
    "type": "object",
    "title": "foxglove.Color",
    "properties": {"r": NUMBER, "g": NUMBER, "b": NUMBER, "a": NUMBER},
}
_LINE: Final[Schema] = {
    "type": "object",
    "title": "foxglove.LinePrimitive",
    "properties": {
        "type": INTEGER,
        "pose": POSE,
        "thickness": NUMBER,
        "scale_invariant": {"type": "boolean"},
        "points": {"type": "array", "items": {**VECTOR, "title": "foxglove.Point3"}},
        "color": _COLOUR,
    },
}
_SPHERE: Final[Schema] = {
    "type": "object",
    "title": "foxglove.SpherePrimitive",
    "properties": {"pose": POSE, "size": VECTOR, "color": _COLOUR},
}
_ENTITY: Final[Schema] = {
    "type": "object",
    "title": "foxglove.SceneEntity",
    "properties": {
        "timestamp": TIME,
        "frame_id": TEXT,
        "id": TEXT,
        "frame_locked": {"type": "boolean"},
        "lines": {"type": "array", "items": _LINE},
        "spheres": {"type": "array", "items": _SPHERE},
    },
}
SCENE_SCHEMA: Final[Schema] = {
    "title": "foxglove.SceneUpdate",
    "type": "object",
    "properties": {"entities": {"type": "array", "items": _ENTITY}},
}
FRAMES_SCHEMA: Final[Schema] = {
    "title": "foxglove.FrameTransforms",
    "type": "object",
    "properties": {
        "transforms": {
            "type": "array",
            "items": {
                "title": "foxglove.FrameTransform",
                "type": "object",
                "properties": {
                    "timestamp": TIME,
                    "parent_frame_id": TEXT,
                    "child_frame_id": TEXT,
                    "translation": VECTOR,
                    "rotation": QUATERNION,
                },
            },
        }
    },
}
CALIBRATION_SCHEMA: Final[Schema] = {
    "title": "foxglove.CameraCalibration",
    "type": "object",
    "properties": {
        "timestamp": TIME,
        "frame_id": TEXT,
        "width": INTEGER,
        "height": INTEGER,
        "distortion_model": TEXT,
        "D": NUMBERS,
        "K": NUMBERS,
        "R": NUMBERS,
        "P": NUMBERS,
    },
}


def body_transform(platform: str, pose: Pose) -> dict[str, Any]:
    """Where the body is, as a `FrameTransform`."""
    return transform(NED_FRAME, body_frame(platform), pose.position_ned_m, pose.ned_from_frd)


def calibration(camera: str, model: CameraModel) -> dict[str, Any]:
    """A camera's model, as a `CameraCalibration`."""
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    padded = [*model.distortion, *[0.0] * 5][:5] if model.lens is Lens.RADTAN else list(model.distortion)
    return {
        "frame_id": camera,
        "width": model.width,
        "height": model.height,
        "distortion_model": DISTORTIONS[model.lens],
        "D": padded,
        "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


class Shown(NamedTuple):
    """A message for Foxglove alone."""

    topic: str
    schema: Schema
    values: dict[str, Any]
    """Without times."""


class FoxgloveScene:
    """What messages add to the scene: the body's frame, obstacles, and the fence when it has changed."""

    KINDS: Final = (Pose, ObstacleScan, MotionLimits)
    """The types of messages that add something."""

    def __init__(self) -> None:
        self._fences: dict[str, Fence | None] = {}

    def shown(self, envelope: Envelope[Any]) -> Iterator[Shown]:
        """What a message adds."""
        platform, _, below = envelope.topic.partition("/")
        message = envelope.payload
        match message:
            case Pose() if below == "pose" and message.is_valid:
                yield Shown(FRAMES, FRAMES_SCHEMA, {"transforms": [body_transform(platform, message)]})
            case ObstacleScan():
                yield Shown(SCENE, SCENE_SCHEMA, {"entities": [obstacles_entity(platform, message)]})
            case MotionLimits() if self._fences.get(platform) != message.fence:
                self._fences[platform] = message.fence
                yield Shown(SCENE, SCENE_SCHEMA, {"entities": [fence_entity(platform, message.fence)]})


def stamped(values: dict[str, Any], time: dict[str, int]) -> dict[str, Any]:
    """A message with its time, where its schema has it: at its top, or in each of its entities or transforms."""
    for name in ("entities", "transforms"):
        if name in values:
            return {name: [{"timestamp": time, **one} for one in values[name]]}
    return {"timestamp": time, **values}


def fence_entity(platform: str, fence: Fence | None) -> dict[str, Any]:
    """The fence as edges of boxes from the origin's height to the ceiling, keep-out areas in red; empty without one."""
    lines = []
    if fence is not None:
        top_m = fence.ceiling_m if fence.ceiling_m is not None else 0.0
        inner = [] if fence.area is None else [(fence.area, FENCE_COLOUR)]
        for area, colour in [*inner, *((one, KEEP_OUT_COLOUR) for one in fence.keep_out)]:
            lines.append(_line(LINE_LIST, list(_box(_corners(area), top_m)), colour))
    return _entity(f"{platform}: fence", lines=lines)


def path_entity(points_ned_m: Sequence[Vector3]) -> dict[str, Any]:
    """The requested path as a line."""
    return _entity("requested path", lines=[_line(LINE_STRIP, points_ned_m, REQUESTED_COLOUR)])


def obstacles_entity(platform: str, scan: ObstacleScan) -> dict[str, Any]:
    """The nearest points of objects as spheres."""
    size = {"x": OBSTACLE_M, "y": OBSTACLE_M, "z": OBSTACLE_M}
    spheres = [
        {"pose": shown_pose((north, east, -scan.height_m), IDENTITY), "size": size, "color": _colour(OBSTACLE_COLOUR)}
        for north, east in scan.closest_ne_m
    ]
    return _entity(f"{platform}: obstacles", spheres=spheres)


def _entity(name: str, **primitives: list[dict[str, Any]]) -> dict[str, Any]:
    return {"frame_id": NED_FRAME, "id": name, "frame_locked": False, **primitives}


def _colour(colour: Colour) -> dict[str, float]:
    return dict(zip("rgba", colour, strict=True))


def _line(kind: int, points: Sequence[Vector3], colour: Colour) -> dict[str, Any]:
    return {
        "type": kind,
        "pose": shown_pose((0.0, 0.0, 0.0), IDENTITY),
        "thickness": 2.0,
        "scale_invariant": True,  # pixels
        "points": [dict(zip("xyz", point, strict=True)) for point in points],
        "color": _colour(colour),
    }


def _corners(area: Area) -> list[tuple[float, float]]:
    if area.polygon_ne_m:
        return list(area.polygon_ne_m)
    north, east = area.center_ne_m
    turns = [tau * index / CIRCLE_CORNERS for index in range(CIRCLE_CORNERS)]
    return [(north + area.radius_m * cos(turn), east + area.radius_m * sin(turn)) for turn in turns]


def _box(corners: Sequence[tuple[float, float]], top_m: float) -> Iterator[Vector3]:
    """Ends of the edges of an upright prism, two and two."""
    for (north, east), (next_north, next_east) in pairwise([*corners, *corners[:1]]):
        for down in dict.fromkeys((0.0, -top_m)):
            yield (north, east, down)
            yield (next_north, next_east, down)
        if top_m:
            yield (north, east, 0.0)
            yield (north, east, -top_m)
