"""The world file: what can stand in it."""

from typing import Annotated

import msgspec

from gloc3.frames import Vector3
from gloc3.platform import FrameRow, Name

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e5)]
Grey = Annotated[float, msgspec.Meta(ge=0.0, le=255.0)]


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of everything that stands in a world file."""


class Spawn(_Row, frozen=True, kw_only=True):
    """Where the vehicle stands at the start."""

    frame: Name
    """The local frame of all positions in the file."""
    position_m: Vector3 = (0.0, 0.0, 0.0)
    """`[x, y, height]` of the ground under the vehicle."""
    heading_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Clockwise from north."""


class Lighting(_Row, frozen=True, kw_only=True):
    """How bright the world is."""

    ambient: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 1.0
    """Factor on every grey value of a texture."""


class Texture(_Row, frozen=True, kw_only=True):
    """A procedurally made grey texture: stains of many sizes, plate seams and speckles. It repeats beyond its size."""

    size_m: tuple[Positive, Positive]
    """Width and height."""
    resolution_px_m: Annotated[float, msgspec.Meta(ge=1.0, le=1000.0)]
    """Pixels per metre."""
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Seed of everything random in it."""
    brightness: Grey = 120.0
    """Mean grey value."""
    contrast: Grey = 60.0
    """How far the stains go from the mean, up and down."""
    seam_m: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 0.0
    """Distance between the seams of plates; 0 for none."""
    speckles_per_m2: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 0.0
    """Small bright and dark spots."""


class Surface(_Row, frozen=True, kw_only=True):
    """A textured rectangle."""

    corner_m: Vector3
    """The upper left corner of its texture, as `[x, y, height]`."""
    across_m: Vector3
    """From the upper left corner to the upper right one."""
    down_m: Vector3
    """From the upper left corner to the lower left one."""
    texture: Name
    """Which texture it bears."""


class Box(_Row, frozen=True, kw_only=True):
    """A solid box with level top; it is an obstacle, and ground to stand on."""

    min_m: Vector3
    """The corner with the least x, y and height."""
    max_m: Vector3
    """The opposite corner."""
    texture: Name
    """Which texture its top and sides bear."""


class Marker(_Row, frozen=True, kw_only=True):
    """A tag of OpenCV's 4x4 dictionary, lying on the floor with its top towards x."""

    id: Annotated[int, msgspec.Meta(ge=0, lt=50)]
    """Which of the 50 tags."""
    center_m: Vector3
    """Its centre as `[x, y, height]`."""
    size_m: Positive
    """Side of the black square; a white border of a sixth of it goes round."""


class WorldFile(_Row, frozen=True, kw_only=True):
    """The whole file."""

    world: Name
    """The world's name."""
    frames: dict[Name, FrameRow]
    """Local frames by name."""
    spawn: Spawn
    is_movable: bool = False
    """Whether it may be put anywhere on Earth by the home of a flight."""
    lighting: Lighting = Lighting()
    textures: dict[Name, Texture] = {}
    """Textures by name."""
    surfaces: dict[Name, Surface] = {}
    """Rectangles by name."""
    boxes: dict[Name, Box] = {}
    """Boxes by name."""
    marker: Marker | None = None
