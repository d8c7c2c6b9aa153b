"""The schema of the world file."""

from math import cos, tau
from typing import Annotated

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.platform.platform import FrameRow, Name
from gloc3_sitl.physics.water import STILL, Water

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e5)]
Grey = Annotated[float, msgspec.Meta(ge=0.0, le=255.0)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Length = Annotated[float, msgspec.Meta(ge=0.0, le=1e3)]


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all objects in a world file."""


class Spawn(_Row, frozen=True, kw_only=True):
    """Start position of the vehicle."""

    frame: Name
    """The local frame of all positions in the file."""
    position_m: Vector3 = (0.0, 0.0, 0.0)
    """`[x, y, height]` of the ground under the vehicle."""
    heading_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Clockwise from north."""


class Lamp(_Row, frozen=True, kw_only=True):
    """A lamp on the vehicle; its light falls off with the square of the distance."""

    position_frd_m: Vector3 = (0.1, 0.0, 0.05)
    """Position on the body."""
    direction_frd: Vector3 = (1.0, 0.0, 0.0)
    """Direction on the body."""
    strength: Positive = 8.0
    """Factor on the grey values of a perpendicular surface at 1 m."""
    beam_deg: Annotated[float, msgspec.Meta(gt=1.0, le=180.0)] = 90.0
    """Full angle at which its light has halved."""


class Lighting(_Row, frozen=True, kw_only=True):
    """How bright the world is."""

    ambient: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 1.0
    """Factor on every grey value of a texture."""
    lamps: tuple[Lamp, ...] = ()
    """Lamps that the vehicle carries here."""


class Dust(_Row, frozen=True, kw_only=True):
    """Dust in the air: a haze, and grains that the light catches."""

    haze_per_m: Share = 0.0
    """Share of the light that is scattered per metre of path."""
    haze_grey: Grey = 60.0
    """Grey value of opaque haze."""
    grains_per_m3: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)] = 0.0
    """Grains that float in the air."""
    grain_grey: Grey = 90.0
    """Brightness that a grain at 0.5 m adds to the picture; falls with the square of the distance."""


class CameraExposure(_Row, frozen=True, kw_only=True):
    """How the cameras of the vehicle expose here."""

    time_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.1)] = 0.0
    """Exposure time, s; motion during it blurs the picture; 0 freezes it."""
    is_automatic: bool = False
    """Whether the gain follows the brightness of the view."""
    jump: Annotated[float, msgspec.Meta(ge=1.0, le=8.0)] = 1.0
    """The gain jumps by a factor of up to this, up and down…"""
    jump_every_s: Positive = 3.0
    """Duration of each gain jump, s; the same for all cameras."""


class Texture(_Row, frozen=True, kw_only=True):
    """A procedurally made texture: stains of many sizes, and what steel bears. It repeats beyond its size."""

    size_m: tuple[Positive, Positive]
    """Width and height."""
    resolution_px_m: Annotated[float, msgspec.Meta(ge=1.0, le=1000.0)]
    """Pixels per metre."""
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Seed of everything random in it."""
    brightness: Grey = 120.0
    """Mean grey value."""
    colour: tuple[Grey, Grey, Grey] = (128.0, 128.0, 128.0)
    """Red, green and blue of the paint; only their ratio counts. Rust has a colour of its own."""
    contrast: Grey = 60.0
    """How far the stains go from the mean, up and down."""
    seam_m: Length = 0.0
    """Distance between the welds of plates; 0 for none. It should divide the size."""
    ribs_m: Length = 0.0
    """Distance between upright frames; 0 for none. It should divide the width."""
    rust: Share = 0.0
    """Share of the area that is rusty, with streaks below."""
    grain: Grey = 0.0
    """Deviation from pixel to pixel: the roughness of paint and rust."""
    speckles_per_m2: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 0.0
    """Small bright and dark spots."""
    label: Annotated[str, msgspec.Meta(max_length=24)] = ""
    """Text stencilled on the surface."""


class WorldSurface(_Row, frozen=True, kw_only=True):
    """A textured rectangle."""

    corner_m: Vector3
    """The upper left corner of its texture, as `[x, y, height]`."""
    across_m: Vector3
    """From the upper left corner to the upper right one."""
    down_m: Vector3
    """From the upper left corner to the lower left one."""
    texture: Name
    """Which texture it bears."""


class Shuttle(_Row, frozen=True, kw_only=True):
    """A smooth back-and-forth motion; it starts at one end when the simulation starts."""

    by_m: Vector3
    """From one end to the other, as `[x, y, height]`."""
    period_s: Positive
    """There and back."""


class Box(_Row, frozen=True, kw_only=True):
    """A solid box with a level top: an obstacle, and ground to stand on."""

    min_m: Vector3
    """The corner with the least x, y and height."""
    max_m: Vector3
    """The opposite corner."""
    texture: Name
    """Which texture its top and sides bear."""
    shuttle: Shuttle | None = None
    """How it moves; its corners are those at the start."""

    def offset_m(self, t_s: float) -> Vector3:
        """How far it has moved at a time."""
        if self.shuttle is None:
            return (0.0, 0.0, 0.0)
        share = 0.5 - 0.5 * cos(tau * t_s / self.shuttle.period_s)
        x, y, height = self.shuttle.by_m
        return (x * share, y * share, height * share)


class BrightSpot(_Row, frozen=True, kw_only=True):
    """A bright spot in the world that is not the vehicle's: it can lead a tracker astray."""

    position_m: Vector3
    """Where it is, as `[x, y, height]`."""
    radius_m: Positive = 0.02
    """Radius of what shines."""
    from_s: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    """Time at which the light goes on, s."""
    to_s: Annotated[float, msgspec.Meta(ge=0.0)] = 1e9
    """When it goes off."""

    def is_on(self, t_s: float) -> bool:
        """Whether it shines at a time."""
        return self.from_s <= t_s < self.to_s


