"""Bad input to each sensor, one kind after the other: told or harmless, right again by itself, and nothing is faulty."""

import pytest
from tests.onboard.bad_input.trial import INPUTS, MISFITS, Trial, faults

pytestmark = pytest.mark.thorough

BAD_S, GOOD_S = 1.3, 2.0
EVERYWHERE = [(sensor, False) for sensor in ("stereo", "ground", "laser", "tracker")]
MARKED = [("ground", True), ("laser", True)]


@pytest.mark.parametrize(("sensor", "with_sampler"), EVERYWHERE + MARKED)
def test_every_kind_of_bad_input_is_told_or_harmless_and_all_is_valid_again_by_itself(
    sensor: str, with_sampler: bool
) -> None:
    found: dict[str, list[str]] = {}
    with Trial(sensor, with_sampler=with_sampler) as trial:
        trial.good(GOOD_S)
        for name, given in INPUTS.items():
            if sensor in given.sensors:
                found[name] = faults(name, trial.bad(name, BAD_S, GOOD_S), is_long=False)
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


def test_a_tracker_whose_clock_was_wrong_until_the_pose_was_lost_is_believed_again() -> None:
    with Trial("tracker", with_sampler=False) as trial:
        trial.good(GOOD_S)
        outcomes = trial.bad("stamped in the future", 3.0)
        assert faults("stamped in the future", outcomes, is_long=True) == []


@pytest.mark.parametrize(
    ("name", "sensor"), [(name, sensor) for name, (_, sensors) in MISFITS.items() for sensor in sensors]
)
def test_a_calibration_that_does_not_fit_is_told_until_the_right_one_is_given(name: str, sensor: str) -> None:
    with Trial(sensor, with_sampler=False) as trial:
        trial.good(0.5)
        assert faults(name, trial.misfit(name, BAD_S, 1.5), is_long=False) == []
