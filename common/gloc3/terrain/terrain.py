"""Heights of the ground above mean sea level, from the tiles of a folder."""

from math import floor
from pathlib import Path
from threading import Lock
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3.terrain.tile import TerrainTile, read_tile, tile_name, tile_named_by

Floats = NDArray[np.float64]

TILES_KEPT: Final = 4
"""Tiles in memory; one of 1 arc second takes 26 MB."""


def open_terrain(folder: Path | None) -> "Terrain | None":
    """The terrain of a folder; None without one.

    Raises:
        Refused: it is no folder, cannot be read, or holds no tile.
    """
    return None if folder is None else Terrain(folder)


def tile_at(latitude_deg: float, longitude_deg: float) -> str:
    """The name of the tile that a place is in."""
    return tile_name(floor(latitude_deg), floor((longitude_deg + 180.0) % 360.0 - 180.0))


class Terrain:
    """Tiles in a folder, read when they are needed; safe to use from several threads.

    Args:
        folder: of `.hgt` and `.hgt.zip` files. Of several files of one tile the first by name counts, plain ones first.

    Raises:
        Refused: it is no folder, cannot be read, or holds no tile.
    """

    def __init__(self, folder: Path) -> None:
        self.folder: Final = folder.expanduser()
        self._files: Final[dict[str, Path]] = {}
        try:
            found = sorted(self.folder.iterdir(), key=lambda path: (path.suffix.lower() == ".zip", path.name))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise Refused(f"terrain tiles in {folder} cannot be read: {reason}") from None
        for path in found:
            name = tile_named_by(path.name)
            if name is not None:
                self._files.setdefault(name, path)
        if not self._files:
            raise Refused(f"{folder} holds no terrain tiles, such as N47E008.hgt or N47E008.hgt.zip")
        self._lock = Lock()
        self._tiles: dict[str, TerrainTile] = {}
        self._wrong: dict[str, str] = {}

    def __repr__(self) -> str:
        return f"Terrain({str(self.folder)!r}, {len(self._files)} tiles)"

    def altitude_m(self, latitude_deg: float, longitude_deg: float) -> float:
        """Height of the ground at a place, above mean sea level.

        Raises:
            Refused: it is not known; with the tile's name.
        """
        found = float(self.altitudes_m(np.array([latitude_deg]), np.array([longitude_deg]))[0])
        if np.isnan(found):
            raise Refused(self.gap(latitude_deg, longitude_deg))
        return found

    def altitudes_m(self, latitudes_deg: Floats, longitudes_deg: Floats) -> Floats:
        """Heights of the ground at places, above mean sea level; NaN where they are not known. Shapes (k,)."""
        found = np.full(len(latitudes_deg), np.nan)
        if not len(found):
            return found
        longitudes_deg = (longitudes_deg + 180.0) % 360.0 - 180.0
        south, west = np.floor(latitudes_deg).astype(int), np.floor(longitudes_deg).astype(int)
        for row, column in np.unique(np.column_stack((south, west)), axis=0).tolist():
            is_here = (south == row) & (west == column)
            found[is_here] = self._in_square(row, column, latitudes_deg[is_here], longitudes_deg[is_here])
        return found

    def gap(self, latitude_deg: float, longitude_deg: float) -> str:
        """Why the height of a place is not known; with the tile's name."""
        name = tile_at(latitude_deg, longitude_deg)
        if name in self._wrong:
            return f"the terrain tile {name} cannot be used: {self._wrong[name]}"
        if name not in self._files:
            return f"the terrain tile {name} is not in {self.folder}"
        return f"the terrain tile {name} has no height at {latitude_deg:.5f}, {longitude_deg:.5f}"

    def _in_square(self, south: int, west: int, latitudes_deg: Floats, longitudes_deg: Floats) -> Floats:
        """Heights in one square degree; on its lower and left edge those of the neighbours are as good."""
        found = np.full(len(latitudes_deg), np.nan)
        for row, column in ((south, west), (south - 1, west), (south, west - 1), (south - 1, west - 1)):
            is_on = np.isnan(found)
            if row != south:
                is_on &= latitudes_deg == south
            if column != west:
                is_on &= longitudes_deg == west
            tile = self._tile(tile_name(row, column)) if is_on.any() else None
            if tile is not None:
                found[is_on] = tile.altitudes_m(latitudes_deg[is_on], longitudes_deg[is_on])
        return found

    def _tile(self, name: str) -> TerrainTile | None:
        with self._lock:
            tile = self._tiles.pop(name, None)
            if tile is None and name in self._files and name not in self._wrong:
                try:
                    tile = read_tile(self._files[name])
                except Refused as refusal:
                    self._wrong[name] = str(refusal)
            if tile is not None:
                self._tiles[name] = tile  # the one used last goes last
                for surplus in list(self._tiles)[:-TILES_KEPT]:
                    del self._tiles[surplus]
            return tile
