"""A VTOL flies its mission under both autopilots: up on rotors, its lines on wings, and down on rotors, whatever comes between."""

from collections.abc import Iterator
from math import dist
from pathlib import Path
from typing import Any

import pytest
from tests.flight.card import Card

from gloc3.messages.vehicle import FlightMode, VtolForm
from gloc3_sitl.physics.wind import gusty

LINES = """mission: two lines
frame: geo
geofence: {circle: {center: [47.4010, 8.5480], radius_m: 900}, ceiling_m: 110}
on_failure: POLICY
on_link_loss: return
on_low_battery: return
link_loss_after_s: 5
tasks:
  away: {actions: {off: {take_off: {height_m: 40}}}}
  field:
    after: [away]
    actions:
      lines: {follow_waypoints: {waypoints: [[47.4000, 8.5456, 50], [47.4000, 8.5516, 50], [47.4036, 8.5516, 50]], by: wings}}
  back: {after: [field], actions: {end: {arrive: {}}}}
"""
TRANSITIONS = """mission: there and back
frame: geo
geofence: {circle: {center: [47.4000, 8.5456], radius_m: 900}, ceiling_m: 110}
tasks:
  away: {actions: {off: {take_off: {height_m: 40}}, over: {go_to: {position: [47.4000, 8.5456, 40]}, after: [off]}}}
  there: {after: [away], actions: {go: {transition: {to: wings}}}}
  wait: {after: [there], actions: {round: {hold: {duration_s: 12}}}}
  back: {after: [wait], actions: {stop: {transition: {to: rotors}}, down: {land: {}, after: [stop]}}}
"""
CORNER, END = (0.0, 452.0), (400.0, 452.0)
"""North and east of home, about."""


@pytest.fixture(params=["px4", "ardupilot"])
def vtol(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Card]:
    card = Card(request.param, tmp_path)
    yield card
    card.close()


def begin(vtol: Card, on_failure: str = "land", **plan: Any) -> None:
    vtol.begin(LINES.replace("POLICY", on_failure), platform="vtol", **plan)


def place_m(vtol: Card) -> tuple[float, float]:
    """Where it truly is, north and east of home."""
    north, east, _ = vtol.flight.truth.samples[-1].position_ned_m
    return north, east


def await_form(vtol: Card, form: VtolForm, within_s: float) -> None:
    vtol.until(lambda: vtol.autopilot.form is form, within_s, f"it flies on {form}")


def fly_to_wings(vtol: Card) -> None:
    """Takes off and goes over to wings, as far as the first line."""
    vtol.await_state("away.off", "done", 40.0)
    await_form(vtol, VtolForm.WINGS, 30.0)
    vtol.until(lambda: place_m(vtol)[1] > 250.0, 40.0, "it is on the line to the east")


def lands_at_home(vtol: Card, within_s: float) -> None:
    vtol.await_landed(within_s)
    assert dist(place_m(vtol), (0.0, 0.0)) < 6.0
    assert not vtol.driver.has_pilot_control


def test_it_takes_off_flies_its_lines_on_wings_hovers_and_lands_on_rotors_at_home(vtol: Card) -> None:
    begin(vtol)
    vtol.await_state("away.off", "done", 40.0)
    assert vtol.height_m == pytest.approx(40.0, abs=1.5)
    assert vtol.autopilot.form is VtolForm.ROTORS
    assert vtol.speed_m_s < 1.0
    await_form(vtol, VtolForm.WINGS, 30.0)
    vtol.until(lambda: dist(place_m(vtol), CORNER) < 60.0, 40.0, "it comes to the corner")
    assert vtol.speed_m_s > 20.0
    assert vtol.last("ci/vehicle").mode == {"px4": "AUTO.MISSION, on wings", "ardupilot": "AUTO, on wings"}[vtol.style]
    vtol.await_state("field.lines", "done", 60.0)
    assert vtol.autopilot.form is VtolForm.ROTORS
    assert dist(place_m(vtol), END) < 15.0
    await_form(vtol, VtolForm.WINGS, 30.0)  # home is far: on wings again
    lands_at_home(vtol, 200.0)
    vtol.await_state("mission", "done", 5.0)


