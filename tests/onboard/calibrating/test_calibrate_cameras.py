"""`gloc3 calibrate camera` and `stereo`, from rendered pictures to the rig file: written, read back, drawn, refused."""

import shutil
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from tests.onboard.algorithms.calibration.rendered import CAMERA
from tests.onboard.calibrating.picture_sets import BOARD, COUNT, RIGHT_FROM_LEFT, grey_picture, pair_folder

from gloc3.camera.model import CameraModel
from gloc3.cli.program import run
from gloc3.messages.frames import rotate
from gloc3_onboard.calibration.mounting import FORWARD, IN_PLACE, Transform
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.calibration.rig_file import read_sections, rows_of, write_sections


def calibrate(*arguments: str, code: int = 0) -> None:
    assert run(["calibrate", *arguments]) == code


def assert_right(model: CameraModel, std: list[float], truth: CameraModel) -> None:
    found = np.array([*model.focal_px, *model.center_px])
    errors = found - np.array([*truth.focal_px, *truth.center_px])
    assert np.abs(errors).max() < 1.5
    assert np.abs(errors / np.array(std)).max() < 4.0
    assert model.distortion[:2] == pytest.approx(truth.distortion[:2], abs=0.03)


def test_a_camera_is_written_with_its_date_and_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, report = tmp_path / "rig.yaml", tmp_path / "report.svg"
    rig.write_text(
        "cam0: {T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]], intrinsics: [1, 1, 1, 1]}\n"
    )
    pattern = str(pair_folder() / "left*.png")
    calibrate("camera", pattern, "--board", BOARD, "--rig", str(rig), "--report", str(report))
    said = capsys.readouterr()
    assert f"in {COUNT} pictures" in said.out
    assert "█" in said.out
    assert "cameras: {front: " in said.err
    section = read_sections(rig)["cam0"]
    assert_right(read_calibration(rig).camera("cam0"), section["calibration"]["intrinsics_std"], CAMERA)
    assert date.fromisoformat(section["calibration"]["date"]) <= date.today()  # noqa: DTZ011
    assert section["T_cam_imu"][2][3] == 0.1, "what else is known of the camera stays"
    drawn = report.read_text()
    assert drawn.count("<g transform") == 3
    assert "residuals" in drawn


