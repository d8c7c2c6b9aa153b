"""`gloc3 calibrate camera-imu` and `laser-imu`, from logs of rendered pictures and scans to the rig file, and back."""

from dataclasses import replace as changed
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.common.log.samples import LogInMemory
from tests.onboard.algorithms.calibration.motions import HAND
from tests.onboard.algorithms.calibration.test_camera_imu_fit import camera_motion
from tests.onboard.calibrating.motion_logs import OFFSET_S, SMALL, camera_folder, camera_log, laser_log
from tests.onboard.calibrating.picture_sets import BOARD

from gloc3.camera.geometry import matrix
from gloc3.cli.program import run
from gloc3.messages.envelope import Source
from gloc3.messages.frames import rotate
from gloc3.messages.perception import ImuSample
from gloc3_onboard.algorithms.calibration.camera_imu_fit import fit_camera_imu
from gloc3_onboard.calibrating.camera_imu import doubts_of
from gloc3_onboard.calibration.mounting import FORWARD, IN_PLACE, Transform, frd_from_axes
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.calibration.rig_file import camera_section, read_sections, rows_of, write_sections

RIGHT_FROM_LEFT = Transform((-0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return camera_log(tmp_path_factory.mktemp("moved") / "log.mcap")


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A rig file with a pair of cameras, as `gloc3 calibrate stereo` writes it."""
    path = tmp_path / "rig.yaml"
    right = camera_section(SMALL, "cam1") | {"T_cn_cnm1": rows_of(RIGHT_FROM_LEFT)}
    write_sections(path, {"cam0": camera_section(SMALL, "cam0"), "cam1": right})
    return path


def test_place_turn_and_time_of_all_cameras_are_written_in_kalibrs_form_and_read_back(
    log: Path, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "report.svg"
    source = f"{log}#camera/front"
    code = run(["calibrate", "camera-imu", source, "--board", BOARD, "--rig", str(rig), "--report", str(report)])
    said = capsys.readouterr()
    assert code == 0, said.err
    sections = read_sections(rig)
    for name in ("cam0", "cam1"):
        assert sections[name]["timeshift_cam_imu"] == pytest.approx(OFFSET_S, abs=1e-3)
        assert sections[name]["imu_calibration"]["date"]
    rows = np.array(sections["cam0"]["T_cam_imu"])
    apart = (Rotation.from_matrix(rows[:3, :3]) * HAND.camera_from_imu.inv()).magnitude()
    assert np.degrees(apart) < 0.3
    assert rows[:3, 3] == pytest.approx(HAND.imu_in_camera_m, abs=0.008)
    assert sections["cam1"]["T_cn_cnm1"] == rows_of(RIGHT_FROM_LEFT)
    # As the vehicle reads it: the cameras on the body, forward, right, down.
    cameras = read_calibration(rig).cameras
    place = -HAND.camera_from_imu.inv().apply(HAND.imu_in_camera_m)
    assert cameras["cam0"].position_frd_m == pytest.approx(place, abs=0.008)
    assert matrix(cameras["cam0"].frd_from_rdf) == pytest.approx(matrix(FORWARD), abs=0.08)
    baseline = np.subtract(cameras["cam1"].position_frd_m, cameras["cam0"].position_frd_m)
    assert np.linalg.norm(baseline) == pytest.approx(0.1, abs=1e-6)
    assert [one.time_shift_s for one in cameras.values()] == pytest.approx([OFFSET_S] * 2, abs=1e-3)
    assert "pictures are stamped late; the vehicle takes that from the rig file" in said.err
    assert report.read_text().count("<g transform") == 2


def test_the_place_of_the_camera_before_it_in_the_chain_follows_from_its_own(log: Path, rig: Path) -> None:
    write_sections(rig, {"cam0": {"T_cam_imu": rows_of(IN_PLACE)}})
    source = f"{log}#camera/front"
    assert run(["calibrate", "camera-imu", source, "--board", BOARD, "--rig", str(rig), "--camera", "cam1"]) == 0
    cameras = read_calibration(rig).cameras
    place = -HAND.camera_from_imu.inv().apply(HAND.imu_in_camera_m)
    assert cameras["cam1"].position_frd_m == pytest.approx(place, abs=0.008)
    baseline = np.subtract(cameras["cam1"].position_frd_m, cameras["cam0"].position_frd_m)
    assert baseline == pytest.approx(rotate(cameras["cam0"].frd_from_rdf, (0.1, 0.0, 0.0)), abs=1e-9)
    assert cameras["cam0"].time_shift_s == cameras["cam1"].time_shift_s


def test_the_axes_of_the_unit_in_a_folder_are_those_that_are_given(log: Path, rig: Path, tmp_path: Path) -> None:
    folder = camera_folder(tmp_path / "moved", log)
    command = ["calibrate", "camera-imu", f"{folder}#cam0", "--board", BOARD, "--rig", str(rig)]
    place = -HAND.camera_from_imu.inv().apply(HAND.imu_in_camera_m)
    assert run([*command, "--axes", "frd"]) == 0
    assert read_calibration(rig).cameras["cam0"].position_frd_m == pytest.approx(place, abs=0.008)
    assert run(command) == 0
    as_of_euroc = rotate(frd_from_axes("urf"), (place[0], place[1], place[2]))
    assert read_calibration(rig).cameras["cam0"].position_frd_m == pytest.approx(as_of_euroc, abs=0.008)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert run(["calibrate", *arguments]) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return said


def test_what_camera_imu_lacks_is_named(
    log: Path, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = ("--board", BOARD, "--rig", str(rig))
    nowhere = str(tmp_path / "none.yaml")
    said = refused(capsys, "camera-imu", f"{log}#camera/front", "--board", BOARD, "--rig", nowhere)
    assert "none.yaml: there is no such rig file (calibrate the lens first: gloc3 calibrate camera)" in said
    said = refused(capsys, "camera-imu", f"{log}#camera/front", *board, "--camera", "cam7")
    assert "it has no camera 'cam7'" in said
    said = refused(capsys, "camera-imu", f"{log}#camera/front", *board, "--imu", "imus")
    assert "it has no ImuSample in 'imus' (did you mean 'imu'?)" in said
    said = refused(capsys, "camera-imu", f"{log}#camera/fron", *board)
    assert "it has no Image in 'camera/fron'" in said
    said = refused(capsys, "camera-imu", f"{log}#camera/front", *board, "--axes", "frd")
    assert "--axes is of folders like EuRoC's" in said
    said = refused(capsys, "camera-imu", "nowhere", *board)
    assert "nowhere: no data set of EuRoC's kind with imu0/data.csv" in said


def test_a_lens_of_another_size_is_refused(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = tmp_path / "rig.yaml"
    write_sections(rig, {"cam0": camera_section(msgspec.structs.replace(SMALL, width=640, height=480), "cam0")})
    said = refused(capsys, "camera-imu", f"{log}#camera/front", "--board", BOARD, "--rig", str(rig))
    assert "the pictures are 320 x 240, the calibration is for 640 x 480" in said


def test_a_result_that_is_not_trustworthy_says_why() -> None:
    fit = fit_camera_imu(camera_motion(HAND), HAND.samples(np.arange(-1.5, 16.0, 0.01)))
    assert doubts_of(fit) == []
    (doubt,) = doubts_of(changed(fit, gravity_m_s2=10.4))
    assert doubt == "gravity follows as 10.40 m/s², and is 9.81: is the board as large as described?"
    (doubt,) = doubts_of(changed(fit, spreads_rad_s=np.array([0.8, 0.05, 0.02])))
    assert doubt.startswith("the unit was turned about one axis only")
    (doubt,) = doubts_of(changed(fit, correlation=0.4))
    assert doubt.startswith("camera and gyro agree to 40% only")
    (doubt,) = doubts_of(changed(fit, place_std_m=np.array([0.001, 0.03, 0.001])))
    assert doubt == "the camera's place is known to 30 mm only, 10 mm is the most"


def test_the_time_of_a_scanner_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, report = tmp_path / "rig.yaml", tmp_path / "report.svg"
    source = laser_log(tmp_path / "log.mcap")
    code = run(["calibrate", "laser-imu", str(source), "--rig", str(rig), "--report", str(report)])
    said = capsys.readouterr()
    assert code == 0, said.err
    section = read_sections(rig)["laser"]
    assert section["timeshift_laser_imu"] == pytest.approx(OFFSET_S, abs=2e-3)
    assert abs(section["timeshift_laser_imu"] - OFFSET_S) < 4.0 * section["calibration"]["timeshift_std_s"]
    assert section["is_flipped"] is False
    assert section["calibration"]["date"]
    assert "mounted      upright" in said.out
    assert f"hokuyo:///dev/ttyACM0?time_shift_s={section['timeshift_laser_imu']:.4f}" in said.err
    assert "residuals of the turn" in report.read_text()


def test_a_vehicle_that_is_hardly_turned_is_not_trusted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = laser_log(tmp_path / "log.mcap", turn=0.02)
    assert run(["calibrate", "laser-imu", str(source), "--rig", str(tmp_path / "rig.yaml")]) == 1
    assert "the vehicle was hardly turned (0.0" in capsys.readouterr().err
    assert not (tmp_path / "rig.yaml").exists()


def test_a_log_without_scans_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = LogInMemory(chosen={"imu": True})
    sample = ImuSample(rate_frd_rad_s=(0.0, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, -9.81))
    log.send("imu", sample, 0.1, Source("pelican", "imu", 1))
    (tmp_path / "log.mcap").write_bytes(log.close())
    assert "log.mcap: it has no LaserScan in 'laser'" in refused(capsys, "laser-imu", str(tmp_path / "log.mcap"))
    assert "aces.log: this is no log of GLOC3 (logs end in .mcap)" in refused(capsys, "laser-imu", "aces.log")
