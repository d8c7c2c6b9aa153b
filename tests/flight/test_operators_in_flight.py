"""DESIGN §6 and §7: pause, resume, skip and abort at each of the three levels while flying; claims; components in use."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.component.lci import State
from gloc3.messages.command_interface import CommandComponent, Outcome, RequestAction, Steer, Verb

HOME_M = 0.3
TWO_WAYS = (
    "{out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 1.0}}, "
    "side: {follow_waypoints: {waypoints_m: [[4, 3, 1.5]], speed_m_s: 1.0}, after: [out]}}"
)
LEVELS = {"mission": "", "task": "sweep", "action": "sweep.out"}


@pytest.fixture(params=list(LEVELS))
def target(request: pytest.FixtureRequest) -> str:
    """What the operator names: the mission, a task, or an action."""
    return LEVELS[request.param]


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the first of two ways."""
    flight.begin(mission(TWO_WAYS, **policies))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)


def test_pause_ends_in_a_hold_and_resume_goes_on_from_there(flight: Card, target: str) -> None:
    sweep(flight)
    flight.command("pause", target)
    flight.await_state(target or "mission", "paused", 1.0)
    flight.await_state("sweep.out", "paused", 1.0)
    flight.wait(5.0)
    place = flight.position_m
    assert 1.0 < place[0] < 5.0
    flight.always(lambda: abs(flight.position_m[0] - place[0]) < 0.2, 2.0, "it keeps its place")
    assert flight.driver.is_streaming
    assert flight.driver.action_id == "hold"
    flight.command("resume", target)
    flight.await_state("sweep.side", "running", 20.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    flight.await_state("mission", "done", 30.0)


def test_skip_leaves_out_what_is_named_and_the_rest_is_flown(flight: Card, target: str) -> None:
    sweep(flight)
    flight.command("skip", target)
    flight.await_state(target or "mission", "skipped", 1.0)
    if not target:
        flight.wait(1.0)
        assert flight.driver.action_id == "hold"
        return
    flight.await_state("mission", "done", 30.0)
    side_m = 3.0 if target == "sweep.out" else 0.0
    assert flight.position_m[1] == pytest.approx(side_m, abs=HOME_M)


def test_abort_ends_what_is_named_and_follows_the_missions_on_failure(flight: Card, target: str) -> None:
    sweep(flight, on_failure="return")
    flight.command("abort", target)
    flight.await_state(target or "mission", "aborted", 1.0)
    flight.await_policy("return", 2.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)


@ONE_STYLE
def test_what_the_table_does_not_have_is_refused_with_what_would_be_accepted(flight: Card) -> None:
    sweep(flight)
    assert "accepted: start, skip, abort" in flight.refused(Steer(verb=Verb.RESUME, target="recover"))
    assert "there is no 'swep'" in flight.refused(Steer(verb=Verb.PAUSE, target="swep"))
    assert flight.state("sweep.out") == "running"


def test_a_single_action_on_claimed_motion_is_refused_naming_the_claimant(flight: Card) -> None:
    sweep(flight)
    up = RequestAction(capability="go_to", arguments={"position_m": [2, 2, 2]})
    assert "motion is claimed by sweep.out; pause or abort it first" in flight.refused(up)
    flight.command("pause")
    assert flight.request(up).outcome is Outcome.ACCEPTED
    flight.until(lambda: abs(flight.height_m - 2.0) < 0.3 and flight.position_m[1] > 1.5, 15.0, "it is there")
    assert flight.state("mission") == "paused"
    flight.until(lambda: flight.driver.action_id == "hold", 5.0, "the action has ended")
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)


def test_the_emergency_key_holds_and_needs_no_control(flight: Card) -> None:
    sweep(flight)
    flight.emergency("hold")
    flight.await_policy("hold", 1.0)
    flight.until(lambda: flight.speed_m_s < 0.05, 6.0, "it stands")
    assert flight.was_told("emergency hold by station 255")
    flight.emergency("land")
    flight.await_policy("land", 1.0)
    flight.await_landed()


def test_an_lci_command_that_takes_away_what_an_action_needs_is_refused(flight: Card) -> None:
    sweep(flight)
    needed = [("waypoints", "stop"), ("waypoints", "goquiet"), ("pose", "shutdown"), ("autopilot_driver", "stop")]
    for component, command in needed:
        reason = flight.refused(CommandComponent(component=component, command=command))
        assert f"sweep.out needs {component}" in reason
        assert flight.lci(component) is State.WORKING
    flight.await_state("mission", "done", 40.0)


def test_a_forced_lci_command_fails_the_action_by_its_policy(flight: Card) -> None:
    sweep(flight, on_failure="land")
    assert flight.component("waypoints", "stop", is_forced=True).outcome is Outcome.ACCEPTED
    flight.await_component("waypoints", "standby")
    flight.await_policy("land", 1.0)
    assert flight.state("sweep.out") == "failed"
    flight.await_landed()


def test_a_forced_stop_of_what_an_action_needs_fails_it_too(flight: Card) -> None:
    sweep(flight, on_failure="land", on_pose_lost="continue")
    assert flight.component("pose", "stop", is_forced=True).outcome is Outcome.ACCEPTED
    flight.await_policy("land", 2.0)
    flight.await_landed()


def test_what_a_policy_needs_is_not_taken_away_either(flight: Card) -> None:
    sweep(flight, on_low_battery="return")
    flight.fault("battery=0.18")
    flight.await_policy("return", 2.0)
    reason = flight.refused(CommandComponent(component="waypoints", command="stop"))
    assert "policy.return_home needs waypoints" in reason
    flight.await_landed()


def test_what_no_action_needs_may_be_commanded_in_flight(flight: Card) -> None:
    sweep(flight)
    assert flight.component("height", "goquiet").outcome is Outcome.ACCEPTED
    flight.await_component("height", "quiet")
    assert flight.component("height", "resume").outcome is Outcome.ACCEPTED
    assert flight.component("height", "stop").outcome is Outcome.ACCEPTED
    assert flight.component("height", "start").outcome is Outcome.ACCEPTED
    flight.await_state("mission", "done", 40.0)


def test_the_driver_does_not_stop_in_flight_unless_the_autopilot_has_a_mode_of_its_own(flight: Card) -> None:
    sweep(flight)
    reply = flight.component("autopilot_driver", "stop", is_forced=True)
    if reply.outcome is Outcome.REFUSED:
        assert flight.lci("autopilot_driver") is State.WORKING
    flight.until(lambda: flight.speed_m_s < 0.1, 5.0, "it stands in the air")
    assert flight.height_m == pytest.approx(1.5, abs=0.4)
