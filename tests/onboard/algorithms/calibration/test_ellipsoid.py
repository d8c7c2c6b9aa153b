"""Magnetometers with known hard and soft iron: found within what is claimed; readings that do not tell are refused."""

import numpy as np
import pytest
from tests.onboard.algorithms.calibration.fields import FIELD, OFFSET, SOFT, readings

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.ellipsoid import LEAST_SHARE, fit_ellipsoid

SPIKES = np.where(np.arange(1200)[:, None] % 40, 0.0, 5.0)


def test_hard_and_soft_iron_are_right_within_what_is_claimed() -> None:
    sigmas = []
    for seed in range(4):
        fit = fit_ellipsoid(readings(seed))
        assert fit.offset == pytest.approx(OFFSET, abs=1e-3)
        assert fit.matrix == pytest.approx(SOFT / np.cbrt(np.linalg.det(SOFT)), abs=3e-3)
        assert fit.before > 0.1
        assert fit.after == pytest.approx(0.003 / np.linalg.norm(FIELD), rel=0.15)
        assert fit.coverage.share >= LEAST_SHARE
        sigmas.append((fit.offset - OFFSET) / fit.offset_std)
    assert np.abs(sigmas).max() < 4.0
    assert 0.3 < np.sqrt(np.mean(np.square(sigmas))) < 1.6


def test_a_long_rest_in_one_attitude_counts_as_one_moment() -> None:
    turned = readings(1)
    rest = turned[:1] + np.random.default_rng(0).normal(0.0, 0.003, (4000, 3))
    fit = fit_ellipsoid(np.concatenate((turned, rest)))
    assert fit.offset == pytest.approx(OFFSET, abs=3e-3)


def test_readings_beside_steel_count_less() -> None:
    turned = readings(2)
    turned[100:130] += np.array([0.2, 0.1, 0.0])
    assert fit_ellipsoid(turned).offset == pytest.approx(OFFSET, abs=4e-3)


def test_a_level_turn_tells_which_side_is_missing() -> None:
    coverage = fit_ellipsoid(readings(0, tilt_rad=0.4)).coverage
    assert coverage.share < LEAST_SHARE
    assert coverage.faces()["top"] == 0.0 < coverage.faces()["underside"]
    assert "along the field" in coverage.advice()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (readings(0)[:20], "20 readings of the magnetometer are too few: 50 are the least"),
        (np.full((100, 3), 0.3), "all readings of the magnetometer are the same"),
        (readings(0, tilt_rad=0.0), "the readings lie in a plane or on a line"),
        (readings(0) + SPIKES, "some readings are far away from those before and after, such as [45]"),
    ],
)
def test_readings_that_do_not_tell_are_refused(
    given: np.ndarray[tuple[int, ...], np.dtype[np.float64]], said: str
) -> None:
    with pytest.raises(Refused, match=said):
        fit_ellipsoid(given)
