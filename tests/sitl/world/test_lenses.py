"""Pictures through each lens: every part of them is where the formula of the lens says, to a tenth of a pixel."""

from collections.abc import Callable
from math import atan, atan2, cos, hypot, sin

import msgspec
import numpy as np
import pytest

from gloc3.camera.model import CameraModel, Lens
from gloc3.messages.frames import Vector3, rotate_back
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.studio import optics_of

from .pictures import CLEAN, fore_wall_by_hand, largest_shift_px, shift_px

pytestmark = pytest.mark.thorough

TruthAt = Callable[..., Truth]
FRONT = CameraModel(width=640, height=480, focal_px=(430.0, 428.0), center_px=(321.3, 238.1))
LENSES = {
    "pinhole": FRONT,
    "radtan": msgspec.structs.replace(FRONT, lens=Lens.RADTAN, distortion=(-0.28, 0.07, 0.0006, -0.0004)),
    "equidistant": msgspec.structs.replace(FRONT, lens=Lens.EQUIDISTANT, distortion=(-0.02, 0.004, -0.002, 0.0003)),
    "fisheye": msgspec.structs.replace(
        FRONT, lens=Lens.EQUIDISTANT, focal_px=(330.0, 330.0), distortion=(-0.01, 0.001, 0.0, 0.0)
    ),
}


def pixel(model: CameraModel, right: float, down: float, forward: float) -> tuple[float, float]:
    """The formula of each lens, point by point (OpenCV's documentation, Camera Calibration and fisheye)."""
    x, y = right / forward, down / forward
    if model.lens is Lens.RADTAN:
        k1, k2, p1, p2 = model.distortion
        r2 = x * x + y * y
        radial = 1.0 + k1 * r2 + k2 * r2**2
        x, y = (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    elif model.lens is Lens.EQUIDISTANT:
        k1, k2, k3, k4 = model.distortion
        angle, way = atan(hypot(x, y)), atan2(y, x)
        bent = angle * (1.0 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
        x, y = bent * cos(way), bent * sin(way)
    return model.center_px[0] + model.focal_px[0] * x, model.center_px[1] + model.focal_px[1] * y


def hold_with_the_fore_wall_alone() -> World:
    file = World.load("hold").file
    surfaces = {"fore": msgspec.structs.replace(file.surfaces["fore"], corner_m=(21, 63, 60))}
    wide = msgspec.structs.replace(surfaces["fore"], across_m=(0.0, -120.0, 0.0), down_m=(0.0, 0.0, -120.0))
    return World(msgspec.structs.replace(file, surfaces={"fore": wide}, boxes={}, marker=None))


@pytest.mark.parametrize("lens", LENSES)
def test_points_are_projected_as_the_formula_says(lens: str, truth_at: TruthAt) -> None:
    world = World.load("hold")
    camera = SimulatedCamera(world, LENSES[lens], CLEAN)
    truth = truth_at(world, (15.0, 5.0, 3.0), (0.1, -0.05, 0.2))
    local_from_rdf, eye = camera.pose(truth)
    points: list[Vector3] = [(21.0, 5.0, 3.0), (21.0, 8.0, 5.0), (20.0, 2.0, 1.0), (18.0, 4.0, 1.5), (21.0, 7.5, 0.5)]
    for point in points:
        away = (point[0] - eye[0], point[1] - eye[1], point[2] - eye[2])
        assert camera.project(truth, point) == pytest.approx(
            pixel(LENSES[lens], *rotate_back(local_from_rdf, away)), abs=1e-6
        )
    assert camera.project(truth, (3.0, 5.0, 3.0)) is None, "behind the camera"


@pytest.mark.parametrize("lens", LENSES)
def test_pictures_show_every_part_of_a_wall_where_its_own_ray_meets_it(lens: str, truth_at: TruthAt) -> None:
    world = hold_with_the_fore_wall_alone()
    camera = SimulatedCamera(world, LENSES[lens], CLEAN)
    truth = truth_at(world, (18.5, 5.0, 3.0), (0.07, -0.05, 0.15))
    drawn, expected = camera.capture(truth).pixels, fore_wall_by_hand(camera, truth)
    assert np.count_nonzero(drawn == 0) == 0, "no part is missing"
    edge = 96 if lens == "fisheye" else 0  # there the rays graze the wall, and the texture is drawn coarser
    cut = np.s_[edge : 480 - edge, edge : 640 - edge]
    assert largest_shift_px(expected[cut], drawn[cut]) < 0.1
    assert float(np.abs(drawn[cut].astype(float) - expected[cut]).mean()) < 4.0


def test_a_shift_of_the_picture_would_be_noticed(truth_at: TruthAt) -> None:
    world = hold_with_the_fore_wall_alone()
    camera = SimulatedCamera(world, LENSES["radtan"], CLEAN)
    truth, moved = (truth_at(world, (18.5, y_m, 3.0), (0.07, -0.05, 0.15)) for y_m in (5.0, 5.0015))
    assert largest_shift_px(fore_wall_by_hand(camera, truth), camera.capture(moved).pixels) > 0.15


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 6.0])
def test_the_disparity_of_a_stereo_pair_is_focal_length_times_baseline_over_depth(
    distance_m: float, truth_at: TruthAt
) -> None:
    world = hold_with_the_fore_wall_alone()
    eyes = [
        SimulatedCamera(
            world, msgspec.structs.replace(FRONT, position_frd_m=(0.12, side * rig.BASELINE_M / 2.0, 0.02)), CLEAN
        )
        for side in (-1.0, 1.0)
    ]
    truth = truth_at(world, (21.0 - 0.12 - distance_m, 5.0, 3.0))
    left, right = (eye.capture(truth).pixels[112:368, 128:512] for eye in eyes)
    disparity_px = FRONT.focal_px[0] * rig.BASELINE_M / distance_m
    whole = round(disparity_px)
    across, down = shift_px(left[:, whole:], right[:, : right.shape[1] - whole])
    assert whole - across == pytest.approx(disparity_px, abs=0.1)
    assert down == pytest.approx(0.0, abs=0.05)


def test_a_fisheye_of_more_than_a_canvas_can_hold_is_drawn_without_gaps(truth_at: TruthAt) -> None:
    world = World.load("hold")
    model = msgspec.structs.replace(LENSES["equidistant"], focal_px=(210.0, 210.0), distortion=())
    picture = SimulatedCamera(world, model, CLEAN).capture(truth_at(world, (15.0, 5.0, 3.0))).pixels
    rows, columns = np.mgrid[0:480, 0:640]
    angle = np.hypot(columns - 321.3, rows - 238.1) / 210.0
    assert np.count_nonzero(picture[angle < 1.5] == 0) == 0
    assert np.count_nonzero(picture[angle > 1.6]) == 0, "what is beside the camera has no place in the model"


def test_a_lens_is_computed_once_for_all_flights_and_another_lens_is_another() -> None:
    bent = msgspec.structs.replace(FRONT, lens=Lens.EQUIDISTANT)
    assert optics_of(bent) is optics_of(msgspec.structs.replace(bent))
    assert optics_of(bent) is not optics_of(FRONT)
