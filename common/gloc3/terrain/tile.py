"""Tiles of SRTM (`.hgt`): the heights of one square degree, in a file or in a zip archive."""

import re
import zipfile
import zlib
from math import isqrt
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused

Floats = NDArray[np.float64]

SIDES: Final = (3601, 1201)
"""Heights along a side of a tile: one every arc second, or every three."""
VOID: Final = -32768
"""Marks a height that was not measured."""
_FILE: Final = re.compile(r"([NS])(\d{2})([EW])(\d{3})(?:\.[\w-]+)*\.hgt(\.zip)?", re.IGNORECASE)
_BYTES: Final = tuple(2 * side * side for side in SIDES)


class TerrainTile:
    """The heights of a square degree above mean sea level, rows from north to south.

    Args:
        south_deg: latitude of its lower edge, whole degrees.
        west_deg: longitude of its left edge, whole degrees.
        heights_m: shape (n, n), big-endian; `VOID` where there is none.
    """

    def __init__(self, south_deg: int, west_deg: int, heights_m: NDArray[np.int16]) -> None:
        self.south_deg: Final = south_deg
        self.west_deg: Final = west_deg
        self._heights_m: Final = heights_m

    def altitudes_m(self, latitudes_deg: Floats, longitudes_deg: Floats) -> Floats:
        """Heights of places in it, bilinear between the four around each; NaN where one of these is void.

        Args:
            latitudes_deg: shape (k,).
            longitudes_deg: shape (k,).
        """
        last = len(self._heights_m) - 1
        down = np.clip((self.south_deg + 1 - latitudes_deg) * last, 0.0, last)
        right = np.clip((longitudes_deg - self.west_deg) * last, 0.0, last)
        row, column = np.minimum(down.astype(int), last - 1), np.minimum(right.astype(int), last - 1)
        south, east = down - row, right - column
        found = np.zeros(len(row))
        for step, across, weight in (
            (0, 0, (1.0 - south) * (1.0 - east)),
            (0, 1, (1.0 - south) * east),
            (1, 0, south * (1.0 - east)),
            (1, 1, south * east),
        ):
            heights_m = self._heights_m[row + step, column + across].astype(np.float64)
            heights_m[heights_m == VOID] = np.nan
            found += np.where(weight > 0.0, weight * heights_m, 0.0)
        return found


def tile_name(south_deg: int, west_deg: int) -> str:
    """The name of the tile with this lower left corner, such as `N47E008`."""
    latitude, longitude = "S" if south_deg < 0 else "N", "W" if west_deg < 0 else "E"
    return f"{latitude}{abs(south_deg):02d}{longitude}{abs(west_deg):03d}"


def tile_named_by(file: str) -> str | None:
    """The tile that a file's name promises, such as `N47E008.hgt` or `N47E008.SRTMGL1.hgt.zip`; None for other files."""
    found = _FILE.fullmatch(file)
    return "".join(found.groups()[:4]).upper() if found else None


def read_tile(path: Path) -> TerrainTile:
    """Reads a tile; its name says where it lies.

    Raises:
        Refused: the file cannot be read, or is no tile.
    """
    name = tile_named_by(path.name)
    if name is None:
        raise Refused(f"{path.name} is not named like a tile, such as N47E008.hgt")
    try:
        raw = _unpacked(path) if path.suffix.lower() == ".zip" else path.read_bytes()
    except OSError as error:
        raise Refused(f"{path} cannot be read: {(error.strerror or str(error)).lower()}") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise Refused(f"{path} cannot be unpacked: {error}") from None
    if len(raw) not in _BYTES:
        sizes = " or ".join(f"{size:,}" for size in _BYTES)
        raise Refused(f"{path} has {len(raw):,} bytes; a tile of 1 or 3 arc seconds has {sizes}")
    side = isqrt(len(raw) // 2)
    south, west = int(name[1:3]), int(name[4:7])
    return TerrainTile(
        -south if name[0] == "S" else south,
        -west if name[3] == "W" else west,
        np.frombuffer(raw, ">i2").reshape(side, side),
    )


def _unpacked(path: Path) -> bytes:
    """The one tile in an archive; larger contents are not unpacked.

    Raises:
        ValueError: it holds no tile, or several.
    """
    with zipfile.ZipFile(path) as archive:
        inside = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".hgt")]
        if len(inside) != 1:
            raise ValueError(f"it holds {len(inside)} .hgt files, and one is expected")
        if inside[0].file_size not in _BYTES:
            raise ValueError(f"{inside[0].filename} has {inside[0].file_size:,} bytes, which is no tile")
        return archive.read(inside[0])
