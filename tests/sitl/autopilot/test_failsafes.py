"""Every failsafe, flown in virtual time: what triggers it, what it does, and what it leaves alone."""

import pytest

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.modes import Result

from .bench import POSITION_AND_VELOCITY, VELOCITY, Bench

pytestmark = pytest.mark.flight

HERE = (0.0, 0.0, -2.5)
STILL = (0.0, 0.0, 0.0)


def hover(_: float) -> tuple[Vector3, Vector3]:
    return HERE, STILL


def station_heartbeats(bench: Bench, seconds: float) -> None:
    for _ in range(round(seconds)):
        bench.send("HEARTBEAT", type=6, autopilot=8)
        bench.run(1.0)


# -- streamed setpoints ---------------------------------------------------------------------------------------------


def test_px4_does_not_enter_offboard_without_a_stream() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.set_mode("Offboard") is Result.TEMPORARILY_REJECTED
    assert "Offboard denied: no setpoints are streamed" in bench.texts


def test_px4_does_not_enter_offboard_on_a_stream_below_two_hertz() -> None:
    bench = Bench()
    bench.take_off()
    bench.stream(hover, 4.0, rate_hz=1.5)
    assert bench.set_mode("Offboard") is Result.TEMPORARILY_REJECTED


@pytest.mark.parametrize(("choice", "mode"), [(0, "Hold"), (3, "Return"), (4, "Land"), (5, "Hold")])
def test_px4_leaves_offboard_one_second_after_the_last_setpoint(choice: int, mode: str) -> None:
    bench = Bench()
    bench.set_parameter("COM_OBL_RC_ACT", choice)
    bench.take_off()
    bench.start_streaming(HERE)
    used = bench.run_until(lambda: bench.mode != "Offboard", 3.0)
    assert bench.mode == mode
    assert 0.9 < used < 1.1


def test_px4_flies_offboard_again_a_second_after_the_setpoints_are_back() -> None:
    bench = Bench()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.run_until(lambda: bench.mode == "Hold", 3.0)
    bench.run(2.0)
    bench.stream(hover, 0.8)
    assert bench.mode == "Hold"
    bench.stream(hover, 0.6)
    assert bench.mode == "Offboard"
    bench.stream(hover, 2.0)
    assert bench.mode == "Offboard"
    bench.run_until(lambda: bench.mode == "Hold", 3.0)


def test_px4_stays_in_a_hold_that_was_commanded_after_the_setpoints_were_lost() -> None:
    bench = Bench()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.run_until(lambda: bench.mode == "Hold", 3.0)
    assert bench.set_mode("Hold") is Result.ACCEPTED
    bench.stream(hover, 3.0)
    assert bench.mode == "Hold"


def test_px4_that_landed_because_the_setpoints_were_lost_stands_in_offboard() -> None:
    bench = Bench()
    bench.set_parameter("COM_OBL_RC_ACT", 4)
    bench.take_off()
    bench.start_streaming(HERE)
    bench.run_until(lambda: bench.mode == "Land", 3.0)
    bench.run_until(lambda: not bench.is_armed, 15.0)
    assert bench.mode == "Offboard"


def test_px4_hands_over_to_a_pilot_who_is_there_when_setpoints_end() -> None:
    bench = Bench()
    bench.set_parameter("COM_OBL_RC_ACT", 0)
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.run(2.0)
    assert bench.mode == "Position"


def test_ardupilot_stops_a_velocity_three_seconds_after_it_was_sent_last() -> None:
    bench = Bench("ardupilot")
    bench.take_off()
    bench.stream(lambda _: (STILL, (1.0, 0.0, 0.0)), 3.0, mask=VELOCITY)
    bench.run(2.5)
    assert bench.sim.truth().velocity_ned_m_s[0] > 0.8
    bench.run(3.0)
    assert abs(bench.sim.truth().velocity_ned_m_s[0]) < 0.1
    assert bench.mode == "GUIDED"


