"""Calibration as PX4 tells it, injected failures, outputs, and the shell."""

from math import degrees, radians

import pytest

from gloc3_sitl.autopilot.mavlink.calibration import TIMEOUT_S
from gloc3_sitl.autopilot.modes import Result

from .bench import ARM, Bench

CALIBRATE, INJECT, SET_SERVO, SET_RELAY, LOOK_AT, LOOK_AT_NOTHING = 241, 420, 183, 181, 195, 197
STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
MAGNETOMETER, GPS, RANGE_FINDER, BATTERY, MOTOR = 2, 4, 7, 100, 101
OK, OFF, STUCK, SLOW = 0, 1, 2, 5


def reported(bench: Bench) -> list[str]:
    return [text.removeprefix("[cal] ") for text in bench.texts if text.startswith("[cal] ")]


@pytest.mark.parametrize(("params", "word"), [((1,), "gyro"), ((0, 0, 0, 0, 2), "level")])
def test_what_needs_no_turning_is_calibrated(params: tuple[float, ...], word: str) -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(CALIBRATE, *params) is Result.ACCEPTED
    assert bench.command(CALIBRATE, *params) is Result.TEMPORARILY_REJECTED
    bench.run(3.0)
    steps = [f"progress <{share}>" for share in (20, 40, 60, 80, 100)]
    assert reported(bench) == [f"calibration started: 2 {word}", *steps, f"calibration done: {word}"]


@pytest.mark.parametrize(("params", "word"), [((0, 1), "mag"), ((0, 0, 0, 0, 1), "accel")])
def test_what_somebody_must_turn_fails_when_nobody_does_and_can_be_cancelled(
    params: tuple[float, ...], word: str
) -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(CALIBRATE, *params) is Result.ACCEPTED
    bench.run(2.0)
    assert reported(bench)[:2] == [f"calibration started: 2 {word}", "pending: back front left right up down"]
    assert bench.command(CALIBRATE) is Result.ACCEPTED
    assert reported(bench)[-1] == "calibration cancelled"
    assert bench.command(CALIBRATE, *params) is Result.ACCEPTED
    bench.run(TIMEOUT_S + 0.5)
    assert reported(bench)[-1] == "calibration failed: timeout: no motion"


