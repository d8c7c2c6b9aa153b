"""`gloc3 odometry stereo`: on a folder of KITTI's kind that is written here, and on real ones."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from tests.data_folders import PICTURES
from tests.onboard.algorithms.vision.wall import BASELINE_M, FOCAL_PX, HEIGHT, WIDTH, poll

from gloc3.cli.program import _call
from gloc3.errors import InputError
from gloc3.evaluation.metrics import TrajectoryAlignment, evaluate, relative_errors, steps
from gloc3.evaluation.trajectory import read_trajectory
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN
from gloc3_onboard.cli.odometry import app
from gloc3_onboard.cli.odometry_stereo import StereoOptions, run_mono, run_stereo
from gloc3_onboard.datasets.stereo_set import read_mono_set, read_stereo_set
from gloc3_sitl.sequences.euroc import write_euroc
from gloc3_sitl.sequences.smooth_flight import SmoothFlight
from gloc3_sitl.world import World

COUNT, STEP_M = 16, 0.02


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Steps to the right before a wall; the third pair is missing."""
    place = tmp_path_factory.mktemp("kitti")
    for part in ("image_0", "image_1"):
        (place / part).mkdir()
    for n in range(COUNT):
        for part, picture in zip(("image_0", "image_1"), poll(STEP_M * n, seed=n), strict=True):
            cv2.imwrite(str(place / part / f"{n:06}.png"), picture)
    column, row = (WIDTH - 1) / 2.0, (HEIGHT - 1) / 2.0
    for_right = -FOCAL_PX * BASELINE_M
    rows = [
        f"P{n}: {FOCAL_PX} 0 {column} {shift} 0 {FOCAL_PX} {row} 0 0 0 1 0\n" for n, shift in ((0, 0), (1, for_right))
    ]
    (place / "calib.txt").write_text("".join(rows))
    (place / "times.txt").write_text("".join(f"{n / 15.0:.6e}\n" for n in range(COUNT)))
    (place / "poses.txt").write_text("".join(f"1 0 0 {STEP_M * n} 0 1 0 0 0 0 1 0\n" for n in range(COUNT)))
    return place


def test_a_folder_of_kittis_kind_is_run_compared_and_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, out = folder / "poses.txt", tmp_path / "out.txt"
    arguments = ["stereo", str(folder), "--truth", str(truth), "--align", "origin", "--over", "0.1", "--json"]
    assert _call(app, [*arguments, "--trajectory", str(out)]) == 0
    found = msgspec.json.decode(capsys.readouterr().out)
    assert found["run"]["inputs"] == COUNT
    assert found["run"]["reasons"] == {BEGUN: 1}
    assert found["errors"]["absolute_m"]["max"] < 0.01
    assert found["errors"]["relative_m"]["rms"] < 0.01
    written = read_trajectory(out)
    assert written.t_s[-1] == pytest.approx((COUNT - 1) / 15.0, abs=1e-6)
    assert written.position_m[-1] == pytest.approx([STEP_M * (COUNT - 1), 0.0, 0.0], abs=0.01)


def test_a_picture_that_cannot_be_read_is_told_and_stepped_over(folder: Path) -> None:
    given = read_stereo_set(folder)
    third = folder / "image_1" / "000003.png"
    whole = third.read_bytes()
    third.write_bytes(whole[:200])
    try:
        estimate, cost = run_stereo(given)
    finally:
        third.write_bytes(whole)
    assert cost.reasons == {BEGUN: 1, "000003.png cannot be read": 1}
    assert estimate.position_m[-1][0] == pytest.approx(STEP_M * (COUNT - 1), abs=0.01)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["/nowhere"], "there is no such folder"),
        (["{tmp}"], "no data set of EuRoC's kind"),
        (["{folder}", "--over", "0"], "--over must be above 0"),
        (["{folder}", "--imu"], "a set of KITTI's form has no inertial unit"),
        (["{folder}", "--calibration-px", "6"], "--calibration-px must be from 0 to 5"),
        (["{folder}", "--nearest-m", "nan"], "--nearest-m must be from 0.05 to 100"),
        (["{folder}", "--mono", "--nearest-m", "3"], "are for two cameras"),
    ],
)
def test_what_is_no_data_set_is_refused(folder: Path, tmp_path: Path, arguments: list[str], said: str) -> None:
    from gloc3.errors import Gloc3Error

    with pytest.raises(Gloc3Error, match=said):
        _call(app, ["stereo", *(word.format(tmp=tmp_path, folder=folder) for word in arguments)])


