"""The height sensor's beam: level floors, slopes, boxes and tilt, as it is worked out by hand."""

from collections.abc import Callable
from math import cos, inf, tan

import msgspec
import pytest

from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.range_finder import HeightSensor, level_ground
from gloc3_sitl.world import World
from gloc3_sitl.world.probe import WorldProbe

TruthAt = Callable[..., Truth]
HOLD = World.load("hold")
CENTER_M = 0.0973


def test_over_a_level_floor_it_is_what_level_ground_gives(truth_at: TruthAt) -> None:
    probe = WorldProbe(HOLD)
    for euler in ((0.0, 0.0, 0.0), (0.2, -0.1, 1.0), (-0.3, 0.3, -2.0)):
        truth = truth_at(HOLD, (8.0, 4.0, 2.0), euler)
        assert probe(truth, 0.05) == pytest.approx(level_ground(truth, 0.05), abs=1e-6)


def test_over_a_slope_it_is_the_distance_to_the_slope_also_when_tilted(truth_at: TruthAt) -> None:
    """The slope rises by 1.2 m on 0.9 m to the left wall; it begins at y = 12.1."""
    probe = WorldProbe(HOLD)
    assert probe(truth_at(HOLD, (8.0, 12.4, 3.0)), 0.0) == pytest.approx(3.0 + CENTER_M - 0.4, abs=1e-6)
    roll = 0.1
    met = probe(truth_at(HOLD, (8.0, 12.4, 3.0), (roll, 0.0, 0.0)), 0.0)
    aside_m, rise = met * cos(roll) * tan(roll), 1.2 / 0.9
    assert 3.0 + CENTER_M - met * cos(roll) == pytest.approx(rise * (12.4 + aside_m - 12.1), abs=1e-6)


def test_over_a_box_it_is_the_distance_to_its_top_and_where_there_is_nothing_none(truth_at: TruthAt) -> None:
    probe = WorldProbe(HOLD)
    assert probe(truth_at(HOLD, (16.0, 12.0, 4.0)), 0.0) == pytest.approx(1.5 + CENTER_M, abs=1e-6)
    bare = World(msgspec.structs.replace(HOLD.file, surfaces={}, boxes={}))
    assert WorldProbe(bare)(truth_at(bare, (8.0, 4.0, 2.0)), 0.0) == inf


def test_a_box_that_passes_below_is_felt(truth_at: TruthAt) -> None:
    busy = World.load("hold_busy")
    truth = truth_at(busy, (8.5, 7.5, 5.0))
    heights = [WorldProbe(busy)(msgspec.structs.replace(truth, t_s=t_s), 0.0) for t_s in (0.0, 15.0)]
    assert heights == pytest.approx([1.5 + CENTER_M, 5.0 + CENTER_M], abs=1e-6)


def test_the_sensor_adds_its_noise_and_says_when_there_is_no_echo(truth_at: TruthAt) -> None:
    truth = truth_at(HOLD, (8.0, 12.4, 3.0))
    sensor = HeightSensor(3, probe=WorldProbe(HOLD))
    readings = [sensor.measure(truth, 0.05 * number) for number in range(400)]
    mean_m = sum(reading.distance_m for reading in readings) / len(readings)
    spread_m = (sum((reading.distance_m - mean_m) ** 2 for reading in readings) / len(readings)) ** 0.5
    assert mean_m == pytest.approx(3.1 - 0.4, abs=0.03), "0.10 m is the height of the mount"
    assert spread_m == pytest.approx(0.01, rel=0.15)
    bare = World(msgspec.structs.replace(HOLD.file, surfaces={}, boxes={}))
    assert not HeightSensor(3, probe=WorldProbe(bare)).measure(truth, 0.0).is_valid
