"""The components around the ground odometer and the optical follower."""

from typing import Any

import numpy as np
import pytest
from tests.onboard.messages import at, autopilot_pose, pose

from gloc3.camera.model import CameraModel
from gloc3.component.ports import PortReport, inbox_of
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import from_euler
from gloc3.messages.perception import Odometry, PositionFix
from gloc3.messages.vehicle import HeightAboveGround, Image
from gloc3_onboard.components.processors.ground_odometry import GroundOdometryProcessor, GroundOdometrySettings
from gloc3_onboard.components.processors.optical_follower import OpticalFollowerProcessor, OpticalFollowerSettings

CAMERA = CameraModel(
    width=160,
    height=120,
    focal_px=(100.0, 100.0),
    center_px=(79.5, 59.5),
    frd_from_rdf=from_euler(0.0, 0.0, np.pi / 2.0),
)
TRACKER = CameraModel(width=160, height=120, focal_px=(100.0, 100.0), center_px=(79.5, 59.5))


class Calibrated:
    """The cameras that are calibrated."""

    def model(self, camera: str) -> CameraModel | None:
        return {"ground": CAMERA, "tracker": TRACKER}.get(camera)


def picture(pixels: Any, t_s: float, camera: str = "ground") -> Envelope[Image]:
    height, width = pixels.shape
    image = Image(camera=camera, width=width, height=height, data=pixels.astype(np.uint8).tobytes())
    return at(t_s, image)


def message(result: Any) -> Any:
    assert isinstance(result, PortReport)
    return result.message


def floor() -> Any:
    import cv2

    noise = np.random.default_rng(2).uniform(0, 255, (300, 160)).astype(np.float32)
    return np.clip(128.0 + 4.0 * (cv2.GaussianBlur(noise, (0, 0), 1.5) - 127.0), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("topic", ["autopilot_pose", "autopilot_attitude"], ids=["with a position", "without one"])
def test_pictures_attitudes_and_heights_become_odometry(topic: str) -> None:
    component = GroundOdometryProcessor(Calibrated())
    component.initialize(GroundOdometrySettings())
    component.start()
    texture, found = floor(), []
    for number in range(6):
        t_s = 0.1 * number
        results = component.work(
            t_s,
            inbox_of(
                image=picture(texture[100 - 2 * number : 220 - 2 * number], t_s),
                height=at(t_s, HeightAboveGround(height_m=2.0, is_valid=True)),
                **{topic: at(t_s, autopilot_pose())},
            ),
        )
        found.append(message(results[0]))
    assert isinstance(found[-1], Odometry)
    assert found[-1].is_valid
    assert found[-1].position_m == pytest.approx((10 * 2.0 / 100.0, 0.0, 0.0), abs=0.004)
    assert component.pictures == 6
    assert component.refused == 1


def test_bad_pictures_and_missing_attitudes_are_told_and_silence_too() -> None:
    component = GroundOdometryProcessor(Calibrated())
    component.initialize(GroundOdometrySettings())
    good = picture(floor()[:120], 0.0)
    assert "no attitude" in message(component.work(0.0, inbox_of(image=good))[0]).reason
    broken = at(0.1, Image(camera="ground", width=160, height=120, data=b"1"))
    assert message(component.work(0.1, inbox_of(image=broken))[0]).reason == "the picture is torn"
    marked = at(0.2, Image(camera="ground", width=0, height=0, data=b"", is_valid=False, reason="black"))
    assert message(component.work(0.2, inbox_of(image=marked))[0]).reason == "black"
    assert component.work(0.7, inbox_of()) == []
    silent = component.work(1.3, inbox_of())[0]
    assert isinstance(silent, Odometry)
    assert silent.reason == "no picture received"


def test_a_camera_without_calibration_is_refused() -> None:
    with pytest.raises(Refused, match="no calibration of a camera 'belly'"):
        GroundOdometryProcessor(Calibrated()).initialize(GroundOdometrySettings(camera="belly"))
    with pytest.raises(Refused, match="no calibration of a camera 'mast'"):
        OpticalFollowerProcessor(Calibrated()).initialize(OpticalFollowerSettings(camera="mast"))


def fixes(height_m: float | None, down_m: float | None) -> PositionFix:
    """The fourth fix of a lamp that is seen straight ahead and 45 degrees down, 2 m below the camera."""
    component = OpticalFollowerProcessor(Calibrated())
    component.initialize(OpticalFollowerSettings(position_ned_m=(1.0, 0.0, -4.0), euler_deg=(0.0, -45.0, 0.0)))
    component.start()
    random, fix = np.random.default_rng(1), None
    for number in range(4):
        t_s = 0.1 * number
        pixels = random.uniform(0, 20, (120, 160))
        pixels[58:62, 78:82] = 255.0
        given: dict[str, Any] = {"image": picture(pixels, t_s, "tracker")}
        if height_m is not None:
            given["height"] = at(t_s, HeightAboveGround(height_m=height_m, is_valid=True))
        if down_m is not None:
            given["pose"] = at(t_s, pose(height=-down_m))
        fix = message(component.work(t_s, inbox_of(**given))[0])
    assert isinstance(fix, PositionFix)
    return fix


def test_the_lamp_is_placed_by_height_by_pose_where_a_box_is_below_and_by_direction_alone() -> None:
    there = (3.0, 0.0, -2.0)
    by_height = fixes(2.0, None)
    assert by_height.position_ned_m == pytest.approx(there, abs=0.03)
    over_a_box = fixes(1.0, -2.0)
    assert over_a_box.position_ned_m == pytest.approx(there, abs=0.03)
    alone = fixes(None, None)
    assert alone.is_valid
    assert max(alone.covariance) > 20.0 > max(by_height.covariance)
