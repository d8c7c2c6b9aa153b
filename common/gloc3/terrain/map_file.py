"""Maps of what is free and what is occupied, as files: images and a YAML file, which the map server of ROS 2 reads, too.

The file has the keys of ROS 2's map server for the layer of which most is known, and `layer_m` and `layers` for all of
them. An image's first row is the northernmost, its first column the westernmost.
Source: https://docs.nav2.org/configuration/packages/configuring-map-server.html
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gloc3.documents.document import dump, load
from gloc3.errors import Finding, Gloc3Error, InputError
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, MOST_CELLS, OccupancyMap

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Grey values that the map server writes."""
_HEAD: Final = """\
# What is free and what is occupied: cells of {cell} m in layers of {layer} m, the lowest number first.
# A platform file knows it at the start by `known_map: {name}`. Other programs read `image`: the layer of which most is known.
"""


class MapLayer(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One layer."""

    number: int
    """It is from this to one more, times `layer_m`, above the frame's origin."""
    image: str


class MapFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of the YAML file; images are relative to it."""

    image: str
    """The layer for programs that know one only."""
    mode: str = "trinary"
    resolution: Annotated[float, msgspec.Meta(ge=0.01, le=5.0)]
    """Side of a cell, m."""
    origin: tuple[float, float, float]
    """Of the image's lower left corner: east and north of the frame's origin, m; and its direction, which must be 0."""
    negate: int = 0
    """1 where occupied cells are white."""
    occupied_thresh: float = 0.65
    """Cells that are more occupied than this, from 0 to 1, are occupied."""
    free_thresh: float = 0.196
    """Cells that are less occupied than this, from 0 to 1, are free."""
    layer_m: Annotated[float, msgspec.Meta(ge=0.05, le=100.0)]
    """Thickness of a layer, m."""
    layers: list[MapLayer]


def write_map(path: Path, known: OccupancyMap) -> list[Path]:
    """Writes a map: the YAML file, and beside it an image of each layer.

    Args:
        path: the YAML file; nothing is overwritten.
        known: the map.

    Returns:
        All files that were written.

    Raises:
        Gloc3Error: a file is there already, or cannot be written.
        ValueError: the map is damaged.
    """
    cells = np.frombuffer(b"".join(known.layers()), np.uint8).reshape(-1, known.rows, known.columns)
    names = {level: f"{path.stem}-{level}.pgm" for level in known.levels}
    best = known.levels[int(np.argmax((cells != CELL_UNKNOWN).sum(axis=(1, 2))))]
    north, east = known.corner_ne_m
    content = MapFile(
        image=names[best],
        resolution=known.cell_m,
        origin=(round(east, 6), round(north, 6), 0.0),
        layer_m=known.layer_m,
        layers=[MapLayer(number=level, image=name) for level, name in names.items()],
    )
    head = _HEAD.format(cell=known.cell_m, layer=known.layer_m, name=path.name)
    files = {path: (head + dump(msgspec.to_builtins(content))).encode()}
    shape = f"P5\n{known.columns} {known.rows}\n255\n".encode()
    for level, layer in zip(known.levels, cells, strict=True):
        grey = np.select([layer == CELL_FREE, layer == CELL_OCCUPIED], [FREE, OCCUPIED], UNKNOWN).astype(np.uint8)
        files[path.with_name(names[level])] = shape + np.flipud(grey).tobytes()
    for file, data in files.items():
        try:
            with file.open("xb") as stream:
                stream.write(data)
        except FileExistsError:
            raise Gloc3Error(f"{file} exists already; choose another --out") from None
        except OSError as error:
            raise Gloc3Error(f"cannot write {file}: {error.strerror}") from error
    return list(files)


def read_map(path: Path) -> OccupancyMap:
    """Reads a map.

    Raises:
        InputError: it or an image of it cannot be used.
    """
    content = load(path, MapFile)
    findings = _findings(content, path)
    layers: dict[int, NDArray[np.uint8]] = {}
    for layer in sorted(content.layers, key=lambda each: each.number):
        try:
            layers[layer.number] = _read_layer(path.parent / layer.image, content)
        except InputError as error:
            findings += error.findings
    if len({states.shape for states in layers.values()}) > 1:
        findings.append(Finding(file=str(path), message="its images are of different sizes"))
    if findings:
        raise InputError(findings)
    cells = np.stack(list(layers.values()))
    if cells.size > MOST_CELLS:
        raise InputError([Finding(file=str(path), message=f"it has more than {MOST_CELLS:,} cells")])
    east, north, _ = content.origin
    return OccupancyMap(
        corner_ne_m=(north, east),
        cell_m=content.resolution,
        rows=cells.shape[1],
        columns=cells.shape[2],
        layer_m=content.layer_m,
        levels=list(layers),
        cells=zlib.compress(cells.tobytes(), 1),
    )


def _findings(content: MapFile, path: Path) -> list[Finding]:
    messages = []
    if content.mode != "trinary":
        messages.append(f"mode: {content.mode!r} is not read, only 'trinary'")
    if content.origin[2]:
        messages.append(f"origin: a map that is turned by {content.origin[2]:g} rad is not read; turn it to 0")
    if not content.layers:
        messages.append("layers: there are none")
    return [Finding(file=str(path), message=message) for message in messages]


def _read_layer(path: Path, content: MapFile) -> NDArray[np.uint8]:
    """States of a layer's cells, shape (rows from south to north, columns from west to east)."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            if image.width * image.height > MOST_CELLS:
                raise InputError([Finding(file=str(path), message=f"it has more than {MOST_CELLS:,} cells")])
            grey = np.asarray(image.convert("L"), np.float64)
    except UnidentifiedImageError as error:
        raise InputError([Finding(file=str(path), message="it is no image (PGM or PNG)")]) from error
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        text = getattr(error, "strerror", None) or error
        raise InputError([Finding(file=str(path), message=f"cannot be read: {text}")]) from error
    occupied = (grey if content.negate else 255.0 - grey) / 255.0
    states = np.select(
        [occupied > content.occupied_thresh, occupied < content.free_thresh], [CELL_OCCUPIED, CELL_FREE], CELL_UNKNOWN
    )
    return np.flipud(states).astype(np.uint8)
