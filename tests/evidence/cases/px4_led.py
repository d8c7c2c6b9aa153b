"""Offboard and by hand, of the cases of PX4's own integration tests for multicopters, written anew and flown in virtual time.

Each name says what the case asks for; where PX4 has a figure (an acceptance radius, a time), it is used.
"""

from collections.abc import Callable
from math import cos, degrees, dist, radians, sin

import pytest
from tests.sitl.autopilot.bench import LAND, POSITION, Bench

from gloc3.messages.frames import Vector3, from_euler
from gloc3_sitl.autopilot.modes import Result

from .px4_steps import arm, from_home_m, hover, ready

pytestmark = pytest.mark.flight


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