def test_setpoints_that_are_not_numbers_are_not_taken() -> None:
    bench = Bench()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.stream(lambda _: ((float("nan"), 0.0, -2.5), STILL), 1.5)
    assert bench.mode == "Hold"
    assert bench.sim.front.refused_setpoints > 20


@pytest.mark.parametrize(
    ("style", "mask"), [("px4", 0b1000000000 | POSITION_AND_VELOCITY), ("ardupilot", 0b100111000001)]
)
def test_masks_that_the_style_does_not_take_are_refused(style: str, mask: int) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.stream(hover, 0.5, mask=mask)
    assert bench.sim.front.refused_setpoints == 10


# -- links ------------------------------------------------------------------------------------------------------------


def test_px4_does_nothing_about_a_lost_station_by_default() -> None:
    bench = Bench()
    station_heartbeats(bench, 3)
    bench.take_off()
    bench.run(20.0)
    assert bench.mode == "Hold"


def test_px4_holds_for_five_seconds_and_returns_when_the_station_is_lost() -> None:
    bench = Bench()
    bench.set_parameter("NAV_DLL_ACT", 2)
    bench.set_parameter("RTL_RETURN_ALT", 5.0)
    bench.take_off()
    station_heartbeats(bench, 3)
    bench.start_streaming(HERE)
    bench.stream(hover, 9.0)
    assert "Failsafe: ground station lost" in bench.texts
    assert bench.mode == "Hold"
    used = bench.run_until(lambda: bench.mode == "Return", 6.0)
    assert used > 1.0
    bench.run_until(lambda: not bench.is_armed, 60.0)


def test_px4_counts_any_ground_station_but_not_a_companion() -> None:
    bench = Bench()
    bench.set_parameter("NAV_DLL_ACT", 3)
    station_heartbeats(bench, 3)
    bench.take_off()
    for _ in range(12):
        bench.send("HEARTBEAT", type=18, autopilot=8)
        bench.run(1.0)
    bench.run_until(lambda: bench.mode == "Land", 10.0)


def test_an_exempt_mode_flies_on_without_its_station() -> None:
    bench = Bench()
    bench.set_parameter("NAV_DLL_ACT", 3)
    bench.set_parameter("COM_DLL_EXCEPT", 4)
    station_heartbeats(bench, 3)
    bench.take_off()
    bench.start_streaming(HERE)
    bench.stream(hover, 20.0)
    assert bench.mode == "Offboard"


def test_ardupilot_only_minds_the_heartbeats_of_its_own_station() -> None:
    bench = Bench("ardupilot", system=200, component=190)
    bench.set_parameter("FS_GCS_ENABLE", 5)
    bench.take_off()
    bench.run(8.0)
    assert bench.mode == "GUIDED"


def test_ardupilot_lands_when_its_own_station_falls_silent() -> None:
    bench = Bench("ardupilot", system=255, component=190)
    bench.take_off()
    bench.set_parameter("FS_GCS_ENABLE", 5)
    station_heartbeats(bench, 6)
    assert bench.mode == "GUIDED"
    used = bench.run_until(lambda: bench.mode == "LAND", 8.0)
    assert 3.5 < used < 5.5


# -- battery, position, fence -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("style", "parameter", "value", "mode"),
    [
        ("px4", "COM_LOW_BAT_ACT", 2, "Land"),
        ("px4", "COM_LOW_BAT_ACT", 3, "Return"),
        ("ardupilot", "BATT_FS_CRT_ACT", 1, "LAND"),
    ],
)
def test_a_critical_battery_brings_it_down(style: str, parameter: str, value: int, mode: str) -> None:
    bench = Bench(style)
    bench.set_parameter(parameter, value)
    bench.take_off()
    bench.sim.sensors.battery.remaining = 0.06
    bench.run_until(lambda: bench.mode == mode, 8.0)
    assert bench.last("HEARTBEAT").system_status in (4, 5)
    bench.run(1.0)
    assert bench.last("HEARTBEAT").system_status == 5


