"""The cases of PX4's own integration tests for multicopters that apply here, written anew and flown in virtual time.

Each name says what the case asks for; where PX4 has a figure (an acceptance radius, a time), it is used.
"""

from collections.abc import Callable
from math import cos, degrees, dist, hypot, nan, radians, sin
from typing import Any

import pytest
from tests.sitl.autopilot.bench import ARM, LAND, POSITION, REPOSITION, TAKE_OFF, Bench

from gloc3.frames import Vector3, from_euler
from gloc3.link.plan import PlanItem, PlanResult, PlanType
from gloc3_sitl.autopilot.mission import MissionState
from gloc3_sitl.autopilot.modes import Result

pytestmark = pytest.mark.flight

WAYPOINT, RETURN, LAND_THERE, CLIMB, JUMP = 16, 20, 21, 22, 177
MISSION_START, PAUSE_CONTINUE, SET_CURRENT, CHANGE_SPEED, INJECT, SET_HOME, RALLY = 300, 193, 224, 178, 420, 179, 5100
MAGNETOMETER, BAROMETER, GPS, MOTOR = 2, 3, 4, 101
OFF, STUCK = 1, 2
HEIGHTS = pytest.mark.parametrize("reference", [0, 1], ids=["baro height", "GPS height"])


# -- steps --------------------------------------------------------------------------------------------------------------


def ready(**parameters: float) -> Bench:
    bench = Bench()
    for name, value in {"RTL_RETURN_ALT": 8.0, "RTL_DESCEND_ALT": 5.0, **parameters}.items():
        bench.set_parameter(name, value)
    bench.get_ready()
    return bench


def arm(bench: Bench) -> None:
    assert bench.command(ARM, 1) is Result.ACCEPTED


def hover(bench: Bench) -> None:
    """Arms, takes off, and waits until it hovers."""
    arm(bench)
    assert bench.command(TAKE_OFF, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
    bench.run_until(lambda: bench.mode == "Hold", 30.0)
    bench.run(2.0)


def return_home(bench: Bench) -> None:
    assert bench.command(RETURN) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 180.0)


def square(bench: Bench, leg_m: float = 20.0, height_m: float = 10.0) -> list[PlanItem]:
    corners = ((leg_m, 0.0), (leg_m, leg_m), (0.0, leg_m))
    return [bench.item(WAYPOINT, north, east, height_m, param2=1.0) for north, east in corners]


def upload(bench: Bench, *items: PlanItem, kind: PlanType = PlanType.MISSION) -> None:
    assert bench.upload(items, kind) is PlanResult.ACCEPTED


def start_mission(bench: Bench) -> None:
    assert bench.command(MISSION_START) is Result.ACCEPTED


def await_item(bench: Bench, number: int, within_s: float = 90.0) -> None:
    bench.run_until(lambda: bench.autopilot.craft.mission.current >= number, within_s)


def await_complete(bench: Bench, within_s: float = 180.0) -> None:
    bench.run_until(lambda: bench.autopilot.craft.mission.state is MissionState.COMPLETE, within_s)


def watch(bench: Bench, seconds: float, look: Callable[[], None]) -> None:
    for _ in range(round(seconds / 0.1)):
        bench.run(0.1)
        look()


def from_home_m(bench: Bench) -> float:
    return hypot(bench.position[0], bench.position[1])


# -- basics and missions ------------------------------------------------------------------------------------------------


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

    def look() -> None:
        if bench.autopilot.craft.mission.current == 2:
            velocity = bench.autopilot.estimator.inertial.velocity_ned_m_s
            speeds.append(hypot(velocity[0], velocity[1]))
            assert abs(bench.position[1]) < 5.0

    watch(bench, 40.0, look)
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


# -- going to places ----------------------------------------------------------------------------------------------------


def go(bench: Bench, north_m: float, east_m: float, height_m: float) -> Result:
    goal = bench.item(WAYPOINT, north_m, east_m)
    altitude = bench.sim.world.home.altitude_m + height_m
    return bench.command(REPOSITION, -1, 1, 0, nan, as_int={"frame": 5, "x": goal.x, "y": goal.y, "z": altitude})


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

    def look() -> None:
        velocity = bench.sim.truth().velocity_ned_m_s
        assert hypot(velocity[0], velocity[1]) < 2.5

    watch(bench, 5.0, look)


