"""Whatever is done to a calibration file or a source: it is read, or refused with a reason; there is no other end."""

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from gloc3.errors import InputError, Refused
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.sensors.registry import parse_source, source_kinds

KALIBR = """\
cam0:
  T_cam_imu: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
"""
OPENCV = """\
%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 319.5, 0., 501., 239.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.02, 0.001, -0.002, 0.003 ]
"""
XML = """\
<?xml version="1.0"?>
<opencv_storage><image_width>640</image_width><image_height>480</image_height>
<K type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>500. 0. 319.5 0. 501. 239.5 0. 0. 1.</data></K>
<D type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt><data>-0.1 0.02 0. 0.</data></D></opencv_storage>
"""
EUROC = """\
sensor_type: camera
T_BS: {rows: 4, cols: 4, data: [0, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 1]}
resolution: [752, 480]
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]
"""
KITTI = "P0: 707 0 601 0 0 707 183 0 0 0 1 0\nP1: 707 0 601 -380 0 707 183 0 0 0 1 0\n"
FORMS = {"kalibr": KALIBR, "opencv": OPENCV, "xml": XML, "euroc": EUROC, "kitti": KITTI}
PIECES = (
    "",
    "0",
    "-1",
    "1e999",
    ".nan",
    "[",
    "]",
    "{}",
    "null",
    "text",
    "'",
    "\t",
    "\x00",
    "é",
    "&a",
    "*a",
    "</",
    "9" * 30,
)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_is_read_as_it_is(form: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text(FORMS[form])
    assert read_calibration(tmp_path / "file", size=(1226, 370)).cameras


@pytest.mark.thorough
@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 1000), st.integers(0, 30), st.sampled_from(PIECES))
def test_a_damaged_file_is_read_or_refused(form: str, tmp_path: Path, place: int, length: int, piece: str) -> None:
    text = FORMS[form]
    place %= len(text)
    (tmp_path / "file").write_text(text[:place] + piece + text[place + length :])
    with suppress(InputError):
        found = read_calibration(tmp_path / "file", size=(1226, 370))
        assert all(min(model.focal_px) > 0.0 and model.width > 0 for model in found.cameras.values())


@pytest.mark.thorough
@settings(max_examples=60)
@given(st.sampled_from(["ground_camera", "laser", "imu", "stereo_camera", "x"]), st.text(max_size=60))
@example("laser", "hokuyo://[::1:5?yaw_deg=1e400#%zz")
@example("laser", "carmen://a?max_m=%00")
def test_any_text_is_a_source_or_refused(device: str, text: str) -> None:
    for url in (text, f"v4l2://{text}", f"hokuyo://{text}", f"autopilot://{text}"):
        with suppress(Refused):
            found = parse_source(device, url)
            assert found.place or not source_kinds()[found.scheme].takes_place
