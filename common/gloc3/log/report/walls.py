"""Walls given on the command line: by corners, or as a surface of a world file."""

from pathlib import Path

import msgspec

from gloc3.camera.wall_coverage import Wall
from gloc3.documents.document import load_bytes, parse
from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3.messages.frames import GeoPoint, LocalFrame, Vector3
from gloc3.platform.platform import FrameRow


class _Surface(msgspec.Struct, frozen=True):
    corner_m: Vector3
    across_m: Vector3
    down_m: Vector3


class _Spawn(msgspec.Struct, frozen=True):
    frame: str


class _World(msgspec.Struct, frozen=True):
    """What of a world file is of concern here."""

    frames: dict[str, FrameRow]
    spawn: _Spawn
    surfaces: dict[str, _Surface] = {}


def read_wall(text: str, bearings_deg: dict[str, float], frame: str = "") -> Wall:
    """Reads a wall.

    Args:
        text: three or four corners `x,y,height`, clockwise from the upper left one as seen from in front, separated by
            spaces; or `FILE.yaml#SURFACE`, a surface of a world file.
        bearings_deg: directions of the local frames in which corners may be given.
        frame: the corners' frame; optional where there is one frame, or none (then x is north).

    Raises:
        Refused: the text is not a valid wall.
        InputError: the world file cannot be read.
    """
    file, hash_sign, surface = text.partition("#")
    if hash_sign:
        return _of_world(Path(file), surface)
    if frame and frame not in bearings_deg:
        raise Refused(f"there is no frame {frame!r}: {nearest(frame, list(bearings_deg))}")
    if not frame and len(set(bearings_deg.values())) > 1:
        raise Refused(f"the platform has several frames: choose one of {', '.join(bearings_deg)} with --frame")
    bearing = bearings_deg[frame] if frame else next(iter(bearings_deg.values()), 0.0)
    try:
        corners = [tuple(float(number) for number in corner.split(",")) for corner in text.split()]
    except ValueError as error:
        raise Refused(f"wall {text!r}: write each corner as x,y,height") from error
    if any(len(corner) != 3 for corner in corners):
        raise Refused(f"wall {text!r}: write each corner as x,y,height")
    local = LocalFrame(GeoPoint(0.0, 0.0, 0.0), bearing)
    return Wall.of_corners([local.to_ned((corner[0], corner[1], corner[2])) for corner in corners])


def _of_world(path: Path, name: str) -> Wall:
    document = parse(load_bytes(path), path.name)
    try:
        world = msgspec.convert(document.value, _World)
    except msgspec.ValidationError as error:
        raise InputError([Finding(file=path.name, message=f"not a world file: {error}")]) from error
    if name not in world.surfaces or world.spawn.frame not in world.frames:
        hint = nearest(name, list(world.surfaces))
        raise InputError([Finding(file=path.name, message=f"it has no surface {name!r}", hint=hint)])
    local, row = world.frames[world.spawn.frame].frame(), world.surfaces[name]
    return Wall(local.to_ned(row.corner_m), local.to_ned(row.across_m), local.to_ned(row.down_m))
