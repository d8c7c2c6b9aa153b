"""The sampler of the autopilot's state dies: what is not known is not guessed, and the vehicle comes down all the same."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.mavlink.codec import enums


def landing_orders(flight: Card, since_s: float) -> int:
    """How often a landing was commanded."""
    orders = [message for t_s, message in flight.to_autopilot if t_s >= since_s and message.name == "COMMAND_LONG"]
    wanted = (enums.MAV_CMD_DO_SET_MODE, enums.MAV_CMD_NAV_LAND)
    return sum(message.command in wanted for message in orders)


def await_down(flight: Card, within_s: float = 40.0) -> None:
    """Waits until the vehicle truly stands on the ground with its motors off, whatever is told of it."""
    craft = flight.flight.simulator.autopilot.craft
    flight.until(lambda: not craft.is_armed, within_s, "disarmed")
    assert abs(flight.height_m) < 0.2


def test_a_dead_sampler_of_the_autopilots_state_lands_the_vehicle_once(flight: Card) -> None:
    flight.begin(mission(on_failure="hold"))
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("crash:autopilot_state", for_s=300.0)
    flight.await_policy("land", 15.0)
    await_down(flight)
    assert sum("policy land:" in event.text for event in flight.events) == 1
    flight.wait(5.0)
    assert flight.last("ci/vehicle").landed == "unknown"


def test_the_policies_still_act_while_nothing_is_known_of_the_autopilot(flight: Card) -> None:
    flight.begin(mission(on_pose_lost="land"))
    flight.await_state("sweep", "running")
    flight.fault("topic:autopilot=lost")
    flight.wait(3.0)
    assert flight.state("mission") == "running"
    flight.fault("topic:autopilot_pose=lost")
    flight.await_policy("land", 3.0)
    await_down(flight)


@ONE_STYLE
def test_a_pilot_who_takes_over_unseen_is_not_overruled(flight: Card) -> None:
    flight.begin(mission(on_link_loss="land"))
    flight.await_state("sweep", "running")
    flight.fault("topic:autopilot=lost")
    flight.fault("link_loss")
    flight.await_policy("land", 8.0)
    flight.wait(1.0)
    flight.fault("pilot:position")
    begin_s = flight.now_s
    flight.wait(20.0)
    assert landing_orders(flight, begin_s) == 0
    assert flight.height_m > 0.3


@ONE_STYLE
def test_nothing_starts_while_nothing_is_known_of_the_autopilot(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    flight.fault("topic:autopilot=lost")
    flight.wait(2.5)
    with pytest.raises(AssertionError, match="no state is received from the autopilot"):
        flight.command("start")
    assert flight.refused_steer("start") == "no state is received from the autopilot"
    reply = flight.action("take_off", height_m=1.5)
    assert reply.reason == "no state is received from the autopilot"


@pytest.mark.parametrize("fault", ["crash:autopilot_state", "hang:autopilot_state", "topic:autopilot=lost"])
def test_a_state_that_is_away_for_some_seconds_changes_nothing(flight: Card, fault: str) -> None:
    flight.begin(mission(on_failure="hold"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    away = flight.fault(fault, for_s=None if fault.startswith("crash") else 2.5)
    flight.wait(3.0)
    away.end()
    flight.await_state("mission", "done", 30.0)
    assert not any(state.has_pilot_control for state in flight.since(0.0, "driver"))
    assert not flight.was_told("policy ")
    assert flight.position_m[0] == pytest.approx(8.0, abs=0.3)
