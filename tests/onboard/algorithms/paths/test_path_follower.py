"""The point that the vehicle follows: speed on each leg, corners, rests, a vehicle that stays behind, and no jumps."""

import itertools
import math
from collections.abc import Callable, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.paths.path_follower import PathFollower, next_ahead

STEP_S = 0.05
WALL = [(2.0, 1.0, -2.0), (18.0, 1.0, -2.0), (18.0, 1.0, -4.0), (2.0, 1.0, -4.0)]


def perfect(at: Vector3, target: Vector3) -> Vector3:
    """A vehicle that is where it shall be."""
    return target


def sluggish(at: Vector3, target: Vector3) -> Vector3:
    """A vehicle that stays 0.4 s behind."""
    share = STEP_S / 0.4
    return tuple(a + (b - a) * share for a, b in zip(at, target, strict=True))  # type: ignore[return-value]


class Flight:
    """A follower and a vehicle, flown to the end."""

    def __init__(
        self,
        waypoints: Sequence[Vector3],
        speed: float = 0.5,
        *,
        start: Vector3 = (0.0, 0.0, -2.0),
        vehicle: Callable[[Vector3, Vector3], Vector3] = perfect,
        hold_s: float = 0.0,
        climb_m_s: float = 1.0,
    ) -> None:
        self.follower = PathFollower(start, waypoints, speed, 2.0, hold_s, climb_m_s=climb_m_s)
        self.vehicle, self.at = vehicle, start
        self.now_s = self.speed_m_s = 0.0
        self.targets = [start]
        self.places = [start]
        self.waypoints: list[int] = []

    def step(self, duration_s: float = STEP_S) -> None:
        self.now_s += duration_s
        target = self.follower.advance(duration_s, self.at)
        self.speed_m_s = math.hypot(*target.velocity_ned_m_s)
        self.at = self.vehicle(self.at, target.position_ned_m)
        self.targets.append(target.position_ned_m)
        self.places.append(self.at)
        self.waypoints.append(self.follower.waypoint)

    def to_end(self, within_s: float = 400.0) -> "Flight":
        while not (self.follower.is_at_end and math.dist(self.at, self.targets[-1]) < 0.25):
            assert self.now_s < within_s, f"at waypoint {self.follower.waypoint} after {within_s} s"
            self.step()
        return self

    def miss_m(self, waypoint: Vector3) -> float:
        return min(math.dist(place, waypoint) for place in self.places)

    def passed_s(self, waypoint: Vector3) -> float:
        """When the vehicle was nearest to it."""
        return STEP_S * min(range(len(self.places)), key=lambda index: math.dist(self.places[index], waypoint))


@pytest.mark.parametrize("angle_deg", [0, 20, 45, 90, 135, 180])
@pytest.mark.parametrize("vehicle", [perfect, sluggish])
def test_each_leg_takes_no_more_than_a_ninth_longer_than_asked(
    angle_deg: float, vehicle: Callable[[Vector3, Vector3], Vector3]
) -> None:
    way = [(0.0, 0.0, -2.0)]
    bearing = 0.0
    for _ in range(5):
        north, east, down = way[-1]
        way.append((north + 1.5 * math.cos(bearing), east + 1.5 * math.sin(bearing), down))
        bearing += math.radians(angle_deg)
    flight = Flight(way[1:], vehicle=vehicle)
    reached = [0.0]
    while len(reached) < len(way):
        flight.step()
        if math.dist(flight.targets[-1], way[len(reached)]) <= 0.05:
            reached.append(flight.now_s)
    speeds = [1.5 / (b - a) for a, b in itertools.pairwise(reached)]
    assert min(speeds) >= 0.9 * 0.5


@pytest.mark.parametrize("vehicle", [perfect, sluggish])
@pytest.mark.parametrize("speed", [0.5, 1.5, 3.0])
def test_every_waypoint_is_passed_near_enough(speed: float, vehicle: Callable[[Vector3, Vector3], Vector3]) -> None:
    flight = Flight(WALL, speed, vehicle=vehicle).to_end()
    assert max(flight.miss_m(waypoint) for waypoint in WALL) <= 0.25
    assert flight.waypoints == sorted(flight.waypoints)
    assert flight.follower.progress == 1.0


def test_waypoints_in_a_straight_line_cost_no_time() -> None:
    many = [(float(north), 0.0, -2.0) for north in range(1, 13)]
    assert Flight(many, 1.0).to_end().now_s == pytest.approx(Flight(many[-1:], 1.0).to_end().now_s, abs=0.1)


