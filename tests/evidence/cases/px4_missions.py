"""Taking off, landing, missions and going to places, of the cases of PX4's own integration tests for multicopters, written anew and flown in virtual time.

Each name says what the case asks for; where PX4 has a figure (an acceptance radius, a time), it is used.
"""

from math import dist, hypot

import pytest
from tests.sitl.autopilot.bench import LAND

from gloc3.mavlink.services.plan import PlanItem
from gloc3_sitl.autopilot.modes import Result

from .px4_steps import (
    RETURN,
    WAYPOINT,
    arm,
    await_complete,
    await_item,
    from_home_m,
    go,
    hover,
    ready,
    return_home,
    square,
    start_mission,
    upload,
    watch,
)

pytestmark = pytest.mark.flight

LAND_THERE, CLIMB, JUMP = 21, 22, 177
PAUSE_CONTINUE, SET_CURRENT, CHANGE_SPEED, SET_HOME = 193, 224, 178, 179


def test_take_off_and_hold() -> None:
    bench = ready()
    hover(bench)
    place = bench.position
    bench.run(20.0)
    assert dist(place, bench.position) < 0.3


def test_take_off_and_land() -> None:
    bench = ready()
    hover(bench)
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 60.0)
    assert from_home_m(bench) < 0.5


def test_take_off_and_return() -> None:
    bench = ready()
    hover(bench)
    return_home(bench)
    assert from_home_m(bench) < 0.5


def test_a_square_mission_with_a_return_at_its_end() -> None:
    bench = ready()
    upload(bench, *square(bench), bench.item(RETURN, frame=2, x=0, y=0))
    arm(bench)
    start_mission(bench)
    bench.run_until(lambda: not bench.is_armed, 180.0)
    assert from_home_m(bench) < 0.5


def test_a_square_mission_and_a_return_by_hand() -> None:
    bench = ready()
    upload(bench, *square(bench))
    arm(bench)
    start_mission(bench)
    await_complete(bench)
    bench.run_until(lambda: bench.mode == "Hold", 5.0)
    return_home(bench)
    assert from_home_m(bench) < 0.5


def test_a_straight_mission_is_flown_through_at_speed() -> None:
    bench = ready(MPC_XY_CRUISE=6.0)
    upload(bench, *(bench.item(WAYPOINT, 25.0 * number, 0.0, 8.0, param2=1.0) for number in range(1, 5)))
    arm(bench)
    start_mission(bench)
    speeds: list[float] = []

    def poll() -> None:
        if bench.autopilot.craft.mission.current == 2:
            velocity = bench.autopilot.estimator.inertial.velocity_ned_m_s
            speeds.append(hypot(velocity[0], velocity[1]))
            assert abs(bench.position[1]) < 5.0

    watch(bench, 40.0, poll)
    assert max(speeds) > 4.0
    await_complete(bench)
    return_home(bench)


def test_setting_the_current_item_to_a_jump_flies_on() -> None:
    bench = ready()
    jump = PlanItem(command=JUMP, frame=2, param1=1.0, param2=1.0)
    land = bench.item(LAND_THERE, 0.0, 0.0, 0.0)
    upload(bench, bench.item(CLIMB, height_m=8.0), *square(bench, 15.0, 8.0)[:2], jump, land)
    arm(bench)
    start_mission(bench)
    await_item(bench, 2)
    assert bench.command(SET_CURRENT, 3) is Result.ACCEPTED
    bench.run(0.1)
    assert bench.autopilot.craft.mission.jumps == {3: 1}
    bench.run_until(lambda: not bench.is_armed, 240.0)
    assert from_home_m(bench) < 0.5


def test_a_waypoint_that_was_missed_is_reached_again_after_home_has_moved() -> None:
    bench = ready(MPC_XY_CRUISE=8.0, MPC_Z_V_AUTO_DN=1.0)
    upload(
        bench,
        bench.item(CLIMB, height_m=12.0),
        *(bench.item(WAYPOINT, north, 0.0, 12.0, param2=2.0) for north in (30.0, 60.0, 90.0)),
        bench.item(LAND_THERE, 90.0, 0.0, 0.0),
    )
    arm(bench)
    start_mission(bench)
    await_item(bench, 2)
    bench.run_until(lambda: bench.position[0] > 50.0, 60.0)
    home = bench.sim.world.home
    place = {"frame": 5, "x": round(home.latitude_deg * 1e7), "y": round(home.longitude_deg * 1e7)}
    assert bench.command(SET_HOME, 0, as_int={**place, "z": home.altitude_m - 5.0}) is Result.ACCEPTED
    await_item(bench, 3)
    assert abs(bench.position[0] - 60.0) < 3.0
    bench.run_until(lambda: not bench.is_armed, 180.0)


def test_a_reposition_flies_to_the_place_and_holds_there() -> None:
    bench = ready(MIS_TAKEOFF_ALT=10.0)
    hover(bench)
    assert go(bench, 50.0, 0.0, 10.0) is Result.ACCEPTED
    bench.run_until(lambda: dist(bench.position, (50.0, 0.0, -10.0)) < 2.0, 60.0)
    watch(bench, 10.0, lambda: None)
    assert dist(bench.position, (50.0, 0.0, -10.0)) < 2.0
    assert bench.mode == "Hold"


def test_a_pause_on_the_way_brakes_and_holds_near_by() -> None:
    bench = ready(MIS_TAKEOFF_ALT=10.0)
    hover(bench)
    assert go(bench, 200.0, 0.0, 10.0) is Result.ACCEPTED
    bench.run(5.0)
    paused = bench.position
    assert bench.command(PAUSE_CONTINUE, 0) is Result.ACCEPTED
    bench.run(6.0)
    watch(bench, 10.0, lambda: None)
    assert dist(bench.position, paused) < 15.0
    assert bench.position[0] > paused[0] - 2.0


def test_a_change_of_speed_is_applied_on_the_way() -> None:
    bench = ready(MIS_TAKEOFF_ALT=10.0)
    hover(bench)
    assert go(bench, 200.0, 0.0, 10.0) is Result.ACCEPTED
    bench.run(5.0)
    assert bench.command(CHANGE_SPEED, 1, 2.0, -1) is Result.ACCEPTED
    bench.run(4.0)

    def poll() -> None:
        velocity = bench.sim.truth().velocity_ned_m_s
        assert hypot(velocity[0], velocity[1]) < 2.5

    watch(bench, 5.0, poll)
