"""Costs of the ground odometer, the optical follower and the coverage of a wall, in processor time."""

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from tests.evidence.ground import SETTINGS
from tests.evidence.ground_flight import fly, motion, truths
from tests.evidence.tracker import follower_in, tracker_in

from gloc3.camera.wall_coverage import CoverageLimits, Wall, WallView, cover
from gloc3_onboard.algorithms.vision.ground_odometer import GroundOdometer
from gloc3_sitl.world.rig import FRONT_LEFT, GROUND
from gloc3_sitl.world.world import World

WAY = ((3.0, 0.2, 2.0), (3.0, 1.0, 2.2), (7.0, 1.0, 2.2))
WARMED_UP = 5
BAR_MS = 3.0


def costs_ms(works: Sequence[Callable[[], object]]) -> list[float]:
    """Processor time of each piece of work, once warmed up."""
    found = []
    for work in works:
        begin_s = time.thread_time()
        work()
        found.append(1e3 * (time.thread_time() - begin_s))
    return found[WARMED_UP:]


def ground() -> list[float]:
    """Each picture of a short flight over the hold's floor."""
    flown = list(fly(1, World.load("hold"), motion(1, WAY)))
    odometer = GroundOdometer(GROUND, SETTINGS)
    return costs_ms([partial(odometer.update, s.picture, s.t_s, s.ned_from_frd, s.range_m) for s in flown])


def tracker() -> list[float]:
    """Each picture of the tracker."""
    world = World.load("hold")
    camera = tracker_in(world, 1)
    follower = follower_in(camera)
    pictures = [(truth.t_s, camera.capture(truth).pixels) for truth in truths(world, motion(1, WAY))]
    return costs_ms([partial(follower.update, picture, t_s, -2.2, 0.05) for t_s, picture in pictures])


def coverage() -> list[float]:
    """A wall of 20 by 6 m on cells of 0.1 m, seen in 100 pictures."""
    wall = Wall((10.0, -10.0, -6.0), (0.0, 20.0, 0.0), (0.0, 0.0, 6.0))
    views = [WallView("front", (7.0, -9.0 + 0.18 * i, -3.0), (1.0, 0.0, 0.0, 0.0)) for i in range(100)]
    return costs_ms([partial(cover, wall, views, {"front": FRONT_LEFT}, CoverageLimits())] * (WARMED_UP + 3))


def run() -> list[str]:
    """The costs."""
    lines = []
    for name, work, bar in (
        ("ground odometry, a picture of 640 x 480", ground, f"   bar {BAR_MS:g} ms"),
        ("optical follower, a picture of 640 x 480", tracker, ""),
        ("coverage of a wall by 100 pictures", coverage, ""),
    ):
        found = work()
        lines.append(f"{name:<42} mean {np.mean(found):6.2f} ms   worst {max(found):6.2f} ms{bar}")
    return lines
