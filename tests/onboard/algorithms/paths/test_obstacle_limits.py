"""The limiter before obstacles: it stops, slides along, goes around, and gives way to what comes nearer."""

import math
from collections.abc import Callable

import pytest
from tests.evidence.obstacles import LEAST_M, among_boxes
from tests.onboard.messages import LIMITS, grant, pose, setpoint
from tests.onboard.stage import Stage

from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import ObstacleScan, Setpoint
from gloc3_onboard.algorithms.mapping.movers import FORESIGHT_S, Movers
from gloc3_onboard.algorithms.mapping.obstacle_field import CLOSED_S, SLACK_M, STUCK_S, Detour, ObstacleField
from gloc3_onboard.algorithms.paths.motion_limits import AMONG_M_S, FENCE_AHEAD, SetpointLimiter
from gloc3_onboard.components.controllers.limiter import Limiter

pytestmark = pytest.mark.thorough

Points = list[tuple[float, float]]
STEP_S = 0.05
KEEP_M = 1.1


def outline(north: float, east: float, length: float, width: float, step: float = 0.05) -> Points:
    """The edges of a box, from its south-western corner."""
    along = [step * number for number in range(round(length / step) + 1)]
    across = [step * number for number in range(round(width / step) + 1)]
    ends = [(north + n, east + e) for n in along for e in (0.0, width)]
    return ends + [(north + n, east + e) for n in (0.0, length) for e in across]


class Room:
    """A limiter that is fed at 20 Hz among obstacles which it sees at 10 Hz; the vehicle is where the point was 0.3 s ago."""

    def __init__(self, points: Callable[[float], Points], start: Vector3 = (0.0, 0.0, -2.0)) -> None:
        self.limiter = SetpointLimiter(LIMITS)
        self.limiter.restart(start, (0.0, 0.0, 0.0), 0.0)
        self.points, self.movers = points, Movers()
        self.places: list[Vector3] = [start] * 7
        self.nearest_m = math.inf
        self.reasons: set[str] = set()

    def feed(self, wanted: Callable[[float], Setpoint], seconds: float) -> Vector3:
        for number in range(1, round(seconds / STEP_S) + 1):
            now_s, vehicle = STEP_S * number, self.places[-7]
            points = self.points(now_s)
            if number % 2:
                soon = self.movers.add_scan(points, vehicle, now_s)
                self.limiter.obstacles = ObstacleField(points, vehicle, KEEP_M, soon)
            before = self.places[-8] if len(self.places) > 7 else vehicle
            north, east, down = ((b - a) / STEP_S for a, b in zip(before, vehicle, strict=True))
            self.limiter.set_vehicle(vehicle, (north, east, down), now_s)
            limited = self.limiter.limit(wanted(now_s), now_s)
            assert limited.setpoint.position_ned_m is not None
            self.places.append(limited.setpoint.position_ned_m)
            self.reasons.add(limited.reason)
            self.nearest_m = min(self.nearest_m, *(math.dist(point, vehicle[:2]) for point in points))
        return self.places[-1]


def to(north: float, east: float) -> Callable[[float], Setpoint]:
    return lambda _: setpoint((north, east, -2.0))


def test_it_stops_before_a_wall_that_is_too_long_to_pass() -> None:
    wall = [(6.0, 0.1 * number) for number in range(-200, 201)]
    room = Room(lambda _: wall)
    end = room.feed(to(12.0, 0.0), 12.0)
    assert end[0] == pytest.approx(6.0 - KEEP_M, abs=SLACK_M + 0.02)
    assert room.nearest_m > KEEP_M - SLACK_M - 0.01
    assert FENCE_AHEAD in room.reasons


@pytest.mark.parametrize("east", [-0.4, 0.0, 0.3])
def test_it_goes_around_a_box_on_its_way(east: float) -> None:
    box = outline(4.0, -0.5, 1.0, 1.0)
    room = Room(lambda _: box)
    end = room.feed(to(9.0, east), 20.0)
    assert math.dist(end, (9.0, east, -2.0)) < 0.05
    assert room.nearest_m > KEEP_M - SLACK_M - 0.01


def test_it_slides_along_a_wall_that_the_way_comes_too_near_to() -> None:
    wall = [(0.1 * number, 1.0) for number in range(-50, 200)]
    room = Room(lambda _: wall)
    end = room.feed(lambda now_s: setpoint((0.8 * now_s, 0.6, -2.0)), 12.0)
    assert end[0] > AMONG_M_S * 12.0 - 1.0
    assert room.nearest_m > KEEP_M - SLACK_M - 0.01


def test_it_passes_through_a_gap_that_is_wide_enough_and_no_other() -> None:
    def wall(gap_m: float) -> Points:
        return [(4.0, 0.05 * number) for number in range(-100, 101) if abs(0.05 * number) > gap_m / 2.0]

    wide, narrow = Room(lambda _: wall(2.6)), Room(lambda _: wall(1.8))
    assert wide.feed(to(8.0, 0.0), 14.0)[0] > 7.9
    assert narrow.feed(to(8.0, 0.0), 14.0)[0] < 4.0
    assert min(wide.nearest_m, narrow.nearest_m) > KEEP_M - SLACK_M - 0.01


