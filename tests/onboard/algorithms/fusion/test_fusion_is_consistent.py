"""The covariance is honest: errors and innovations are as large as it says, over seeds."""

import numpy as np
import pytest

from gloc3_onboard.algorithms.fusion.settings import FusionSettings

from .consistency import Consistency, consistency
from .flown import Tracker, inspection, sensors_of
from .fly import fly

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize(("platform", "without"), [("pelican", ()), ("hummingbird", ("tracker",))])
def test_errors_and_innovations_are_as_large_as_the_covariance_says(platform: str, without: tuple[str, ...]) -> None:
    found: Consistency = consistency(platform, without, seeds=range(4), until_s=22.0)
    assert 0.3 < np.mean(found.nees) / 6.0 < 1.8
    for source in ("stereo", "ground"):
        assert found.innovation[source] == pytest.approx(1.0, abs=0.25)


def test_positions_whose_errors_last_are_not_averaged_like_independent_ones() -> None:
    """The lamp of a tracker whose direction wanders is off for seconds in the same direction."""

    def nees(correlation_s: float) -> float:
        settings = FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=0.0, fix_correlation_s=correlation_s)
        found = []
        for seed in range(4):
            sensors = sensors_of("hummingbird", seed)
            for sensor in sensors:
                if isinstance(sensor, Tracker):
                    sensor.lasting_s = 1.0
            found.append(fly(inspection(), sensors, seed, settings, until_s=30.0).nees[80::40])
        return float(np.mean(found)) / 6.0

    assert nees(0.0) > 1.5, "the simulated tracker does err like that"
    assert 0.3 < nees(1.0) < 1.0
