"""A plane flies its mission: it takes off, keeps its lines, waits in circles, and comes home to land."""

from math import dist, nan
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.mavlink.codec import message
from gloc3.messages.vehicle import FlightMode
from gloc3.platform.reader import whole_text

REPOSITION = 192
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


def test_a_plane_whose_onboard_process_restarts_on_its_way_is_ours_and_not_a_pilots(plane: Card) -> None:
    try:
        plane.await_state("away.off", "done", 40.0)
        plane.until(lambda: east_m(plane) > 100.0, 60.0, "it is on the line to the east")
        plane.fault("restart", for_s=2.0)
        plane.wait(2.5)
        plane.await_policy("hold", 15.0)
        plane.await_mode(FlightMode.HOLD, 5.0)
        assert not plane.driver.has_pilot_control
        plane.command("resume")
        plane.await_mode(FlightMode.MISSION, 8.0)
        plane.await_landed(300.0)
    finally:
        plane.close()


def test_a_plane_that_loses_its_station_after_an_onboard_restart_comes_home(plane: Card) -> None:
    try:
        plane.await_state("away.off", "done", 40.0)
        plane.until(lambda: east_m(plane) > 100.0, 60.0, "it is on the line to the east")
        plane.fault("restart", for_s=2.0)
        plane.fault("link_loss")
        plane.wait(2.5)
        plane.await_policy("return", 15.0)
        plane.until(lambda: dist(ned_m(plane)[:2], (0.0, 0.0)) < 100.0, 60.0, "it is over home")
        plane.await_landed(120.0)
        assert not plane.driver.has_pilot_control
    finally:
        plane.close()


def test_a_plane_that_is_led_out_of_its_mission_s_fence_is_turned_back_by_its_autopilot(plane: Card) -> None:
    """Nothing of ours has a part in its path: the fence is the autopilot's, and has to be switched on."""
    try:
        plane.await_state("away.off", "done", 40.0)
        out = message(
            "COMMAND_INT", target_system=1, target_component=1, frame=6, command=REPOSITION, param1=-1.0, param2=1.0,
            param4=nan, x=474000000, y=85800000, z=60.0,
        )  # fmt: skip
        plane.flight.process.vehicle.autopilot.send_message(out)
        plane.await_mode(FlightMode.GUIDED, 5.0)

        def texts() -> list[str]:
            return [text for _, _, text in plane.flight.simulator.texts]

        plane.until(lambda: "Failsafe: outside the fence" in texts(), 90.0, "its autopilot notices the fence")
        plane.await_mode(FlightMode.RETURN, 1.0)
        plane.always(lambda: east_m(plane) < 1400.0, 30.0, "it turns back")
    finally:
        plane.close()


def low_battery_return(plane: Card) -> None:
    """Its autopilot returns by its own failsafe, while it is on the line to the east."""
    plane.await_state("away.off", "done", 40.0)
    plane.until(lambda: east_m(plane) > 100.0, 60.0, "it is on the line to the east")
    plane.flight.simulator.autopilot.parameters.set("BATT_FS_LOW_ACT", 1.0)
    plane.fault("battery=0.06")
    plane.await_mode(FlightMode.RETURN, 10.0)


def test_a_plane_whose_autopilot_returns_by_a_failsafe_and_circles_over_home_lands_in_the_end(tmp_path: Path) -> None:
    plane = Card("ardupilot", tmp_path)
    try:
        alone = whole_text("plane").replace("low_battery: {action: land, at: 0.1}", "{}")
        plane.begin(LINES + "on_low_battery: continue\n", platform=alone, parameters={"BATT_FS_LOW_ACT": 0.0})
        low_battery_return(plane)
        plane.until(lambda: plane.driver.is_failsafe, 5.0, "the driver sees the failsafe")
        plane.until(lambda: dist(ned_m(plane)[:2], (0.0, 0.0)) < 100.0, 90.0, "it is over home")
        plane.await_mode(FlightMode.HOLD, 120.0)
        plane.await_policy("land", 90.0)
        plane.await_landed(240.0)
    finally:
        plane.close()


def test_a_plane_that_its_pilot_returns_stays_with_the_pilot(plane: Card) -> None:
    try:
        plane.await_state("away.off", "done", 40.0)
        plane.until(lambda: east_m(plane) > 100.0, 60.0, "it is on the line to the east")
        plane.fault("pilot:return")
        plane.await_mode(FlightMode.RETURN, 5.0)
        plane.until(lambda: dist(ned_m(plane)[:2], (0.0, 0.0)) < 100.0, 90.0, "it is over home")
        plane.always(lambda: plane.autopilot.mode is FlightMode.RETURN, 150.0, "nothing of ours takes it away")
        assert plane.driver.has_pilot_control
    finally:
        plane.close()
