"""A plane flies its mission: it takes off, keeps its lines, waits in circles, and comes home to land."""

from math import dist
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.messages.vehicle import FlightMode

LINES = """mission: two lines
frame: geo
geofence: {circle: {center: [47.4000, 8.5480], radius_m: 1200}, ceiling_m: 110}
on_link_loss: return
link_loss_after_s: 5
tasks:
  away: {actions: {off: {depart: {}}}}
  field:
    after: [away]
    actions: {lines: {transit: {to: [[47.4000, 8.5456], [47.4000, 8.5536], [47.4036, 8.5536]], height_m: 60}}}
  back: {after: [field], actions: {end: {arrive: {}}}}
"""


@pytest.fixture
def plane(tmp_path: Path) -> Card:
    card = Card("ardupilot", tmp_path)
    card.begin(LINES, platform="plane")
    return card


def ned_m(plane: Card) -> tuple[float, float, float]:
    """Where it truly is, from home."""
    return plane.flight.truth.samples[-1].position_ned_m


def east_m(plane: Card) -> float:
    return ned_m(plane)[1]


def test_a_plane_takes_off_keeps_its_lines_circles_when_paused_and_comes_home_without_its_station(plane: Card) -> None:
    try:
        plane.await_state("away.off", "done", 40.0)
        assert plane.height_m == pytest.approx(50.0, abs=4.0)
        plane.await_mode(FlightMode.MISSION, 5.0)
        plane.until(lambda: east_m(plane) > 350.0, 60.0, "it is on the line to the east")
        assert ned_m(plane) == pytest.approx((0.0, east_m(plane), -60.0), abs=3.0)
        plane.command("pause")
        plane.await_mode(FlightMode.HOLD, 2.0)
        begun = ned_m(plane)
        plane.always(lambda: dist(ned_m(plane), begun) < 200.0, 12.0, "it circles")
        plane.command("resume")
        plane.await_mode(FlightMode.MISSION, 8.0)
        plane.fault("link_loss")
        plane.await_policy("return", 8.0)
        plane.until(lambda: dist(ned_m(plane)[:2], (0.0, 0.0)) < 100.0, 60.0, "it is over home")
        plane.await_landed(120.0)
        assert dist(ned_m(plane)[:2], (0.0, 0.0)) < 300.0
        assert not plane.driver.has_pilot_control
    finally:
        plane.close()