def test_the_settings_of_the_components_are_those_of_the_command(folder: Path) -> None:
    given = read_stereo_set(folder)
    exact, wide = (run_stereo(given, StereoOptions(calibration_px=off_px))[0] for off_px in (0.0, 1.2))
    assert np.abs(exact.position_m - wide.position_m).max() > 1e-5
    assert wide.position_m[-1][0] == pytest.approx(STEP_M * (COUNT - 1), abs=0.02)
    _, cost = run_stereo(given, StereoOptions(nearest_m=100.0))  # the wall is much nearer: at 2 m
    assert cost.valid < COUNT - 4


@pytest.mark.thorough
def test_the_inertial_unit_of_a_data_set_bridges_pictures_that_are_black(tmp_path: Path) -> None:
    world = World.load("hold")
    flight = SmoothFlight(world, [(2.0, 2.0, 1.5), (6.0, 2.0, 1.8)], 0.6)
    write_euroc(tmp_path, world, flight.truth, 2.0)
    for place in (tmp_path / "mav0" / "cam0" / "data", tmp_path / "mav0" / "cam1" / "data"):
        for picture in sorted(place.glob("*.png"))[18:20]:
            cv2.imwrite(str(picture), np.zeros((480, 640), np.uint8))
    truth = read_trajectory(tmp_path / "mav0" / "state_groundtruth_estimate0" / "data.csv")
    costs = []
    for with_imu in (False, True):
        estimate, cost = run_stereo(read_stereo_set(tmp_path, with_imu=with_imu))
        costs.append(cost)
        assert evaluate(estimate, truth, TrajectoryAlignment.ORIGIN).absolute_m.max < 0.02
    assert costs[0].valid == costs[1].valid - 2 == costs[1].inputs - 3
    (tmp_path / "mav0" / "imu0" / "data.csv").unlink()
    with pytest.raises(InputError, match="there is no imu0/data"):
        read_stereo_set(tmp_path, with_imu=True)


@pytest.mark.thorough
@pytest.mark.outside
def test_a_vehicle_at_rest_drifts_by_less_than_three_millimetres() -> None:
    estimate, cost = run_stereo(read_stereo_set(PICTURES / "euroc_rest"))
    assert cost.inputs == 40
    assert cost.reasons == {BEGUN: 1}
    assert np.linalg.norm(estimate.position_m - estimate.position_m[0], axis=1).max() < 0.003
    lines = (PICTURES / "euroc_rest" / "mav0" / "cam0" / "data.csv").read_text().splitlines()[1:]
    stamps_s = [int(line.split(",")[0]) * 1e-9 for line in lines]
    np.testing.assert_allclose(estimate.t_s, stamps_s, atol=1e-6, rtol=0.0)


@pytest.mark.thorough
@pytest.mark.outside
def test_one_camera_tells_the_turns_of_a_car_to_a_tenth_of_a_degree() -> None:
    given = read_mono_set(PICTURES / "kitti_mono")
    truth = read_trajectory(PICTURES / "kitti_mono" / "poses.txt")
    estimate, cost = run_mono(given)
    assert cost.reasons == {"the first picture": 1}
    _, turns_deg = relative_errors(estimate, truth, steps(truth))
    assert np.sqrt(np.mean(turns_deg**2)) < 0.1
