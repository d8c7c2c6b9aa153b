"""Coverage of a wall, against what is worked out by other means."""

import math

import numpy as np
import pytest

from gloc3.camera.geometry import unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.wall_coverage import CoverageLimits, Wall, WallView, cover, footprint
from gloc3.errors import Refused
from gloc3.messages.frames import from_euler, rotate

FRONT = CameraModel(width=640, height=480, focal_px=(400.0, 400.0), center_px=(319.5, 239.5))
BENT = CameraModel(
    width=640, height=480, focal_px=(400.0, 400.0), center_px=(319.5, 239.5), lens=Lens.RADTAN, distortion=(-0.3, 0.08)
)
# 10 m north, 12 m wide from west to east, 6 m high, standing on the ground.
WALL = Wall.of_corners([(10.0, -6.0, -6.0), (10.0, 6.0, -6.0), (10.0, 6.0, 0.0), (10.0, -6.0, 0.0)])
LIMITS = CoverageLimits(cell_m=0.05)


def view(north: float, east: float, height: float, yaw: float = 0.0, pitch: float = 0.0) -> WallView:
    return WallView("front", (north, east, -height), from_euler(0.02, pitch, yaw))


def test_a_picture_from_straight_ahead_covers_the_rectangle_that_its_angles_cut() -> None:
    found = cover(WALL, [WallView("front", (7.0, 0.0, -3.0), (1.0, 0.0, 0.0, 0.0))], {"front": FRONT}, LIMITS)
    assert found.share == pytest.approx((640 * 3 / 400) * (480 * 3 / 400) / 72.0, rel=0.02)
    assert found.median_mm == pytest.approx(1000 * 3 / 400, rel=0.01)
    corners = footprint(WALL, WallView("front", (7.0, 0.0, -3.0), (1.0, 0.0, 0.0, 0.0)), FRONT)
    assert corners is not None
    assert corners[0] == pytest.approx((6.0 - 2.4, 3.0 - 1.8), abs=0.01)
    assert corners[2] == pytest.approx((6.0 + 2.4, 3.0 + 1.8), abs=0.01)


@pytest.mark.parametrize("camera", [FRONT, BENT])
@pytest.mark.thorough
def test_the_coverage_of_a_flight_is_what_rays_from_all_its_pictures_hit(camera: CameraModel) -> None:
    views = [view(6.5, -5.0 + 1.3 * i, 2.0 + (i % 3), 0.1 * (i % 4) - 0.2, 0.05 * (i % 2)) for i in range(5)]
    found = cover(WALL, views, {"front": camera}, LIMITS)
    columns, rows = np.meshgrid(np.arange(0.0, 640.0, 2.0), np.arange(0.0, 480.0, 2.0))
    flat = unproject(camera, np.column_stack((columns.ravel(), rows.ravel())))
    hit = np.zeros((120, 240), np.bool_)
    for each in views:
        turn = np.array([rotate(each.ned_from_frd, axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))]).T
        rays = np.column_stack((np.ones(len(flat)), flat)) @ turn.T  # ahead, right and down are the body's axes
        reach = (10.0 - each.position_ned_m[0]) / rays[:, 0]
        east, down = each.position_ned_m[1] + reach * rays[:, 1], each.position_ned_m[2] + reach * rays[:, 2]
        slant = np.linalg.norm(rays, axis=1) / rays[:, 0]
        fine = (np.abs(east) < 6.0) & (np.abs(down + 3.0) < 3.0) & (slant < 1.0 / math.cos(math.radians(70.0)))
        hit[((down[fine] + 6.0) / 0.05).astype(int), ((east[fine] + 6.0) / 0.05).astype(int)] = True
    assert found.share == pytest.approx(hit.mean(), rel=0.02)
    assert 0.3 < found.share < 0.99
    assert found.used.all()


def test_a_wall_behind_from_behind_too_far_or_too_oblique_is_not_seen() -> None:
    for each in (view(7.0, 0.0, 3.0, yaw=math.pi), view(13.0, 0.0, 3.0, yaw=math.pi), view(-11.0, 0.0, 3.0)):
        assert cover(WALL, [each], {"front": FRONT}, LIMITS).share == 0.0
    grazing = cover(WALL, [view(9.8, -5.9, 3.0, yaw=math.pi / 2.0)], {"front": FRONT}, LIMITS)
    assert grazing.share < 0.01


def test_what_is_no_rectangle_or_no_known_camera_is_refused() -> None:
    with pytest.raises(Refused, match="rectangle"):
        Wall.of_corners([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 1.0), (1.0, 0.0, 1.0)])
    with pytest.raises(Refused, match="camera 'front'"):
        cover(WALL, [view(0.0, 0.0, 1.0)], {}, LIMITS)
