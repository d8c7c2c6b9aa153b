"""Loops, guards, patterns and contingencies in the air: one short flight of the whole stack that meets all of them."""

from pathlib import Path

import pytest

from gloc3.clock import run_virtual
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.flight import DEVICES
from gloc3_sitl.flight.fly import FlyOptions, fly_mission

pytestmark = pytest.mark.flight

MISSION = """\
mission: two laps with a refuge
frame: hold
on_link_loss: {task: refuge, then: resume}
tasks:
  laps:
    repeat: {times: 2, until: {battery: {below: 0.1}}}
    actions:
      begin: {depart: {}}
      lap:   {transit: {to_m: [[3, 1], [3, 3]]}, after: [begin]}
      high:  {hold: {duration_s: 2}, after: [lap], when: {height_m: {above: 3}}}
      low:   {hold: {duration_s: 1}, after: [high], when: {altitude_m: {below: 3}}}
      end:   {arrive: {}, after: [low]}
contingencies:
  refuge:
    actions:
      away: {transit: {to_m: [[2, 2]]}}
"""


def test_a_lap_is_flown_twice_with_a_refuge_on_the_way_and_what_it_took_stands_beside_the_estimate(
    tmp_path: Path,
) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(MISSION, encoding="utf-8")
    platform = load_platform("pelican_rtk", is_loading_classes=True, devices=DEVICES)
    options = FlyOptions(mission=file, faults=("link_loss@5..12",))
    report = run_virtual(fly_mission(options, platform, None, 0.0))
    assert (report.mission_state, report.tasks["laps.end"], report.tasks["refuge"]) == ("done", "done", "done")
    reported = [event.partition("mission: ")[2] for event in report.events]
    assert reported.count("laps.begin done") == reported.count("laps.end done") == 2
    assert reported.count("laps.high skipped: not height above 3 m") == reported.count("laps.low done") == 2
    assert (
        reported.index("contingency refuge: link lost")
        < reported.index("refuge.away done")
        < reported.index("laps: 2 of 2")
    )
    assert report.estimate["distance_m"] == pytest.approx(report.distance_m, rel=0.4)
    assert report.estimate["mission_time_s"] < report.mission_time_s < 2.0 * report.estimate["mission_time_s"]
    assert report.energy_wh == pytest.approx(report.estimate["energy_wh"], rel=0.6)
