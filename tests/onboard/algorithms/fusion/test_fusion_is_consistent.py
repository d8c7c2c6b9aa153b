"""The covariance is honest: errors and innovations are as large as it says, over seeds."""

import numpy as np
import pytest

from .consistency import Consistency, consistency

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize(("platform", "without"), [("pelican", ()), ("hummingbird", ("tracker",))])
def test_errors_and_innovations_are_as_large_as_the_covariance_says(platform: str, without: tuple[str, ...]) -> None:
    found: Consistency = consistency(platform, without, seeds=range(4), until_s=22.0)
    assert 0.3 < np.mean(found.nees) / 6.0 < 1.8
    for source in ("stereo", "ground"):
        assert found.innovation[source] == pytest.approx(1.0, abs=0.25)
