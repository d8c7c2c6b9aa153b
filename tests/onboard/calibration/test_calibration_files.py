"""Calibration files of every form become camera models; what is wrong in them is told with its place and a hint."""

import math
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from tests.data_folders import PICTURES

from gloc3.camera.model import CameraModel, Lens, misfit
from gloc3.errors import InputError, Refused
from gloc3.messages.frames import rotate
from gloc3_onboard.calibration.mounting import frd_from_axes
from gloc3_onboard.calibration.reader import read_calibration, read_reference

CAMCHAIN = """\
cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.02]
  - [0.0, 0.0, -1.0, 0.03]
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.002, -0.0003, 0.0001]
  distortion_model: equidistant
  intrinsics: [330.0, 330.0, 376.0, 240.0]
  resolution: [752, 480]
"""
MATRIX = np.array([[500.0, 0.0, 319.5], [0.0, 501.0, 239.5], [0.0, 0.0, 1.0]])
FIVE = np.array([[-0.1, 0.02, 0.001, -0.002, 0.003]])


def written(tmp_path: Path, text: str, name: str = "calibration.yaml") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def findings(path: Path, **options: str) -> str:
    with pytest.raises(InputError) as found:
        read_calibration(path, **options)  # type: ignore[arg-type] # only texts are given here
    return str(found.value).replace(str(path), "FILE")


def stored(path: Path, **values: Any) -> Path:
    """A file that OpenCV itself has written; its form follows the name."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


def test_the_offset_in_time_of_a_camchain_is_read(tmp_path: Path) -> None:
    text = CAMCHAIN.replace("cam1:\n", "  timeshift_cam_imu: -0.0125\ncam1:\n")
    found = read_calibration(written(tmp_path, text))
    assert [found.camera(name).time_shift_s for name in ("cam0", "cam1")] == [-0.0125, 0.0]
    for wrong in ("late", "true", "-1.5"):
        path = written(tmp_path, text.replace("-0.0125", wrong))
        assert "is not a time from -1 to 1 s" in findings(path)


@pytest.mark.parametrize("name", ["camera.yml", "camera.xml"])
def test_a_file_that_opencv_wrote_is_read_in_both_its_forms(tmp_path: Path, name: str) -> None:
    path = stored(
        tmp_path / name,
        image_width=640,
        image_height=480,
        camera_matrix=MATRIX,
        distortion_coefficients=FIVE.T,
        avg_reprojection_error=0.31,
    )
    found = read_calibration(path)
    assert found.form == "OpenCV"
    model = found.camera()
    assert (model.width, model.height, model.focal_px, model.center_px) == (640, 480, (500.0, 501.0), (319.5, 239.5))
    assert (model.lens, model.distortion) == (Lens.RADTAN, tuple(FIVE[0]))


def test_a_fisheye_of_opencv_is_told_by_its_flag(tmp_path: Path) -> None:
    four = np.array([[0.01, -0.002, 0.0003, 0.0]])
    values = {"image_width": 640, "image_height": 480, "K": MATRIX, "D": four}
    assert read_calibration(stored(tmp_path / "a.yml", **values, fisheye_model=1)).camera().lens is Lens.EQUIDISTANT
    assert read_calibration(stored(tmp_path / "b.yml", **values)).camera().lens is Lens.RADTAN


def test_a_stereo_file_of_opencv_puts_the_right_camera_where_r_and_t_say(tmp_path: Path) -> None:
    shift = np.array([[-0.12], [0.0], [0.0]])
    size = {"image_width": 640, "image_height": 480}
    pair = {"M1": MATRIX, "D1": FIVE, "M2": MATRIX, "D2": FIVE, "R": np.eye(3), "T": shift}
    found = read_calibration(stored(tmp_path / "pair.yml", **size, **pair)).cameras
    assert found["left"].position_frd_m == (0.0, 0.0, 0.0)
    assert found["right"].position_frd_m == pytest.approx((0.0, 0.12, 0.0))


def test_a_file_of_the_ros_calibrator_is_read(tmp_path: Path) -> None:
    text = """\
