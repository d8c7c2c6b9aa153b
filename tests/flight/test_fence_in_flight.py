"""DESIGN §6: the fence is enforced in flight by the limiter, stopping distance included; what a breach leads to."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.errors import Gloc3Error
from gloc3.platform.reader import load_platform
from gloc3_sitl.physics.wind import gusty

FAST = "{out: {follow_waypoints: {waypoints_m: [[15, 0, 1.5]], speed_m_s: 3.0}}}"
TIGHT = "{polygon_m: [[-2, -2], [16, -2], [16, 4], [-2, 4]], ceiling_m: 4}"
HOME_M = 0.3


def test_setpoints_beyond_the_fence_end_before_it_at_full_speed(flight: Card) -> None:
    flight.begin(mission(FAST, fence=TIGHT))
    flight.await_state("sweep.out", "running")
    flight.until(lambda: flight.speed_m_s > 2.0, 6.0, "it is fast")
    flight.fault("topic:setpoint_wanted/waypoints=jump/50", for_s=8.0)
    flight.wait(8.0)
    limits = flight.last("motion/limits")
    requested = [setpoint.position_ned_m[0] for setpoint in flight.since(flight.now_s - 8.0, "setpoint")]
    assert max(requested) <= 16.0 - limits.fence_margin_m + 0.01
    flown = [truth.position_ned_m[0] for truth in flight.since(flight.now_s - 8.0, "sim/truth")]
    assert max(flown) < 16.0
    assert max(flown) > 14.0
    assert not flight.was_told("fence breached")


@pytest.mark.both_styles
def test_the_margin_is_left_in_the_wind_that_the_platform_file_states(flight: Card) -> None:
    limits = load_platform("pelican_rtk").limits
    edge_m = 5.0 + limits.margin_m
    fence = f"{{polygon_m: [[-30, -{edge_m}], [60, -{edge_m}], [60, 40], [-30, 40]], ceiling_m: 8}}"
    out = "{out: {follow_waypoints: {waypoints_m: [[0, -5, 3], [40, -5, 3], [0, -5, 3]], speed_m_s: 2.0}}}"
    flight.begin(mission(out, fence=fence), wind=gusty(limits.wind_m_s, from_deg=270.0), seed=1)
    flight.await_state("sweep.out", "done", 90.0)
    inside_m = [edge_m - truth.position_ned_m[1] for truth in flight.since(0.0, "sim/truth")]
    assert min(inside_m) >= limits.fence_margin_m
    assert min(inside_m) < limits.margin_m - 0.05, "the wind displaces it"
    assert not flight.was_told("fence")


def test_a_keep_out_area_is_not_entered(flight: Card) -> None:
    fence = "{polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8, keep_out: [{polygon_m: [[8, 2], [12, 2], [12, 6], [8, 6]]}]}"
    flight.begin(mission(FAST, fence=fence))
    flight.await_state("sweep.out", "running")
    flight.until(lambda: flight.position_m[0] > 6.0, 10.0, "it is near")
    flight.fault("topic:setpoint_wanted/waypoints=jump/50", for_s=6.0)
    flight.wait(6.0)
    inside = [
        truth.position_ned_m
        for truth in flight.since(0.0, "sim/truth")
        if 8.0 < truth.position_ned_m[0] < 12.0 and 2.0 < -truth.position_ned_m[1] < 6.0
    ]
    assert not inside


def test_a_breach_aborts_into_what_the_mission_does_on_failure(flight: Card) -> None:
    flight.begin(mission(fence=TIGHT, on_failure="return"))
    flight.await_state("sweep.out", "running")
    flight.wait(3.0)
    flight.fault("topic:pose=jump/14", for_s=0.5)
    flight.until(lambda: flight.was_told("fence breached"), 1.0, "told")
    flight.await_policy("return", 1.0)
    flight.await_landed()
    assert flight.position_m[0] == pytest.approx(0.0, abs=HOME_M)
    assert flight.state("mission") == "failed"


def test_a_vehicle_that_a_storm_blows_out_of_the_fence_comes_back(flight: Card) -> None:
    fence = "{polygon_m: [[-1, -1.6], [9, -1.6], [9, 1.6], [-1, 1.6]], ceiling_m: 8}"
    out = "{out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 0.5}}}"
    flight.begin(mission(out, fence=fence, on_failure="return"))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    flight.fault("wind=20/90", for_s=4.0)  # from the east, to where the walls of the hold are far
    flight.until(lambda: flight.was_told("fence breached"), 6.0, "it is out")
    flight.until(lambda: flight.mission.policy in ("return", "failsafe"), 1.0, "we, or the autopilot by its own fence")
    flight.await_landed(60.0)
    assert abs(flight.position_m[1]) < 1.6


def test_the_ceiling_is_kept(flight: Card) -> None:
    fence = "{polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 3}"
    out = "{out: {follow_waypoints: {waypoints_m: [[1, 0, 2.1], [8, 0, 2.1]], speed_m_s: 1}}}"
    flight.begin(mission(out, fence=fence))
    flight.await_state("mission", "done", 40.0)
    heights = [-truth.position_ned_m[2] for truth in flight.since(0.0, "sim/truth")]
    assert max(heights) < 3.0
    assert not flight.was_told("fence")


@ONE_STYLE
@pytest.mark.parametrize(("edge_m", "why"), [(0.3, "home is 0.3 m outside"), (-0.3, "home is 0.30 m inside")])
def test_a_home_outside_the_fence_or_too_near_to_it_is_refused(flight: Card, edge_m: float, why: str) -> None:
    fence = f"{{polygon_m: [[{edge_m}, -2], [20, -2], [20, 12], [{edge_m}, 12]], ceiling_m: 8}}"
    with pytest.raises(Gloc3Error, match=why):
        flight.begin(mission(fence=fence))
