"""Missions on a computer that is always late: poses and setpoints stay away again and again, for less than a second each."""

from itertools import cycle
from pathlib import Path

import pytest
from tests.flight.card import Card

from gloc3.platform.reader import load_platform

MISSION = """\
mission: a corner and home
frame: FRAME
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  depart: {actions: {off: {SET_OFF}}}
  go: {after: [depart], actions: {way: {follow_waypoints: {waypoints_m: [[6, 0, H], [6, 6, H]], speed_m_s: 1}}}}
  recover: {after: [go], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""
AWAY = (("autopilot_pose", 0.9), ("setpoint", 0.7), ("autopilot_pose", 0.5), ("setpoint", 0.9), ("autopilot_pose", 0.3))
"""Topics, and for how long nothing comes on them."""
EVERY_S = 3.1
HOME_M = 2.0


@pytest.mark.both_styles
@pytest.mark.parametrize(
    ("platform", "style", "set_off", "height"),
    [
        ("pelican_rtk", "px4", "take_off: {height_m: 2}", 2),
        ("pelican_rtk", "ardupilot", "take_off: {height_m: 2}", 2),
        ("rover", "ardupilot", "drive_off: {}", 0),
        ("boat", "ardupilot", "drive_off: {}", 0),
    ],
)
def test_it_holds_goes_on_and_ends_at_home_however_often_something_is_late(
    platform: str, style: str, set_off: str, height: int, tmp_path: Path
) -> None:
    frame = next(iter(load_platform(platform).frames))
    text = MISSION.replace("FRAME", frame).replace("SET_OFF", set_off).replace("H]", f"{height}]")
    flight = Card(style, tmp_path)
    try:
        flight.begin(text, platform=platform, seed=1)
        flight.await_state("go", "running", 60.0)
        for topic, away_s in cycle(AWAY):
            if flight.mission.state != "running":
                break
            flight.fault(f"topic:{topic}=lost", for_s=away_s)
            flight.wait(EVERY_S)
            assert flight.now_s < 300.0, "it does not come to an end"
        assert (flight.mission.state, flight.mission.reason) == ("done", "")
        assert not flight.driver.has_pilot_control
        assert not [event.text for event in flight.events if "policy" in event.text]
        north, east, _ = flight.flight.truth.samples[-1].position_ned_m
        assert max(abs(north), abs(east)) < HOME_M
    finally:
        flight.close()
