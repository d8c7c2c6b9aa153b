"""DESIGN §6, on_link_loss: nothing from the holder of control for `link_loss_after_s`, and what then happens."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.command_interface import StationRole
from gloc3.messages.summaries import StationHeard

HOME_M = 0.4
"""So near to the place of take-off counts as home."""


def sweep_and_lose_the_link(flight: Card, **policies: str) -> float:
    """The radio falls silent one second into the sweep; returns when."""
    flight.begin(mission(**policies))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("link_loss")
    return flight.now_s


def test_a_lost_link_lands_the_vehicle_where_it_is(flight: Card) -> None:
    lost_s = sweep_and_lose_the_link(flight, on_link_loss="land")
    flight.await_policy("land")
    assert 4.0 < flight.now_s - lost_s < 6.0
    x, _, _ = flight.position_m
    flight.await_landed()
    assert abs(flight.position_m[0] - x) < 1.2
    assert flight.state("mission") == "failed"


@ONE_STYLE
@pytest.mark.parametrize("heard", [StationHeard(station="254"), StationHeard(station="255", role=StationRole.OBSERVER)])
def test_only_the_holder_of_control_keeps_the_link_alive(flight: Card, heard: StationHeard) -> None:
    flight.begin(mission(on_link_loss="land", link_loss_after_s="2"))
    flight.await_state("sweep", "running")
    flight.fault("link_loss")
    for _ in range(6):  # another station, or an observer of the same name, is heard all the time
        flight.flight.exchange.publish(flight.envelope("ci/heard", heard))
        flight.wait(0.5)
    assert flight.mission.policy == "land"


def test_a_lost_link_returns_the_vehicle_and_lands_it_at_home(flight: Card) -> None:
    sweep_and_lose_the_link(flight, on_link_loss="return")
    flight.await_policy("return")
    assert flight.position_m[0] > 3.0
    flight.await_policy("land", 15.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_a_lost_link_changes_nothing_where_the_mission_says_continue(flight: Card) -> None:
    sweep_and_lose_the_link(flight, on_link_loss="continue")
    flight.until(lambda: flight.was_told("link lost"), 6.0, "told")
    flight.await_state("mission", "done", 30.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(8.0, abs=0.3)


def test_a_lost_link_aborts_into_what_the_mission_does_on_failure(flight: Card) -> None:
    sweep_and_lose_the_link(flight, on_link_loss="abort", on_failure="return")
    flight.await_policy("return")
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


def test_a_hold_in_which_nobody_acts_ends_in_a_landing(flight: Card) -> None:
    sweep_and_lose_the_link(flight, on_link_loss="hold", hold_s="4")
    flight.await_policy("hold")
    flight.wait(2.0)
    held_m = flight.position_m
    flight.always(lambda: abs(flight.position_m[0] - held_m[0]) < 0.2, 1.5, "it keeps its place")
    assert abs(flight.height_m - 1.5) < 0.3
    assert flight.state("mission") == "paused"
    flight.await_policy("land")
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(held_m[0], abs=HOME_M)


def test_an_operator_goes_on_after_a_hold_when_the_link_is_back(flight: Card) -> None:
    flight.begin(mission(on_link_loss="hold"))
    flight.await_state("sweep", "running")
    silence = flight.fault("link_loss")
    flight.await_policy("hold")
    silence.end()
    flight.until(lambda: flight.was_told("link lost: over"), 3.0, "the link is back")
    assert flight.state("mission") == "paused"
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=0.3)