# -- offboard -----------------------------------------------------------------------------------------------------------


def hold_at(place: Vector3) -> Callable[[float], tuple[Vector3, Vector3]]:
    return lambda _: (place, (0.0, 0.0, 0.0))


def offboard_goto(bench: Bench, place: Vector3, yaw_deg: float, within_s: float, radius_m: float = 0.3) -> None:
    begin = bench.sim.now_s
    while dist(bench.position, place) > radius_m:
        assert bench.sim.now_s - begin < within_s
        bench.stream(hold_at(place), 0.2, mask=POSITION, yaw=radians(yaw_deg))


def enter_offboard(bench: Bench, place: Vector3) -> None:
    bench.stream(hold_at(place), 0.8, mask=POSITION)
    assert bench.set_mode("Offboard") is Result.ACCEPTED


def test_offboard_take_off_and_land() -> None:
    bench = ready(COM_RCL_EXCEPT=4)
    enter_offboard(bench, (0.0, 0.0, -2.0))
    arm(bench)
    offboard_goto(bench, (0.0, 0.0, -2.0), 0.0, 90.0)
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) < 2.0


def test_offboard_position_control() -> None:
    bench = ready(COM_RCL_EXCEPT=4)
    start = (0.0, 0.0, -2.0)
    enter_offboard(bench, start)
    arm(bench)
    for place, yaw_deg in (
        (start, 0.0),
        ((0.0, 5.0, -2.0), 180.0),
        ((5.0, 5.0, -4.0), 180.0),
        ((5.0, 0.0, -4.0), 90.0),
        (start, 0.0),
    ):
        offboard_goto(bench, place, yaw_deg, 10.0)
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) < 2.0


def attitude(bench: Bench, seconds: float, pitch_deg: float, thrust: float, rates: bool = False) -> None:
    """Streams an attitude, or a pitch rate in its place, with a thrust."""
    begin = bench.sim.now_s
    for count in range(round(seconds * 20)):
        bench.send(
            "SET_ATTITUDE_TARGET",
            target_system=1,
            target_component=1,
            type_mask=128 if rates else 7,
            q=from_euler(0.0, radians(pitch_deg), 0.0),
            body_pitch_rate=radians(pitch_deg) if rates else 0.0,
            thrust=thrust,
        )
        bench.sim.advance(begin + (count + 1) / 20.0)


def test_offboard_attitude_control_flies_forward() -> None:
    bench = ready(COM_RCL_EXCEPT=4)
    hover_thrust = bench.autopilot.tuning.hover_thrust
    attitude(bench, 1.0, 0.0, 0.0)
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    arm(bench)
    attitude(bench, 3.0, 0.0, 1.2 * hover_thrust)
    assert -bench.position[2] > 1.0
    attitude(bench, 4.0, -5.0, hover_thrust / cos(radians(5.0)))
    assert bench.position[0] > 3.0
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 120.0)
    assert from_home_m(bench) > 5.0


def test_offboard_body_rates_are_flown() -> None:
    bench = ready(COM_RCL_EXCEPT=4, MIS_TAKEOFF_ALT=10.0)
    hover(bench)
    thrust = bench.autopilot.tuning.hover_thrust
    attitude(bench, 0.8, 0.0, thrust, rates=True)
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    attitude(bench, 0.5, -20.0, thrust, rates=True)
    pitch = bench.autopilot.estimator.euler_rad[1]
    assert degrees(pitch) == pytest.approx(-10.0, abs=3.0)


def motion(bench: Bench, seconds: float, mask: int, frame: int = 1, **fields: float) -> None:
    begin = bench.sim.now_s
    for count in range(round(seconds * 20)):
        bench.send(
            "SET_POSITION_TARGET_LOCAL_NED",
            target_system=1,
            target_component=1,
            coordinate_frame=frame,
            type_mask=mask,
            **fields,
        )
        bench.sim.advance(begin + (count + 1) / 20.0)


