"""Writes calibrations into a rig file: cameras in the form of Kalibr's camchain, beside them what else was calibrated.

A file with cameras alone is a camchain that Kalibr, OpenVINS and others read: `T_cn_cnm1` is camera n from camera n - 1,
`T_cam_imu` is `camera_from_imu`, and the time of a picture on the IMU's clock is its own plus `timeshift_cam_imu`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import dump, load_bytes, parse
from gloc3.errors import Finding, InputError
from gloc3.store import replace_file
from gloc3_onboard.calibration.mounting import Transform, transform_of, transform_problem

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


def transform_in(section: Mapping[str, Any], key: str) -> Transform | None:
    """A transform of a section; None where there is none that moves a rigid body."""
    try:
        rows = [list(row) for row in msgspec.convert(section.get(key), list[tuple[float, float, float, float]])]
    except msgspec.ValidationError:
        return None
    return transform_of(rows) if len(rows) == 4 and not transform_problem(rows) else None


def chain_from_imu(
    sections: Mapping[str, Mapping[str, Any]], camera: str, camera_from_imu: Transform
) -> dict[str, Transform]:
    """`T_cam_imu` of a camera and of all that `T_cn_cnm1` connects with it, on both sides of the chain.

    Args:
        sections: of the rig file.
        camera: the camera of which it is known.
        camera_from_imu: of that camera.
    """
    found, digits = {camera: camera_from_imu}, camera.removeprefix("cam")
    if not digits.isdecimal():
        return found
    number, after = int(digits) + 1, camera_from_imu
    while (step := transform_in(sections.get(f"cam{number}", {}), "T_cn_cnm1")) is not None:
        after = found[f"cam{number}"] = step.then(after)
        number += 1
    number, before = int(digits), camera_from_imu
    while number and f"cam{number - 1}" in sections:
        step = transform_in(sections.get(f"cam{number}", {}), "T_cn_cnm1")
        if step is None:
            break
        number -= 1
        before = found[f"cam{number}"] = step.inverse().then(before)
    return found


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
