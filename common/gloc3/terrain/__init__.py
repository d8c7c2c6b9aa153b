"""Terrain: heights of the ground from SRTM tiles in a folder, and paths that follow the ground; and maps of obstacles.

Nothing is ever downloaded; what the folder lacks is unknown, and is reported with the tile's name. `map_file` reads and
writes maps of what is free and what is occupied.
"""

from gloc3.terrain.follow import FOLLOW_TOLERANCE_M, follow_ground
from gloc3.terrain.ground_level import GroundLevel
from gloc3.terrain.map_file import read_map, write_map
from gloc3.terrain.terrain import Terrain, open_terrain, tile_at

__all__ = [
    "FOLLOW_TOLERANCE_M",
    "GroundLevel",
    "Terrain",
    "follow_ground",
    "open_terrain",
    "read_map",
    "tile_at",
    "write_map",
]
