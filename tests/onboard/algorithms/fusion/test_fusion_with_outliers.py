"""No single report moves the pose, and what cannot be decided is told; the page of evidence `outliers` has all cells."""

import numpy as np
import pytest

from .flown import Tracker, inspection, sensors_of
from .fly import fly
from .outliers import LONGEST_S, ODOMETERS_AND_TRACKER, Case, lasting, sporadic, together, trial
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
    "name",
    [
        "hummingbird: stereo and tracker 5 % too long",
        "pelican: stereo and tracker 5 % too long",
        "hummingbird: stereo and ground 5 % too long",
        "hummingbird: stereo and tracker drift by 0.05 m/s",
    ],
)
def test_two_that_lie_together_are_not_believed_to_the_millimetre(name: str) -> None:
    assert max(trial(CASES[name], seed).lying_s for seed in range(2)) <= LONGEST_S
    assert trial(CASES[name], 0, PlainGate).lying_s > 10.0


def test_a_contradiction_that_has_lasted_leaves_its_doubt() -> None:
    """Two that are 5 % too long have wrongly convicted all others after 25 s, and everyone agrees then."""
    assert trial(CASES["hummingbird: stereo and tracker 5 % too long"], 16).lying_s <= LONGEST_S


def test_a_correction_that_is_not_blended_in_yet_is_told() -> None:
    """Two that drift together move the pose within half a second, too soon for any other source to know."""
    assert trial(CASES["hummingbird: stereo and tracker drift by 0.05 m/s"], 14).lying_s <= LONGEST_S


def test_one_that_has_dragged_the_pose_leaves_its_doubt_when_its_gate_turns_it_down() -> None:
    """In these flights the tracker has moved the pose by 2 cm before it is turned down."""
    assert max(trial(CASES["tracker: ramp"], seed).lying_s for seed in (8, 22)) <= LONGEST_S


def test_one_that_was_wrong_does_not_make_certain_again_what_others_have_made_uncertain_meanwhile() -> None:
    """The tracker comes back, 0.2 m off, to a pose that a wrong laser has moved there."""
    case = CASES["pelican: stereo garbage, laser 5 % too long, tracker 0.2 m off"]
    assert max(trial(case, seed).lying_s for seed in (1, 42)) <= LONGEST_S


@pytest.mark.parametrize(("other_fault", "is_confirmed"), [("", True), ("step", False)])
def test_the_doubt_about_a_reference_ends_once_another_source_of_positions_holds_it_too(
    other_fault: str, *, is_confirmed: bool
) -> None:
    sensors = sensors_of("hummingbird", 1)
    other = Tracker("beacon", 10.0, 0.08, rng=np.random.default_rng(7))
    for sensor in (sensors[2], other):
        sensor.fault, sensor.fault_s = "step", (8.0, 10.0)
    other.fault = other_fault
    flown = fly(inspection(), [*sensors, other], 1, until_s=24.0)
    doubts = [max(pose.position_std_m) for pose in flown.poses]
    came_back = next(i for i, pose in enumerate(flown.poses) if flown.t_s[i] > 10.0 and "tracker" in pose.sources)
    assert max(flown.fusion.estimate.reference_m) == (0.0 if is_confirmed else pytest.approx(0.05, abs=0.049))
    assert (doubts[-1] < 0.5 * doubts[came_back]) == is_confirmed


@pytest.mark.parametrize("name", ODOMETERS_AND_TRACKER)
def test_some_reports_in_a_row_with_the_same_error_do_not_end_the_pose(name: str) -> None:
    """Two to four of them, once in two to three seconds: neither outliers nor a drift, and most sources are right."""
    outcomes = [trial(Case(name, "hummingbird", {name: "bursts"}, 0.03), seed) for seed in range(3)]
    assert min(outcome.valid_share for outcome in outcomes) >= 0.95
    assert max(outcome.lying_s for outcome in outcomes) <= LONGEST_S
    assert max(outcome.worst_m for outcome in outcomes) < 0.03
