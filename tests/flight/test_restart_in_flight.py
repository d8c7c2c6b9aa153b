"""DESIGN §6 and §7: the onboard process dies in flight and comes back; requests run at most once."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.exchange import Publisher
from gloc3.messages.command_interface import CiRequest, CommandComponent, Control, ControlVerb, Outcome, Query, Steer
from gloc3.messages.vehicle import FlightMode
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author

HOME_M = 0.3
TWO_WAYS = (
    "{out: {follow_waypoints: {waypoints_m: [[5, 0, 1.5]], speed_m_s: 1.0}}, "
    "side: {follow_waypoints: {waypoints_m: [[5, 4, 1.5]], speed_m_s: 1.0}, after: [out]}}"
)


def restart_on_the_second_way(flight: Card, **policies: str) -> None:
    """The onboard process dies for two seconds when the first way is done and the second is half done."""
    flight.begin(mission(TWO_WAYS, **policies))
    flight.await_state("sweep.side", "running", 20.0)
    flight.wait(2.0)
    flight.fault("restart")
    flight.wait(0.1)
    assert flight.flight.process.onboard is None
    flight.until(lambda: flight.flight.process.onboard is not None, 3.0, "it is back")


def test_while_the_onboard_process_is_away_the_autopilot_holds(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("restart", for_s=8.0)
    flight.wait(4.0)
    commander = flight.flight.simulator.autopilot.commander
    assert flight.speed_m_s < 0.1
    assert flight.height_m == pytest.approx(1.5, abs=0.4)
    assert commander.craft.is_armed
    place = flight.position_m
    flight.always(lambda: abs(flight.position_m[0] - place[0]) < 0.2, 3.0, "it stays there")


def test_a_restart_in_flight_holds_with_progress_kept_until_an_operator_acts(flight: Card) -> None:
    restart_on_the_second_way(flight)
    back_s = flight.now_s
    flight.await_policy("hold", 10.0)
    flight.wait(2.0)
    assert flight.state("mission") == "paused"
    assert flight.state("sweep.out") == "done"
    assert flight.state("sweep.side") == "paused"
    place = flight.position_m
    flight.always(lambda: abs(flight.position_m[1] - place[1]) < 0.3, 3.0, "it holds")
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)
    assert flight.position_m[1] == pytest.approx(4.0, abs=HOME_M)
    assert not [status for status in flight.since(back_s, "action_status/waypoints") if "out" in status.action_id]


def test_a_restart_in_flight_continues_where_the_mission_says_so(flight: Card) -> None:
    restart_on_the_second_way(flight, on_restart="continue")
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[1] == pytest.approx(4.0, abs=HOME_M)


def test_a_restart_in_flight_lands_where_the_mission_says_so(flight: Card) -> None:
    restart_on_the_second_way(flight, on_restart="land")
    flight.await_policy("land", 10.0)
    flight.await_landed()
    assert flight.state("mission") == "failed"


def test_a_hold_after_a_restart_in_which_nobody_acts_ends_in_a_landing(flight: Card) -> None:
    restart_on_the_second_way(flight, hold_s="3")
    flight.await_policy("hold", 10.0)
    flight.await_policy("land", 6.0)
    flight.await_landed()


def test_a_restart_on_the_ground_never_arms_and_never_starts(flight: Card) -> None:
    flight.begin(mission(on_restart="continue"))
    flight.fault("restart", for_s=15.0)  # before the motors run, or just then: the autopilot disarms by itself
    flight.until(lambda: not flight.flight.simulator.autopilot.commander.craft.is_armed, 14.0, "disarmed")
    flight.until(lambda: flight.flight.process.onboard is not None, 16.0, "it is back")
    flight.wait(3.0)
    flight.always(lambda: not flight.autopilot.is_armed, 10.0, "it stays disarmed")
    assert flight.state("mission") == "paused"
    assert abs(flight.height_m) < 0.1


def test_a_restart_during_a_landing_goes_on_landing(flight: Card) -> None:
    flight.begin(mission(on_restart="continue"))
    flight.await_state("recover.down", "running", 30.0)
    flight.wait(0.5)
    flight.fault("restart")
    flight.wait(2.5)
    flight.await_landed()
    flight.wait(2.0)
    assert flight.state("mission") in ("done", "paused")


def test_a_link_that_is_lost_before_a_restart_is_lost_after_it_too(flight: Card) -> None:
    flight.begin(mission(on_restart="continue", on_link_loss="land", link_loss_after_s="3"))
    flight.await_state("sweep", "running")
    flight.fault("link_loss")
    flight.wait(1.0)
    flight.fault("restart")
    flight.await_policy("land", 10.0)
    assert flight.position_m[0] < 6.0
    flight.await_landed()


@ONE_STYLE
def test_who_held_control_before_a_restart_holds_it_still(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.fault("restart")
    flight.wait(6.0)
    assert flight.last("ci/control").holder == flight.flight.station.id
    flight.command("resume")
    flight.await_state("mission", "done", 40.0)


def test_a_pilot_who_took_over_while_the_process_was_away_keeps_control(flight: Card) -> None:
    flight.begin(mission(on_restart="continue"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("restart", for_s=3.0)
    flight.wait(1.0)
    flight.fault("pilot:position")
    flight.wait(3.0)
    flight.until(lambda: flight.driver.has_pilot_control, 4.0, "the pilot has control")
    flight.always(lambda: flight.autopilot.mode is FlightMode.MANUAL, 6.0, "the mode stays the pilot's")
    assert flight.state("mission") == "paused"
    assert flight.mission.policy == "pilot"


def set_mode(flight: Card, behaviour: Behaviour) -> None:
    """What a station sends by the autopilot's own link, while the process is away."""
    autopilot = flight.flight.simulator.autopilot
    mode = next(mode.custom_mode for mode in autopilot.style.modes if mode.behaviour is behaviour)
    autopilot.commander.set_mode(mode, Author.COMMAND)


