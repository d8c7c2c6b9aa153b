"""Frames: round trips, known points and the meaning of each axis."""

from math import cos, hypot, pi, radians, sin, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.messages import frames
from gloc3.messages.frames import GeoPoint, LocalFrame, Quaternion, TangentPlane, Vector3

angles = st.floats(-50.0, 50.0)
small = st.floats(-1000.0, 1000.0)
vectors = st.tuples(small, small, small)
latitudes = st.floats(-89.0, 89.0)
longitudes = st.floats(-180.0, 180.0)
places = st.builds(GeoPoint, latitudes, longitudes, st.floats(-100.0, 5000.0))
unit = st.floats(-1.0, 1.0)
quaternions = st.tuples(unit, unit, unit, unit).filter(lambda q: sum(c * c for c in q) > 1e-3).map(frames.normalize)
bounded = settings(max_examples=30)


def near(a: tuple[float, ...], b: tuple[float, ...], tolerance: float) -> bool:
    return all(abs(x - y) <= tolerance for x, y in zip(a, b, strict=True))


@bounded
@given(angles)
def test_wrapped_angles_point_the_same_way(angle: float) -> None:
    wrapped = frames.wrap_pi(angle)
    assert -pi <= wrapped < pi + 1e-12
    assert cos(wrapped) == pytest.approx(cos(angle), abs=1e-9)
    assert sin(wrapped) == pytest.approx(sin(angle), abs=1e-9)


@bounded
@given(quaternions, vectors)
def test_rotating_there_and_back_changes_nothing(q: Quaternion, v: Vector3) -> None:
    turned = frames.rotate(q, v)
    assert near(frames.rotate_back(q, turned), v, 1e-9 * 1000)
    assert sqrt(sum(c * c for c in turned)) == pytest.approx(sqrt(sum(c * c for c in v)), abs=1e-6)


@bounded
@given(quaternions, quaternions, vectors)
def test_chained_rotations_rotate_one_after_the_other(a: Quaternion, b: Quaternion, v: Vector3) -> None:
    assert near(frames.rotate(frames.multiply(a, b), v), frames.rotate(a, frames.rotate(b, v)), 1e-6)
    assert near(frames.multiply(a, frames.conjugate(a)), frames.IDENTITY, 1e-9)


@bounded
@given(quaternions, quaternions, st.floats(0.0, 1.0))
def test_between_two_rotations_the_way_is_the_shorter_one_and_even(a: Quaternion, b: Quaternion, share: float) -> None:
    way = frames.to_rotation_vector(frames.multiply(frames.conjugate(a), b))
    part = frames.to_rotation_vector(frames.multiply(frames.conjugate(a), frames.slerp(a, b, share)))
    assert near(part, (way[0] * share, way[1] * share, way[2] * share), 1e-6)
    assert sqrt(sum(c * c for c in part)) <= pi + 1e-9


def test_interpolation_goes_from_the_first_point_to_the_second() -> None:
    assert frames.interpolate((0.0, 2.0, 4.0), (2.0, 2.0, 0.0), 0.25) == (0.5, 2.0, 3.0)
    assert frames.interpolate((0.0, 2.0, 4.0), (2.0, 2.0, 0.0), 1.5) == (3.0, 2.0, -2.0)


@bounded
@given(st.floats(-pi, pi), st.floats(-1.5, 1.5), st.floats(-pi, pi))
def test_euler_angles_come_back(roll: float, pitch: float, yaw: float) -> None:
    q = frames.from_euler(roll, pitch, yaw)
    assert q[0] >= 0.0
    back = frames.to_euler(q)
    assert near(tuple(frames.wrap_pi(x - y) for x, y in zip(back, (roll, pitch, yaw), strict=True)), (0, 0, 0), 1e-6)
    assert frames.wrap_pi(frames.yaw_of(q) - yaw) == pytest.approx(0.0, abs=1e-6)


@bounded
@given(st.tuples(st.floats(-1.7, 1.7), st.floats(-1.7, 1.7), st.floats(-1.7, 1.7)))
def test_rotation_vectors_come_back(rotation: Vector3) -> None:
    assert near(frames.to_rotation_vector(frames.from_rotation_vector(rotation)), rotation, 1e-9)


