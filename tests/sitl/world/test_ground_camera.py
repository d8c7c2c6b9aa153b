"""The ground camera: pictures agree with the geometry, tags are where the truth says, pictures repeat."""

from collections.abc import Callable
from math import dist, pi

import msgspec
import numpy as np
import pytest

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.imager import Imager
from gloc3_sitl.world.rig import GROUND, GROUND_IMAGER
from gloc3_sitl.world.texture import Image

pytestmark = pytest.mark.thorough

TruthAt = Callable[..., Truth]
CLEAN = Imager(name="ground", noise_grey=0.0)


@pytest.fixture(scope="module")
def hold() -> World:
    return World.load("hold")


@pytest.fixture(scope="module")
def camera(hold: World) -> SimulatedCamera:
    return SimulatedCamera(hold, GROUND, GROUND_IMAGER)


def find_tag(picture: Image) -> tuple[int, list[tuple[float, float]]] | None:
    """Number and corners of the tag in a picture, by OpenCV's detector."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    corners, ids, _ = detector.detectMarkers(picture)
    if ids is None:
        return None
    return int(ids.ravel()[0]), [(float(x), float(y)) for x, y in corners[0].reshape(4, 2)]


VIEWS: list[tuple[Vector3, Vector3]] = [
    ((10.0, 1.0, 2.0), (0.0, 0.0, 0.0)),
    ((9.8, 0.9, 1.5), (0.0, 0.0, 2.0)),
    ((10.3, 1.2, 4.0), (0.1, 0.2, 0.7)),
    ((9.6, 1.3, 3.0), (-0.15, 0.1, -2.5)),
    ((11.5, -1.0, 6.0), (0.1, -0.1, 3.0)),
    ((10.0, 4.0, 8.0), (0.0, 0.0, 0.5)),
    ((8.0, 1.0, 2.5), (0.0, 0.45, 0.0)),
]


@pytest.mark.parametrize(("position_m", "euler_rad"), VIEWS)
def test_the_tag_is_seen_where_the_truth_says(
    hold: World, camera: SimulatedCamera, truth_at: TruthAt, position_m: Vector3, euler_rad: Vector3
) -> None:
    truth = truth_at(hold, position_m, euler_rad)
    assert camera.marker_in_view(truth)
    found = find_tag(camera.capture(truth).pixels)
    expected = camera.marker_corners_px(truth)
    assert found is not None
    assert expected is not None
    assert found[0] == 7
    assert max(dist(a, b) for a, b in zip(found[1], expected, strict=True)) < 1.0


@pytest.mark.parametrize(
    ("position_m", "euler_rad"),
    [((2.0, 1.0, 2.0), (0.0, 0.0, 0.0)), ((10.0, 1.0, 0.3), (0.0, 0.0, 0.0)), ((10.0, 1.0, 3.0), (1.2, 0.0, 0.0))],
)
def test_no_tag_is_seen_where_the_truth_says_none_is(
    hold: World, camera: SimulatedCamera, truth_at: TruthAt, position_m: Vector3, euler_rad: Vector3
) -> None:
    truth = truth_at(hold, position_m, euler_rad)
    assert not camera.marker_in_view(truth)
    assert find_tag(camera.capture(truth).pixels) is None


def test_the_predicate_and_the_detector_agree_along_a_flight(
    hold: World, camera: SimulatedCamera, truth_at: TruthAt
) -> None:
    seen = []
    for step in range(40):
        truth = truth_at(hold, (6.0 + 0.2 * step, 1.2, 2.0), (0.02, -0.03, 0.1))
        clearly_in, half_out = camera.marker_in_view(truth, margin_px=4.0), not camera.marker_in_view(truth, -80.0)
        found = find_tag(camera.capture(truth).pixels) is not None
        seen.append(found)
        assert not (clearly_in and not found)
        assert not (half_out and found)
    assert 5 < sum(seen) < 35


def test_the_picture_s_top_is_ahead_and_its_right_is_to_the_right(
    hold: World, camera: SimulatedCamera, truth_at: TruthAt
) -> None:
    truth = truth_at(hold, (5.0, 5.0, 2.0))
    middle = camera.project(truth, (5.0, 5.0, 0.0))
    assert middle == pytest.approx(GROUND.center_px)
    ahead, right = camera.project(truth, (6.0, 5.0, 0.0)), camera.project(truth, (5.0, 4.0, 0.0))
    assert ahead is not None
    assert right is not None
    height_m = 2.0 + 0.0973 - 0.07
    assert ahead == pytest.approx((319.5, 239.5 - 400.0 / height_m))
    assert right == pytest.approx((319.5 + 400.0 / height_m, 239.5))
    assert camera.project(truth, (5.0, 5.0, 9.0)) is None


def test_a_step_sideways_moves_the_picture_by_as_much_as_geometry_says(hold: World, truth_at: TruthAt) -> None:
    import cv2

    camera = SimulatedCamera(hold, GROUND, CLEAN)
    first = camera.capture(truth_at(hold, (5.0, 5.0, 4.0))).pixels.astype(np.float32)
    second = camera.capture(truth_at(hold, (5.3, 5.1, 4.0))).pixels.astype(np.float32)
    (across, down), _ = cv2.phaseCorrelate(first, second, cv2.createHanningWindow((640, 480), cv2.CV_32F))
    per_m = 400.0 / (4.0 + 0.0973 - 0.07)
    assert (across, down) == pytest.approx((0.1 * per_m, 0.3 * per_m), abs=0.3)


def test_pictures_have_texture_everywhere_and_noise_of_the_stated_strength(hold: World, truth_at: TruthAt) -> None:
    truth = truth_at(hold, (16.0, 9.0, 3.0))
    noisy, clean = (
        SimulatedCamera(hold, GROUND, Imager(name="ground", noise_grey=grey)).capture(truth).pixels
        for grey in (3.0, 0.0)
    )
    assert float((noisy.astype(int) - clean).std()) == pytest.approx(3.0, rel=0.05)
    blocks = clean.reshape(6, 80, 8, 80).std(axis=(1, 3))
    assert blocks.min() > 3.0


def test_the_same_seed_gives_the_same_pictures_and_another_seed_other_noise(hold: World, truth_at: TruthAt) -> None:
    truth = truth_at(hold, (3.0, 3.0, 2.0), (0.1, 0.1, 1.0))
    truths = [truth, msgspec.structs.replace(truth, t_s=truth.t_s + 0.2)]
    cameras = [SimulatedCamera(hold, GROUND, GROUND_IMAGER, seed) for seed in (1, 1, 2)]
    first, again, other = ([camera.capture(truth).pixels.tobytes() for truth in truths] for camera in cameras)
    assert first == again
    assert first != other
    assert first[0] != first[1]
    assert cameras[0].capture(truth).pixels.tobytes() == first[0], "a picture does not depend on those before it"


def test_walls_come_into_view_near_them(hold: World, truth_at: TruthAt) -> None:
    camera = SimulatedCamera(hold, GROUND, CLEAN)
    picture = camera.capture(truth_at(hold, (20.0, 5.0, 5.0))).pixels
    wall_foot = camera.project(truth_at(hold, (20.0, 5.0, 5.0)), (21.0, 5.0, 0.0))
    assert wall_foot is not None
    row = round(wall_foot[1])
    assert 0 < row < 240
    assert np.count_nonzero(picture == 0) < 300, "nothing of the picture is empty, also where two sides meet"
    assert abs(float(picture[:row].mean()) - float(picture[row + 40 :].mean())) > 5.0


def test_open_ground_goes_on_for_ever_and_has_its_tag_ahead_of_the_home(truth_at: TruthAt) -> None:
    world = World.load("open")
    camera = SimulatedCamera(world, GROUND, GROUND_IMAGER)
    far = camera.capture(truth_at(world, (640.0, -410.0, 60.0))).pixels
    assert float(far.std()) > 5.0
    found = find_tag(camera.capture(truth_at(world, (3.0, 0.0, 5.0), (0.0, 0.0, pi / 3))).pixels)
    assert found is not None


def test_repeated_texture_has_no_seam(truth_at: TruthAt) -> None:
    world = World.load("open")
    camera = SimulatedCamera(world, GROUND, CLEAN)
    for x_m in (8.0, 24.0, 40.0):
        picture = camera.capture(truth_at(world, (x_m, 8.0, 4.0))).pixels.astype(int)
        steps = np.abs(np.diff(picture, axis=0)).mean(axis=1)
        assert steps.max() < 4.0 * np.median(steps) + 2.0


def test_a_camera_that_looks_ahead_sees_the_wall(hold: World, truth_at: TruthAt) -> None:
    front = SimulatedCamera(hold, msgspec.structs.replace(GROUND, frd_from_rdf=(0.5, 0.5, 0.5, 0.5)), CLEAN)
    truth = truth_at(hold, (15.0, 5.0, 3.0))
    place = front.project(truth, (21.0, 5.0, 3.0 + 0.0973 - 0.07))
    assert place == pytest.approx(GROUND.center_px, abs=0.01)
    left = front.project(truth, (21.0, 6.0, 3.0))
    assert left is not None
    assert left[0] < 319.5, "y is to the left"
    assert np.count_nonzero(front.capture(truth).pixels == 0) < 300
