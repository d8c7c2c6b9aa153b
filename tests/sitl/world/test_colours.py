"""Pictures in colour: rust is rust-coloured, the grey values stay as they are, and every lens has both in the same place."""

from collections.abc import Callable
from math import pi

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from gloc3.camera.model import CameraModel, Lens
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.imager import Photo
from gloc3_sitl.world.texture import painted, tint_of

FISHEYE = CameraModel(
    width=321, height=241, focal_px=(90.0, 90.0), center_px=(160.0, 120.0), lens=Lens.EQUIDISTANT, distortion=(0.0,) * 4
)


def photo(truth: Truth, model: CameraModel, *, is_coloured: bool, world: str = "hold") -> Photo:
    camera = SimulatedCamera(World.load(world), model, replace(rig.FRONT_LEFT_IMAGER, noise_grey=0.0), 1)
    camera.is_coloured = is_coloured
    return camera.capture(truth)


def test_one_of_the_last_pictures_gets_the_same_colours_afterwards(truth_at: Callable[..., Truth]) -> None:
    world = World.load("hold_hard")  # with an exposure of some length
    moving = replace(
        truth_at(world, (6.0, 8.0, 3.0), (0.05, 0.1, -pi / 2.0)), velocity_ned_m_s=(1.0, 0.5, 0.0), t_s=2.0
    )
    at_once = photo(moving, rig.FRONT_LEFT, is_coloured=True, world="hold_hard")
    camera = SimulatedCamera(world, rig.FRONT_LEFT, replace(rig.FRONT_LEFT_IMAGER, noise_grey=0.0), 1)
    taken = camera.capture(moving)
    data = taken.pixels.tobytes()
    camera.keep(data, moving)
    afterwards = camera.coloured(data)
    assert taken.bgr is None
    assert afterwards is not None
    assert at_once.bgr is not None
    assert np.array_equal(afterwards, at_once.bgr)
    assert camera.coloured(at_once.pixels.tobytes()) is None, "the bytes of no picture that was kept"


@pytest.mark.parametrize("model", [rig.GROUND, rig.FRONT_LEFT, FISHEYE])
def test_grey_values_are_those_of_a_grey_camera_and_the_colours_have_them_as_brightness(
    model: CameraModel, truth_at: Callable[..., Truth]
) -> None:
    truth = truth_at(World.load("hold"), (6.0, 8.0, 3.0), (0.05, 0.1, -pi / 2.0))
    grey, coloured = (photo(truth, model, is_coloured=is_coloured) for is_coloured in (False, True))
    assert grey.bgr is None
    assert coloured.bgr is not None
    assert np.array_equal(grey.pixels, coloured.pixels)
    assert coloured.bgr.shape == (model.height, model.width, 3)
    luma = cv2.cvtColor(coloured.bgr, cv2.COLOR_BGR2GRAY).astype(int)
    away = np.abs(luma - grey.pixels)
    assert away[grey.pixels < 170].max() <= 2
    assert away.mean() < 0.5


def test_rust_is_red_where_the_texture_has_rust_and_paint_has_its_colour(truth_at: Callable[..., Truth]) -> None:
    world = World.load("hold")
    truth = truth_at(world, (6.0, 9.0, 4.0), (0.0, 0.0, -pi / 2.0))
    bgr = photo(truth, rig.FRONT_LEFT, is_coloured=True).bgr
    assert bgr is not None
    upper = bgr[:240].astype(float)
    redness = upper[:, :, 2] / np.maximum(upper[:, :, 0], 1.0)
    rusty = (redness > 2.0).mean()
    assert 0.05 < rusty < 0.4, "the side's texture is rusty on a fifth of its area, with streaks below"
    assert (redness < 0.95).mean() > 0.4, "the paint is a bluish grey"
    texture = world.file.textures["side"]
    rust, tint = painted(texture).rust, tint_of(texture)
    assert tint[rust == 0].tolist()[:1] == [[142, 130, 118]]
    assert (tint[rust == 255][:, 2] > 180).all()


def test_a_texture_without_a_colour_is_grey(truth_at: Callable[..., Truth]) -> None:
    bare = replace(World.load("hold").file.textures["crate"], colour=(128.0, 128.0, 128.0), rust=0.0)
    assert set(tint_of(bare).ravel().tolist()) == {128}