def test_a_vertical_leg_is_flown_at_the_climb_limit_and_has_no_bearing() -> None:
    flight = Flight([(0.0, 0.0, -5.0)], 3.0, climb_m_s=1.0)
    assert flight.follower.advance(0.0, flight.at).bearing_rad is None
    flight.to_end()
    assert flight.now_s == pytest.approx(4.0, abs=0.6)
    slanted = Flight([(3.0, 0.0, -5.0)], 3.0, climb_m_s=1.0).to_end()
    climbs = [(a[2] - b[2]) / STEP_S for a, b in zip(slanted.targets, slanted.targets[1:], strict=False)]
    assert max(climbs) == pytest.approx(1.0, abs=0.01)


def test_repeated_waypoints_are_one() -> None:
    a, b = (3.0, 0.0, -2.0), (3.0, 3.0, -2.0)
    flight = Flight([a, a, b, b, b]).to_end()
    assert flight.now_s == pytest.approx(Flight([a, b]).to_end().now_s)
    assert flight.follower.waypoint in (2, 4)


def test_a_single_waypoint_at_the_present_place_is_reached_at_once() -> None:
    flight = Flight([(0.0, 0.0, -2.0)])
    flight.step()
    assert flight.follower.is_at_end
    assert flight.follower.progress == 1.0
    assert flight.targets[-1] == (0.0, 0.0, -2.0)


def test_it_rests_at_each_waypoint_and_the_rest_begins_when_the_vehicle_is_there() -> None:
    legs = [(2.0, 0.0, -2.0), (2.0, 2.0, -2.0)]
    moving_s = Flight(legs, vehicle=sluggish).to_end().now_s
    flight = Flight(legs, vehicle=sluggish, hold_s=3.0).to_end()
    assert flight.now_s >= moving_s + 6.0
    near = sum(math.dist(place, legs[0]) <= 0.25 for place in flight.places) * STEP_S
    assert near >= 3.0
    here = Flight([(0.0, 0.0, -2.0), (2.0, 0.0, -2.0)], hold_s=3.0)
    here.to_end()
    assert here.now_s > 6.0 + 4.0


def test_the_point_waits_for_a_vehicle_that_does_not_come_and_says_how_long() -> None:
    flight = Flight([(9.0, 0.0, -2.0)], vehicle=lambda at, target: at)
    for _ in range(200):
        flight.step()
    assert math.dist(flight.targets[-1], flight.at) <= 2.0 * (0.3 + 0.35 * 0.5)
    assert flight.follower.waited_s == pytest.approx(7.0, abs=1.5)
    flight.vehicle = perfect
    flight.to_end()
    assert flight.follower.waited_s < 0.2


def test_at_a_corner_it_waits_until_the_vehicle_is_near() -> None:
    flight = Flight([(2.0, 0.0, -2.0), (2.0, 9.0, -2.0)], vehicle=lambda at, target: (min(target[0], 1.7), 0.0, -2.0))
    for _ in range(200):
        flight.step()
    assert flight.targets[-1] == pytest.approx((2.0, 0.0, -2.0))
    assert flight.follower.waypoint == 0
    assert flight.follower.progress < 0.5
    flight.vehicle = perfect
    flight.to_end()
    assert flight.follower.progress == 1.0


def test_a_vehicle_that_comes_slowly_is_waited_for_as_long_as_it_comes_nearer() -> None:
    def held(at: Vector3, target: Vector3) -> Vector3:
        return at

    flight = Flight([(1.0, 0.0, -2.0)], 0.5, start=(0.0, 3.0, -2.0), vehicle=held)
    flight.follower.slack_m = 5.0
    longest_s = 0.0
    for _ in range(2400):
        flight.step()
        x, y, z = flight.at
        flight.at = (x, y - 0.03 * STEP_S, z) if y > 0.0 else (x, y, z)
        longest_s = max(longest_s, flight.follower.waited_s) if y > 1.0 else longest_s
    assert longest_s < 10.0
    assert flight.follower.waited_s > 10.0, "it does not come nearer any more, and is not there"


def test_after_a_pause_the_vehicle_comes_back_to_where_it_left_the_way_at_the_ways_speed() -> None:
    flight = Flight([(6.0, 0.0, -2.0), (6.0, 6.0, -2.0)])
    for _ in range(100):
        flight.step()
    left = flight.targets[-1]
    travelled_m = flight.follower.travelled_m
    flight.at = (2.0, 4.0, -2.0)
    flight.targets.append(flight.at)
    flight.follower.rejoin(flight.at)
    begin = len(flight.targets) - 1
    flight.to_end()
    assert flight.miss_m(left) < 0.05
    steps = [math.dist(a, b) for a, b in zip(flight.targets[begin:], flight.targets[begin + 1 :], strict=False)]
    assert max(steps) <= 0.5 * STEP_S + 1e-6
    assert flight.follower.travelled_m == pytest.approx(flight.follower.length_m)
    assert travelled_m < flight.follower.length_m


