"""What a picture, a scan and an inertial step cost, against one remap of a picture: that ratio is about the same on any machine."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.benchmarks import fusion, ground, laser, stereo
from tests.benchmarks.world import remap_ms
from tests.onboard.algorithms.vision.flights import fly, inspection

pytestmark = pytest.mark.thorough

REMAP_MS = 0.6
"""One remap on the machine of the bars."""


def stereo_ms() -> list[float]:
    """Features and motion of each pair of two seconds of a flight."""
    features, motions = stereo.costs_ms(list(fly(inspection(1).select(slice(200, 230)), "hold", 1)))
    return [a + b for a, b in zip(features, motions, strict=True)]


def fusion_ms() -> list[float]:
    """An inertial step with its share of all measurements; half, because it has no room to its bar."""
    return [fusion.cost_ms(until_s=8.0)[0] / 2.0]


@pytest.mark.parametrize(
    ("costs_ms", "bar_ms"),
    [
        (stereo_ms, stereo.BAR_MS),
        (lambda: ground.ground(steps=40), ground.BAR_MS),
        (lambda: laser.odometer_ms(length_m=4.0), laser.BAR_MS),
        (fusion_ms, fusion.BAR_MS),
    ],
    ids=["stereo", "ground", "laser", "fusion"],
)
def test_the_odometers_and_the_fusion_cost_no_more_than_their_bars(
    costs_ms: Callable[[], list[float]], bar_ms: float
) -> None:
    assert np.median(costs_ms()) / remap_ms() < bar_ms / REMAP_MS
