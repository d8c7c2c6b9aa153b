"""Failures, returning, the fence, and following, of the cases of PX4's own integration tests for multicopters, written anew and flown in virtual time.

Each name says what the case asks for; where PX4 has a figure (an acceptance radius, a time), it is used.
"""

from math import cos, dist, hypot, nan, radians, sin
from typing import Any

import pytest
from tests.sitl.autopilot.bench import Bench

from gloc3.mavlink.services.plan import PlanType
from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.modes import Result

from .px4_steps import (
    RETURN,
    WAYPOINT,
    arm,
    await_item,
    from_home_m,
    go,
    hover,
    ready,
    return_home,
    square,
    start_mission,
    upload,
)

pytestmark = pytest.mark.flight

INJECT, RALLY = 420, 5100
MAGNETOMETER, BAROMETER, GPS, MOTOR = 2, 3, 4, 101
OFF, STUCK = 1, 2
HEIGHTS = pytest.mark.parametrize("reference", [0, 1], ids=["baro height", "GPS height"])


def mission_with_failure(unit: int, kind: int, **parameters: float) -> Bench:
    bench = ready(SYS_FAILURE_EN=1, **parameters)
    upload(bench, *square(bench), bench.item(RETURN, frame=2, x=0, y=0))
    arm(bench)
    start_mission(bench)
    await_item(bench, 1)
    assert bench.command(INJECT, unit, kind) is Result.ACCEPTED
    return bench


@HEIGHTS
def test_it_lands_when_gps_is_lost_in_a_mission(reference: int) -> None:
    bench = mission_with_failure(GPS, OFF, EKF2_HGT_REF=reference)
    bench.run_until(lambda: bench.mode == "Land", 20.0)
    bench.run_until(lambda: not bench.is_armed, 40.0)


@pytest.mark.parametrize("kind", [OFF, STUCK], ids=["lost", "stuck"])
def test_it_flies_on_when_the_magnetometer_fails_in_a_mission(kind: int) -> None:
    bench = mission_with_failure(MAGNETOMETER, kind)
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) < 2.0


@HEIGHTS
@pytest.mark.parametrize("kind", [OFF, STUCK], ids=["lost", "stuck"])
def test_it_flies_on_when_the_barometer_fails_in_a_mission(kind: int, reference: int) -> None:
    bench = mission_with_failure(BAROMETER, kind, EKF2_HGT_REF=reference)
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) < 2.0


def test_a_failure_is_refused_in_flight_and_on_the_ground_while_it_is_not_allowed() -> None:
    bench = ready()
    assert bench.command(INJECT, MOTOR, OFF, 1) is Result.DENIED
    hover(bench)
    assert bench.command(INJECT, MOTOR, OFF, 1) is Result.DENIED
    return_home(bench)


def rally(bench: Bench, *places: tuple[float, float]) -> None:
    upload(bench, *(bench.item(RALLY, north, east, 5.0) for north, east in places), kind=PlanType.RALLY)


def test_it_returns_home_where_there_is_no_rally_point() -> None:
    bench = ready()
    hover(bench)
    return_home(bench)
    assert from_home_m(bench) < 5.0


def test_it_returns_home_where_home_is_closest() -> None:
    bench = ready()
    rally(bench, (100.0, -100.0))
    hover(bench)
    return_home(bench)
    assert from_home_m(bench) < 5.0


def test_it_returns_to_the_rally_point_that_is_closer() -> None:
    bench = ready()
    rally(bench, (60.0, 0.0))
    hover(bench)
    assert go(bench, 80.0, 0.0, 8.0) is Result.ACCEPTED
    bench.run_until(lambda: dist(bench.position, (80.0, 0.0, -8.0)) < 2.0, 60.0)
    return_home(bench)
    assert hypot(bench.position[0] - 60.0, bench.position[1]) < 5.0


def test_it_returns_at_the_height_set_and_no_lower() -> None:
    bench = ready(RTL_RETURN_ALT=12.0)
    hover(bench)
    assert go(bench, 30.0, 0.0, 4.0) is Result.ACCEPTED
    bench.run_until(lambda: dist(bench.position, (30.0, 0.0, -4.0)) < 1.0, 60.0)
    assert bench.command(RETURN) is Result.ACCEPTED
    bench.run_until(lambda: bench.position[0] < 15.0, 60.0)
    assert -bench.position[2] == pytest.approx(12.0, abs=0.5)
    bench.run_until(lambda: not bench.is_armed, 120.0)


def test_a_fence_that_is_left_brings_it_back() -> None:
    bench = ready(GF_ACTION=3)
    corners = ((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0))
    fence = [bench.item(5001, north, east, param1=4.0, frame=0) for north, east in corners]
    upload(bench, *fence, kind=PlanType.FENCE)
    hover(bench)
    assert go(bench, 40.0, 0.0, 5.0) is Result.ACCEPTED
    bench.run_until(lambda: bench.mode == "Return", 60.0)
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) < 1.0


def target(bench: Bench, north_m: float, east_m: float, velocity: Vector3) -> None:
    place = bench.item(WAYPOINT, north_m, east_m)
    rest: dict[str, Any] = {
        "timestamp": 0,
        "est_capabilities": 3,
        "acc": (nan, nan, nan),
        "attitude_q": (1.0, nan, nan, nan),
        "rates": (nan, nan, nan),
        "position_cov": (nan, nan, nan),
        "custom_state": 0,
    }
    altitude = bench.sim.world.home.altitude_m
    bench.send("FOLLOW_TARGET", lat=place.x, lon=place.y, alt=altitude, vel=velocity, **rest)


@pytest.mark.parametrize("bearing_deg", [0.0, 180.0, 90.0], ids=["ahead", "behind", "right"])
def test_it_follows_at_each_side(bearing_deg: float) -> None:
    bench = ready(FLW_TGT_DST=8.0, FLW_TGT_FA=bearing_deg)
    hover(bench)
    assert bench.set_mode("Follow") is Result.ACCEPTED
    for step in range(80):
        target(bench, 0.5 * step, 0.0, (1.0, 0.0, 0.0))
        bench.run(0.5)
    angle = radians(bearing_deg)
    north, east, down = bench.position
    assert (north - 40.0, east) == pytest.approx((8.0 * cos(angle), 8.0 * sin(angle)), abs=1.5)
    assert -down == pytest.approx(8.0, abs=0.5)
