"""Terrain tiles for tests, in the real file format."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gloc3.terrain.tile import VOID

Floats = NDArray[np.float64]
Shape = Callable[[Floats, Floats], Floats]
"""Heights in metres for latitudes, a column, and longitudes in degrees, a row."""


def write_tile(
    folder: Path,
    name: str,
    shape: Shape,
    *,
    side: int = 1201,
    zipped: bool = False,
    void: Callable[[Floats, Floats], NDArray[np.bool_]] | None = None,
    file: str = "",
) -> Path:
    """Writes a tile whose heights are a function of the place.

    Args:
        folder: is made where it is not there.
        name: of the tile, such as `N47E008`.
        shape: its heights, rounded to metres.
        side: heights along a side: 3601 or 1201.
        zipped: packs the file into an archive.
        void: where it has no heights.
        file: its name; default: that of the tile.
    """
    folder.mkdir(parents=True, exist_ok=True)
    south = int(name[1:3]) * (-1 if name[0] == "S" else 1)
    west = int(name[4:7]) * (-1 if name[3] == "W" else 1)
    latitudes = south + 1.0 - np.arange(side) / (side - 1)
    longitudes = west + np.arange(side) / (side - 1)
    rows, columns = np.meshgrid(latitudes, longitudes, indexing="ij", sparse=True)
    heights = np.broadcast_to(np.round(shape(rows, columns)).astype(">i2"), (side, side))
    if void is not None:
        heights = np.where(void(rows, columns), VOID, heights).astype(">i2")
    if not zipped:
        path = folder / (file or f"{name}.hgt")
        path.write_bytes(heights.tobytes())
        return path
    path = folder / (file or f"{name}.hgt.zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{name}.hgt", heights.tobytes())
    return path


def level(height_m: float) -> Shape:
    """The same height everywhere."""
    return lambda latitudes, _: np.full_like(latitudes, height_m)


def ridge(foot_m: float, top_m: float, at_deg: float, half_width_deg: float) -> Shape:
    """Level ground with a ridge from south to north, of triangular section, at a longitude."""

    def shape(_: Floats, longitudes: Floats) -> Floats:
        return foot_m + (top_m - foot_m) * np.clip(1.0 - np.abs(longitudes - at_deg) / half_width_deg, 0.0, None)

    return shape
