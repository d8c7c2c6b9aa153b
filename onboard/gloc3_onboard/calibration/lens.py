"""Makes a camera model from the values of a calibration file, and reports impossible ones."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import Where
from gloc3_onboard.calibration.mounting import FORWARD, Transform
from gloc3_onboard.calibration.numbers import Values

PIXELS: Final = (16, 16_384)
NARROWEST_DEG: Final = 2.0
WIDEST_DEG: Final = 170.0
"""Of a lens that is described by a plane: beyond, it is a fisheye."""
WIDEST_FISHEYE_DEG: Final = 300.0
MOST_ASPECT: Final = 1.5
"""Between the two focal lengths; pixels are square, or nearly."""
FAR_OFF: Final = 0.3
"""Share of the picture by which the optical axis may miss its middle before that is doubtful."""
COUNTS: Final[dict[Lens, tuple[int, ...]]] = {Lens.PINHOLE: (0,), Lens.RADTAN: (4, 5), Lens.EQUIDISTANT: (4,)}
IN_PLACE: Final = Transform((0.0, 0.0, 0.0), FORWARD)


def size_of(values: Values, where: Where, size: Sequence[object]) -> tuple[int, int] | None:
    """Width and height of the pictures, checked."""
    low, high = PIXELS
    if len(size) != 2 or not all(isinstance(n, int) and not isinstance(n, bool) and low <= n <= high for n in size):
        values.wrong(where, f"a picture of {' x '.join(map(str, size))} pixels", f"from {low} to {high} each way")
        return None
    return int(str(size[0])), int(str(size[1]))


class WrittenLens(NamedTuple):
    """A lens as a calibration file describes it."""

    size: tuple[int, int]
    """Width and height of its pictures."""
    intrinsics: Sequence[float]
    """Focal lengths along columns and rows, then column and row of the optical axis."""
    lens: Lens
    """As the file names it."""
    coefficients: Sequence[float]
    """Zeros at the end that the model does not have are left out."""
    coefficients_at: Where
    """Location of the coefficients in the file."""


def lens_model(values: Values, where: Where, written: WrittenLens, mount: Transform = IN_PLACE) -> CameraModel | None:
    """The model, or None with findings.

    Args:
        values: collects the findings.
        where: location of the intrinsics in the file.
        written: the file's values.
        mount: `frd_from_rdf`.
    """
    before = len(values.findings)
    size, (fx, fy, cx, cy), lens, coefficients, coefficients_at = written
    kept = _fitting(values, coefficients_at, lens, coefficients)
    _check_focal(values, where, size, (fx, fy), lens)
    if not (0.0 <= cx <= size[0] and 0.0 <= cy <= size[1]):
        message = f"the optical axis at {cx:g}, {cy:g} is outside the picture of {size[0]} x {size[1]}"
        values.wrong(where, message, "was it calibrated for another size?")
    elif abs(cx / size[0] - 0.5) > FAR_OFF or abs(cy / size[1] - 0.5) > FAR_OFF:
        message = f"the optical axis at {cx:g}, {cy:g} is far from the middle of {size[0]} x {size[1]}"
        values.warn(where, message, "was the picture cut after the calibration?")
    if any(not finding.is_warning for finding in values.findings[before:]):
        return None
    model = CameraModel(
        width=size[0],
        height=size[1],
        focal_px=(fx, fy),
        center_px=(cx, cy),
        lens=lens if any(kept) or lens is Lens.EQUIDISTANT else Lens.PINHOLE,
        distortion=kept if any(kept) or lens is Lens.EQUIDISTANT else (),
        position_frd_m=mount.position_m,
        frd_from_rdf=mount.rotation,
    )
    if not shows_its_corners(model):
        message = f"the lens {lens} with these coefficients cannot show the corners of {size[0]} x {size[1]}"
        values.wrong(coefficients_at, message, "calibrate with the target in the corners, too")
        return None
    return model


def _fitting(values: Values, where: Where, lens: Lens, coefficients: Sequence[float]) -> tuple[float, ...]:
    """The coefficients that the model takes."""
    counts = COUNTS[lens]
    kept = list(coefficients)
    while len(kept) > max(counts) and kept[-1] == 0.0:
        kept.pop()
    if len(kept) > max(counts) and lens is Lens.RADTAN:
        message = f"{len(coefficients)} coefficients: the rational, prism and tilted models are not supported"
        values.wrong(where, message, "calibrate with k1, k2, p1, p2, k3")
    elif len(kept) not in counts and any(kept):
        wanted = " or ".join(map(str, counts))
        values.wrong(where, f"{len(coefficients)} coefficients, and the lens {lens} has {wanted}")
    return tuple(kept)


def _check_focal(
    values: Values, where: Where, size: tuple[int, int], focal_px: tuple[float, float], lens: Lens
) -> None:
    """Fields of view that no lens has, and pixels that no sensor has."""
    if min(focal_px) <= 0.0:
        values.wrong(where, f"focal lengths {focal_px[0]:g} and {focal_px[1]:g}", "both are above 0 pixels")
        return
    is_fisheye = lens is Lens.EQUIDISTANT
    half = 0.5 * size[0] / focal_px[0]
    field_deg = 2.0 * math.degrees(half if is_fisheye else math.atan(half))
    widest_deg = WIDEST_FISHEYE_DEG if is_fisheye else WIDEST_DEG
    if not NARROWEST_DEG <= field_deg <= widest_deg:
        message = f"a focal length of {focal_px[0]:g} pixels is a field of view of {field_deg:.1f} degrees"
        values.wrong(where, message, f"from {NARROWEST_DEG:g} to {widest_deg:g} can be; is it in pixels of this size?")
    aspect = max(focal_px) / min(focal_px)
    if aspect > MOST_ASPECT:
        values.wrong(where, f"focal lengths {focal_px[0]:g} and {focal_px[1]:g} differ by {aspect:.2f} times")


def shows_its_corners(model: CameraModel) -> bool:
    """Whether every corner of the picture is a direction: a polynomial that fits only the middle turns back."""
    if model.lens is Lens.PINHOLE:
        return True
    import numpy as np

    from gloc3.camera.geometry import unproject

    right, bottom = model.width - 1.0, model.height - 1.0
    corners = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
    if model.lens is Lens.EQUIDISTANT:  # the corners of a fisheye may be behind the camera, or never lit
        corners = (corners + np.array(model.center_px)) / 2.0
    with np.errstate(all="ignore"):
        return bool(np.isfinite(unproject(model, corners)).all())