def test_a_body_that_turned_right_by_90_degrees_has_its_nose_to_the_east() -> None:
    assert near(frames.rotate(frames.from_yaw(pi / 2), (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0), 1e-12)
    assert near(frames.from_yaw(pi / 2), frames.from_euler(0.0, 0.0, pi / 2), 1e-12)


def test_a_nose_up_pitch_lifts_the_forward_axis_and_a_right_roll_lowers_the_right_one() -> None:
    assert frames.rotate(frames.from_euler(0.0, 0.1, 0.0), (1.0, 0.0, 0.0))[2] < 0.0
    assert frames.rotate(frames.from_euler(0.1, 0.0, 0.0), (0.0, 1.0, 0.0))[2] > 0.0


def test_a_pitch_straight_up_does_not_fail() -> None:
    assert frames.to_euler(frames.from_euler(0.0, pi / 2, 0.3))[1] == pytest.approx(pi / 2)
    assert frames.normalize((0.0, 0.0, 0.0, 0.0)) == frames.IDENTITY


@bounded
@given(places)
def test_a_place_comes_back_from_earth_centred_coordinates(place: GeoPoint) -> None:
    back = frames.geo_from_ecef(*frames.ecef_from_geo(place))
    assert abs(back.latitude_deg - place.latitude_deg) * 111_000 < 1e-6
    assert abs(frames.wrap_pi(radians(back.longitude_deg - place.longitude_deg))) * 6.4e6 < 1e-6
    assert abs(back.altitude_m - place.altitude_m) < 1e-6


def test_earth_centred_coordinates_of_known_places() -> None:
    assert near(frames.ecef_from_geo(GeoPoint(0.0, 0.0, 0.0)), (6_378_137.0, 0.0, 0.0), 1e-6)
    assert near(frames.ecef_from_geo(GeoPoint(90.0, 0.0, 0.0)), (0.0, 0.0, 6_356_752.314245), 1e-6)
    assert near(frames.ecef_from_geo(GeoPoint(0.0, 90.0, 100.0)), (0.0, 6_378_237.0, 0.0), 1e-6)


@bounded
@given(places, vectors)
def test_ned_positions_come_back_through_geodetic_ones(origin: GeoPoint, position: Vector3) -> None:
    plane = TangentPlane(origin)
    assert near(plane.ned_from_geo(*plane.geo_from_ned(position)), position, 1e-5)


@bounded
@given(latitudes, longitudes)
def test_a_small_step_north_or_east_has_the_length_of_the_ellipsoid_s_radii(latitude: float, longitude: float) -> None:
    e2 = frames.WGS84_F * (2 - frames.WGS84_F)
    root = sqrt(1 - e2 * sin(radians(latitude)) ** 2)
    meridian, normal = frames.WGS84_A_M * (1 - e2) / root**3, frames.WGS84_A_M / root
    plane = TangentPlane(GeoPoint(latitude, longitude, 0.0))
    step_deg = 1e-4
    north = plane.ned_from_geo(latitude + step_deg, longitude, 0.0)
    assert north[0] == pytest.approx(radians(step_deg) * meridian, abs=1e-3)
    assert abs(north[1]) < 1e-6
    east = plane.ned_from_geo(latitude, longitude + step_deg, 0.0)
    assert east[1] == pytest.approx(radians(step_deg) * normal * cos(radians(latitude)), abs=1e-3)
    assert plane.ned_from_geo(latitude, longitude, 10.0) == pytest.approx((0.0, 0.0, -10.0), abs=1e-6)


def test_the_plane_leaves_the_ground_by_7_mm_at_300_m() -> None:
    plane = TangentPlane(GeoPoint(47.4, 8.5, 488.0))
    assert plane.geo_from_ned((300.0, 0.0, 0.0)).altitude_m - 488.0 == pytest.approx(0.00707, abs=2e-4)


def test_x_lies_along_the_bearing_and_y_to_its_left() -> None:
    north_up = LocalFrame(GeoPoint(39.6, 2.6, 5.0))
    assert near(north_up.to_ned((1.0, 0.0, 0.0)), (1.0, 0.0, 0.0), 1e-12)
    assert near(north_up.to_ned((0.0, 1.0, 0.0)), (0.0, -1.0, 0.0), 1e-12)
    assert near(north_up.to_ned((0.0, 0.0, 2.0)), (0.0, 0.0, -2.0), 1e-12)
    eastward = LocalFrame(GeoPoint(39.6, 2.6, 5.0), 90.0)
    assert near(eastward.to_ned((1.0, 0.0, 0.0)), (0.0, 1.0, 0.0), 1e-12)
    assert near(eastward.to_ned((0.0, 1.0, 0.0)), (1.0, 0.0, 0.0), 1e-12)


@bounded
@given(places, st.floats(0.0, 360.0), vectors)
def test_local_positions_come_back(origin: GeoPoint, bearing_deg: float, position: Vector3) -> None:
    frame = LocalFrame(origin, bearing_deg)
    assert near(frame.from_ned(frame.to_ned(position)), position, 1e-9 * 1000)
    assert near(frame.from_geo(*frame.to_geo(position)), position, 1e-5)
    ned = frame.to_ned(position)
    assert hypot(ned[0], ned[1]) == pytest.approx(hypot(position[0], position[1]), abs=1e-6)
