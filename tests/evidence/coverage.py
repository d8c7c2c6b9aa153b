"""Which part of a surface a camera has truly seen, cell by cell: what reports of coverage are judged by."""

from math import cos
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, project
from gloc3.camera.model import CameraModel
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.placing import Place
from gloc3_sitl.world.world import World


class Coverage:
    """Counts for each cell of one surface how often it was seen.

    Args:
        world: where the surface is.
        surface: its name.
        cell_m: side of a cell; the surface is cut into whole cells of about this size.
        range_max_m: what is farther away does not count as seen.
        incidence_max_rad: nor what is seen from further beside the surface's normal.
    """

    def __init__(
        self,
        world: World,
        surface: str,
        *,
        cell_m: float = 0.25,
        range_max_m: float = 6.0,
        incidence_max_rad: float = 1.2,
    ) -> None:
        row = world.file.surfaces[surface]
        corner, across, down = (np.array(part, float) for part in (row.corner_m, row.across_m, row.down_m))
        columns, rows = (max(1, round(float(np.linalg.norm(side)) / cell_m)) for side in (across, down))
        shares_x, shares_y = (np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows
        self.centers_m: Final[Floats] = corner + shares_y[:, None, None] * down + shares_x[None, :, None] * across
        """Middles of the cells, shape `(rows, columns, 3)`; the first is the upper left one."""
        self.counts: Final[NDArray[np.int64]] = np.zeros((rows, columns), np.int64)
        """How often each was seen."""
        normal = np.cross(across, down)
        self._normal = normal / np.linalg.norm(normal)
        self._geometry = world.geometry
        self._range_max_m, self._cosine_min = range_max_m, cos(incidence_max_rad)

    def look(self, model: CameraModel, eye: Place, t_s: float) -> NDArray[np.bool_]:
        """Counts what a picture shows.

        Args:
            model: the camera.
            eye: the place of its optical centre, with axes right, down, forward.
            t_s: when.

        Returns:
            The cells that it shows, `(rows, columns)`.
        """
        away = self.centers_m.reshape(-1, 3) - eye.position_m
        distances = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        pixels = project(model, away @ matrix(eye.local_from_here))
        with np.errstate(invalid="ignore"):
            inside = (pixels >= -0.5) & (pixels <= (model.width - 0.5, model.height - 0.5))
        near = (distances <= self._range_max_m) & (np.abs(away @ self._normal) >= self._cosine_min * distances)
        seen = inside.all(axis=1) & near
        chosen = np.flatnonzero(seen)
        if len(chosen):
            clear = self._geometry.is_clear(eye.position_m, self.centers_m.reshape(-1, 3)[chosen], t_s)
            seen[chosen] = clear
        shown: NDArray[np.bool_] = seen.reshape(self.counts.shape)
        self.counts[shown] += 1
        return shown

    @property
    def share(self) -> float:
        """Share of the surface that was seen at least once."""
        return float((self.counts > 0).mean())
