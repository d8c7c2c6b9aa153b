"""What makes the world hard, each measured in pictures: lamps, dust, blur, exposure, repetition, bareness, motion."""

from collections.abc import Callable

import cv2
import msgspec
import numpy as np
import pytest

from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.model import CameraExposure, Dust, Lamp, Lighting

from .pictures import CLEAN, shift_px, with_hold

pytestmark = pytest.mark.thorough

TruthAt = Callable[..., Truth]
AHEAD = msgspec.structs.replace(rig.GROUND, frd_from_rdf=(0.5, 0.5, 0.5, 0.5))
LAMP = Lamp(position_frd_m=(0.0, 0.0, 0.07), strength=8.0, beam_deg=90.0)


def middle(world: World, truth: Truth, half: int = 12) -> float:
    """Mean grey value in the middle of a picture ahead."""
    picture = SimulatedCamera(world, AHEAD, CLEAN).capture(truth).pixels
    return float(picture[240 - half : 240 + half, 320 - half : 320 + half].mean())


def bare_walls() -> dict[str, object]:
    """All surfaces with one even coat of paint."""
    textures = World.load("hold").file.textures
    even = {
        name: msgspec.structs.replace(texture, contrast=0.0, seam_m=0.0, ribs_m=0.0, rust=0.0)
        for name, texture in textures.items()
    }
    return {
        "textures": {
            name: msgspec.structs.replace(texture, grain=0.0, speckles_per_m2=0.0, label="", brightness=120.0)
            for name, texture in even.items()
        }
    }


def test_a_lamp_fades_with_the_square_of_the_distance_and_beside_its_beam(truth_at: TruthAt) -> None:
    world = with_hold(lighting=Lighting(ambient=0.0, lamps=(LAMP,)), **bare_walls())
    near, far = (middle(world, truth_at(world, (21.0 - d, 5.0, 4.0))) for d in (3.0, 6.0))
    assert near == pytest.approx(120.0 * 8.0 / 9.0, rel=0.03)
    assert far == pytest.approx(near / 4.0, rel=0.05)
    picture = SimulatedCamera(world, AHEAD, CLEAN).capture(truth_at(world, (18.0, 5.0, 4.0))).pixels
    tangent = 200.0 / 400.0
    cosine = 1.0 / np.sqrt(1.0 + tangent**2)
    beside = float(picture[230:250, 510:530].mean())
    assert beside == pytest.approx(near * cosine**2 * cosine * cosine**2, rel=0.06), "beam of 90 degrees: power 2"


def test_an_automatic_exposure_keeps_pictures_usable_where_the_lamp_alone_would_not(truth_at: TruthAt) -> None:
    lighting = Lighting(ambient=0.0, lamps=(LAMP,))
    fixed = with_hold(lighting=lighting, **bare_walls())
    metered = with_hold(lighting=lighting, exposure=CameraExposure(is_automatic=True), **bare_walls())
    truths = [truth_at(fixed, (21.0 - d, 5.0, 4.0)) for d in (2.0, 8.0)]
    bright, dark = (SimulatedCamera(fixed, AHEAD, CLEAN).capture(truth).pixels.mean() for truth in truths)
    first, second = (SimulatedCamera(metered, AHEAD, CLEAN).capture(truth).pixels.mean() for truth in truths)
    assert bright > 5.0 * dark
    assert first < 1.5 * second
    assert 60.0 < second < 180.0


def test_haze_takes_contrast_by_the_metre(truth_at: TruthAt) -> None:
    clear = with_hold(lighting=Lighting(ambient=1.0))
    hazy = with_hold(lighting=Lighting(ambient=1.0), dust=Dust(haze_per_m=0.05, haze_grey=60.0))
    truth = truth_at(clear, (15.0, 5.0, 5.0))
    cut = np.s_[200:280, 280:360]
    first, second = (
        SimulatedCamera(world, AHEAD, CLEAN).capture(truth).pixels[cut].astype(float) for world in (clear, hazy)
    )
    assert second.std() / first.std() == pytest.approx(0.95**6, rel=0.04)
    assert second.mean() == pytest.approx(first.mean() * 0.95**6 + 60.0 * (1.0 - 0.95**6), rel=0.04)


def test_grains_float_before_the_camera_and_do_not_move_with_the_wall(truth_at: TruthAt) -> None:
    clear, dusty = with_hold(), with_hold(dust=Dust(grains_per_m3=10.0))
    truth = truth_at(clear, (17.0, 5.0, 5.0))
    moments = [truth, msgspec.structs.replace(truth, t_s=truth.t_s + 1.0)]
    still = [SimulatedCamera(clear, AHEAD, CLEAN).capture(moment).pixels.astype(int) for moment in moments]
    dust = [SimulatedCamera(dusty, AHEAD, CLEAN).capture(moment).pixels.astype(int) for moment in moments]
    assert np.array_equal(still[0], still[1])
    spots = [cv2.connectedComponents(((a - b) > 5).astype(np.uint8))[0] - 1 for a, b in zip(dust, still, strict=True)]
    assert min(spots) >= 8
    assert not np.array_equal(dust[0], dust[1]), "they drift"
    assert min((a - b).min() for a, b in zip(dust, still, strict=True)) >= 0, "they only add light"


