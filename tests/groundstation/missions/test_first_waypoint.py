"""Distance from a vehicle to the first waypoint of a mission, in every kind of frame."""

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.messages.motion import SiteSummary
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.missions.first_waypoint import far_away, first_waypoint_m
from gloc3_groundstation.station.snapshots import PlatformSnapshot, Timed

GEO = """mission: survey
frame: geo
tasks:
  all:
    actions:
      up: {{take_off: {{height_m: 10}}}}
      way: {{follow_waypoints: {{waypoints: [[{latitude}, 9.2, 10], [43.1, 9.2, 10]], speed_m_s: 5}}, after: [up]}}
      down: {{land: {{}}, after: [way]}}
"""
LOCAL = """mission: hold
frame: hold
tasks:
  all:
    actions:
      up: {{take_off: {{height_m: 2}}}}
      way: {{go_to: {{position_m: [{x}, 1, 2]}}, after: [up]}}
"""
SITE = SiteSummary(frame="hold", x_axis_bearing_deg=90.0, origin_geo=(43.1, 9.2, 12.0), home_m=(1.0, 1.0, 0.0))


def heron(vehicle: VehicleSummary = VEHICLE, site: SiteSummary | None = None) -> PlatformSnapshot:
    return PlatformSnapshot(
        name="heron",
        boot=1,
        first_received_s=0.0,
        received_s=0.0,
        vehicle=Timed(vehicle, 0.0),
        site=None if site is None else Timed(site, 0.0),
    )


@pytest.mark.parametrize("site", [None, SITE])
def test_it_is_measured_on_earth_from_the_vehicle_with_or_without_its_frame(site: SiteSummary | None) -> None:
    assert first_waypoint_m(GEO.format(latitude=43.2), heron(site=site)) == pytest.approx(11_110.0, abs=30.0)
    assert first_waypoint_m(GEO.format(latitude=43.101), heron(site=site)) == pytest.approx(111.0, abs=2.0)


@pytest.mark.parametrize("site", [None, SITE])
def test_it_is_measured_in_a_local_frame(site: SiteSummary | None) -> None:
    vehicle = replace(VEHICLE, position_m=(100.0, 1.0, 0.0))
    assert first_waypoint_m(LOCAL.format(x=3100), heron(vehicle, site)) == pytest.approx(3000.0, abs=0.1)


def test_what_is_not_known_is_not_guessed() -> None:
    far = GEO.format(latitude=43.2)
    assert first_waypoint_m(far, None) is None
    assert first_waypoint_m(far, heron(replace(VEHICLE, is_pose_valid=False))) is None
    assert first_waypoint_m(far, heron(replace(VEHICLE, geo=None))) is None
    assert first_waypoint_m("mission: none\n", heron()) is None


def test_only_kilometres_are_told() -> None:
    assert (
        far_away(GEO.format(latitude=43.2), "survey", heron()) == "the first waypoint of 'survey' is 11.1 km from heron"
    )
    assert far_away(GEO.format(latitude=43.11), "survey", heron()) == ""