def test_a_vehicle_that_was_taken_away_from_a_stop_comes_back_at_once_and_stops_there() -> None:
    first = (2.0, 0.0, -2.0)
    flight = Flight([first, (2.0, 4.0, -2.0)], hold_s=10.0)
    while flight.at != pytest.approx(first):
        flight.step()
    for _ in range(40):
        flight.step()
    flight.at = (2.0, -3.0, -2.0)
    flight.follower.rejoin(flight.at)
    begin = len(flight.places)
    flight.to_end()
    places = flight.places[begin:]
    assert sum(place == pytest.approx((2.0, -3.0, -2.0), abs=0.01) for place in places) * STEP_S < 1.0
    assert sum(place == pytest.approx(first) for place in places) * STEP_S == pytest.approx(10.0, abs=0.5)


def test_a_vehicle_that_was_taken_away_between_two_stops_does_not_stop_where_it_left_the_way() -> None:
    flight = Flight([(4.0, 0.0, -2.0), (4.0, 4.0, -2.0)], hold_s=20.0)
    for _ in range(80):
        flight.step()
    left = flight.targets[-1]
    assert 1.0 < left[0] < 3.0
    flight.at = (left[0], 3.0, -2.0)
    flight.follower.rejoin(flight.at)
    flight.to_end()
    assert flight.miss_m(left) < 0.05
    assert sum(math.dist(place, left) < 0.1 for place in flight.places) * STEP_S < 5.0
    assert flight.now_s == pytest.approx(40.0 + 3.0 / 0.5 + 8.0 / 0.5, abs=4.0)


def test_a_short_way_off_it_only_begins_again_from_rest() -> None:
    flight = Flight([(6.0, 0.0, -2.0)])
    for _ in range(60):
        flight.step()
    here = flight.targets[-1]
    flight.follower.rejoin((here[0] + 0.2, 0.0, -2.0))
    flight.step()
    assert 0.0 < flight.targets[-1][0] - here[0] < 0.01


points = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-6, -1))


@settings(max_examples=25)
@given(
    st.lists(points, min_size=1, max_size=4),
    st.floats(0.4, 4.0),
    st.lists(st.floats(0.02, 0.12), min_size=1, max_size=4),
    st.sampled_from([perfect, sluggish]),
)
def test_the_point_never_jumps_and_comes_to_the_end(
    waypoints: list[Vector3], speed: float, steps_s: list[float], vehicle: Callable[[Vector3, Vector3], Vector3]
) -> None:
    flight = Flight(waypoints, speed, vehicle=vehicle)
    progress = 0.0
    for count in range(20_000):
        duration_s = steps_s[count % len(steps_s)]
        before_s = steps_s[(count - 1) % len(steps_s)]
        before_m_s, waypoint = flight.speed_m_s, flight.follower.waypoint
        flight.step(duration_s)
        slack_m_s = 2e-3 / duration_s  # the last millimetre is made at once
        assert math.dist(flight.targets[-2], flight.targets[-1]) / duration_s <= speed * 1.001 + slack_m_s
        is_at_waypoint = flight.follower.waypoint != waypoint or flight.speed_m_s == 0.0
        most_m_s = 0.35 if is_at_waypoint else 2.0 * (duration_s + before_s) + slack_m_s
        assert abs(flight.speed_m_s - before_m_s) <= most_m_s
        assert flight.follower.progress >= progress - 0.011
        progress = flight.follower.progress
        if flight.follower.is_at_end:
            break
    assert flight.targets[-1] == pytest.approx(waypoints[-1])
    assert flight.follower.is_at_end


@pytest.mark.parametrize(
    ("position", "first", "expected"),
    [
        ((1.5, 0.0, -2.0), 1, 1),  # before it
        ((2.5, 0.1, -2.0), 1, 2),  # drifted past it along the way
        ((4.4, -0.1, -2.0), 1, 3),  # past two
        ((2.5, 0.5, -2.0), 1, 1),  # beside the way
        ((8.5, 0.0, -2.0), 1, 4),  # past the corner without having turned: back to it
        ((8.0, 1.0, -2.0), 4, 5),  # round the corner
        ((8.0, 9.0, -2.0), 4, 5),  # far beyond the last
    ],
)
def test_a_vehicle_that_drifted_on_is_led_to_the_waypoint_that_is_next_ahead(
    position: Vector3, first: int, expected: int
) -> None:
    way = [(0.0, 0.0, -2.0), (2.0, 0.0, -2.0), (4.0, 0.0, -2.0), (6.0, 0.0, -2.0), (8.0, 0.0, -2.0), (8.0, 4.0, -2.0)]
    assert next_ahead(position, way, first, 0.25) == expected


def test_a_way_out_and_back_is_not_cut_short() -> None:
    way = [(0.0, 0.0, -2.0), (8.0, 0.0, -2.0), (0.0, 0.0, -2.0)]
    assert next_ahead((5.0, 0.0, -2.0), way, 1, 0.25) == 1
    assert next_ahead((8.3, 0.0, -2.0), way, 1, 0.25) == 1
