"""What is nearer hides what is farther, at any place and time, and no pixel of a closed room is left out."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, unproject
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.geometry import Geometry
from gloc3_sitl.world.model import Box, Lighting, Texture, WorldSurface

from .pictures import CLEAN

pytestmark = pytest.mark.thorough

TruthAt = Callable[..., Truth]
Floats = NDArray[np.float64]
ROOMS = {"hold_busy": ((-2.5, -2.5, 0.3), (20.5, 12.5, 9.5)), "tank": ((-1.5, -1.2, 0.8), (13.5, 6.3, 5.5))}


def in_one_grey_each(name: str) -> tuple[World, list[tuple[int, WorldSurface | Box]]]:
    """A world with every surface and box in a grey of its own."""
    file = World.load(name).file
    things: list[tuple[str, WorldSurface | Box]] = [*file.surfaces.items(), *file.boxes.items()]
    greys = {thing: 20 + 10 * number for number, (thing, _) in enumerate(things)}
    textures = {
        thing: Texture(size_m=(4.0, 4.0), resolution_px_m=16, contrast=0.0, brightness=grey)
        for thing, grey in greys.items()
    }
    surfaces = {thing: msgspec.structs.replace(row, texture=thing) for thing, row in file.surfaces.items()}
    boxes = {thing: msgspec.structs.replace(row, texture=thing) for thing, row in file.boxes.items()}
    plain = msgspec.structs.replace(
        file, textures=textures, surfaces=surfaces, boxes=boxes, marker=None, lighting=Lighting()
    )
    return World(plain), [(greys[thing], row) for thing, row in things]


def nearest(things: list[tuple[int, WorldSurface | Box]], eye: Floats, looks: Floats, t_s: float) -> NDArray[np.int64]:
    """The grey of what each ray meets first."""
    alone = [Geometry([row], []) if isinstance(row, WorldSurface) else Geometry([], [row]) for _, row in things]
    reach = np.array([geometry.ranges(eye, looks, t_s) for geometry in alone])
    greys = np.array([grey for grey, _ in things])
    return np.asarray(greys[reach.argmin(axis=0)], np.int64)


@pytest.mark.parametrize("name", ROOMS)
def test_every_pixel_shows_what_its_ray_meets_first(name: str, truth_at: TruthAt) -> None:
    world, things = in_one_grey_each(name)
    camera = SimulatedCamera(world, rig.FRONT_LEFT, CLEAN)
    random = np.random.default_rng(7)
    low, high = ROOMS[name]
    for _ in range(40):
        place = random.uniform(low, high)
        if world.geometry.clearance_m((place[0], place[1], place[2]), 0.0) < 0.3:
            continue
        euler = (random.uniform(-0.5, 0.5), random.uniform(-0.8, 0.8), random.uniform(-3.1, 3.1))
        truth = msgspec.structs.replace(truth_at(world, tuple(place), euler), t_s=float(random.uniform(0.0, 30.0)))
        picture = camera.capture(truth).pixels
        assert np.count_nonzero(picture == 0) == 0, (place, euler, truth.t_s)
        columns, rows = random.integers(0, 640, 800), random.integers(0, 480, 800)
        flat = unproject(camera.model, np.column_stack([columns, rows]).astype(float))
        local_from_rdf, eye = camera.pose(truth)
        views = np.column_stack([flat, np.ones(len(flat))]) @ matrix(local_from_rdf).T
        views /= np.linalg.norm(views, axis=1, keepdims=True)
        expected = nearest(things, np.array(eye), views, truth.t_s)
        wrong = np.abs(picture[rows, columns].astype(int) - expected) > 1
        assert wrong.mean() < 0.02, f"{wrong.mean():.1%} of the pixels at {place}, {euler}, {truth.t_s}"


def test_nothing_breaks_where_no_vehicle_should_be(truth_at: TruthAt) -> None:
    world = World.load("hold_hard")
    cameras = [SimulatedCamera(world, *rig.CAMERAS[name]) for name in ("front_left", "ground")]
    places = [
        (21.0, 5.0, 3.0),
        (20.999, 5.0, 0.01),
        (15.0, 12.0, 1.0),
        (40.0, 40.0, 30.0),
        (5.0, 5.0, -2.0),
        (5.0, 5.0, 10.0),
    ]
    for place in places:
        for yaw in (0.0, 1.0, 3.0):
            truth = truth_at(world, place, (0.3, -0.4, yaw))
            for camera in cameras:
                assert camera.capture(truth).pixels.shape == (480, 640)