def test_a_pair_is_written_in_kalibrs_form(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    left, right = (str(pair_folder() / f"{side}*.png") for side in ("left", "right"))
    calibrate("stereo", left, right, "--board", BOARD, "--rig", str(rig))
    sections = read_sections(rig)
    assert {"camera_model", "intrinsics", "distortion_coeffs", "resolution", "rostopic"} <= set(sections["cam1"])
    shift = np.array(sections["cam1"]["T_cn_cnm1"])[:3, 3]
    assert shift == pytest.approx(RIGHT_FROM_LEFT[3:], abs=5e-4)
    cameras = read_calibration(rig).cameras
    # The right camera is to the right of the left one by the baseline: y of the body.
    apart = np.subtract(cameras["cam1"].position_frd_m, cameras["cam0"].position_frd_m)
    assert np.linalg.norm(apart) == pytest.approx(np.linalg.norm(RIGHT_FROM_LEFT[3:]), abs=5e-4)
    assert apart[1] == pytest.approx(0.07, abs=2e-3)
    assert rotate(cameras["cam0"].frd_from_rdf, (0.0, 0.0, 1.0))[0] == pytest.approx(1.0)


def test_a_file_with_another_camera_than_the_first_one_alone_is_read_back(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    pattern = str(pair_folder() / "left*.png")
    calibrate("camera", pattern, "--board", BOARD, "--rig", str(rig), "--name", "cam1")
    assert [*read_calibration(rig).cameras] == ["cam1"]


@pytest.mark.parametrize("known", [("cam0", "cam1"), ("cam0",), ("cam1",)])
def test_the_place_of_a_pair_on_the_inertial_unit_follows_its_new_baseline(
    known: tuple[str, ...], tmp_path: Path
) -> None:
    """As after an earlier calibration of the pair and with the inertial unit, when the right camera was elsewhere."""
    rig = tmp_path / "rig.yaml"
    old = {"T_cam_imu": rows_of(Transform((0.3, 0.2, 0.1), FORWARD)), "timeshift_cam_imu": 0.02}
    write_sections(rig, dict.fromkeys(known, old) | {"cam2": {"T_cn_cnm1": rows_of(IN_PLACE)}})
    left, right = (str(pair_folder() / f"{side}*.png") for side in ("left", "right"))
    calibrate("stereo", left, right, "--board", BOARD, "--rig", str(rig))
    sections = read_sections(rig)
    assert sections[known[0]]["T_cam_imu"] == old["T_cam_imu"]
    assert [sections[name]["timeshift_cam_imu"] for name in ("cam0", "cam1", "cam2")] == [0.02] * 3
    first, second, third = (np.array(sections[f"cam{number}"]["T_cam_imu"]) for number in range(3))
    assert second @ np.linalg.inv(first) == pytest.approx(np.array(sections["cam1"]["T_cn_cnm1"]), abs=1e-9)
    assert third == pytest.approx(second, abs=1e-9)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copied = tmp_path / "pictures"
    copied.mkdir()
    for path in pair_folder().glob("*0[1-4].png"):
        shutil.copy(path, copied)
    return copied


def test_too_few_pictures_are_not_trusted_unless_forced(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig.yaml"
    arguments = ["camera", str(folder / "left*.png"), "--board", BOARD, "--rig", str(rig)]
    calibrate(*arguments, code=1)
    said = capsys.readouterr()
    assert "not trustworthy: 4 pictures with a board, 8 are the least" in said.err
    assert "rig.yaml is not written" in said.err
    assert "focal length" in said.out, "what was found is shown all the same"
    assert not rig.exists()
    calibrate(*arguments, "--force")
    assert "cam0" in read_sections(rig)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    calibrate(*arguments, code=2)
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return said


def test_a_picture_without_a_board_is_named_and_passed_over(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grey_picture(folder / "left05.png")
    run(["calibrate", "camera", str(folder / "left*.png"), "--board", BOARD, "--rig", str(folder / "rig.yaml")])
    assert "1 of 5 pictures do not show the board whole: " in (said := capsys.readouterr().err)
    assert "left05.png" in said


def test_another_board_than_described_is_refused_with_a_hint(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "camera", str(folder / "left*.png"), "--board", "checkerboard:10x7:0.025")
    assert "none of 4 pictures shows the board" in said
    assert "inner corners, one less than squares" in said


def test_two_sizes_are_refused_with_the_picture(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grey_picture(folder / "left05.png", 640, 480)
    said = refused(capsys, "camera", str(folder / "left*.png"), "--board", BOARD)
    assert "left05.png: the picture is 640 x 480, and " in said
    assert "left01.png is 480 x 360 (calibrate with pictures of one camera at one size)" in said


def test_a_damaged_picture_is_refused_with_its_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "left03.png").write_bytes(b"\x89PNG no more")
    said = refused(capsys, "camera", str(folder / "left*.png"), "--board", BOARD)
    assert "left03.png: left03.png cannot be read (take it out of the folder)" in said


def test_a_pair_without_its_partner_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "right02.png").unlink()
    said = refused(capsys, "stereo", str(folder / "left*.png"), str(folder / "right*.png"), "--board", BOARD)
    assert "1 pictures have no partner, such as" in said
    assert "left02.png" in said


def test_cameras_that_do_not_expose_together_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, path in enumerate(sorted(folder.glob("*.png"))):
        side, index = path.stem[:-2], int(path.stem[-2:])
        (folder / side).mkdir(exist_ok=True)
        path.rename(
            folder / side / f"{1_600_000_000_000_000_000 + index * 500_000_000 + (number > 3) * 40_000_000}.png"
        )
    said = refused(capsys, "stereo", str(folder / "left"), str(folder / "right"), "--board", BOARD)
    assert (
        "not synchronised: 0 of 4 left pictures have a right one within 5 ms, half of them are more than 40.0 ms apart"
        in said
    )


def test_pairs_whose_boards_are_elsewhere_are_not_trusted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(1, COUNT + 1):
        shutil.copy(pair_folder() / f"left{number:02}.png", tmp_path)
        other = number - 1 if number > COUNT - 3 else number
        shutil.copy(pair_folder() / f"right{other:02}.png", tmp_path / f"right{number:02}.png")
    left, right = (str(tmp_path / f"{side}*.png") for side in ("left", "right"))
    calibrate("stereo", left, right, "--board", BOARD, "--rig", str(tmp_path / "rig.yaml"), code=1)
    assert "they do not expose together, or one has moved" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("camera", "nowhere", "--board", BOARD), "nowhere: there is no such folder"),
        (("camera", "no*.png", "--board", BOARD), "no*.png: no file fits this pattern"),
        (("camera", ".", "--board", BOARD), "there are no pictures in this folder"),
        (("camera", ".", "--board", "chessboard:9x6"), "'chessboard:9x6' is no board; write checkerboard:9x6:0.025"),
        (("camera", ".", "--board", "checkerboard:9x1:0.02"), "1 must be from 2 to 60"),
        (("camera", ".", "--board", "aprilgrid:6x6:88:0.3"), "88 must be from 0.001 to 5"),
        (("camera", ".", "--board", "board.yaml"), "board.yaml: cannot be read"),
        (("camera", ".", "--board", BOARD, "--report", "report.pdf"), "the report is an SVG"),
        (("camera", ".", "--board", BOARD, "--rig", "nowhere/rig.yaml"), "there is no folder nowhere"),
        (("camera", "log.mcap#camera/front", "--board", BOARD), "log.mcap: cannot be read"),
        (("camera", ".", "--board", BOARD, "--name", "front"), "--name 'front' must be cam0, cam1 and so on"),
        (("stereo", ".", "v4l2:///dev/video0", "--board", BOARD), "both cameras must be live, or neither"),
        (("stereo", ".", ".", "--board", BOARD, "--within", "0"), "--within must be above 0"),
    ],
)
def test_wrong_use_is_refused_with_the_reason(
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, *arguments)


def test_a_file_that_is_no_rig_file_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("platform: pelican\n")
    said = refused(capsys, "camera", str(tmp_path), "--board", BOARD, "--rig", str(rig))
    assert "rig.yaml: this is not a rig file" in said
    assert rig.read_text() == "platform: pelican\n"
