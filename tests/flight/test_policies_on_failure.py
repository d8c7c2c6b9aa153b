"""DESIGN §6, on_failure: what fails, at action, task and mission level, and what then happens; deadlines; retries."""

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission

OUT = "follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 1.0}"
SIDE = "follow_waypoints: {waypoints_m: [[4, 3, 1.5]], speed_m_s: 1.0}"
HOME_M = 0.3


def fly_into_a_deadline(flight: Card, policy: str, **policies: str) -> None:
    """The first way of two gets stuck on its way, until its deadline has passed; then it could go on."""
    out = f"{{out: {{{OUT}, deadline_s: 10, on_failure: {policy}}}, side: {{{SIDE}, after: [out]}}}}"
    flight.begin(mission(out, **policies))
    flight.await_state("sweep.out", "running")
    flight.wait(3.0)
    flight.fault("topic:setpoint_wanted/waypoints=lost", for_s=6.9)
    flight.wait(6.5)


def test_a_failed_action_that_continues_stays_failed_and_what_comes_after_runs(flight: Card) -> None:
    fly_into_a_deadline(flight, "continue")
    flight.await_state("sweep.out", "failed")
    flight.await_state("sweep.side", "running", 1.0)
    assert "deadline" in flight.mission.reasons["sweep.out"], "stations are told why"
    flight.await_state("mission", "done", 30.0)
    assert flight.state("sweep.out") == "failed"
    assert flight.position_m[1] == pytest.approx(3.0, abs=HOME_M)


def test_a_failed_action_that_is_skipped_counts_as_skipped_and_what_comes_after_runs(flight: Card) -> None:
    fly_into_a_deadline(flight, "skip")
    flight.await_state("sweep.out", "skipped")
    flight.await_state("mission", "done", 30.0)
    assert flight.state("sweep") == "done"
    assert flight.position_m[1] == pytest.approx(3.0, abs=HOME_M)


def test_a_failed_action_is_retried_once_and_then_the_next_level_decides(flight: Card) -> None:
    fly_into_a_deadline(flight, "retry", on_failure="return")
    flight.until(lambda: flight.was_told("sweep.out waiting: attempt 2 of 2"), 2.0, "the second attempt")
    flight.wait(1.0)
    flight.fault("topic:setpoint_wanted/waypoints=lost", for_s=8.95)
    flight.await_policy("return", 12.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_a_retry_that_goes_well_is_a_success(flight: Card) -> None:
    flight.begin(mission(f"{{out: {{{OUT}, retries: 1}}}}"))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    flight.fault("crash:waypoints")
    flight.await_state("mission", "done", 30.0)
    assert flight.was_told("attempt 2 of 2")
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


def test_a_failed_action_holds_until_an_operator_acts(flight: Card) -> None:
    fly_into_a_deadline(flight, "hold")
    flight.await_policy("hold", 15.0)
    place = flight.position_m[0]
    flight.wait(2.0)
    flight.always(lambda: abs(flight.position_m[0] - place) < 1.0, 3.0, "it keeps its place")
    assert flight.state("mission") == "paused"
    flight.command("skip", "sweep.out")
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[1] == pytest.approx(3.0, abs=HOME_M)


def test_a_failed_action_returns_and_lands_at_home(flight: Card) -> None:
    fly_into_a_deadline(flight, "return")
    flight.await_policy("return", 15.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)
    assert flight.state("mission") == "failed"


def test_a_failed_action_lands_here(flight: Card) -> None:
    fly_into_a_deadline(flight, "land")
    flight.await_policy("land", 15.0)
    place = flight.position_m[0]
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(place, abs=1.2)


def test_a_failed_action_aborts_into_what_the_mission_does_on_failure(flight: Card) -> None:
    fly_into_a_deadline(flight, "abort", on_failure="return")
    flight.await_policy("return", 15.0)
    assert flight.state("sweep.side") == "aborted"
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_a_task_that_misses_its_deadline_follows_its_own_policy(flight: Card) -> None:
    flight.begin(mission(options="deadline_s: 10, on_failure: skip,"))
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("topic:setpoint_wanted/waypoints=lost")
    flight.await_state("sweep", "skipped", 12.0)
    flight.await_state("mission", "done", 30.0)
    assert 1.0 < flight.position_m[0] < 5.0


def test_a_mission_that_misses_its_deadline_fails_as_a_whole(flight: Card) -> None:
    flight.begin(mission(deadline_s="20", on_failure="return"))
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("topic:setpoint_wanted/waypoints=lost", for_s=14.4)
    flight.await_state("mission", "failed", 15.0)
    assert "deadline" in flight.mission.reason
    assert flight.mission.policy == "return"
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_the_most_severe_of_several_policies_wins(flight: Card) -> None:
    flight.begin(mission(on_link_loss="hold", on_low_battery="return", on_pose_lost="land", link_loss_after_s="1"))
    flight.await_state("sweep", "running")
    flight.wait(3.0)
    flight.fault("link_loss")
    flight.await_policy("hold")
    flight.fault("battery=0.18")
    flight.await_policy("return", 3.0)
    flight.wait(0.5)
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("land", 3.0)
    flight.await_landed()
    assert flight.position_m[0] > 1.0


def test_a_milder_policy_does_not_end_a_more_severe_one(flight: Card) -> None:
    flight.begin(mission(on_link_loss="hold", on_low_battery="land", link_loss_after_s="1"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("battery=0.18")
    flight.await_policy("land", 3.0)
    flight.fault("link_loss")
    flight.until(lambda: flight.was_told("link lost"), 3.0, "told")
    assert flight.mission.policy == "land"
    flight.await_landed()