image_width: 640
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [500., 0, 319.5, 0, 501., 239.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.001, -0.002, 0.0]}
"""
    model = read_calibration(written(tmp_path, text)).camera()
    assert model.distortion == (-0.1, 0.02, 0.001, -0.002, 0.0)


def test_a_camchain_of_kalibr_places_every_camera_on_the_body(tmp_path: Path) -> None:
    found = read_calibration(written(tmp_path, CAMCHAIN), axes="flu")
    left, right = found.cameras["cam0"], found.cameras["cam1"]
    assert (left.lens, right.lens) == (Lens.RADTAN, Lens.EQUIDISTANT)
    # The camera looks along the IMU's x, forward; the IMU's y is left, its z up.
    assert rotate(left.frd_from_rdf, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert left.position_frd_m == pytest.approx((0.1, -0.02, -0.03))
    assert right.position_frd_m == pytest.approx((0.1, 0.09, -0.03))
    assert right.frd_from_rdf == pytest.approx(left.frd_from_rdf)


def test_calibrations_of_opencv_and_kalibr_project_as_opencv_does(tmp_path: Path) -> None:
    from gloc3.camera.geometry import project

    points = np.array([[0.3, -0.2, 1.0], [-0.5, 0.4, 2.0], [0.1, 0.1, 0.7]])
    for name in ("cam0", "cam1"):
        model = read_calibration(written(tmp_path, CAMCHAIN)).cameras[name]
        k = np.array(
            [[model.focal_px[0], 0, model.center_px[0]], [0, model.focal_px[1], model.center_px[1]], [0, 0, 1]]
        )
        d, zero = np.array(model.distortion), np.zeros(3)
        if model.lens is Lens.EQUIDISTANT:
            wanted, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, k, d)
        else:
            wanted, _ = cv2.projectPoints(points, zero, zero, k, d)
        assert project(model, points) == pytest.approx(wanted[:, 0], abs=1e-9)


def test_a_projection_of_kitti_gives_the_baseline_and_takes_the_size_of_a_picture_beside_it(tmp_path: Path) -> None:
    row = "7.07e+02 0 6.01e+02 {} 0 7.07e+02 1.83e+02 0 0 0 1 0"
    path = written(tmp_path, f"P0: {row.format(0)}\nP1: {row.format(-380)}\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n", "calib.txt")
    assert "size" in findings(path)
    (tmp_path / "image_0").mkdir()
    cv2.imwrite(str(tmp_path / "image_0" / "000000.png"), np.zeros((370, 1226), np.uint8))
    found = read_calibration(path)
    assert [(name, model.width) for name, model in found.cameras.items()] == [("P0", 1226), ("P1", 1226)]
    assert found.cameras["P1"].position_frd_m == pytest.approx((0.0, 380.0 / 707.0, 0.0))


# --- what is wrong ---


def changed(tmp_path: Path, previous: str, new: str) -> Path:
    assert previous in CAMCHAIN
    return written(tmp_path, CAMCHAIN.replace(previous, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[458.6, 457.3, 367.2, 248.4]", "[458.6, 457.3, 367.2]", "FILE:11:15: intrinsics: 3 numbers, expected 4"),
        ("[458.6, 457.3, 367.2, 248.4]", "[4.6, 4.6, 367.2, 248.4]", "FILE:11:15: a focal length of 4.6 pixels is"),
        ("[458.6, 457.3, 367.2, 248.4]", "[4e5, 4e5, 367.2, 248.4]", "field of view of 0.1 degrees"),
        ("[458.6, 457.3, 367.2, 248.4]", "[458.6, 857.3, 367.2, 248.4]", "differ by 1.87 times"),
        ("[458.6, 457.3, 367.2, 248.4]", "[0.0, 0.0, 367.2, 248.4]", "above 0 pixels"),
        (
            "[458.6, 457.3, 367.2, 248.4]",
            "[458.6, 457.3, 967.2, 248.4]",
            "FILE:11:15: the optical axis at 967.2, 248.4",
        ),
        ("-0.28, 0.07,", "-0.28, wide,", "FILE:9:30: 'wide' is not a number"),
        ("-0.28, 0.07,", "-0.28, .nan,", "FILE:9:"),
        ("-0.28, 0.07, 0.0002, 0.00002", "-0.28, 0.07", "FILE:9:22: distortion_coeffs: 2 numbers, expected 4 or 5"),
        ("-0.28, 0.07, 0.0002", "-2.8, 0.07, 0.0002", "FILE:9:22: the lens radtan with these coefficients cannot show"),
        ("distortion_model: radtan", "distortion_model: fov", "FILE:10:21: the lens 'fov' is not supported"),
        ("camera_model: pinhole", "camera_model: omni", "FILE:8:17: the camera model 'omni' is not supported"),
        ("[752, 480]", "[752, 0]", "FILE:12:15: a picture of 752 x 0 pixels"),
        ("[752, 480]", "[752]", "FILE:12:15: resolution: 1 numbers, expected 2"),
        ("resolution: [752, 480]", "resolutoin: [752, 480]", "'resolution' is missing (did you mean 'resolutoin'?)"),
        ("[0.0, -1.0, 0.0, 0.02]", "[0.0, -2.0, 0.0, 0.02]", "FILE:3:3: T_cam_imu: its rotation is invalid"),
        ("[0.0, -1.0, 0.0, 0.02]", "[0.0, 1.0, 0.0, 0.02]", "T_cam_imu: its rotation mirrors"),
        ("  - [0.0, 0.0, 0.0, 1.0]\n", "", "FILE:3:3: T_cam_imu has 3 rows, expected 4"),
        ("intrinsics: [458.6", "intrinsics: 458.6 #[", "intrinsics must be a list of numbers"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert told in findings(changed(tmp_path, old, new))


def test_the_last_two_mistakes_of_a_file_are_told_at_once(tmp_path: Path) -> None:
    path = written(tmp_path, CAMCHAIN.replace("radtan", "fov").replace("330.0, 330.0", "3.0, 3.0"))
    assert [line.split(":")[1] for line in findings(path).splitlines()] == ["10", "23"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "empty"),
        ("just text", "not a known calibration"),
        ("a: 1\n", "OpenCV (YAML, XML), Kalibr camchain, EuRoC sensor.yaml, KITTI calib.txt"),
        ("cam0: {camera_model: [", "not YAML"),
        ("<?xml version='1.0'?><opencv_storage><K>1</opencv_storage>", "FILE:1:"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "a document type is declared"),
        ("P0: 1 2 3 4 5 6 7 8 9 10 11 12\n", "size"),
        ("sensor_type: imu\nT_BS: {rows: 4}\n", "FILE:1:14: this describes a sensor of type 'imu'"),
    ],
)
def test_what_is_no_calibration_is_refused_with_a_reason(tmp_path: Path, text: str, told: str) -> None:
    assert told in findings(written(tmp_path, text))


def test_a_projection_that_is_none_is_told_with_line_and_column(tmp_path: Path) -> None:
    good = "P0: 707 0 601 0 0 707 183 0 0 0 1 0\n"
    path = written(tmp_path, good + "P1: 707 0 601 -380 0 x 183 0 0 0 1 0\nP2: 1 2 3\n", "calib.txt")
    with pytest.raises(InputError) as found:
        read_calibration(path, size=(1226, 370))
    reported = str(found.value).replace(str(path), "FILE")
    assert reported.splitlines() == [
        "FILE:2:22: P1: 'x' is not a number",
        "FILE:3:5: P2: 3 numbers, expected 12",
    ]
    with pytest.raises(InputError, match="outside pictures of 320 x 100"):
        read_calibration(written(tmp_path, good, "calib.txt"), size=(320, 100))


def test_coefficients_beyond_the_model_are_refused_unless_they_are_zero(tmp_path: Path) -> None:
    for last, is_good in ((0.0, True), (0.1, False)):
        eight = np.array([[-0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, last]])
        values = {"image_width": 640, "image_height": 480, "camera_matrix": MATRIX, "dist_coeffs": eight}
        path = stored(tmp_path / "camera.yml", **values)
        if is_good:
            assert read_calibration(path).camera().distortion == (-0.1, 0.02, 0.0, 0.0, 0.0)
        else:
            assert "k1, k2, p1, p2, k3" in findings(path)


def test_a_camera_is_chosen_by_name_and_a_reference_may_tell_the_axes(tmp_path: Path) -> None:
    written(tmp_path, CAMCHAIN)
    _, model = read_reference("calibration.yaml?axes=flu#cam1", tmp_path)
    assert model.lens is Lens.EQUIDISTANT
    _, labelled = read_reference("calibration.yaml?axes=flu&make=Arducam&product=OV9281&pixel_um=3#cam1", tmp_path)
    assert labelled == msgspec.structs.replace(model, make="Arducam", product="OV9281", pixel_um=3.0)
    for reference, reported in (
        ("calibration.yaml#cam3", "it has no camera 'cam3'"),
        ("calibration.yaml", "calibration.yaml#cam0"),
        ("calibration.yaml?axes=fly#cam0", "right-handed"),
        ("calibration.yaml?colour=red", "write it as"),
        ("calibration.yaml?size=big", "640x480"),
        ("calibration.yaml?pixel_um=0#cam0", "pixel_um"),
        ("nothing.yaml", "cannot be read"),
    ):
        with pytest.raises((InputError, Refused), match=reported):
            read_reference(reference, tmp_path)


@pytest.mark.parametrize(("letters", "x"), [("frd", (1, 0, 0)), ("flu", (1, 0, 0)), ("urf", (0, 0, -1)), ("lbd", None)])
def test_axes_are_told_by_letters(letters: str, x: tuple[float, float, float] | None) -> None:
    if x is None:
        with pytest.raises(Refused):
            frd_from_axes(letters)
    else:
        assert rotate(frd_from_axes(letters), (1.0, 0.0, 0.0)) == pytest.approx(x)
        assert math.hypot(*frd_from_axes(letters)) == pytest.approx(1.0)


def test_pictures_of_another_size_do_not_fit_and_the_reason_says_what_to_do() -> None:
    model = CameraModel(width=640, height=480, focal_px=(500.0, 500.0), center_px=(320.0, 240.0))
    assert misfit(model, 640, 480) == ""
    assert "set the camera to that size" in misfit(model, 320, 240)
    assert "calibrate the camera as it is used" in misfit(model, 640, 360)


# --- files that are not ours ---


@pytest.mark.outside
def test_the_calibrations_of_euroc_and_kitti_are_read() -> None:
    left, right = (read_calibration(PICTURES / f"euroc_rest/mav0/cam{n}/sensor.yaml").camera() for n in (0, 1))
    baseline_m = math.dist(left.position_frd_m, right.position_frd_m)
    assert baseline_m == pytest.approx(0.110, abs=0.001)
    # EuRoC's cameras look ahead and the body's axes become ours: forward is forward, right is right.
    assert rotate(left.frd_from_rdf, (0.0, 0.0, 1.0))[0] > 0.99
    assert rotate(left.frd_from_rdf, (1.0, 0.0, 0.0))[1] > 0.99
    assert right.position_frd_m[1] > left.position_frd_m[1]
    mono = read_calibration(PICTURES / "kitti_mono" / "calib.txt", size=(1226, 370))
    assert mono.cameras["P0"].focal_px == (707.0912, 707.0912)
    assert mono.cameras["P1"].position_frd_m[1] == pytest.approx(0.537, abs=0.001)
