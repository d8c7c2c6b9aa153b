"""The external tracker: the light is where geometry says, and gone when it is hidden, off, or out of the picture."""

from collections.abc import Callable
from math import dist

import cv2
import msgspec
import numpy as np
import pytest

from gloc3.camera.geometry import matrix, project
from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.model import Box, BrightSpot, Tracker
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.tracker import LED_FRD_M, TrackerCamera

pytestmark = pytest.mark.thorough

TruthAt = Callable[..., Truth]


def tracker_in(world: World, seed: int = 0) -> TrackerCamera:
    assert world.file.tracker is not None
    return TrackerCamera(world, world.file.tracker, rig.TRACKER, rig.TRACKER_IMAGER, seed)


def spots(picture: Image) -> list[tuple[float, float]]:
    """Middles of what is bright, weighted by how much it outshines its surroundings."""
    count, _, stats, _ = cv2.connectedComponentsWithStats((picture > 180).astype(np.uint8))
    found = []
    for left, top, width, height, _ in stats[1:count]:
        cut = picture[top - 6 : top + height + 6, left - 6 : left + width + 6].astype(float)
        cut = np.maximum(cut - np.median(cut) - 60.0, 0.0)  # welds and labels behind it are darker
        rows, columns = np.mgrid[top - 6 : top + height + 6, left - 6 : left + width + 6]
        found.append((float((cut * columns).sum() / cut.sum()), float((cut * rows).sum() / cut.sum())))
    return found


PLACES: list[tuple[Vector3, Vector3]] = [
    ((2.0, 1.0, 1.5), (0.0, 0.0, 0.0)),
    ((9.0, 5.0, 2.0), (0.2, -0.1, 1.0)),
    ((12.0, 9.0, 4.0), (0.0, 0.3, -2.0)),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
]


@pytest.mark.parametrize(("position_m", "euler_rad"), PLACES)
def test_the_light_is_seen_where_it_is_projected(position_m: Vector3, euler_rad: Vector3, truth_at: TruthAt) -> None:
    world = World.load("hold")
    tracker = tracker_in(world)
    truth = truth_at(world, position_m, euler_rad)
    ned_m = np.array(world.frame.to_ned(tracker.light_m(truth)))
    in_stand = (ned_m - tracker.position_ned_m) @ matrix(tracker.ned_from_frd)
    expected = project(rig.TRACKER, (in_stand @ matrix(rig.TRACKER.frd_from_rdf))[None])[0]
    found = spots(tracker.capture(truth).pixels)
    assert len(found) == 1
    assert dist(found[0], expected) < 0.1, "what the stand's place says is where the light is"


def test_the_light_sits_on_top_of_the_vehicle(truth_at: TruthAt) -> None:
    world = World.load("hold")
    truth = truth_at(world, (9.0, 5.0, 2.0))
    above_m = 2.0 + truth.standing_height_m - LED_FRD_M[2]
    assert tracker_in(world).light_m(truth) == pytest.approx((9.0, 5.0, above_m), abs=1e-6)


def test_no_light_is_seen_when_it_is_off_or_out_of_view(truth_at: TruthAt) -> None:
    world = World.load("hold")
    tracker = tracker_in(world)
    assert spots(tracker.capture(truth_at(world, (19.5, -1.5, 2.0))).pixels) == [], "straight below the tracker"
    tracker.is_lit = False
    assert spots(tracker.capture(truth_at(world, (9.0, 5.0, 2.0))).pixels) == []
    tracker.is_lit = True
    assert len(spots(tracker.capture(truth_at(world, (9.0, 5.0, 2.0))).pixels)) == 1, "and found again"


def test_a_box_hides_the_light_while_it_stands_in_between(truth_at: TruthAt) -> None:
    file = World.load("hold_busy").file
    stand = Tracker(position_m=(-2.5, 5.0, 2.0), look_at_m=(20.0, 5.0, 2.0))
    world = World(msgspec.structs.replace(file, tracker=stand))
    tracker = tracker_in(world)
    truth = truth_at(world, (14.0, 4.5, 2.0))
    seen = [
        len(spots(tracker.capture(msgspec.structs.replace(truth, t_s=t_s)).pixels)) for t_s in (0.0, 7.5, 15.0, 22.5)
    ]
    assert seen == [1, 0, 1, 0]


def test_a_second_light_leads_astray_while_it_is_on(truth_at: TruthAt) -> None:
    file = World.load("hold").file
    world = World(
        msgspec.structs.replace(file, lights={"torch": BrightSpot(position_m=(6.0, 9.0, 3.0), from_s=2.0, to_s=4.0)})
    )
    tracker = tracker_in(world)
    truth = truth_at(world, (9.0, 5.0, 2.0))
    seen = [len(spots(tracker.capture(msgspec.structs.replace(truth, t_s=t_s)).pixels)) for t_s in (1.0, 3.0, 5.0)]
    assert seen == [1, 2, 1]


def test_pictures_depend_on_seed_and_time_alone(truth_at: TruthAt) -> None:
    world = World.load("hold")
    truth = truth_at(world, (9.0, 5.0, 2.0))
    later = msgspec.structs.replace(truth, t_s=2.0)
    first, again, other = tracker_in(world, 1), tracker_in(world, 1), tracker_in(world, 2)
    picture = first.capture(truth).pixels
    again.capture(later)
    assert np.array_equal(again.capture(truth).pixels, picture)
    assert not np.array_equal(first.capture(later).pixels, picture)
    assert not np.array_equal(other.capture(truth).pixels, picture)


def test_a_box_in_view_of_the_tracker_is_in_its_picture(truth_at: TruthAt) -> None:
    file = World.load("hold").file
    pillar = Box(min_m=(8.0, 4.0, 0.0), max_m=(9.0, 5.0, 4.0), texture="crate")
    worlds = World(file), World(msgspec.structs.replace(file, boxes={**file.boxes, "pillar": pillar}))
    truth = truth_at(worlds[0], (2.0, 1.0, 1.5))
    first, second = (tracker_in(world).capture(truth).pixels.astype(int) for world in worlds)
    assert (np.abs(first - second) > 8).mean() > 0.002
