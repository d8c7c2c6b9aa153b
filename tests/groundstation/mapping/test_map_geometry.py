"""Where things lie on the map: frames of several vehicles, what a mission asks for, scales, progress along a path."""

from math import dist, hypot

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.groundstation.flown import SITE, TEXT
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.motion import SiteSummary
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.progress import PathProgress
from gloc3_groundstation.mapping.projection import Projection, length_text, round_length
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.station.snapshots import PlatformSnapshot, Timed

ORIGIN = GeoPoint(39.5528, 2.6285, 2.0)
GEO = """
mission: round
frame: geo
geofence: {circle: {center: [39.5528, 2.6285], radius_m: 80}}
tasks:
  go:
    actions:
      up: {take_off: {height_m: 5}}
      out: {follow_waypoints: {waypoints: [[39.5530, 2.6285, 10], [39.5530, 2.6290, 12]], speed_m_s: 2}, after: [up]}
"""


def platform(name: str, site: SiteSummary | None, vehicle: VehicleSummary = VEHICLE) -> PlatformSnapshot:
    return PlatformSnapshot(
        name=name,
        boot=1,
        first_received_s=0.0,
        received_s=0.0,
        vehicle=Timed(vehicle, 0.0),
        site=None if site is None else Timed(site, 0.0),
    )


def at(origin: GeoPoint, bearing_deg: float, frame: str = "field") -> SiteSummary:
    return SiteSummary(frame=frame, x_axis_bearing_deg=bearing_deg, origin_geo=(origin[0], origin[1], origin[2]))


def test_the_vehicle_in_view_lies_by_the_bearing_of_its_frame() -> None:
    heron = platform("heron", at(ORIGIN, 90.0))
    place = Ground(heron).place(heron)
    assert place is not None
    assert place.point((10.0, 3.0, 2.0)) == pytest.approx((3.0, 10.0, 2.0))
    assert place.local(3.0, 10.0) == pytest.approx((10.0, 3.0))
    assert place.plane(np.array([(10.0, 3.0)]))[0] == pytest.approx((3.0, 10.0))


def test_another_vehicle_is_placed_by_where_its_frame_lies_on_earth() -> None:
    elsewhere = LocalFrame(ORIGIN).to_geo((100.0, -50.0, 4.0))
    heron, tern = platform("heron", at(ORIGIN, 30.0)), platform("tern", at(elsewhere, 200.0))
    place = Ground(heron).place(tern)
    assert place is not None
    frame = LocalFrame(elsewhere, 200.0)
    expected = LocalFrame(ORIGIN).plane.ned_from_geo(*frame.to_geo((7.0, 2.0, 1.0)))
    assert place.point((7.0, 2.0, 1.0)) == pytest.approx((expected[0], expected[1], -expected[2]), abs=0.01)


def test_without_earth_only_vehicles_of_the_same_frame_share_a_map() -> None:
    unplaced = SiteSummary(frame="hold", x_axis_bearing_deg=0.0)
    heron = platform("heron", unplaced)
    ground = Ground(heron)
    assert ground.place(platform("tern", unplaced)) is not None
    assert ground.place(platform("gull", SiteSummary(frame="dock", x_axis_bearing_deg=0.0))) is None
    assert ground.geo(1.0, 1.0) is None


def test_a_vehicle_on_another_continent_is_not_on_the_map() -> None:
    heron = platform("heron", at(ORIGIN, 0.0))
    assert Ground(heron).place(platform("kiwi", at(GeoPoint(-41.3, 174.8, 0.0), 0.0))) is None


def test_before_the_site_is_known_x_counts_as_north_and_earth_follows_from_both_positions() -> None:
    place = LocalFrame(ORIGIN).to_geo((12.0, -5.0, 3.0))
    vehicle = msgspec.structs.replace(VEHICLE, position_m=(12.0, -5.0, 3.0), geo=tuple(place))
    ground = Ground(platform("heron", None, vehicle))
    assert not ground.has_north
    found = ground.geo(0.0, 0.0)
    assert found is not None
    assert found.latitude_deg == pytest.approx(ORIGIN.latitude_deg, abs=1e-7)
    assert found.longitude_deg == pytest.approx(ORIGIN.longitude_deg, abs=1e-7)


def test_a_mission_in_a_local_frame_is_laid_out_with_way_and_numbers() -> None:
    found = requested(TEXT, SITE)
    assert found is not None
    assert [way.target for way in found.paths] == ["depart.climb", "sweep.wall", "recover.home", "recover.down"]
    assert [waypoint.number for waypoint in found.waypoints] == [1, 2, 3, 4, 5]
    assert found.waypoints[1].position_ned_m == (12.0, -1.0, -2.0)
    assert found.path_ned_m[0] == found.path_ned_m[-1] == (0.0, 0.0, 0.0)
    assert sum(dist(a, b) for a, b in zip(found.path_ned_m, found.path_ned_m[1:], strict=False)) == pytest.approx(
        found.length_m, abs=0.1
    )
    assert found.fence is not None
    assert len(found.fence.keep_out) == 1
    assert found.fence.ceiling_m == 8.0


