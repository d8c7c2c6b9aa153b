"""Kalibr's camchain YAML: cameras cam0, cam1… with their lenses, the IMU's frame, and each camera from the one before.

`T_cam_imu` is `camera_from_imu`, `T_cn_cnm1` is camera n from camera n - 1, and `timeshift_cam_imu` is added to a picture's
time to have it on the IMU's clock (Kalibr's wiki, "YAML formats").
"""

import re
from typing import Any, Final

from msgspec.structs import replace

from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import Document, Where
from gloc3_onboard.calibration.lens import IN_PLACE, WrittenLens, lens_model, size_of
from gloc3_onboard.calibration.mounting import Transform, transform_of, transform_problem
from gloc3_onboard.calibration.numbers import Values

CAMERA: Final = re.compile(r"cam\d+")
LENSES: Final[dict[str, Lens]] = {"none": Lens.PINHOLE, "radtan": Lens.RADTAN, "equidistant": Lens.EQUIDISTANT}
MOST_SHIFT_S: Final = 1.0
"""Greatest offset in time that a camera can have, s."""
SPELLED: Final = {"equi": "equidistant"}
"""As the calibrator's own option says it."""


def looks_like_kalibr(value: Any) -> bool:
    """Whether a document is perhaps a camchain."""
    return isinstance(value, dict) and any(
        CAMERA.fullmatch(str(key)) and isinstance(section, dict) for key, section in value.items()
    )


def read_kalibr(document: Document, frd_from_imu: Transform) -> tuple[dict[str, CameraModel], Values]:
    """The cameras by name, and the findings.

    Args:
        document: the file.
        frd_from_imu: transform from the IMU's frame to the body.
    """
    values = Values(document)
    cameras: dict[str, CameraModel] = {}
    before: Transform | None = None
    for name in sorted((key for key in document.value if str(key).startswith("cam")), key=_number):
        mount = _mount(values, (name,), frd_from_imu, before)
        model = _camera(values, (name,), mount or IN_PLACE)
        before = mount
        shift_s = _time_shift(values, (name, "timeshift_cam_imu"))
        if model is not None and mount is not None and shift_s is not None:
            cameras[name] = replace(model, time_shift_s=shift_s)
    return cameras, values


def _number(name: str) -> tuple[int, str]:
    digits = name.removeprefix("cam")
    return (int(digits), "") if digits.isdecimal() else (1 << 30, name)


def _time_shift(values: Values, where: Where) -> float | None:
    """The offset in time, s; 0 where the file has none."""
    value = values.value(where)
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MOST_SHIFT_S:
        values.wrong(where, f"timeshift_cam_imu: {value!r} is not a time from {-MOST_SHIFT_S:g} to {MOST_SHIFT_S:g} s")
        return None
    return float(value)


def _mount(values: Values, where: Where, frd_from_imu: Transform, before: Transform | None) -> Transform | None:
    """`frd_from_rdf`: from the IMU, or from the previous camera; the first camera of a chain faces ahead."""
    is_first = where == ("cam0",)
    for key in ("T_cam_imu", "T_cn_cnm1"):
        at = (*where, key)
        if values.value(at) is None or (key == "T_cn_cnm1" and is_first):
            continue
        matrix = values.matrix(at, 4, 4, key)
        problem = transform_problem(matrix) if matrix is not None else ""
        if problem:
            values.wrong(at, f"{key}: {problem}")
        if matrix is None or problem:
            return None
        camera_from_other = transform_of(matrix)
        if key == "T_cam_imu":
            return frd_from_imu.then(camera_from_other.inverse())
        return (before or IN_PLACE).then(camera_from_other.inverse())
    if not is_first:
        values.warn(where, "neither T_cam_imu nor T_cn_cnm1: it is taken to sit where the body's origin is")
    return IN_PLACE


def _camera(values: Values, where: Where, mount: Transform) -> CameraModel | None:
    kind, lens_name = (values.value((*where, key)) for key in ("camera_model", "distortion_model"))
    lens_name = SPELLED.get(lens_name, lens_name) if isinstance(lens_name, str) else lens_name
    if kind != "pinhole":
        values.wrong((*where, "camera_model"), f"the camera model {kind!r} is not supported", "calibrate with pinhole")
        return None
    if lens_name not in LENSES:
        hint = f"calibrate with pinhole-radtan or pinhole-equi; known: {', '.join(LENSES)}"
        values.wrong((*where, "distortion_model"), f"the lens {lens_name!r} is not supported", hint)
        return None
    intrinsics = values.numbers((*where, "intrinsics"), (4,), "intrinsics")
    lens = LENSES[lens_name]
    coefficients_at = (*where, "distortion_coeffs")
    is_given = lens is not Lens.PINHOLE or values.value(coefficients_at) is not None
    coefficients = values.numbers(coefficients_at, (4, 5), "distortion_coeffs") if is_given else []
    resolution = values.numbers((*where, "resolution"), (2,), "resolution")
    if intrinsics is None or coefficients is None or resolution is None:
        return None
    size = size_of(values, (*where, "resolution"), values.value((*where, "resolution")))
    if size is None:
        return None
    return lens_model(
        values, (*where, "intrinsics"), WrittenLens(size, intrinsics, lens, coefficients, coefficients_at), mount
    )
