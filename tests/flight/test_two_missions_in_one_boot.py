"""After a landing the autopilot is fit for the next mission, in whatever mode it stands; nobody restarts anything."""

from tests.flight.card import Card
from tests.flight.missions import mission

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
