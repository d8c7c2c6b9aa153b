"""Camera model: lens, image size and mount on the vehicle, for simulated and real cameras."""

from enum import StrEnum
from typing import Annotated

import msgspec

from gloc3.messages.frames import Quaternion, Vector3

Pixels = Annotated[int, msgspec.Meta(ge=16, le=16384)]
Focal = Annotated[float, msgspec.Meta(gt=0.0, le=1e5)]


class Lens(StrEnum):
    """Distortion model of a lens."""

    PINHOLE = "pinhole"
    """Not at all."""
    RADTAN = "radtan"
    """Radial and tangential: k1, k2, p1, p2 and optionally k3 (OpenCV's five-parameter model)."""
    EQUIDISTANT = "equidistant"
    """A fisheye: k1 to k4 (Kannala and Brandt, 2006; OpenCV's `fisheye`)."""


class CameraModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One camera. Pixel centres have whole coordinates; camera axes are *rdf*: right, down, forward."""

    width: Pixels
    """Columns."""
    height: Pixels
    """Rows."""
    focal_px: tuple[Focal, Focal]
    """Focal lengths along columns and rows."""
    center_px: tuple[float, float]
    """Column and row at which the optical axis meets the picture."""
    lens: Lens = Lens.PINHOLE
    distortion: tuple[float, ...] = ()
    """Coefficients of the lens."""
    position_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Optical centre in the body frame."""
    frd_from_rdf: Quaternion = (0.5, 0.5, 0.5, 0.5)
    """Rotation from camera axes to body axes; (0.5, 0.5, 0.5, 0.5) looks ahead."""
    time_shift_s: Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)] = 0.0
    """Added to the time at which the source stamps a picture, it gives the time on the inertial unit's clock, s."""
    make: Annotated[str, msgspec.Meta(max_length=60)] = ""
    """The camera's manufacturer, for the pictures' EXIF."""
    product: Annotated[str, msgspec.Meta(max_length=60)] = ""
    """The manufacturer's name of the camera and lens, likewise."""
    pixel_um: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None
    """Side of a pixel on the sensor, by which EXIF gives the focal length in millimetres; None if unknown."""


def misfit(model: CameraModel, width: int, height: int) -> str:
    """Why a calibration is not of pictures of this size; empty if it is."""
    if (width, height) == (model.width, model.height):
        return ""
    wanted = f"the calibration is for {model.width} x {model.height}"
    if width * model.height == height * model.width:
        return f"the pictures are {width} x {height}, {wanted}: the same shape; set the camera to that size"
    return f"the pictures are {width} x {height}, {wanted}: calibrate the camera as it is used"