@pytest.mark.parametrize("speed_m_s", [0.2, 0.5, 0.8])
def test_a_hovering_vehicle_gives_way_to_a_box_that_comes(speed_m_s: float) -> None:
    room = Room(lambda now_s: outline(5.0 - speed_m_s * now_s, -0.5, 0.6, 1.0, 0.1))
    room.feed(to(0.0, 0.0), 6.0 / speed_m_s)
    assert room.nearest_m > 0.5


def test_a_box_that_crosses_the_way_is_not_met() -> None:
    room = Room(lambda now_s: outline(4.0, 4.0 - 0.6 * now_s, 0.8, 0.8, 0.1))
    end = room.feed(lambda now_s: setpoint((min(0.8 * now_s, 9.0), 0.0, -2.0)), 16.0)
    assert end[0] > 8.9
    assert room.nearest_m > 0.5


def test_who_flees_from_what_comes_out_of_a_box_beside_it_is_not_stopped_by_what_is_not_there_yet() -> None:
    found = among_boxes(10)
    assert found["state"] == "done"
    assert found["nearest_m"] > LEAST_M


def test_what_moves_is_told_where_it_will_be_and_the_wall_behind_it_is_not() -> None:
    movers, wall = Movers(), [(8.0, 0.1 * number) for number in range(-60, 61)]
    for number in range(12):
        box = outline(5.0 - 0.05 * number, -0.5, 0.6, 1.0, 0.1)
        soon = movers.add_scan([*box, *wall], (0.0, 0.0, 0.0), 0.1 * number)
    face = 5.0 - 0.05 * 11
    assert min(north for north, _ in soon) == pytest.approx(face - 0.5 * FORESIGHT_S[-1], abs=0.25)
    assert all(north < face + 0.5 and abs(east) < 0.6 for north, east in soon)


def test_noise_a_vehicle_that_moves_and_a_pose_that_jumps_are_no_motion() -> None:
    movers, box = Movers(), outline(4.0, -0.5, 1.0, 1.0)
    for number in range(20):
        noise_m = 0.02 * (-1) ** number
        points = [(north + noise_m, east + noise_m) for north, east in box]
        at = (0.08 * number, 0.05 * number, 0.0)
        assert movers.add_scan(points, at, 0.1 * number) == []
    jumped = [(north - 0.5, east) for north, east in box]
    assert movers.add_scan(jumped, (1.1, 1.0, 0.0), 2.0, resets=1) == []
    assert movers.add_scan([(n - 0.3, e) for n, e in jumped], (1.1, 1.0, 0.0), 2.5, resets=1)


def test_a_detour_stays_on_its_side() -> None:
    detour = Detour()
    left = detour.heading(ObstacleField([(1.5, 0.1)], (0.0, 0.0, 0.0), KEEP_M), (0.0, 0.0, 0.0), 0.0, 5.0, 0.0)
    again = detour.heading(ObstacleField([(1.5, -0.1)], (0.0, 0.0, 0.0), KEEP_M), (0.0, 0.0, 0.0), 0.0, 5.0, 0.1)
    assert left[0] < 0.0
    assert again[0] < 0.0


def test_a_side_that_does_not_lead_on_is_given_up_for_a_while() -> None:
    detour, field, at = Detour(), ObstacleField([(1.5, 0.1)], (0.0, 0.0, 0.0), KEEP_M), (0.0, 0.0, 0.0)
    turns = {now_s: detour.heading(field, at, 0.0, 5.0, now_s)[0] for now_s in (0.0, STUCK_S, STUCK_S + 0.1)}
    assert (turns[0.0] < 0.0, turns[STUCK_S] < 0.0, turns[STUCK_S + 0.1] > 0.0) == (True, True, True)
    later = [detour.heading(field, (0.0, 0.5 * n, 0.0), 0.0, 5.0, STUCK_S + n)[0] for n in range(1, round(CLOSED_S))]
    assert min(turn for turn in later if turn) > 0.0


def test_the_component_keeps_away_from_what_it_was_told_and_forgets_it_after_a_while() -> None:
    stage = Stage(Limiter())
    stage.step(limits=LIMITS, grant=grant("go"), pose=pose())
    wall = ObstacleScan(points_ne_m=[(1.5, 0.1 * number) for number in range(-50, 51)])
    for _ in range(100):
        stage.step(pose=pose(), obstacles=wall, setpoint_wanted=setpoint((4.0, 0.0, -2.0)))
    held = stage.last(Setpoint).position_ned_m
    assert held is not None
    assert held[0] < 1.5 - KEEP_M + SLACK_M + 0.01
    for _ in range(200):
        stage.step(pose=pose(), setpoint_wanted=setpoint((4.0, 0.0, -2.0)))
    lost = stage.last(Setpoint).position_ned_m
    assert lost is not None
    assert lost[0] == pytest.approx(4.0, abs=0.01)
