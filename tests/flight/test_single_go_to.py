"""A single go_to is checked as missions are, the loaded mission's fence included, and redirects the one before it."""

from math import dist

from tests.flight.card import ONE_STYLE, Card

from gloc3.messages.command_interface import Outcome, RequestAction

FENCED = """\
mission: fenced
frame: hold
geofence: {polygon_m: [[-3, -3], [12, -3], [12, 4], [-3, 4]], ceiling_m: 3.5}
tasks:
  up: {actions: {off: {take_off: {height_m: 2}}}}
"""


def go_to(flight: Card, *place_m: float) -> str:
    """The reason why it is refused; empty if it is accepted."""
    reply = flight.action("go_to", position_m=list(place_m), speed_m_s=1.0)
    return "" if reply.outcome is Outcome.ACCEPTED else reply.reason


@ONE_STYLE
def test_a_single_go_to_beyond_fence_or_limits_is_refused_with_the_distance(flight: Card) -> None:
    flight.begin(FENCED, platform="pelican_rtk")
    flight.await_state("mission", "done", 60.0)
    assert go_to(flight, 30.0, 1.0, 2.0) == "go_to's end is 18.0 m outside the fence"
    assert go_to(flight, 11.6, 1.0, 2.0).startswith("go_to's end is 0.40 m inside the fence, less than the margin of ")
    assert go_to(flight, 6.0, 1.0, 300.0) == "go_to's end is 300.0 m above home; the platform's limit is 30 m"
    assert "0.10 m inside the fence" in go_to(flight, 6.0, 1.0, 3.4)
    assert go_to(flight, 6.0, 1.0, 2.0) == ""


@ONE_STYLE
def test_a_second_go_to_redirects_the_first_and_nothing_else_may(flight: Card) -> None:
    flight.begin(FENCED, platform="pelican_rtk")
    flight.await_state("mission", "done", 60.0)
    assert go_to(flight, 6.0, 1.0, 2.0) == ""
    flight.wait(2.0)
    assert "motion is claimed by " in flight.refused(RequestAction(capability="return_home", arguments={}))
    assert go_to(flight, 30.0, 1.0, 2.0), "refused, and the first goes on"
    assert go_to(flight, 2.0, -1.0, 2.0) == ""
    assert flight.was_told(": redirected by command-")
    flight.wait(10.0)
    assert dist(flight.position_m, (2.0, -1.0, 2.0)) < 0.3
