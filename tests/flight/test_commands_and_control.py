"""DESIGN §7, one path: authority and its hand-over, single tasks and actions, the emergency key, what is available."""

import asyncio

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import FENCE, mission

from gloc3.messages.command_interface import (
    CiReply,
    CommandComponent,
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    LoadMission,
    Outcome,
    RequestTask,
    Steer,
    Verb,
)

OTHER = "254"
TASK = """mission: look
frame: hold
tasks:
  look:
    actions:
      there: {go_to: {position_m: [3, 2, 2], speed_m_s: 1.0}}
      stay: {hold: {duration_s: 1}, after: [there]}
"""


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)


@ONE_STYLE
def test_a_second_station_asks_for_control_and_gets_it_when_the_holder_grants_it(flight: Card) -> None:
    sweep(flight)
    assert flight.as_station(OTHER, Steer(verb=Verb.PAUSE)).outcome is Outcome.REFUSED
    requested = flight.as_station(OTHER, Control(verb=ControlVerb.REQUEST))
    assert "station 255 has been asked" in requested.reason
    flight.until(lambda: flight.last("ci/control").requested_by == OTHER, 1.5, "the holder is told")
    assert flight.request(Control(verb=ControlVerb.GRANT)).outcome is Outcome.ACCEPTED
    assert flight.as_station(OTHER, Steer(verb=Verb.PAUSE)).outcome is Outcome.ACCEPTED
    assert "station 254 holds control" in flight.refused_steer("resume")


@ONE_STYLE
def test_a_request_that_the_holder_refuses_or_does_not_answer_leaves_control_where_it_is(flight: Card) -> None:
    sweep(flight)
    flight.as_station(OTHER, Control(verb=ControlVerb.REQUEST))
    assert flight.request(Control(verb=ControlVerb.REFUSE)).outcome is Outcome.ACCEPTED
    assert flight.as_station(OTHER, Steer(verb=Verb.PAUSE)).outcome is Outcome.REFUSED
    flight.as_station(OTHER, Control(verb=ControlVerb.REQUEST))
    flight.wait(11.5)
    assert flight.last("ci/control").requested_by == ""
    assert flight.last("ci/control").holder == "255"


@ONE_STYLE
def test_control_may_be_taken_over_and_from_a_holder_that_is_gone_it_is_given(flight: Card) -> None:
    sweep(flight)
    assert "taken over from station 255" in flight.as_station(OTHER, Control(verb=ControlVerb.TAKE_OVER)).reason
    flight.until(lambda: flight.last("ci/control").holder == OTHER, 1.5, "it is told")
    flight.wait(6.0)  # of 254 nothing more is heard
    assert "is lost" in flight.request(Control(verb=ControlVerb.REQUEST)).reason
    flight.command("pause")