def test_a_long_exposure_smears_along_the_motion_and_not_across(truth_at: TruthAt) -> None:
    sharp, smeared = with_hold(), with_hold(exposure=CameraExposure(time_s=0.03))
    truth = truth_at(sharp, (5.0, 5.0, 2.0))
    moving = msgspec.structs.replace(truth, velocity_ned_m_s=(1.5, 0.0, 0.0))
    pictures = [
        SimulatedCamera(world, rig.GROUND, CLEAN).capture(state).pixels.astype(float)
        for world, state in ((sharp, moving), (smeared, moving), (smeared, truth))
    ]
    across = [np.abs(np.diff(picture, axis=1)).mean() for picture in pictures]
    along = [np.abs(np.diff(picture, axis=0)).mean() for picture in pictures]
    assert along[1] < 0.5 * along[0]
    assert across[1] / across[0] > 1.5 * along[1] / along[0]
    assert np.array_equal(pictures[0], pictures[2]), "who stands still is not smeared"
    assert shift_px(pictures[0], pictures[1]) == pytest.approx((0.0, 0.0), abs=0.1), "the time is that of the middle"


def test_the_exposure_jumps_for_all_cameras_at_once_and_stays_for_a_while(truth_at: TruthAt) -> None:
    world = with_hold(exposure=CameraExposure(jump=2.0, jump_every_s=2.0), **bare_walls())
    truth = truth_at(world, (5.0, 5.0, 4.0))
    cameras = [
        SimulatedCamera(world, model, imager, 3) for model, imager in (rig.CAMERAS["front_left"], rig.CAMERAS["ground"])
    ]
    greys = [
        [
            float(camera.capture(msgspec.structs.replace(truth, t_s=t_s)).pixels[100:380].mean())
            for t_s in np.arange(0.1, 24.0, 0.5)
        ]
        for camera in cameras
    ]
    first, second = (np.array(line) / line[0] for line in greys)
    assert first == pytest.approx(second, rel=0.02)
    assert first[:4] == pytest.approx(np.ones(4), rel=0.01), "nothing happens within two seconds"
    assert first.max() / first.min() > 1.4
    assert first.max() / first.min() <= 4.0 + 0.1


def test_the_hard_hold_has_a_bare_wall_and_plates_that_look_alike(truth_at: TruthAt) -> None:
    world = World.load("hold_hard")
    bare = SimulatedCamera(world, AHEAD, CLEAN).capture(truth_at(world, (19.0, 5.0, 6.0))).pixels
    busy = SimulatedCamera(world, AHEAD, CLEAN).capture(truth_at(world, (5.0, 11.0, 6.0), (0.0, 0.0, -1.57))).pixels
    fine = [np.abs(cv2.Laplacian(picture, cv2.CV_32F)[100:380, 100:540]).mean() for picture in (bare, busy)]
    assert fine[0] < 0.25 * fine[1]
    calm = World(msgspec.structs.replace(world.file, dust=Dust(), lighting=Lighting(), exposure=CameraExposure()))
    camera = SimulatedCamera(calm, rig.GROUND, CLEAN)
    here, there, beside = (
        camera.capture(truth_at(calm, (x_m, 5.0, 2.0))).pixels.astype(float) for x_m in (4.0, 6.0, 5.0)
    )
    assert np.abs(here - there).mean() < 1.0, "two metres further all is the same again"
    assert np.abs(here - beside).mean() > 10.0


def test_a_box_that_moves_is_seen_and_scanned_where_it_is(truth_at: TruthAt) -> None:
    from gloc3_sitl.world.laser import LaserScanner

    world = World.load("hold_busy")
    camera = SimulatedCamera(world, AHEAD, CLEAN)
    scanner = LaserScanner(world, rig.LASER)
    pictures, ranges = [], []
    for t_s in (0.0, 5.0):
        truth = msgspec.structs.replace(truth_at(world, (5.0, 7.6, 1.5)), t_s=t_s)
        pictures.append(camera.capture(truth).pixels.astype(int))
        ranges.append(scanner.true_ranges_m(truth)[180])
    assert ranges == pytest.approx([3.0, 16.0], abs=1e-6)
    middles = [camera.project(truth, (8.0, y_m, 1.5)) for y_m in (7.0, 8.2)]
    assert None not in middles
    changed = np.abs(pictures[0] - pictures[1]) > 12
    left, right = (round(place[0]) for place in reversed(middles) if place is not None)
    assert changed[140:340, left + 5 : right - 5].mean() > 0.5
    assert changed[140:340, right + 10 :].mean() > 0.1, "it went to the right"
    assert changed[140:340, : left - 10].mean() == 0.0


def test_a_flight_through_the_hard_hold_always_has_something_to_see(truth_at: TruthAt) -> None:
    world = World.load("hold_hard")
    camera = SimulatedCamera(world, *rig.CAMERAS["front_left"])
    for number in range(12):
        truth = truth_at(world, (2.0 + 1.2 * number, 1.0 + 0.6 * number, 1.5), (0.0, 0.0, 0.5 * number))
        picture = camera.capture(msgspec.structs.replace(truth, t_s=0.7 * number)).pixels
        assert 15.0 < picture.mean() < 230.0
        assert (picture == 255).mean() < 0.5