@STYLES
def test_nothing_is_calibrated_while_armed(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    bench.command(ARM, 1)
    assert bench.command(CALIBRATE, 1) is (Result.TEMPORARILY_REJECTED if bench.is_px4 else Result.FAILED)


def test_ardupilot_fails_what_nobody_can_turn_here() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    assert bench.command(CALIBRATE, 0, 1) is Result.FAILED


def test_a_failure_is_injected_and_ended_where_the_parameter_allows_it() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(INJECT, GPS, OFF) is Result.DENIED
    bench.set_parameter("SYS_FAILURE_EN", 1)
    assert bench.command(INJECT, GPS, OFF) is Result.ACCEPTED
    bench.run(8.0)
    assert not bench.autopilot.estimator.is_position_good(bench.sim.now_s)
    assert bench.command(INJECT, GPS, OK) is Result.ACCEPTED
    bench.run(5.0)
    assert bench.autopilot.estimator.is_position_good(bench.sim.now_s)
    assert bench.command(INJECT, BATTERY, OFF) is Result.ACCEPTED
    bench.run(0.5)
    assert bench.autopilot.commander.battery_share < 0.01
    assert bench.command(INJECT, RANGE_FINDER, STUCK) is Result.ACCEPTED
    for unit, failure in ((MOTOR, OFF), (GPS, SLOW), (BATTERY, STUCK)):
        assert bench.command(INJECT, unit, failure) is Result.UNSUPPORTED


def test_ardupilot_has_no_such_command() -> None:
    assert Bench("ardupilot").command(INJECT, GPS, OFF) is Result.UNSUPPORTED


def test_ardupilot_moves_free_outputs_and_fails_the_motors_and_relays() -> None:
    bench = Bench("ardupilot")
    bench.run(1.0)
    assert bench.command(SET_SERVO, 1, 1500) is Result.FAILED
    assert bench.command(SET_SERVO, 17, 1500) is Result.FAILED
    assert bench.command(SET_SERVO, 9, 1700) is Result.ACCEPTED
    bench.command(512, 36)
    assert bench.last("SERVO_OUTPUT_RAW").servo9_raw == 1700
    assert bench.last("SERVO_OUTPUT_RAW").servo1_raw == 1000
    assert bench.command(SET_RELAY, 0, 1) is Result.FAILED


def test_px4_has_no_command_for_servos_and_relays() -> None:
    bench = Bench()
    assert bench.command(SET_SERVO, 9, 1700) is Result.UNSUPPORTED
    assert bench.command(SET_RELAY, 0, 1) is Result.UNSUPPORTED


@pytest.mark.flight
def test_ardupilot_looks_at_a_place_until_it_is_told_to_stop() -> None:
    bench = Bench("ardupilot")
    bench.take_off()
    place = bench.item(16, 0.0, 20.0)
    where = {"frame": 0, "x": place.x, "y": place.y, "z": bench.sim.world.home.altitude_m}
    assert bench.command(LOOK_AT, as_int=where) is Result.ACCEPTED
    bench.run(3.0)
    assert bench.autopilot.estimator.yaw_rad == pytest.approx(radians(90.0), abs=0.1)
    assert bench.command(LOOK_AT_NOTHING) is Result.ACCEPTED
    assert bench.autopilot.craft.is_facing is None


@STYLES
@pytest.mark.parametrize("command", [202, 203, 205, 206, 2000, 2001])
def test_there_is_no_camera_and_no_mount(style: str, command: int) -> None:
    assert Bench(style).command(command, 1) is Result.UNSUPPORTED


def typed(bench: Bench, line: bytes) -> str:
    bench.received.clear()
    data = (*line, *bytes(70 - len(line)))
    bench.send("SERIAL_CONTROL", device=10, flags=2, timeout=0, baudrate=0, count=len(line), data=data)
    return b"".join(bytes(one.data[: one.count]) for one in bench.received if one.name == "SERIAL_CONTROL").decode()


def test_the_shell_of_px4_echoes_and_runs_a_few_commands() -> None:
    bench = Bench()
    assert typed(bench, b"ver") == "ver"
    assert typed(bench, b" all\n").startswith(" all\nHW arch: GLOC3_SITL\nFW version: 1.")
    assert typed(bench, b"param show NAV_DLL_ACT\n").endswith("NAV_DLL_ACT: 0\nnsh> \x1b[K")
    assert "no parameter NAV_X" in typed(bench, b"param show NAV_X\n")
    assert "ver" in typed(bench, b"help\n")
    assert "nsh: rm: command not found" in typed(bench, b"rm -rf /\n")
    assert typed(bench, b"half\x03") == "half^C\nnsh> \x1b[K"
    assert typed(bench, b"\n") == "\nnsh> \x1b[K"
    assert typed(Bench("ardupilot"), b"help\n") == ""


# -- ArduPilot ----------------------------------------------------------------------------------------------------------


def requested_positions(bench: Bench) -> list[float]:
    return [
        received.param1 for received in bench.received if received.name == "COMMAND_LONG" and received.command == 42429
    ]


def test_ardupilot_requests_each_position_of_its_accelerometer_every_second_until_it_is_confirmed() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    assert bench.command(241, 0, 0, 0, 0, 1) is Result.ACCEPTED
    bench.run(3.5)
    assert 3 <= len(requested_positions(bench)) <= 5
    assert set(requested_positions(bench)) == {1.0}
    assert bench.command(42429, 3) is Result.FAILED
    for position in range(1, 7):
        assert bench.command(42429, position) is Result.ACCEPTED
        bench.run(1.5)
    assert requested_positions(bench)[-1] == 16777216.0
    count = len(requested_positions(bench))
    bench.run(3.0)
    assert len(requested_positions(bench)) == count
    assert bench.command(42429, 1) is Result.FAILED


@pytest.mark.parametrize(
    ("params", "heading_deg"), [((90, 0, 0, 0), 90.0), ((40, 0, -1, 1), -40.0), ((40, 0, 1, 1), 40.0)]
)
def test_copter_turns_its_nose_on_condition_yaw(params: tuple[float, ...], heading_deg: float) -> None:
    bench = Bench("ardupilot")
    bench.take_off()
    before = degrees(bench.autopilot.estimator.yaw_rad) if params[3] else 0.0
    assert bench.command(115, *params) is Result.ACCEPTED
    bench.run(6.0)
    turned = degrees(bench.autopilot.estimator.yaw_rad) - before - heading_deg
    assert abs((turned + 180.0) % 360.0 - 180.0) < 4.0
    assert bench.command(115, 400) is Result.FAILED


def test_px4_and_planes_know_no_condition_yaw_outside_a_mission() -> None:
    assert Bench().command(115, 90) is Result.UNSUPPORTED
    assert Bench("ardupilot", vehicle="plane").command(115, 90) is Result.UNSUPPORTED
