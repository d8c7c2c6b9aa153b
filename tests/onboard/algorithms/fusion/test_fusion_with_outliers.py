"""No single report moves the pose, and what cannot be decided is told; the page of evidence `outliers` has all cells."""

import numpy as np
import pytest

from .outliers import LONGEST_S, Case, lasting, sporadic, together, trial
from .plain_gate import PlainGate

pytestmark = pytest.mark.thorough

CASES = {case.name: case for case in (*sporadic(), *lasting(), *together())}


def rms_m(case: Case, seeds: range, kind: type[PlainGate] | None = None) -> float:
    outcomes = [trial(case, seed, kind) if kind else trial(case, seed) for seed in seeds]
    return float(np.sqrt(np.mean([outcome.square_m2 for outcome in outcomes])))


def test_where_every_fifth_report_of_all_sources_is_off_by_a_metre_the_pose_is_as_good_as_if_these_were_left_out() -> (
    None
):
    case, seeds = CASES["all three: 20% outliers"], range(3)
    outcomes = [trial(case, seed) for seed in seeds]
    assert max(outcome.worst_m for outcome in outcomes) < 0.03
    assert max(outcome.lying_s for outcome in outcomes) == 0.0
    assert min(outcome.valid_share for outcome in outcomes) == 1.0
    assert 0.3 < np.mean([outcome.nees for outcome in outcomes]) < 1.8
    assert rms_m(case, seeds) <= 1.01 * rms_m(case, seeds, PlainGate)


@pytest.mark.parametrize("name", ["stereo: scale", "ground: ramp", "tracker: ramp"])
def test_an_error_that_grows_is_told_before_it_is_found(name: str) -> None:
    """The plain filter is fooled by each of these for seconds."""
    outcomes = [trial(CASES[name], seed) for seed in range(2)]
    assert max(outcome.lying_s for outcome in outcomes) <= LONGEST_S
    assert min(outcome.valid_share for outcome in outcomes) == 1.0
    assert max(outcome.worst_m for outcome in outcomes) < 0.12
    assert max(trial(CASES[name], seed, PlainGate).lying_s for seed in range(2)) > LONGEST_S


@pytest.mark.parametrize(
    "name", ["hummingbird: stereo and tracker 5 % too long", "pelican: stereo and tracker 5 % too long"]
)
def test_two_that_lie_together_are_not_believed_to_the_millimetre(name: str) -> None:
    assert trial(CASES[name], 0).lying_s <= LONGEST_S
    assert trial(CASES[name], 0, PlainGate).lying_s > 10.0
