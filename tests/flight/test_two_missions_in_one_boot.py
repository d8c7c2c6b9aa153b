"""After a landing the autopilot is fit for the next mission, in whatever mode it stands; nobody restarts anything."""

import msgspec
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.command_interface import Preflight
from gloc3.messages.preflight import PreflightReport, Verdict
from gloc3.messages.vehicle import FlightMode


def test_a_second_mission_of_a_boot_is_flown_like_the_first(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("mission", "done", 60.0)
    flight.until(lambda: not flight.autopilot.is_armed, 5.0, "disarmed")
    flight.wait(3.0)
    assert flight.autopilot.mode not in (FlightMode.GUIDED, *([FlightMode.LAND] if flight.style == "px4" else []))
    flight.run(flight.flight.upload_and_start())
    flight.await_state("mission", "running", 5.0)
    flight.await_state("mission", "done", 60.0)


@ONE_STYLE
def test_a_mission_starts_while_a_standby_is_in_charge_of_a_limiter_that_came_back(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("mission", "running", 5.0)
    flight.wait(4.0)
    flight.fault("crash:limiter")
    flight.await_component("limiter_standby", "working", 1.0)
    flight.await_component("limiter", "quiet")
    flight.await_state("mission", "done", 60.0)
    flight.until(lambda: not flight.autopilot.is_armed, 5.0, "disarmed")
    flight.wait(3.0)
    report = msgspec.convert(flight.request(Preflight()).result, PreflightReport)
    (line,) = [check for check in report.checks if check.title == "components: all"]
    assert line.verdict is Verdict.OK
    assert "limiter_standby is in charge for limiter, which is its standby" in line.finding
    flight.run(flight.flight.upload_and_start())
    flight.await_state("mission", "running", 5.0)
    flight.await_state("mission", "done", 60.0)
