"""The limiter's algorithm: what it lets pass, how it approaches, and that the fence is kept at speed."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.onboard.messages import LIMITS, setpoint

from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import MotionLimits
from gloc3.mission.model.fence import Area, Fence
from gloc3_onboard.algorithms.paths.motion_limits import Limited, SetpointLimiter, is_finite

STEP_S = 0.05
SQUARE = ((-2.0, -2.0), (20.0, -2.0), (20.0, 12.0), (-2.0, 12.0))
HORSESHOE = ((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (12.0, 20.0), (12.0, 6.0), (8.0, 6.0), (8.0, 20.0), (0.0, 20.0))


def fenced(
    *, area: Area | None = None, keep_out: tuple[Area, ...] = (), ceiling_m: float | None = None
) -> MotionLimits:
    return replace(LIMITS, fence=Fence(area=area, keep_out=keep_out, ceiling_m=ceiling_m))


class Stream:
    """A limiter that is fed at 20 Hz, and what came out of it."""

    def __init__(self, limits: MotionLimits, start: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.limiter = SetpointLimiter(limits)
        self.limiter.restart(start, velocity, 0.0)
        self.now_s = 0.0
        self.out: list[Limited] = []

    def feed(self, position: Vector3 | None, velocity: Vector3 | None = None, seconds: float = STEP_S) -> Limited:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.out.append(self.limiter.limit(setpoint(position, velocity), self.now_s))
        return self.out[-1]

    @property
    def places(self) -> list[Vector3]:
        found = [limited.setpoint.position_ned_m for limited in self.out]
        return [place for place in found if place is not None]

    def speeds(self) -> list[Vector3]:
        pairs = zip(self.places, self.places[1:], strict=False)
        return [((b[0] - a[0]) / STEP_S, (b[1] - a[1]) / STEP_S, (b[2] - a[2]) / STEP_S) for a, b in pairs]


def test_what_obeys_all_limits_passes_to_the_millimetre() -> None:
    stream = Stream(fenced(area=Area(polygon_ne_m=SQUARE)), (0.0, 0.0, -2.0))
    speed = 0.0
    north = 0.0
    for _ in range(200):
        speed = min(0.5, speed + 2.0 * STEP_S)
        north += speed * STEP_S
        out = stream.feed((north, 0.0, -2.0), (speed, 0.0, 0.0))
        assert out.setpoint == setpoint((north, 0.0, -2.0), (speed, 0.0, 0.0))
        assert not out.is_clamped


@pytest.mark.parametrize(("speed_m_s", "within_s", "most_m_s2"), [(0.7, 0.9, 1.1), (3.0, 1.9, 2.6)])
def test_where_it_is_to_hold_at_once_it_slows_down_as_the_vehicle_can(
    speed_m_s: float, within_s: float, most_m_s2: float
) -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0), (speed_m_s, 0.0, 0.0))
    stream.limiter.careful_m_s = 0.0
    stream.feed((40.0, 0.0, -2.0), seconds=3.0)
    speeds = [north for north, _, _ in stream.speeds()]
    assert max(a - b for a, b in pairwise(speeds)) / STEP_S < most_m_s2
    assert speeds[round(within_s / STEP_S)] == pytest.approx(0.0, abs=0.01)
    assert stream.places[-1] == stream.places[-2]


def test_behind_a_target_that_moves_on_it_slows_down_no_faster() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0), (0.7, 0.0, 0.0))
    for number in range(1, 61):
        stream.limiter.careful_m_s = 0.0 if number > 20 else math.inf
        stream.feed((0.7 * STEP_S * number, 0.0, -2.0), (0.7, 0.0, 0.0))
    speeds = [north for north, _, _ in stream.speeds()]
    assert speeds[18] == pytest.approx(0.7)
    assert max(a - b for a, b in pairwise(speeds[18:])) / STEP_S < 1.1
    assert speeds[-1] == pytest.approx(0.0, abs=0.01)


def test_a_far_position_is_approached_within_speed_and_acceleration_and_without_overshoot() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    out = stream.feed((10.0, 0.0, -2.0), seconds=2.0)
    assert out.is_clamped
    assert out.setpoint.velocity_ned_m_s == pytest.approx((3.0, 0.0, 0.0))
    stream.feed((10.0, 0.0, -2.0), seconds=6.0)
    assert stream.places[-1] == pytest.approx((10.0, 0.0, -2.0))
    assert max(place[0] for place in stream.places) <= 10.0 + 1e-9
    assert not stream.out[-1].is_clamped


def test_the_feed_forward_agrees_with_how_the_clamped_position_moves() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    stream.feed((50.0, 30.0, -9.0), (8.0, 0.0, 0.0), seconds=4.0)
    for before, after, limited in zip(stream.places, stream.places[1:], stream.out[1:], strict=False):
        moved = tuple((b - a) / STEP_S for a, b in zip(before, after, strict=True))
        assert limited.setpoint.velocity_ned_m_s == pytest.approx(moved, abs=1e-6)


def test_a_feed_forward_that_belies_the_position_is_not_passed_on() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    out = stream.feed((0.0, 0.0, -2.0), (2.0, 0.0, 0.0), seconds=1.0)
    assert out.setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0))
    assert out.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -2.0))


def test_a_moving_position_without_a_velocity_is_followed_closely() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    for step in range(100):
        stream.feed((step * 0.025, 0.0, -2.0))
    assert stream.places[-1] == pytest.approx((99 * 0.025, 0.0, -2.0))


@pytest.mark.parametrize(("wanted_m", "reached_m"), [(0.0, 2.3), (50.0, 32.0), (5.0, 5.0)])
def test_heights_count_from_home_not_from_the_origin(wanted_m: float, reached_m: float) -> None:
    limits = replace(LIMITS, home_ned_m=(3.0, 4.0, -2.0))
    stream = Stream(limits, (0.0, 0.0, -6.0))
    out = stream.feed((0.0, 0.0, -wanted_m), seconds=40.0)
    assert out.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -reached_m))
    assert out.is_clamped == (wanted_m != reached_m)


def test_before_home_is_known_no_height_is_wrong_but_the_ceiling_holds() -> None:
    limits = replace(fenced(ceiling_m=8.0), home_ned_m=None)
    stream = Stream(limits, (0.0, 0.0, -0.1))
    assert not stream.feed((0.0, 0.0, -0.1), seconds=0.2).is_clamped
    out = stream.feed((0.0, 0.0, -50.0), seconds=12.0)
    assert out.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -7.5))


def test_a_position_outside_the_fence_becomes_the_nearest_inside() -> None:
    stream = Stream(fenced(area=Area(polygon_ne_m=SQUARE)), (10.0, 5.0, -2.0))
    out = stream.feed((10.0, 30.0, -2.0), seconds=10.0)
    assert out.setpoint.position_ned_m == pytest.approx((10.0, 11.5, -2.0), abs=1e-4)
    assert "nearer to the fence than 0.5 m" in out.reason
    out = stream.feed((90.0, 30.0, -2.0), seconds=10.0)
    assert out.setpoint.position_ned_m == pytest.approx((19.5, 11.5, -2.0), abs=1e-3)


def test_a_target_that_runs_along_outside_is_followed_along_the_inside() -> None:
    stream = Stream(fenced(area=Area(polygon_ne_m=SQUARE)), (0.0, 11.0, -2.0))
    for step in range(300):
        stream.feed((step * 0.05, 14.0, -2.0), (1.0, 0.0, 0.0))
    assert stream.places[-1][0] == pytest.approx(14.95, abs=0.1)
    assert stream.places[-1][1] == pytest.approx(11.5, abs=1e-3)


def test_the_arm_of_a_concave_fence_is_not_cut_across() -> None:
    fence = Fence(area=Area(polygon_ne_m=HORSESHOE))
    stream = Stream(replace(LIMITS, fence=fence), (4.0, 18.0, -2.0))
    out = stream.feed((16.0, 18.0, -2.0), seconds=20.0)
    assert min(fence.clearance_m(place) for place in stream.places) >= 0.5 - 1e-5
    assert out.setpoint.position_ned_m == pytest.approx((7.5, 18.0, -2.0), abs=0.05)
    assert "the fence blocks the path" in out.reason


@pytest.mark.thorough
def test_keep_outs_are_not_entered_from_any_side() -> None:
    fence = Fence(
        keep_out=(Area(center_ne_m=(5.0, 0.0), radius_m=2.0), Area(polygon_ne_m=((9, -1), (11, -1), (11, 1), (9, 1))))
    )
    for start in ((0.0, 0.0, -2.0), (7.8, 0.0, -2.0), (5.0, 6.0, -2.0), (14.0, 0.3, -2.0)):
        stream = Stream(replace(LIMITS, fence=fence), start)
        stream.feed((5.0, 0.5, -2.0), seconds=5.0)
        stream.feed((10.0, 0.2, -2.0), seconds=8.0)
        assert min(fence.clearance_m(place) for place in stream.places) >= 0.5 - 1e-5


def test_from_outside_the_way_leads_back_in_and_never_farther_out() -> None:
    fence = Fence(area=Area(polygon_ne_m=SQUARE))
    stream = Stream(replace(LIMITS, fence=fence), (10.0, 15.0, -2.0))
    stream.feed((10.0, 20.0, -2.0), seconds=6.0)
    clearances = [fence.clearance_m(place) for place in stream.places]
    assert clearances == sorted(clearances)
    assert stream.places[-1] == pytest.approx((10.0, 11.5, -2.0), abs=1e-3)


def test_at_speed_it_brakes_in_front_of_the_wall_also_when_the_fence_has_come_later() -> None:
    stream = Stream(LIMITS, (0.0, 5.0, -2.0))
    stream.feed((30.0, 5.0, -2.0), seconds=3.0)
    assert stream.places[-1][0] < 19.5 - 1.8
    stream.limiter.limits = fenced(area=Area(polygon_ne_m=SQUARE))
    stream.feed((30.0, 5.0, -2.0), seconds=10.0)
    assert max(place[0] for place in stream.places) <= 19.5 + 1e-5


def test_velocities_without_a_position_are_held_at_the_fence_too() -> None:
    fence = Fence(area=Area(polygon_ne_m=SQUARE), ceiling_m=8.0)
    limiter = SetpointLimiter(replace(LIMITS, fence=fence))
    north, down, now_s = 0.0, -5.0, 0.0
    for _ in range(400):
        now_s += STEP_S
        limiter.set_vehicle((north, 5.0, down), (0.0, 0.0, 0.0), now_s)
        velocity = limiter.limit(setpoint(None, (9.0, 0.0, -3.0)), now_s).setpoint.velocity_ned_m_s
        assert velocity is not None
        north, down = north + velocity[0] * STEP_S, down + velocity[2] * STEP_S
    assert north == pytest.approx(19.5, abs=0.05)
    assert north <= 19.5 + 1e-5
    assert down >= -7.5 - 1e-5


def test_another_owner_goes_on_from_where_the_setpoint_is() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    stream.feed((10.0, 0.0, -2.0), seconds=2.0)
    stream.limiter.set_vehicle((stream.places[-1][0] - 0.4, 0.1, -2.1), (2.5, 0.0, 0.0), stream.now_s)
    stream.feed((5.0, 3.0, -2.0), seconds=2.0)
    changes = [math.dist(a, b) for a, b in zip(stream.speeds(), stream.speeds()[1:], strict=False)]
    assert max(changes) <= 2.5 * STEP_S * 1.01 + 2e-3


def test_after_a_gap_the_stream_begins_at_the_vehicle() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    stream.feed((10.0, 0.0, -2.0), seconds=2.0)
    stream.now_s += 1.0
    stream.limiter.set_vehicle((1.0, 1.0, -3.0), (0.0, 0.0, 0.0), stream.now_s + STEP_S)
    out = stream.feed((10.0, 0.0, -2.0))
    assert out.setpoint.position_ned_m == pytest.approx((1.0, 1.0, -3.0))


def test_a_jump_of_the_estimate_is_no_step_for_the_vehicle() -> None:
    stream = Stream(LIMITS, (0.0, 0.0, -2.0))
    limiter = stream.limiter
    for step in range(40):
        limiter.set_vehicle((step * 0.025, 0.0, -2.0), (0.5, 0.0, 0.0), stream.now_s + STEP_S, resets=0)
        stream.feed((step * 0.025, 0.0, -2.0), (0.5, 0.0, 0.0))
    before = stream.places[-1][0] - 39 * 0.025
    limiter.set_vehicle((40 * 0.025 + 0.8, 0.0, -2.0), (0.5, 0.0, 0.0), stream.now_s + STEP_S, resets=1)
    stream.feed((41 * 0.025, 0.0, -2.0), (0.5, 0.0, 0.0))
    after = stream.places[-1][0] - (40 * 0.025 + 0.8)
    assert after == pytest.approx(before, abs=0.05)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_told(bad: float) -> None:
    assert is_finite(setpoint((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)))
    assert not is_finite(setpoint((1.0, bad, 3.0)))
    assert not is_finite(setpoint(None, (0.0, 0.0, bad)))
    assert not is_finite(setpoint(yaw=bad))


places = st.tuples(st.floats(-5, 25), st.floats(-5, 25), st.floats(-12, 2))
fences = st.sampled_from(
    [
        Fence(area=Area(polygon_ne_m=SQUARE), ceiling_m=9.0),
        Fence(area=Area(polygon_ne_m=HORSESHOE)),
        Fence(area=Area(center_ne_m=(4.0, 4.0), radius_m=6.0), ceiling_m=5.0),
        Fence(area=Area(polygon_ne_m=SQUARE), keep_out=(Area(center_ne_m=(4.0, 8.0), radius_m=1.5),)),
        Fence(keep_out=(Area(polygon_ne_m=((6.0, 6.0), (9.0, 5.0), (8.0, 9.0))),)),
    ]
)


@settings(max_examples=40)
@given(fences, st.lists(st.tuples(places, st.integers(1, 40), st.floats(0.01, 0.12)), min_size=1, max_size=6))
def test_whatever_is_asked_fence_speed_and_acceleration_are_kept(
    fence: Fence, wishes: list[tuple[Vector3, int, float]]
) -> None:
    limits = replace(LIMITS, fence=fence, height_max_m=10.0)
    at, velocity, now_s = (3.0, 3.0, -2.0), (0.0, 0.0, 0.0), 0.0
    limiter = SetpointLimiter(limits)
    limiter.restart(at, velocity, now_s)
    for wanted, count, step_s in wishes:
        for _ in range(count):
            now_s += step_s
            place = limiter.limit(setpoint(wanted), now_s).setpoint.position_ned_m
            assert place is not None
            duration_s = min(step_s, 0.1)
            moved = tuple((b - a) / duration_s for a, b in zip(at, place, strict=True))
            assert math.hypot(moved[0], moved[1]) <= 3.0 * 1.01 + 1e-3
            assert abs(moved[2]) <= 1.0 * 1.01 + 1e-3
            assert math.dist(moved, velocity) <= 2.5 * duration_s * 1.01 + 2e-3
            assert fence.clearance_m(place) >= 0.5 - 1e-4
            assert 0.3 - 1e-4 <= -place[2] <= 10.0 + 1e-4
            at, velocity = place, (moved[0], moved[1], moved[2])


@settings(max_examples=25)
@given(fences, places, places)
def test_from_anywhere_it_never_gets_farther_outside(fence: Fence, start: Vector3, wish: Vector3) -> None:
    stream = Stream(replace(LIMITS, fence=fence), start)
    before = fence.clearance_m(start)
    for _ in range(60):
        stream.feed(wish)
        now = fence.clearance_m(stream.places[-1])
        assert now >= min(before, 0.5) - 1e-4
        before = now