def test_a_return_that_an_operator_sent_meanwhile_is_no_pilot_s(flight: Card) -> None:
    flight.begin(mission(on_restart="continue", on_link_loss="hold", link_loss_after_s="1"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("restart", for_s=3.0)
    flight.wait(1.0)
    set_mode(flight, Behaviour.RETURN)
    flight.wait(3.0)
    flight.until(lambda: flight.driver.has_pilot_control, 4.0, "the driver sees that somebody else chose a mode")
    flight.await_policy("pilot", 4.0)
    assert flight.request(Control(verb=ControlVerb.OPERATED, command="return")).outcome is Outcome.ACCEPTED
    assert flight.was_told("station 255 sent return to the autopilot while this process was not heard")
    flight.await_policy("operator", 1.0)
    flight.until(lambda: flight.last("ci/vehicle").is_operators, 1.5, "the station is told")
    flight.fault("link_loss", for_s=2.0)  # its policy, hold, is milder than the return that is under way
    flight.always(lambda: flight.autopilot.mode is FlightMode.RETURN, 2.2, "the operator's return goes on")
    assert flight.was_told("link lost")
    flight.fault("pilot:position")
    flight.await_policy("pilot", 2.0)
    flight.until(lambda: not flight.last("ci/vehicle").is_operators, 1.5, "the station is told")


def test_a_hold_that_an_operator_sent_meanwhile_keeps_the_mission_paused(flight: Card) -> None:
    flight.begin(mission(on_restart="continue"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("restart", for_s=3.0)
    flight.wait(1.0)
    set_mode(flight, Behaviour.HOLD if flight.style == "px4" else Behaviour.BRAKE)
    flight.wait(4.0)
    told = Control(verb=ControlVerb.OPERATED, command="hold")
    while flight.request(told).outcome is not Outcome.ACCEPTED:  # until the process knows its mission again
        assert flight.now_s < 30.0
        flight.wait(0.5)
    flight.await_state("mission", "paused", 2.0)
    flight.always(lambda: flight.state("mission") == "paused", 6.0, "it waits for an operator")
    assert flight.speed_m_s < 0.1
    flight.command("resume")
    flight.await_state("mission", "done", 40.0)


# --- requests run at most once ---


def send(flight: Card, request: CiRequest) -> None:
    """Puts a request on the platform's topic once more, as a repeat over the radio would."""
    publisher = Publisher(flight.flight.exchange, flight.flight.name, "station_link", 7)
    publisher.publish(f"{flight.flight.name}/ci/request", request, flight.now_s)


@ONE_STYLE
def test_a_repeat_gets_the_same_reply_and_runs_nothing_twice_also_after_a_restart(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.command("pause")
    pause = next(r for r in reversed(flight.since(0.0, "ci/request")) if isinstance(r.body, Steer))
    first = next(r for r in flight.since(0.0, "ci/reply") if r.sequence == pause.sequence)
    flight.command("resume")
    flight.fault("restart")
    flight.wait(5.0)
    flight.command("resume")
    flight.await_state("sweep.out", "running")
    begin_s = flight.now_s
    send(flight, pause)
    flight.wait(0.5)
    again = [r for r in flight.since(begin_s, "ci/reply") if r.sequence == pause.sequence]
    assert again == [first]
    assert flight.state("sweep.out") == "running"


@ONE_STYLE
def test_a_query_tells_what_became_of_a_request_and_unknown_of_one_that_never_came(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.command("pause")
    pause = next(r for r in reversed(flight.since(0.0, "ci/request")) if isinstance(r.body, Steer))
    flight.fault("restart")
    flight.wait(5.0)
    assert flight.request(Query(boot=pause.boot, sequence=pause.sequence)).outcome is Outcome.ACCEPTED
    assert flight.request(Query(boot=pause.boot, sequence=999)).outcome is Outcome.UNKNOWN


@ONE_STYLE
def test_a_request_under_way_when_the_process_dies_is_unknown_and_is_not_run_again(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    stop = CiRequest(
        sender=flight.flight.station.id, boot=77, sequence=1, body=CommandComponent(component="height", command="stop")
    )
    flight.fault("hang:height")
    flight.wait(0.1)
    send(flight, stop)
    flight.wait(0.06)
    flight.fault("restart")
    flight.wait(5.0)
    begin_s = flight.now_s
    send(flight, stop)
    flight.wait(1.0)
    replies = [reply for reply in flight.since(0.0, "ci/reply") if reply.boot == 77]
    assert [reply.outcome for reply in replies] == [Outcome.UNKNOWN]
    assert "the process ended" in replies[0].reason
    assert not flight.since(begin_s, "components/height/command")


# --- what an action had achieved is not done again ---

ROUND = (
    "{round: {follow_waypoints: {waypoints_m: [[5, 0, 1.5], [5, 4, 1.5], [0, 4, 1.5], [0, 1, 1.5]], speed_m_s: 1.0}}}"
)


@pytest.mark.parametrize("on_restart", ["continue", "hold"])
def test_after_a_restart_the_way_goes_on_where_it_was_and_not_from_its_first_waypoint(
    flight: Card, on_restart: str
) -> None:
    flight.begin(mission(ROUND, on_restart=on_restart))
    flight.until(lambda: flight.position_m[1] > 3.7 and flight.position_m[0] < 4.0, 40.0, "on the third leg")
    flight.fault("restart")
    flight.wait(0.1)
    flight.until(lambda: flight.flight.process.onboard is not None, 3.0, "it is back")
    if on_restart == "hold":
        flight.await_policy("hold", 10.0)
        flight.command("resume")
    came_back: list[tuple[float, float, float]] = []
    flight.await_state("sweep.round", "running", 10.0)

    def is_done() -> bool:
        came_back.append(flight.position_m)
        return flight.state("sweep.round") == "done"

    flight.until(is_done, 20.0, "the way is done")
    assert max(x for x, _, _ in came_back) < 4.5, "it does not fly back"
    assert flight.position_m[:2] == pytest.approx((0.0, 1.0), abs=HOME_M)


@ONE_STYLE
def test_on_a_way_of_many_near_waypoints_a_restart_leads_no_waypoint_back(flight: Card) -> None:
    places = ", ".join(f"[{0.25 * n:.2f}, 0, 1.5]" for n in range(1, 61))
    flight.begin(
        mission("{out: {follow_waypoints: {waypoints_m: [" + places + "], speed_m_s: 1.5}}}", on_restart="continue")
    )
    flight.until(lambda: flight.position_m[0] > 6.0, 30.0, "under way")
    flight.fault("restart")
    flight.wait(0.1)
    flight.until(lambda: flight.flight.process.onboard is not None, 3.0, "it is back")
    farthest_m = 0.0

    def is_done() -> bool:
        nonlocal farthest_m
        assert flight.position_m[0] > min(farthest_m, 14.5) - 0.1, flight.story("it flies back")
        farthest_m = max(farthest_m, flight.position_m[0])
        return flight.state("sweep.out") == "done"

    flight.until(is_done, 40.0, "the way is done")


@ONE_STYLE
def test_after_a_restart_only_the_pictures_that_are_left_are_taken(flight: Card) -> None:
    photos = "{photos: {record_images: {camera: ground, every_s: 0.5, count: 8}}}"
    flight.begin(mission(photos, on_restart="continue"))
    flight.until(lambda: len(flight.received.get("image_recorded", [])) == 5, 40.0, "five pictures")
    flight.wait(0.2)
    flight.fault("restart")
    flight.await_state("sweep.photos", "done", 20.0)
    assert len(flight.received["image_recorded"]) == 8


def test_an_emergency_is_obeyed_while_the_components_are_still_coming_up(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("hang:waypoints")
    flight.fault("restart")
    flight.wait(0.1)
    flight.until(lambda: flight.flight.process.onboard is not None, 3.0, "it is back")
    back_s = flight.now_s
    flight.wait(0.3)
    flight.emergency("land")
    assert flight.now_s - back_s < 3.0, "nobody waits for what may never come up"
    flight.await_landed(20.0)
    assert flight.was_told("emergency land by station 255", back_s)
