"""The rover drives through a gap of satellites by its wheels, and goes on where its wheels tell nothing."""

from pathlib import Path

from tests.flight.driving_blind import drive

MISSION = """\
mission: under a bridge
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  away: {actions: {off: {drive_off: {}}}}
  box:
    after: [away]
    actions:
      way: {follow_waypoints: {waypoints_m: [[14, 0, 0], [14, -9, 0], [0, -9, 0]], speed_m_s: 1.5, acceptance_m: 1.5}}
  back: {after: [box], actions: {end: {land: {}}}}
"""


def test_it_drives_through_a_gap_by_its_wheels_and_the_autopilot_flies_by_its_pose_meanwhile(tmp_path: Path) -> None:
    found = drive(MISSION, tmp_path, away=(10.0, 30.0), seed=5)
    assert found.state == "done"
    assert not found.reasons
    assert ("wheels", "heading") in found.sources
    assert found.distance_m > 18.0
    assert found.off_m < 0.03 * found.distance_m
    assert found.off_m < 3.0 * found.claimed_m
    assert found.turns == 3, "satellites, wheels, satellites"


def test_wheels_whose_encoders_have_failed_are_found_out_by_satellites(tmp_path: Path) -> None:
    found = drive(MISSION, tmp_path, away=(590.0, 600.0), faults=("sensor:wheels=stuck@10..300",))
    assert found.state == "done"
    assert ("autopilot", "heading", "satellites") in found.sources
    assert found.worst_m < 6.0, "three fixes' way at 1.5 m/s"
