"""The `sensor.yaml` of a camera of the EuRoC data sets: lens, and `T_BS`, the body from the sensor."""

from typing import Any

from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import Document
from gloc3_onboard.calibration.lens import IN_PLACE, WrittenLens, lens_model, size_of
from gloc3_onboard.calibration.mounting import Transform, transform_of, transform_problem
from gloc3_onboard.calibration.numbers import Values

LENSES = {"radial-tangential": Lens.RADTAN, "equidistant": Lens.EQUIDISTANT, "none": Lens.PINHOLE}


def looks_like_euroc(value: Any) -> bool:
    """Whether a document is perhaps a sensor's."""
    return isinstance(value, dict) and "sensor_type" in value


def read_euroc(document: Document, frd_from_body: Transform) -> tuple[dict[str, CameraModel], Values]:
    """The camera, named *camera*, and the findings.

    Args:
        document: the file.
        frd_from_body: transform from the data set's body; EuRoC's has axes *urf*.
    """
    values = Values(document)
    kind = values.value(("sensor_type",))
    if kind not in ("camera", "visual"):
        values.wrong(("sensor_type",), f"this describes a sensor of type {kind!r}", "take the sensor.yaml of a camera")
        return {}, values
    lens_name = values.value(("distortion_model",))
    if lens_name not in LENSES:
        message = f"the lens {lens_name!r} is not supported"
        values.wrong(("distortion_model",), message, f"known: {', '.join(LENSES)}")
    intrinsics = values.numbers(("intrinsics",), (4,), "intrinsics")
    coefficients = values.numbers(("distortion_coefficients",), (0, 4, 5), "distortion_coefficients")
    resolution = values.numbers(("resolution",), (2,), "resolution")
    mount = _mount(values, frd_from_body)
    if None in (intrinsics, coefficients, resolution, mount) or lens_name not in LENSES:
        return {}, values
    size = size_of(values, ("resolution",), values.value(("resolution",)))
    if size is None or intrinsics is None or coefficients is None or mount is None:
        return {}, values
    model = lens_model(
        values,
        ("intrinsics",),
        WrittenLens(size, intrinsics, LENSES[lens_name], coefficients, ("distortion_coefficients",)),
        mount,
    )
    return ({"camera": model} if model is not None else {}), values


def _mount(values: Values, frd_from_body: Transform) -> Transform | None:
    if values.value(("T_BS",)) is None:
        return IN_PLACE
    matrix = values.matrix(("T_BS",), 4, 4, "T_BS")
    problem = transform_problem(matrix) if matrix is not None else ""
    if problem:
        values.wrong(("T_BS",), f"T_BS: {problem}")
    return None if matrix is None or problem else frd_from_body.then(transform_of(matrix))
