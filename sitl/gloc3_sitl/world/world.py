"""A world: where it is on Earth, where the vehicle starts, how high the ground is, and what there is to see."""

from importlib.resources import files
from pathlib import Path
from typing import Final

from gloc3.document import Document, load_bytes, parse
from gloc3.errors import Finding, InputError, nearest
from gloc3.frames import GeoPoint, LocalFrame, Vector3
from gloc3.schema import check
from gloc3_sitl.world.model import Box, Marker, Surface, WorldFile

_SHIPPED: Final = files("gloc3_sitl.world") / "worlds"


class World:
    """What a world file says, ready to be asked. All positions are `[x, y, height]` in `frame`."""

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
        self.surfaces: Final = (*file.surfaces.values(), *(side for box in file.boxes.values() for side in _sides(box)))
        """Everything that can be seen, as rectangles."""

    @staticmethod
    def names() -> list[str]:
        """The worlds that come with the package."""
        return sorted(entry.name.removesuffix(".yaml") for entry in _SHIPPED.iterdir() if entry.name.endswith(".yaml"))

    @staticmethod
    def load(name_or_path: str, home: GeoPoint | None = None, heading_deg: float | None = None) -> "World":
        """Read a world.

        Args:
            name_or_path: The name of a world of the package, or a path that ends in `.yaml`.
            home: Where on Earth a movable world is to be; None for where its file says.
            heading_deg: Heading of the vehicle at the start; None for what the file says.

        Raises:
            InputError: With everything that is wrong in the file, or if a world that is not movable is to be moved.
        """
        if name_or_path.endswith((".yaml", ".yml")):
            name, data = name_or_path, load_bytes(Path(name_or_path))
        else:
            name = f"{name_or_path}.yaml"
            resource = _SHIPPED / name
            if name_or_path not in World.names():
                hint = nearest(name_or_path, World.names())
                raise InputError([Finding(file=name_or_path, message=f"no world named {name_or_path!r}", hint=hint)])
            data = resource.read_bytes()
        document = parse(data, name)
        findings: list[Finding] = []
        file = check(document.root, WorldFile, name, findings)
        if file is not None:
            findings.extend(_doubts(document, file))
            if home is not None and not file.is_movable:
                message = f"the world {file.world} has its own place on Earth and cannot be moved to a home"
                findings.append(Finding(file=name, message=message, hint="use the world open"))
        if findings or file is None:
            raise InputError(sorted(findings))
        return World(file, home, heading_deg)

    def height_at(self, x_m: float, y_m: float) -> float:
        """Height of the ground at a place: the top of the highest box there, else 0."""
        height_m = 0.0
        for box in self.file.boxes.values():
            if box.min_m[0] <= x_m <= box.max_m[0] and box.min_m[1] <= y_m <= box.max_m[1]:
                height_m = max(height_m, box.max_m[2])
        return height_m

    def local(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
        """Local position `[x, y, height]` of a place on Earth."""
        return self.frame.from_geo(latitude_deg, longitude_deg, altitude_m)


def _doubts(document: Document, file: WorldFile) -> list[Finding]:
    """What the schema cannot see."""
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
    return found


def _sides(box: Box) -> list[Surface]:
    """The top and the four sides of a box."""
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
    return [Surface(corner_m=c, across_m=a, down_m=d, texture=box.texture) for c, a, d in corners]
