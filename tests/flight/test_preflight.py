"""The pre-flight list before every start: read anew, refusing on red, overridden by name and logged."""

from typing import Any

import msgspec
import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.mavlink.codec import Encoder, message
from gloc3.messages.command_interface import Hello, Outcome, Preflight, RequestAction, Steer, Verb
from gloc3.messages.preflight import Check, PreflightReport, Verdict, red
from gloc3.messages.software import own_software
from gloc3_sitl.vehicles.simulator import LinkKind

LINK_LOSS = {"px4": "NAV_DLL_ACT", "ardupilot": "FS_GCS_ENABLE"}
RETURNS = {"px4": 2.0, "ardupilot": 1.0}


def checks(flight: Card) -> dict[str, Check]:
    """The list, as the station gets it, by title."""
    reply = flight.request(Preflight())
    assert reply.outcome is Outcome.ACCEPTED, reply.reason
    return {check.title: check for check in msgspec.convert(reply.result, PreflightReport).checks}


def ready(flight: Card, **plan: Any) -> None:
    """The mission is loaded, nothing is started."""
    flight.begin(mission(), is_started=False, **plan)


def test_a_vehicle_that_is_set_up_like_its_platform_file_has_no_red_or_doubtful_line(flight: Card) -> None:
    ready(flight, parameters={"GF_MAX_VER_DIST" if flight.style == "px4" else "FENCE_ALT_MAX": 8.0})
    found = checks(flight)
    assert [str(check) for check in found.values() if check.verdict is not Verdict.OK] == []
    assert {check.group for check in found.values()} == {
        "autopilot", "failsafes", "sensors", "components", "mission", "computer", "link"
    }  # fmt: skip
    assert found["failsafes: low battery"].finding.startswith("return at 10 %")


@pytest.mark.both_styles
def test_a_failsafe_that_is_set_otherwise_refuses_the_start_and_says_what_to_do(flight: Card) -> None:
    name = LINK_LOSS[flight.style]
    ready(flight, parameters={name: RETURNS[flight.style]})
    reply = flight.request(Steer(verb=Verb.START))
    assert reply.outcome is Outcome.REFUSED
    assert "a check is red: failsafes: link loss (return after " in reply.reason
    assert f"set {name} to 0" in reply.text
    assert reply.result == {"may_settle": False}
    flight.wait(2.0)
    assert not flight.autopilot.is_armed
    assert flight.state("mission") == "waiting"


@ONE_STYLE
def test_a_station_of_another_version_is_seen_before_the_flight_for_as_long_as_it_is_there(flight: Card) -> None:
    ready(flight)
    assert checks(flight)["link: station 255"].verdict is Verdict.OK
    assert (
        flight.as_station("254", Hello(version="0.0.9", protocol=own_software().protocol)).outcome is Outcome.ACCEPTED
    )
    assert checks(flight)["link: station 254"].verdict is Verdict.WARNING
    flight.as_station("254", Hello(version="0.0.9", protocol="00c0ffee"))
    reply = flight.request(Steer(verb=Verb.START))
    assert reply.outcome is Outcome.REFUSED
    assert "a check is red: link: station 254 (0.0.9 (00c0ffee) there, " in reply.reason
    flight.wait(31.0)
    assert "link: station 254" not in checks(flight)
    flight.command("start")


def test_an_override_starts_and_is_logged_with_its_author_and_what_was_red(flight: Card) -> None:
    ready(flight, parameters={LINK_LOSS[flight.style]: RETURNS[flight.style]})
    reply = flight.request(Steer(verb=Verb.START, override="no radio in this hold", author="ana"))
    assert reply.outcome is Outcome.ACCEPTED, reply.reason
    flight.await_state("mission", "running", 2.0)
    assert flight.was_told("ana (station 255) starts despite red checks: 'no radio in this hold'")
    assert flight.was_told("red: failsafes: link loss (return after ")
    flight.await_state("mission", "done", 60.0)
    (report,) = flight.since(0.0, "preflight")
    assert [check.title for check in red(report.checks)] == ["failsafes: link loss"]


def test_an_override_of_a_list_without_red_is_just_a_start(flight: Card) -> None:
    ready(flight)
    assert flight.request(Steer(verb=Verb.START, override="always", author="ana")).outcome is Outcome.ACCEPTED
    assert not flight.was_told("despite")


def test_what_somebody_sets_after_the_first_reading_is_seen_before_the_start(flight: Card) -> None:
    name = LINK_LOSS[flight.style]
    ready(flight)
    assert checks(flight)["failsafes: link loss"].verdict is Verdict.OK
    flight.flight.simulator.autopilot.parameters.set(name, RETURNS[flight.style])
    assert "link loss" in flight.refused_steer("start")
    flight.flight.simulator.autopilot.parameters.set(name, 0.0)
    flight.command("start")


