"""Writes calibrations into a rig file: cameras in the form of Kalibr's camchain, beside them what else was calibrated.

A file with cameras alone is a camchain that Kalibr, OpenVINS and others read: `T_cn_cnm1` is camera n from camera n - 1,
`T_cam_imu` is `camera_from_imu`, and the time of a picture on the IMU's clock is its own plus `timeshift_cam_imu`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import dump, load_bytes, parse
from gloc3.errors import Finding, InputError
from gloc3.store import replace_file
from gloc3_onboard.calibration.mounting import Transform

LENSES: Final[Mapping[Lens, str]] = {Lens.PINHOLE: "radtan", Lens.RADTAN: "radtan", Lens.EQUIDISTANT: "equidistant"}
ORDER: Final = (
    "camera_model",
    "intrinsics",
    "distortion_model",
    "distortion_coeffs",
    "resolution",
    "rostopic",
    "T_cn_cnm1",
    "T_cam_imu",
    "timeshift_cam_imu",
)
HEAD: Final = "# Calibrations by `gloc3 calibrate`. Cameras are written in the form of Kalibr's camchain.\n"


def camera_section(model: CameraModel, name: str) -> dict[str, Any]:
    """A camera's lens as a section of a camchain."""
    return {
        "camera_model": "pinhole",
        "intrinsics": [*model.focal_px, *model.center_px],
        "distortion_model": LENSES[model.lens],
        "distortion_coeffs": list(model.distortion) or [0.0] * 4,
        "resolution": [model.width, model.height],
        "rostopic": f"/{name}/image_raw",
    }


def rows_of(transform: Transform) -> list[list[float]]:
    """A transform as the four rows of its matrix."""
    turn, shift = matrix(transform.rotation).tolist(), transform.position_m
    return [*([*row, place] for row, place in zip(turn, shift, strict=True)), [0.0, 0.0, 0.0, 1.0]]


def read_sections(path: Path) -> dict[str, Any]:
    """The sections of a rig file by name; none if there is no such file.

    Raises:
        InputError: it is no rig file.
    """
    if not path.exists():
        return {}
    value = parse(load_bytes(path), str(path)).value
    if not isinstance(value, dict) or not all(isinstance(section, dict) for section in value.values()):
        hint = "its sections are cam0, cam1, laser, magnetometer"
        raise InputError([Finding(file=str(path), message="this is not a rig file", hint=hint)])
    return value


def write_sections(path: Path, sections: Mapping[str, Mapping[str, Any]], drop: Sequence[str] = ()) -> None:
    """Replaces entries of a rig file's sections; other entries and sections stay.

    Args:
        path: the file; written whole, or not at all.
        sections: the entries of each section that is written.
        drop: entries that do not hold any longer in the sections that are written.

    Raises:
        InputError: there is a file that is no rig file.
    """
    whole = read_sections(path)
    for name, section in sections.items():
        merged = {key: value for key, value in whole.get(name, {}).items() if key not in drop} | dict(section)
        whole[name] = {key: merged[key] for key in (*ORDER, *merged) if key in merged}
    replace_file(path, (HEAD + dump(whole)).encode())