def test_a_turned_frame_turns_the_mission_and_home_moves_its_begin() -> None:
    site = msgspec.structs.replace(SITE, x_axis_bearing_deg=90.0, home_m=(1.0, 0.0, 0.0))
    found = requested(TEXT, site)
    assert found is not None
    assert found.waypoints[1].position_ned_m == pytest.approx((1.0, 12.0, -2.0))
    assert found.path_ned_m[0] == pytest.approx((0.0, 1.0, 0.0))


def test_a_mission_on_earth_is_laid_out_around_the_vehicles_origin() -> None:
    found = requested(GEO, at(ORIGIN, 0.0, ""))
    assert found is not None
    assert found.is_geo
    north, east, down = found.waypoints[0].position_ned_m
    assert (north, east, down) == pytest.approx((22.2, 0.0, -10.0), abs=0.1)
    assert found.fence is not None
    assert found.fence.area is not None
    assert found.fence.area.radius_m == 80.0


@pytest.mark.parametrize("text", ["", "]", "mission: x\nframe: dock\ntasks: {}\n", "mission: cargo hold\n"])
def test_what_cannot_be_placed_is_left_out(text: str) -> None:
    found = requested(text, SITE)
    assert found is None or found.paths == ()


@settings(max_examples=60)
@given(
    st.floats(-500, 500), st.floats(-500, 500), st.floats(0.01, 100), st.sampled_from([0.0, 90.0, 180.0, 270.0, 33.0])
)
def test_dots_and_places_are_two_ways_of_the_same_road(
    north: float, east: float, m_per_dot: float, up_deg: float
) -> None:
    projection = Projection(12.0, -7.0, m_per_dot, up_deg, 160, 80)
    assert projection.place(*projection.dot(north, east)) == pytest.approx((north, east), abs=1e-6)


def test_north_is_up_unless_the_map_is_turned() -> None:
    projection = Projection(0.0, 0.0, 0.5, 0.0, 160, 80)
    assert projection.dot(10.0, 0.0) == (80.0, 20.0)
    assert projection.dot(0.0, 10.0) == (100.0, 40.0)
    assert projection._replace(up_deg=90.0).dot(0.0, 10.0) == pytest.approx((80.0, 20.0))
    assert projection.moved(0.25, 0.0).east_m == pytest.approx(20.0)
    assert projection.moved(0.0, 0.5).north_m == pytest.approx(20.0)


def test_everything_is_seen_when_the_map_is_fitted() -> None:
    part = np.array([(-2.0, -12.0), (20.0, 2.0), (np.nan, np.nan), (5.0, 5.0)])
    for up_deg in (0.0, 90.0):
        projection = Projection(99.0, 99.0, 9.0, up_deg, 160, 80).fitted([part])
        dots = projection.dots(part[[0, 1, 3]])
        assert (dots.min(axis=0) >= 9.9).all()
        assert (dots.max(axis=0) <= np.array((150.1, 70.1))).all()
    assert Projection(1.0, 2.0, 9.0, 0.0, 160, 80).fitted([]) == Projection(1.0, 2.0, 9.0, 0.0, 160, 80)


@pytest.mark.parametrize(
    ("most", "length", "text"), [(7.3, 5.0, "5 m"), (1.0, 1.0, "1 m"), (0.34, 0.2, "20 cm"), (2600.0, 2000.0, "2 km")]
)
def test_the_scale_bar_is_round(most: float, length: float, text: str) -> None:
    assert round_length(most) == pytest.approx(length)
    assert length_text(round_length(most)) == text


def flown(
    points: list[tuple[float, float]], height_m: float = 2.0
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([(north, east, -height_m, float(n)) for n, (north, east) in enumerate(points)])


def test_progress_follows_the_path_and_does_not_jump_where_it_crosses_itself() -> None:
    there_and_back = [(0.0, 0.0, -2.0), (10.0, 0.0, -2.0), (10.0, 1.0, -2.0), (0.0, 1.0, -2.0)]
    progress = PathProgress(there_and_back)
    progress.advance(flown([(n / 2.0, 0.6) for n in range(19)]))
    assert progress.reached_m == pytest.approx(9.0)
    progress.advance(np.array([(9.0 - n / 2.0, 1.0, -3.0, 100.0 + n) for n in range(11)]))
    assert progress.reached_m == pytest.approx(17.0, abs=1.1)
    along = progress.flown
    assert (np.diff(along[:, 0]) >= 0.0).all()
    assert along[-1, 1] == 3.0


def test_progress_takes_each_point_once_and_begins_where_the_action_does() -> None:
    progress = PathProgress([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0)])
    points = flown([(60.0, 0.0), (61.0, 0.0)])
    progress.advance(points, at_least_m=59.0)
    progress.advance(points)
    assert len(progress.flown) == 2
    assert progress.reached_m == pytest.approx(61.0)
    assert hypot(*progress.flown[0]) > 59.0