def test_a_single_take_off_has_to_pass_too_and_what_does_not_move_has_not(flight: Card) -> None:
    ready(flight, parameters={LINK_LOSS[flight.style]: RETURNS[flight.style]})
    assert "link loss" in flight.refused(RequestAction(capability="take_off", arguments={"height_m": 1.0}))
    assert flight.action("record_images", camera="ground", every_s=1.0, count=1).outcome is Outcome.ACCEPTED
    up = RequestAction(capability="take_off", arguments={"height_m": 1.0}, override="test hop", author="ana")
    assert flight.request(up).outcome is Outcome.ACCEPTED


def test_in_the_air_nothing_is_held_against_a_start(flight: Card) -> None:
    flight.begin(mission(on_failure="hold"))
    flight.await_state("sweep", "running")
    flight.flight.simulator.autopilot.parameters.set(LINK_LOSS[flight.style], RETURNS[flight.style])
    flight.command("abort")
    flight.await_policy("hold")
    assert flight.action("land").outcome is Outcome.ACCEPTED
    flight.await_landed()


@ONE_STYLE
def test_a_setup_that_cannot_be_read_anew_does_not_keep_a_start_waiting(flight: Card) -> None:
    ready(flight)
    deaf = {"PARAM_REQUEST_READ"}
    cable = flight.flight.links.cable
    send = cable.b.send
    from gloc3.mavlink.codec import Parser

    def lossy(data: bytes) -> None:
        frames = Parser(is_datagram=True).receive(data)
        if not any(frame.message_id == message(name).id for frame in frames for name in deaf):
            send(data)

    cable.b.send = lossy  # type: ignore[method-assign]
    begin_s = flight.now_s
    found = checks(flight)
    assert flight.now_s - begin_s < 4.5
    assert found["autopilot: parameters"].verdict is Verdict.WARNING
    assert "not for this check" in found["autopilot: parameters"].finding


@ONE_STYLE
def test_a_station_may_look_without_control_but_not_start(flight: Card) -> None:
    ready(flight)
    assert flight.as_station("254", Preflight()).outcome is Outcome.ACCEPTED
    assert flight.as_station("254", Steer(verb=Verb.START, override="mine")).outcome is Outcome.REFUSED


@ONE_STYLE
def test_a_component_that_is_down_and_a_lost_position_are_named(flight: Card) -> None:
    ready(flight)
    assert flight.component("waypoints", "stop").outcome is Outcome.ACCEPTED
    flight.fault("topic:autopilot_pose=lost")
    flight.wait(1.5)
    found = checks(flight)
    assert found["components: waypoints"].verdict is Verdict.RED
    assert found["sensors: position"].verdict is Verdict.RED
    reply = flight.request(Steer(verb=Verb.START))
    assert (reply.outcome, reply.result) == (Outcome.REFUSED, {"may_settle": True})


@ONE_STYLE
def test_a_sensor_has_a_line_that_tells_when_it_falls_silent(flight: Card) -> None:
    flight.begin(mission("{photos: {record_images: {camera: ground, every_s: 1, count: 3}}}"), is_started=False)
    assert checks(flight)["sensors: ground_camera"].finding == "alive, simulated"
    flight.fault("device:ground_camera=lost")
    flight.wait(3.0)
    lost = checks(flight)["sensors: ground_camera"]
    assert lost.verdict is Verdict.WARNING
    assert lost.finding.startswith("no data for ")


@pytest.mark.both_styles
def test_a_remote_id_that_lacks_the_operator_s_position_refuses_the_start_until_it_is_sent(flight: Card) -> None:
    ready(flight, parameters={"COM_ARM_ODID" if flight.style == "px4" else "DID_ENABLE": 1.0})
    flight.wait(2.0)
    line = checks(flight)["autopilot: remote id"]
    assert (line.verdict, line.finding) == (Verdict.RED, "not good to arm: operator location missing")
    assert "a check is red: autopilot: remote id" in flight.request(Steer(verb=Verb.START)).reason
    send = flight.flight.simulator.attach(lambda _: None, LinkKind.GROUND)
    where = {"operator_latitude": 473977000, "operator_longitude": 85456000}
    send(Encoder(250, 190).encode(message("OPEN_DRONE_ID_SYSTEM", **where)))
    flight.wait(2.0)
    assert checks(flight)["autopilot: remote id"].verdict is Verdict.OK
    flight.command("start")
