"""A world: place on Earth, start of the vehicle, ground heights and visible surfaces."""

from functools import cached_property
from importlib.resources import files
from itertools import combinations
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gloc3.documents.document import Document, load_bytes, parse
from gloc3.documents.schema import check
from gloc3.errors import Finding, InputError, nearest
from gloc3.messages.frames import GeoPoint, LocalFrame, Vector3
from gloc3_sitl.physics.water import Water
from gloc3_sitl.world.model import Box, Marker, VariantFile, WorldFile, WorldSurface
from gloc3_sitl.world.polygon import Plane, Polygon, clip_all

if TYPE_CHECKING:
    from gloc3_sitl.world.geometry import Geometry

_SHIPPED: Final = files("gloc3_sitl.world") / "worlds"


class World:
    """A world file, ready for queries. All positions are `[x, y, height]` in `frame`."""

    def __init__(self, file: WorldFile, home: GeoPoint | None = None, heading_deg: float | None = None) -> None:
        row = file.frames[file.spawn.frame]
        self.file: Final = file
        """The file's content."""
        self.name: Final = file.world
        self.frame_name: Final = file.spawn.frame
        """Name of the world's local frame, as missions call it."""
        self.frame: Final = row.frame() if home is None else LocalFrame(home, row.x_axis_bearing_deg)
        """The world's local frame."""
        self.spawn_m: Final = file.spawn.position_m
        """Where the vehicle starts."""
        self.heading_deg: Final = file.spawn.heading_deg if heading_deg is None else heading_deg
        """Heading of the vehicle at the start, clockwise from north."""
        self.home: Final = self.frame.to_geo(self.spawn_m)
        """The ground where the vehicle starts."""
        self.marker: Final[Marker | None] = file.marker
        self.water: Water = file.water
        """What is swum in; may be set before a vehicle is put into it."""
        self.surfaces: Final = (
            *file.surfaces.values(),
            *(side for box in file.boxes.values() for side in box_sides(box)),
        )
        """Everything that can be seen, as rectangles, at the start."""
        self._slopes: Final = [slope for slope in map(_slope, file.surfaces.values()) if slope is not None]

    @cached_property
    def geometry(self) -> "Geometry":
        """Shape of the world, for distances and lines of sight."""
        from gloc3_sitl.world.geometry import Geometry

        return Geometry(list(self.file.surfaces.values()), list(self.file.boxes.values()))

    @property
    def is_flat(self) -> bool:
        """Whether the ground is at height 0 everywhere and free of objects."""
        return not self.file.boxes and not self._slopes

    @staticmethod
    def names() -> list[str]:
        """The worlds that come with the package."""
        return sorted(entry.name.removesuffix(".yaml") for entry in _SHIPPED.iterdir() if entry.name.endswith(".yaml"))

    @staticmethod
    def load(name_or_path: str, home: GeoPoint | None = None, heading_deg: float | None = None) -> "World":
        """Reads a world.

        Args:
            name_or_path: The name of a world of the package, or a path that ends in `.yaml`.
            home: Location of a movable world on Earth; None for the file's.
            heading_deg: Heading of the vehicle at the start; None for the file's.

        Raises:
            InputError: with all errors in the file, or because the world is not movable.
        """
        name, data = _read(name_or_path)
        findings: list[Finding] = []
        file = _parsed(name, data, findings)
        if file is not None and home is not None and not file.is_movable:
            message = f"the world {file.world} has a fixed place on Earth and cannot be moved to a home"
            findings.append(Finding(file=name, message=message, hint="use the world open"))
        if findings or file is None:
            raise InputError(sorted(findings))
        return World(file, home, heading_deg)

    def height_at(self, x_m: float, y_m: float, t_s: float = 0.0, below_m: float = inf, lowest_m: float = 0.0) -> float:
        """Height of the ground at a place: the top of the highest box or slope there below a height, else `lowest_m`."""
        height_m = lowest_m
        for box in self.file.boxes.values():
            (x0, y0, _), (x1, y1, z1) = box.min_m, box.max_m
            dx, dy, dz = box.offset_m(t_s)
            if x0 + dx <= x_m <= x1 + dx and y0 + dy <= y_m <= y1 + dy and z1 + dz <= below_m:
                height_m = max(height_m, z1 + dz)
        for slope in self._slopes:
            height_m = max(height_m, slope.height_at(x_m, y_m))
        return height_m

    def local(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
        """Local position `[x, y, height]` of a geographic position."""
        return self.frame.from_geo(latitude_deg, longitude_deg, altitude_m)


class _Slope:
    """A rectangle that is ground, but not level at height 0."""

    def __init__(self, surface: WorldSurface, normal: Vector3) -> None:
        self._corner_m, self._normal = surface.corner_m, normal
        self._sides = [(side, sum(part * part for part in side)) for side in (surface.across_m, surface.down_m)]

    def height_at(self, x_m: float, y_m: float) -> float:
        """Its height at a place; minus infinity beside it."""
        (cx, cy, cz), (nx, ny, nz) = self._corner_m, self._normal
        dx, dy = x_m - cx, y_m - cy
        height_m = cz - (nx * dx + ny * dy) / nz
        for (along_x, along_y, along_z), square in self._sides:
            share = (dx * along_x + dy * along_y + (height_m - cz) * along_z) / square
            if not 0.0 <= share <= 1.0:
                return -inf
        return height_m


def _slope(surface: WorldSurface) -> _Slope | None:
    """Slope of a surface that lies rather than stands and rises above height 0; None for others."""
    (ax, ay, az), (bx, by, bz) = surface.across_m, surface.down_m
    normal = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    size = sum(part * part for part in normal) ** 0.5
    heights = [surface.corner_m[2] + up for up in (0.0, az, bz, az + bz)]
    is_ground = abs(normal[2]) > 0.3 * size and min(heights) < 0.5 and max(heights) > 0.0
    return _Slope(surface, normal) if is_ground else None


def _read(name_or_path: str) -> tuple[str, bytes]:
    """Name and content of a world's file."""
    if name_or_path.endswith((".yaml", ".yml")):
        return name_or_path, load_bytes(Path(name_or_path))
    if name_or_path not in World.names():
        hint = nearest(name_or_path, World.names())
        raise InputError([Finding(file=name_or_path, message=f"no world named {name_or_path!r}", hint=hint)])
    name = f"{name_or_path}.yaml"
    return name, (_SHIPPED / name).read_bytes()


def _parsed(name: str, data: bytes, findings: list[Finding]) -> WorldFile | None:
    """The world that a file says, alone or as a variant of another."""
    document = parse(data, name)
    if not isinstance(document.value, dict) or "based_on" not in document.value:
        file = check(document.root, WorldFile, name, findings)
    else:
        variant = check(document.root, VariantFile, name, findings)
        if variant is None:
            return None
        if variant.based_on not in World.names():
            hint = nearest(variant.based_on, World.names())
            findings.append(document.finding(("based_on",), f"no world named {variant.based_on!r}", hint))
            return None
        base = _parsed(*_read(variant.based_on), findings)
        file = None if base is None else variant.applied_to(base)
    if file is not None:
        findings.extend(doubts(document, file))
    return file


def box_sides(box: Box) -> list[WorldSurface]:
    """The top and the four sides of a box at the start, and its lower side if it hangs above the ground."""
    (x0, y0, z0), (x1, y1, z1) = box.min_m, box.max_m
    width, depth, height = x1 - x0, y1 - y0, z1 - z0
    down = (0.0, 0.0, -height)
    corners: list[tuple[Vector3, Vector3, Vector3]] = [
        ((x1, y1, z1), (0.0, -depth, 0.0), (-width, 0.0, 0.0)),
        ((x0, y1, z1), (0.0, -depth, 0.0), down),
        ((x1, y0, z1), (0.0, depth, 0.0), down),
        ((x0, y0, z1), (width, 0.0, 0.0), down),
        ((x1, y1, z1), (-width, 0.0, 0.0), down),
    ]
    if z0 > 0.0:
        corners.append(((x0, y1, z0), (0.0, -depth, 0.0), (width, 0.0, 0.0)))
    return [WorldSurface(corner_m=c, across_m=a, down_m=d, texture=box.texture) for c, a, d in corners]


_TOUCH_M: Final = 1e-3
"""What reaches no deeper into something else only touches it."""


def doubts(document: Document, file: WorldFile) -> list[Finding]:
    """Returns inconsistencies between values that are valid individually."""
    found = []
    if file.spawn.frame not in file.frames:
        hint = nearest(file.spawn.frame, list(file.frames))
        found.append(document.finding(("spawn", "frame"), f"no frame named {file.spawn.frame!r}", hint))
    bearers: list[tuple[str, str, str]] = [("surfaces", name, row.texture) for name, row in file.surfaces.items()]
    bearers += [("boxes", name, row.texture) for name, row in file.boxes.items()]
    for section, name, texture in bearers:
        if texture not in file.textures:
            hint = nearest(texture, list(file.textures))
            found.append(document.finding((section, name, "texture"), f"no texture named {texture!r}", hint))
    for name, box in file.boxes.items():
        if not all(low < high for low, high in zip(box.min_m, box.max_m, strict=True)):
            found.append(document.finding(("boxes", name), "min_m must be less than max_m on each axis"))
    if not found:
        found += _crossings(document, file)
    return found


def _crossings(document: Document, file: WorldFile) -> list[Finding]:
    """Things that pass through one another at the start: then neither can be drawn before the other."""
    found = []
    for (name, box), (other, beside) in combinations(file.boxes.items(), 2):
        gaps = [
            max(a, b) - min(c, d) for a, b, c, d in zip(box.min_m, beside.min_m, box.max_m, beside.max_m, strict=True)
        ]
        if max(gaps) < -_TOUCH_M:
            found.append(document.finding(("boxes", other), f"it is partly inside the box {name}", "split one in two"))
    for surface, row in file.surfaces.items():
        for name, box in file.boxes.items():
            if clip_all(_corners(row), _inside(box)):
                message = f"it intersects the box {name}"
                found.append(document.finding(("surfaces", surface), message, "split it in two beside the box"))
    return found


def _corners(surface: WorldSurface) -> Polygon:
    (x, y, z), (ax, ay, az), (bx, by, bz) = surface.corner_m, surface.across_m, surface.down_m
    return [
        (x, y, z),
        (x + ax, y + ay, z + az),
        (x + ax + bx, y + ay + by, z + az + bz),
        (x + bx, y + by, z + bz),
    ]


def _inside(box: Box) -> list[Plane]:
    """The planes between which the inside of a box is."""
    (x0, y0, z0), (x1, y1, z1) = box.min_m, box.max_m
    return [
        (1.0, 0.0, 0.0, x0 + _TOUCH_M),
        (-1.0, 0.0, 0.0, _TOUCH_M - x1),
        (0.0, 1.0, 0.0, y0 + _TOUCH_M),
        (0.0, -1.0, 0.0, _TOUCH_M - y1),
        (0.0, 0.0, 1.0, z0 + _TOUCH_M),
        (0.0, 0.0, -1.0, _TOUCH_M - z1),
    ]