class Tracker(_Row, frozen=True, kw_only=True):
    """A fixed camera in the world that tracks the vehicle's light."""

    position_m: Vector3
    """Position as `[x, y, height]`."""
    look_at_m: Vector3
    """What is in the middle of its picture; the picture's upper side is up."""


class Marker(_Row, frozen=True, kw_only=True):
    """A tag of OpenCV's 4x4 dictionary on the floor, its top towards x."""

    id: Annotated[int, msgspec.Meta(ge=0, lt=50)]
    """Which of the 50 tags."""
    center_m: Vector3
    """Its centre as `[x, y, height]`."""
    size_m: Positive
    """Side of the black square; a white border of a sixth of it goes round."""


Amount = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]


class FieldSource(_Row, frozen=True, kw_only=True):
    """A place around which a field differs from its background: most at the place, half as much at a radius."""

    position_m: Vector3
    """Its centre, as `[x, y, height]`."""
    peak: Amount
    """Added to the background at the centre; less than 0 lowers it."""
    radius_m: Positive
    """Horizontal distance at which half of the peak is left."""
    height_m: Positive | None = None
    """Vertical distance at which half of the peak is left; by default the radius."""

    def excess_at(self, position_m: Vector3) -> float:
        """What it adds at `[x, y, height]`: a Gaussian bell."""
        dx, dy, dz = (here - there for here, there in zip(position_m, self.position_m, strict=True))
        spread = (dx * dx + dy * dy) / self.radius_m**2 + (dz / (self.height_m or self.radius_m)) ** 2
        return float(self.peak * 2.0**-spread)


class ScalarField(_Row, frozen=True, kw_only=True):
    """A quantity with a value at every place, such as a gas or a temperature, and how well a probe measures it."""

    unit: Annotated[str, msgspec.Meta(pattern=r"^\S{1,16}$")]
    """Its unit, such as `ppm`; without spaces."""
    background: Amount = 0.0
    """The value far from all sources."""
    noise: Annotated[float, msgspec.Meta(ge=0.0, le=1e9)] = 0.0
    """Standard deviation of a probe's readings, in the unit."""
    sources: dict[Name, FieldSource] = {}
    """Places where it is stronger or weaker, by name; they add up."""

    def value_at(self, position_m: Vector3) -> float:
        """Its true value at `[x, y, height]`."""
        return self.background + sum(source.excess_at(position_m) for source in self.sources.values())


class WorldFile(_Row, frozen=True, kw_only=True):
    """The whole file."""

    world: Name
    """The world's name."""
    frames: dict[Name, FrameRow]
    """Local frames by name."""
    spawn: Spawn
    is_movable: bool = False
    """Whether the home of a flight may place the world anywhere on Earth."""
    lighting: Lighting = Lighting()
    dust: Dust = Dust()
    exposure: CameraExposure = CameraExposure()
    textures: dict[Name, Texture] = {}
    """Textures by name."""
    surfaces: dict[Name, WorldSurface] = {}
    """Rectangles by name."""
    boxes: dict[Name, Box] = {}
    """Boxes by name."""
    lights: dict[Name, BrightSpot] = {}
    """Bright spots by name."""
    fields: dict[Name, ScalarField] = {}
    """Gases, temperatures and the like by name; `co2` is what the device `co2_probe` measures."""
    tracker: Tracker | None = None
    marker: Marker | None = None
    water: Water = STILL
    """Water properties; used for swimming vehicles even where the file does not name water."""


class VariantFile(_Row, frozen=True, kw_only=True):
    """A file with the differences from a world of the package; unnamed items stay."""

    world: Name
    """The variant's name."""
    based_on: Name
    """The world that it differs from."""
    spawn: Spawn | None = None
    lighting: Lighting | None = None
    dust: Dust | None = None
    exposure: CameraExposure | None = None
    textures: dict[Name, Texture] = {}
    """Textures that are added, or that take the place of those of the same name."""
    surfaces: dict[Name, WorldSurface] = {}
    """Rectangles, likewise."""
    boxes: dict[Name, Box] = {}
    """Boxes, likewise."""
    lights: dict[Name, BrightSpot] = {}
    """Bright spots, likewise."""
    fields: dict[Name, ScalarField] = {}
    """Fields, likewise."""
    tracker: Tracker | None = None
    water: Water | None = None

    def applied_to(self, base: WorldFile) -> WorldFile:
        """The world that results."""
        names = ("spawn", "lighting", "dust", "exposure", "tracker", "water")
        plain = {name: getattr(self, name) for name in names}
        return msgspec.structs.replace(
            base,
            world=self.world,
            textures={**base.textures, **self.textures},
            surfaces={**base.surfaces, **self.surfaces},
            boxes={**base.boxes, **self.boxes},
            lights={**base.lights, **self.lights},
            fields={**base.fields, **self.fields},
            **{name: value for name, value in plain.items() if value is not None},
        )