@pytest.mark.parametrize(("threshold", "mode"), [("BATT_LOW_VOLT", "RTL"), ("BATT_CRT_VOLT", "LAND")])
def test_ardupilot_acts_on_a_voltage_that_stays_low_whatever_charge_is_left(threshold: str, mode: str) -> None:
    bench = Bench("ardupilot", battery_remaining=0.5)
    bench.set_parameter("BATT_FS_CRT_ACT", 1)
    bench.take_off()
    bench.run(15.0)
    assert bench.mode == "GUIDED"
    bench.set_parameter(threshold, 11.3)
    used = bench.run_until(lambda: bench.mode == mode, 20.0)
    assert 9.5 < used < 11.0


def test_a_short_dip_of_the_voltage_is_no_failsafe() -> None:
    bench = Bench("ardupilot", battery_remaining=0.5)
    bench.take_off()
    for _ in range(3):
        bench.set_parameter("BATT_LOW_VOLT", 11.3)
        bench.run(7.0)
        bench.set_parameter("BATT_LOW_VOLT", 5.0)
        bench.run(1.0)
    assert bench.mode == "GUIDED"


def test_a_low_battery_is_only_told_and_forbids_arming() -> None:
    bench = Bench(battery_remaining=0.12)
    bench.run(4.0)
    assert bench.command(400, 1) is Result.TEMPORARILY_REJECTED
    assert "battery low: 12 %" in bench.autopilot.commander.problems()


@pytest.mark.parametrize("failure", ["lost", "late"])
@pytest.mark.parametrize(("style", "mode"), [("px4", "Land"), ("ardupilot", "LAND")])
def test_a_lost_position_lands_it(style: str, mode: str, failure: str) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.sim.sensors.fail("fix", failure)
    used = bench.run_until(lambda: bench.mode == mode, 4.0)
    assert used > 0.9
    bench.run_until(lambda: not bench.is_armed, 20.0)
    assert abs(bench.position[0]) < 3.0
    assert abs(bench.position[1]) < 3.0


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_without_its_inertial_unit_it_stops_its_motors(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.command(511, 105, 10_000)  # HIGHRES_IMU
    bench.run(1.0)
    bench.sim.sensors.fail("imu", "lost")
    bench.run(0.5)
    samples = bench.counts["HIGHRES_IMU"]
    assert bench.is_armed, "for a moment it may be missing"
    bench.run(1.0)
    assert "Failsafe: attitude lost" in bench.texts
    assert not bench.is_armed
    assert bench.last("HEARTBEAT").system_status == 8
    assert 0 < samples == bench.counts["HIGHRES_IMU"], "nothing old is repeated"


@pytest.mark.parametrize("checks", [1, 0])
def test_ardupilot_disarms_what_has_crashed(checks: int) -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("FS_CRASH_CHECK", checks)
    bench.take_off()
    bench.run(5.0)
    assert not bench.autopilot.craft.crash.has_crashed
    bench.sim.motors_left[1] = 0.0
    bench.run(12.0)
    assert bench.position[2] > -0.5
    assert bench.is_armed is (checks == 0)
    assert ("Failsafe: Crash: Disarming" in bench.texts) is (checks == 1)


@pytest.mark.parametrize(("choice", "mode"), [(2, "Hold"), (3, "Return"), (5, "Land")])
def test_px4_acts_at_the_height_of_its_fence(choice: int, mode: str) -> None:
    bench = Bench()
    bench.set_parameter("GF_MAX_VER_DIST", 4.0)
    bench.set_parameter("GF_ACTION", choice)
    bench.take_off()
    bench.start_streaming(HERE)
    bench.stream(lambda t: ((0.0, 0.0, -2.5 - 0.8 * t), (0.0, 0.0, -0.8)), 4.0)
    assert "Failsafe: above the fence height of 4 m" in bench.texts
    assert bench.mode == mode


def test_a_termination_stops_the_motors_for_good() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.command(185, 1) is Result.ACCEPTED
    assert not bench.is_armed
    bench.run(3.0)
    assert bench.last("HEARTBEAT").system_status == 8
    assert bench.command(400, 1) is Result.TEMPORARILY_REJECTED
