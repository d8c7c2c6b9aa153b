"""Height of the ground on the scale of a vehicle's altitudes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.terrain.terrain import Terrain

Floats = NDArray[np.float64]


class GroundLevel(NamedTuple):
    """The ground around a vehicle: heights of tiles, moved so that the ground at home is as high as home."""

    terrain: Terrain
    offset_m: float = 0.0
    """Added to the tiles' heights; 0 where altitudes are those above the sea."""

    @classmethod
    def under(cls, terrain: Terrain, home: GeoPoint) -> "GroundLevel":
        """The ground that is as high as home at home: errors that tiles and the altitude of home have there cancel.

        Raises:
            Refused: no tile tells the ground's height at home.
        """
        return cls(terrain, home.altitude_m - terrain.altitude_m(home.latitude_deg, home.longitude_deg))

    def altitude_m(self, latitude_deg: float, longitude_deg: float) -> float:
        """Altitude of the ground at a place.

        Raises:
            Refused: it is not known; with the tile's name.
        """
        return self.terrain.altitude_m(latitude_deg, longitude_deg) + self.offset_m

    def clearances_m(self, plane: TangentPlane, places_ned_m: "list[Vector3]") -> tuple[Floats, list[GeoPoint]]:
        """Heights of places above the ground, NaN where it is not known; and the places on Earth."""
        places = [plane.geo_from_ned(place) for place in places_ned_m]
        rows = np.array(places, np.float64).reshape(-1, 3)
        return rows[:, 2] - self.terrain.altitudes_m(rows[:, 0], rows[:, 1]) - self.offset_m, places