def test_paused_on_wings_it_circles_and_paused_on_rotors_it_hovers_and_goes_on_from_both(vtol: Card) -> None:
    begin(vtol)
    vtol.until(lambda: vtol.height_m > 15.0, 30.0, "it climbs")
    vtol.command("pause")
    vtol.await_mode(FlightMode.HOLD, 3.0)
    vtol.wait(4.0)
    begun = place_m(vtol)
    vtol.always(lambda: dist(place_m(vtol), begun) < 2.0, 5.0, "it hovers")
    vtol.command("resume")
    fly_to_wings(vtol)
    vtol.command("pause")
    vtol.await_mode(FlightMode.HOLD, 3.0)
    begun = place_m(vtol)
    vtol.always(lambda: dist(place_m(vtol), begun) < 260.0 and vtol.speed_m_s > 18.0, 20.0, "it circles")
    assert vtol.autopilot.form is VtolForm.WINGS
    vtol.command("resume")
    vtol.await_mode(FlightMode.MISSION, 8.0)
    vtol.await_state("field.lines", "done", 90.0)
    lands_at_home(vtol, 200.0)


def test_skipped_and_aborted_on_wings_it_comes_home_or_down(vtol: Card) -> None:
    begin(vtol)
    fly_to_wings(vtol)
    vtol.command("skip", "field")
    vtol.await_state("back", "running", 3.0)
    vtol.until(lambda: dist(place_m(vtol), (0.0, 0.0)) < 200.0, 60.0, "it comes home")
    vtol.command("abort")
    vtol.await_mode(FlightMode.LAND, 5.0)
    vtol.await_landed(120.0)
    assert dist(place_m(vtol), (0.0, 0.0)) < 200.0
    assert vtol.state("mission") == "aborted"


def test_a_low_battery_on_wings_brings_it_home_on_wings_and_down_on_rotors(vtol: Card) -> None:
    begin(vtol)
    fly_to_wings(vtol)
    vtol.fault("battery=0.2")
    vtol.await_policy("return", 8.0)
    vtol.wait(4.0)
    assert vtol.autopilot.form is VtolForm.WINGS
    lands_at_home(vtol, 200.0)


def test_without_its_station_it_comes_home(vtol: Card) -> None:
    begin(vtol)
    fly_to_wings(vtol)
    vtol.fault("link_loss")
    vtol.await_policy("return", 8.0)
    lands_at_home(vtol, 200.0)


def test_after_a_restart_on_wings_it_circles_and_is_ours(vtol: Card) -> None:
    begin(vtol)
    fly_to_wings(vtol)
    vtol.fault("restart", for_s=2.0)
    vtol.wait(2.5)
    vtol.await_policy("hold", 15.0)
    vtol.await_mode(FlightMode.HOLD, 5.0)
    assert vtol.autopilot.form is VtolForm.WINGS
    assert not vtol.driver.has_pilot_control
    vtol.command("resume")
    vtol.await_mode(FlightMode.MISSION, 8.0)
    lands_at_home(vtol, 300.0)


def test_a_transition_that_fails_leaves_it_on_rotors_and_the_mission_decides(vtol: Card) -> None:
    limits = {"px4": {"VT_TRANS_TIMEOUT": 3.0}, "ardupilot": {"AIRSPEED_MIN": 31.0, "AIRSPEED_MAX": 60.0}}
    begin(vtol, parameters=limits[vtol.style])
    vtol.await_state("field.lines", "failed", 90.0)
    assert vtol.was_told("the transition to wings failed")
    vtol.await_mode(FlightMode.LAND, 5.0)
    await_form(vtol, VtolForm.ROTORS, 20.0)
    vtol.await_landed(120.0)


def test_in_wind_it_stays_inside_its_fence_all_the_way(vtol: Card) -> None:
    begin(vtol, wind=gusty(7.0, 270.0))
    vtol.await_state("mission", "done", 260.0)
    away_m = [dist(sample.position_ned_m[:2], (111.0, 181.0)) for sample in vtol.flight.truth.samples]
    assert max(away_m) < 870.0
    assert max(-sample.position_ned_m[2] for sample in vtol.flight.truth.samples) < 70.0


def test_transitions_of_their_own_end_in_a_circle_and_in_a_hover(vtol: Card) -> None:
    vtol.begin(TRANSITIONS, platform="vtol")
    vtol.await_state("there.go", "done", 90.0)
    await_form(vtol, VtolForm.WINGS, 1.0)
    begun = place_m(vtol)
    vtol.always(lambda: vtol.speed_m_s > 18.0 and dist(place_m(vtol), begun) < 260.0, 10.0, "it circles")
    vtol.await_state("back.stop", "done", 40.0)
    assert vtol.autopilot.form is VtolForm.ROTORS
    vtol.await_landed(120.0)


def test_the_same_seed_gives_the_same_flight(tmp_path: Path) -> None:
    def track() -> list[tuple[float, float, float]]:
        card = Card("px4", tmp_path)
        try:
            begin(card, wind=gusty(5.0, 200.0))
            card.wait(60.0)
            return [sample.position_ned_m for sample in card.flight.truth.samples]
        finally:
            card.close()

    assert track() == track()
