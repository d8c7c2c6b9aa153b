"""Whether a calibration fits the pictures that come: known only once there is one."""

from gloc3.camera.model import CameraModel


def misfit(model: CameraModel, width: int, height: int) -> str:
    """Why a calibration is not of pictures of this size; empty if it is."""
    if (width, height) == (model.width, model.height):
        return ""
    wanted = f"the calibration is for {model.width} x {model.height}"
    if width * model.height == height * model.width:
        return f"the pictures are {width} x {height}, {wanted}: the same shape; set the camera to that size"
    return f"the pictures are {width} x {height}, {wanted}: calibrate the camera as it is used"
