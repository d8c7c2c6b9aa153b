"""Coverage of a wall by pictures: their footprints on a grid of cells. Pure geometry."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, project, unproject
from gloc3.camera.model import CameraModel
from gloc3.errors import Refused
from gloc3.messages.frames import Quaternion, Vector3

Array = NDArray[np.float64]

_RIM_POINTS: Final = 33
"""Points on each side of a picture's border, used to find the field of view of its lens."""
_MOST_CELLS: Final = 1_000_000


class WallView(NamedTuple):
    """A picture and where the body of its vehicle was."""

    camera: str
    position_ned_m: Vector3
    ned_from_frd: Quaternion


class Wall(NamedTuple):
    """A rectangle, in the frame of the poses: metres north, east and down."""

    corner_ned_m: Vector3
    """Upper left corner, as seen from in front of the wall."""
    across_ned_m: Vector3
    """To the upper right corner."""
    down_ned_m: Vector3
    """To the lower left corner."""

    @staticmethod
    def of_corners(corners_ned_m: list[Vector3]) -> "Wall":
        """A wall of its upper left, upper right, lower right and lower left corners; the third may be left out.

        Raises:
            Refused: they are not those of a rectangle.
        """
        if len(corners_ned_m) not in (3, 4):
            raise Refused("a wall has 4 corners: upper left, upper right, lower right, lower left")
        left, right = np.array(corners_ned_m[0]), np.array(corners_ned_m[1])
        low = np.array(corners_ned_m[-1]) if len(corners_ned_m) == 4 else left + np.array(corners_ned_m[2]) - right
        across, down = right - left, low - left
        size = min(float(np.linalg.norm(across)), float(np.linalg.norm(down)))
        if size < 0.01 or abs(float(across @ down)) > 0.02 * float(np.linalg.norm(across) * np.linalg.norm(down)):
            raise Refused("the corners of the wall are not those of a rectangle")
        if len(corners_ned_m) == 4 and np.linalg.norm(left + across + down - np.array(corners_ned_m[2])) > 0.05 * size:
            raise Refused("the corners of the wall are not those of a rectangle")
        return Wall(_triple(left), _triple(across), _triple(down))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        return float(np.linalg.norm(self.across_ned_m)), float(np.linalg.norm(self.down_ned_m))


class CoverageLimits(NamedTuple):
    """What counts as seen."""

    most_oblique_deg: float = 70.0
    """Angle between the line of sight and the wall's normal."""
    farthest_m: float = 20.0
    """Distance from the camera."""
    cell_m: float = 0.1
    """Side of a cell."""


class Coverage(NamedTuple):
    """Covered part of a wall, on a grid of cells, (rows, columns), from the upper left."""

    wall: Wall
    times: NDArray[np.int32]
    """In how many pictures each cell's middle is."""
    finest_mm: Array
    """Size on the wall of a pixel of the best picture of each cell; infinite for a cell that no picture shows."""
    used: NDArray[np.bool_]
    """Which views show anything of the wall, (n,)."""

    @property
    def share(self) -> float:
        """Share of the wall that is in at least one picture."""
        return float((self.times > 0).mean())

    @property
    def share_twice(self) -> float:
        """Share that is in at least two."""
        return float((self.times > 1).mean())

    @property
    def median_mm(self) -> float:
        """Median over the covered cells of the pixel size on the wall; NaN where nothing was covered."""
        seen = self.finest_mm[self.times > 0]
        return float(np.median(seen)) if len(seen) else float("nan")


def cover(wall: Wall, views: list[WallView], cameras: dict[str, CameraModel], limits: CoverageLimits) -> Coverage:
    """Projects the centre of each cell into each picture. Occlusion of the wall is not considered.

    Raises:
        Refused: a camera is unknown, or the grid would be too fine.
    """
    unknown = sorted({view.camera for view in views} - set(cameras))
    if unknown:
        raise Refused(f"unknown camera {unknown[0]!r}: set its model with --cameras")
    width_m, height_m = wall.size_m
    columns, rows = max(1, round(width_m / limits.cell_m)), max(1, round(height_m / limits.cell_m))
    if columns * rows > _MOST_CELLS:
        raise Refused(f"{columns} x {rows} cells are too many: choose a larger --cell")
    across = (np.arange(columns) + 0.5) / columns
    down = (np.arange(rows) + 0.5) / rows
    points = (
        np.array(wall.corner_ned_m)
        + across[None, :, None] * np.array(wall.across_ned_m)
        + down[:, None, None] * np.array(wall.down_ned_m)
    ).reshape(-1, 3)
    normal = np.cross(wall.down_ned_m, wall.across_ned_m)
    normal = normal / np.linalg.norm(normal)
    count = np.zeros(len(points), np.int32)
    finest_mm = np.full(len(points), np.inf)
    used = np.zeros(len(views), np.bool_)
    reaches = {name: _reach(camera) for name, camera in cameras.items()}
    for index, view in enumerate(views):
        camera = cameras[view.camera]
        which, pixel_mm = _seen(points, normal, view, camera, reaches[view.camera], limits)
        count[which] += 1
        finest_mm[which] = np.minimum(finest_mm[which], pixel_mm)
        used[index] = len(which) > 0
    return Coverage(wall, count.reshape(rows, columns), finest_mm.reshape(rows, columns), used)