def test_a_mission_starts_only_by_the_station_in_control(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    reply = flight.as_station(OTHER, Steer(verb=Verb.START))
    assert reply.outcome is Outcome.REFUSED
    flight.wait(2.0)
    assert not flight.autopilot.is_armed


def test_the_emergency_key_is_taken_from_any_station_and_logged_with_its_author(flight: Card) -> None:
    sweep(flight)
    assert flight.as_station(OTHER, Emergency(verb=EmergencyVerb.HOLD)).outcome is Outcome.ACCEPTED
    flight.await_policy("hold", 1.0)
    assert flight.was_told("emergency hold by station 254")
    assert flight.as_station(OTHER, Emergency(verb=EmergencyVerb.LAND, author="ada")).outcome is Outcome.ACCEPTED
    flight.await_policy("land", 1.0)
    assert flight.was_told("emergency land by ada")
    flight.await_landed()


def test_the_emergency_disarm_stops_the_motors_with_the_platforms_name_typed(flight: Card) -> None:
    sweep(flight)
    assert flight.emergency_reply("disarm", confirmation="pelicna").outcome is Outcome.REFUSED
    assert flight.emergency_reply("disarm", confirmation="pelican").outcome is Outcome.ACCEPTED
    flight.until(lambda: not flight.autopilot.is_armed, 1.5, "the motors stand")
    assert flight.was_told("emergency disarm by station 255")
    assert flight.state("mission") == "aborted"
    flight.wait(5.0)
    assert not flight.autopilot.is_armed


def test_a_single_task_is_flown_beside_a_mission_that_waits(flight: Card) -> None:
    sweep(flight)
    flight.command("pause")
    assert flight.request(RequestTask(text=TASK)).outcome is Outcome.ACCEPTED
    flight.await_state("look", "done", 20.0)
    assert flight.position_m[1] == pytest.approx(2.0, abs=0.3)
    assert flight.state("mission") == "paused"
    flight.command("resume")
    flight.await_state("mission", "done", 40.0)


def test_single_actions_fly_without_any_mission(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    assert flight.action("take_off", height_m=1.5).outcome is Outcome.ACCEPTED
    flight.until(lambda: abs(flight.height_m - 1.5) < 0.2, 10.0, "it is up")
    flight.until(lambda: flight.driver.action_id == "hold", 5.0, "and holds")
    assert flight.action("go_to", position_m=[3, 0, 1.5]).outcome is Outcome.ACCEPTED
    flight.until(lambda: abs(flight.position_m[0] - 3.0) < 0.3, 10.0, "it is there")
    flight.until(lambda: flight.driver.action_id == "hold", 10.0, "and holds")
    assert flight.action("land").outcome is Outcome.ACCEPTED
    flight.await_landed()


@ONE_STYLE
def test_a_single_action_is_checked_like_a_mission(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    assert flight.action("fly_to_the_moon").outcome is Outcome.REFUSED
    assert flight.action("take_off").outcome is Outcome.REFUSED
    assert flight.action("go_to", position_m=[3, 0, 1.5]).outcome is Outcome.REFUSED  # it stands on the ground
    assert not flight.autopilot.is_armed


@ONE_STYLE
def test_a_capability_is_available_only_while_what_it_needs_is_alive(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    assert flight.component("waypoints", "stop").outcome is Outcome.ACCEPTED
    assert "components: waypoints (standby)" in flight.refused_steer("start")
    overridden = Steer(verb=Verb.START, override="to see what happens")
    assert "follow_waypoints is not available: it lacks waypoints" in flight.refused(overridden)
    assert flight.component("waypoints", "start").outcome is Outcome.ACCEPTED
    assert flight.component("pose", "goquiet").outcome is Outcome.ACCEPTED
    flight.wait(0.5)
    assert "lacks pose" in flight.refused(overridden)
    assert flight.component("pose", "resume").outcome is Outcome.ACCEPTED
    flight.wait(0.5)
    flight.command("start")
    flight.await_state("depart", "done")


@ONE_STYLE
def test_a_command_that_the_table_does_not_have_is_refused_with_what_would_be_accepted(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    reason = flight.refused(CommandComponent(component="waypoints", command="start"))
    assert "working" in reason
    assert "accepted: goquiet, stop, shutdown" in reason
    assert "there is no component 'waypoins'" in flight.refused(CommandComponent(component="waypoins", command="stop"))


@ONE_STYLE
@pytest.mark.parametrize("is_another", [False, True])
def test_two_uploads_at_once_are_both_answered(flight: Card, is_another: bool) -> None:
    flight.begin(mission(), is_started=False)
    client, name = flight.flight.station.client, flight.flight.name
    wide, wider = (FENCE.replace("[20, 12]", f"[{x_m}, 12]") for x_m in (21, 22))
    texts = mission(fence=wide), mission(fence=wider if is_another else wide)

    async def load() -> tuple[CiReply, ...]:
        bodies = [LoadMission(name="card.yaml", text=text) for text in texts]
        return tuple(await asyncio.gather(*(client.request(name, body) for body in bodies)))

    first, second = flight.run(load())
    assert second.outcome is Outcome.ACCEPTED
    if is_another:
        assert first.reason == "another mission was loaded after it"
    else:
        assert first.outcome is Outcome.ACCEPTED
