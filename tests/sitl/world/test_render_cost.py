"""What a picture costs, against one remap of its size in the same run: that ratio is about the same on any machine."""

import pytest
from tests.benchmarks.world import costs_ms, lap_truths, remap_ms

from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.laser import LaserScanner

pytestmark = pytest.mark.thorough

MOST_REMAPS = 9.0
"""5 ms on the machine of the bar, where a remap takes 0.55 to 0.7 ms."""


def test_a_picture_with_distortion_and_noise_costs_less_than_nine_remaps_and_a_scan_less_than_one() -> None:
    world = World.load("hold")
    truths = lap_truths(world, 24)
    unit_ms = remap_ms()
    mean_ms, _ = costs_ms(SimulatedCamera(world, *rig.CAMERAS["front_left"]).capture, truths)
    scan_ms, _ = costs_ms(LaserScanner(world, rig.LASER).scan, truths)
    assert mean_ms / unit_ms < MOST_REMAPS
    assert scan_ms / unit_ms < 1.0