def footprint(wall: Wall, view: WallView, camera: CameraModel) -> Array | None:
    """Where the corners of a picture meet the wall's plane, (4, 2) metres across and down; None if one does not."""
    rays, eye = _rays(view, camera)
    corner, across, down = (np.array(v) for v in wall)
    normal = np.cross(across, down)
    depth = rays @ normal
    reach = float((corner - eye) @ normal) / np.where(np.abs(depth) > 1e-9, depth, np.nan)
    if not (reach > 0.0).all():
        return None
    places = eye + rays * reach[:, None] - corner
    width_m, height_m = wall.size_m
    return np.column_stack((places @ across / width_m, places @ down / height_m))


def optical_axis(view: WallView, camera: CameraModel) -> tuple[Array, Array]:
    """Optical centre and viewing direction of a camera, in north, east and down."""
    turn = matrix(view.ned_from_frd)
    eye = np.array(view.position_ned_m) + turn @ np.array(camera.position_frd_m)
    return eye, turn @ matrix(camera.frd_from_rdf)[:, 2]


def _seen(
    points: Array, normal: Array, view: WallView, camera: CameraModel, reach: float, limits: CoverageLimits
) -> tuple[NDArray[np.intp], Array]:
    """Which points are in a picture, and how large a pixel is there, in millimetres."""
    ned_from_rdf = matrix(view.ned_from_frd) @ matrix(camera.frd_from_rdf)
    eye, _ = optical_axis(view, camera)
    away = points - eye
    distance = np.linalg.norm(away, axis=1)
    rdf = away @ ned_from_rdf
    # The wall has one face: it is seen by those who see its corners in the order that they were given in.
    upright = -(away @ normal) / np.maximum(distance, 1e-9)
    near = (distance <= limits.farthest_m) & (upright >= np.cos(np.radians(limits.most_oblique_deg)))
    near &= (rdf[:, 2] > 1e-6) & (np.hypot(rdf[:, 0], rdf[:, 1]) <= reach * rdf[:, 2])
    which = np.flatnonzero(near)
    pixels = project(camera, rdf[which])
    inside = ((pixels >= -0.5) & (pixels <= np.array([camera.width - 0.5, camera.height - 0.5]))).all(axis=1)
    which = which[inside]
    # The solid angle of a pixel shrinks with the cube of the cosine off the axis.
    cosine = rdf[which, 2] / distance[which]
    pixel_mm = 1000.0 * distance[which] / min(camera.focal_px) * np.sqrt(cosine**3 / upright[which])
    return which, pixel_mm


def _rays(view: WallView, camera: CameraModel) -> tuple[Array, Array]:
    last = np.array([camera.width - 0.5, camera.height - 0.5])
    corners = np.array([[-0.5, -0.5], [last[0], -0.5], last, [-0.5, last[1]]])
    flat = unproject(camera, corners)
    rdf = np.column_stack((flat, np.ones(4)))
    eye, _ = optical_axis(view, camera)
    return rdf @ (matrix(view.ned_from_frd) @ matrix(camera.frd_from_rdf)).T, eye


def _reach(camera: CameraModel) -> float:
    """How far off its axis a camera sees, as a tangent; beyond it a lens polynomial may bend back into the picture."""
    columns, rows = (
        np.linspace(-0.5, camera.width - 0.5, _RIM_POINTS),
        np.linspace(-0.5, camera.height - 0.5, _RIM_POINTS),
    )
    rim = np.vstack(
        [np.column_stack((columns, np.full(_RIM_POINTS, row))) for row in (-0.5, camera.height - 0.5)]
        + [np.column_stack((np.full(_RIM_POINTS, column), rows)) for column in (-0.5, camera.width - 0.5)]
    )
    flat = unproject(camera, rim)
    return 1.02 * float(np.nanmax(np.hypot(flat[:, 0], flat[:, 1])))


def _triple(vector: Array) -> Vector3:
    return float(vector[0]), float(vector[1]), float(vector[2])