VELOCITY_MASK, ACCELERATION_MASK = 0b100111000111, 0b110000111111


@pytest.mark.parametrize("frame", [1, 8], ids=["NED", "body"])
def test_offboard_velocity_control(frame: int) -> None:
    bench = ready(COM_RCL_EXCEPT=4, MIS_TAKEOFF_ALT=5.0)
    hover(bench)
    motion(bench, 0.8, VELOCITY_MASK, yaw=radians(90.0))
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    motion(bench, 4.0, VELOCITY_MASK, yaw=radians(90.0))
    motion(bench, 4.0, VELOCITY_MASK, frame, vx=1.0, yaw=radians(90.0))
    north, east, _ = bench.sim.truth().velocity_ned_m_s
    wanted = (1.0, 0.0) if frame == 1 else (0.0, 1.0)
    assert (north, east) == pytest.approx(wanted, abs=0.2)


def test_offboard_acceleration_control() -> None:
    bench = ready(COM_RCL_EXCEPT=4, MIS_TAKEOFF_ALT=5.0)
    hover(bench)
    motion(bench, 0.8, ACCELERATION_MASK)
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    motion(bench, 2.0, ACCELERATION_MASK, afx=1.0)
    assert bench.sim.truth().velocity_ned_m_s[0] == pytest.approx(2.0, abs=0.7)


def test_offboard_position_with_velocity_follows_a_circle() -> None:
    bench = ready(COM_RCL_EXCEPT=4, MIS_TAKEOFF_ALT=5.0)
    hover(bench)
    bench.start_streaming((3.0, 0.0, -5.0))
    bench.stream(hold_at((3.0, 0.0, -5.0)), 4.0)

    def round_and_round(t_s: float) -> tuple[Vector3, Vector3]:
        angle = 0.4 * t_s
        return (
            (3.0 * cos(angle), 3.0 * sin(angle), -5.0),
            (-1.2 * sin(angle), 1.2 * cos(angle), 0.0),
        )

    errors = bench.stream(round_and_round, 15.0)
    assert max(errors[100:]) < 0.5


def test_offboard_is_refused_without_setpoints_and_a_loss_is_acted_on() -> None:
    bench = ready(COM_RCL_EXCEPT=4, COM_OBL_RC_ACT=4)
    hover(bench)
    assert bench.set_mode("Offboard") is Result.TEMPORARILY_REJECTED
    bench.start_streaming((0.0, 0.0, -3.0))
    bench.run(1.5)
    assert bench.mode == "Land"
    bench.run_until(lambda: not bench.is_armed, 60.0)


# -- by hand ------------------------------------------------------------------------------------------------------------


def joystick(bench: Bench, seconds: float, forward: float = 0.0, throttle: float = 0.5) -> None:
    begin = bench.sim.now_s
    for count in range(round(seconds * 20)):
        fields = {"x": round(1000 * forward), "y": 0, "z": round(1000 * throttle), "r": 0, "buttons": 0}
        bench.send("MANUAL_CONTROL", target=1, **fields)
        bench.sim.advance(begin + (count + 1) / 20.0)


@pytest.mark.parametrize("mode", ["Position", "Altitude"])
def test_flying_forward_by_hand(mode: str) -> None:
    bench = ready()
    joystick(bench, 1.0)
    assert bench.set_mode(mode) is Result.ACCEPTED
    joystick(bench, 0.5)
    arm(bench)
    joystick(bench, 4.0, throttle=1.0)
    assert -bench.position[2] > 2.0
    joystick(bench, 6.0, forward=0.5)
    joystick(bench, 40.0, throttle=0.0)
    bench.run_until(lambda: not bench.is_armed, 20.0)
    assert from_home_m(bench) > 5.0


# -- failures -----------------------------------------------------------------------------------------------------------


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


# -- returning ----------------------------------------------------------------------------------------------------------


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


# -- following ----------------------------------------------------------------------------------------------------------


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
