"""The human pilot: switch, sticks and kill switch win over whatever the vehicle does."""

import pytest

from gloc3_sitl.autopilot.modes import Result

from .bench import Bench

pytestmark = pytest.mark.flight

STYLES = pytest.mark.parametrize(("style", "position"), [("px4", "Position"), ("ardupilot", "LOITER")])
HERE = (0.0, 0.0, -2.5)


@STYLES
def test_the_mode_switch_takes_over_from_streamed_control(style: str, position: str) -> None:
    bench = Bench(style)
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.sim.pilot.switch_mode(position)
    bench.stream(lambda _: ((5.0, 0.0, -2.5), (0.0, 0.0, 0.0)), 3.0)
    assert bench.mode == position
    assert abs(bench.position[0]) < 0.3


@STYLES
def test_the_sticks_fly_and_letting_go_holds(style: str, position: str) -> None:
    bench = Bench(style)
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.sim.pilot.switch_mode(position)
    bench.run(1.0)
    bench.sim.pilot.sticks(pitch=-0.5)
    bench.run(2.0)
    assert bench.position[0] > 1.0
    bench.sim.pilot.sticks()
    bench.run(5.0)
    stopped = bench.position
    bench.run(3.0)
    assert abs(bench.position[0] - stopped[0]) < 0.15


def test_moved_sticks_take_over_from_a_mode_of_its_own_in_px4() -> None:
    bench = Bench()
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.sim.pilot.sticks(roll=0.5)
    bench.run(0.1)
    assert bench.mode == "Position"
    assert "Pilot took over using sticks" in bench.texts


def test_moved_sticks_do_not_take_over_from_offboard_unless_asked_to() -> None:
    bench = Bench()
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.sim.pilot.sticks(roll=0.5)
    bench.stream(lambda _: (HERE, (0.0, 0.0, 0.0)), 1.0)
    assert bench.mode == "Offboard"
    bench.set_parameter("COM_RC_OVERRIDE", 3)
    bench.stream(lambda _: (HERE, (0.0, 0.0, 0.0)), 0.2)
    assert bench.mode == "Position"


def test_the_arming_switch_is_refused_in_flight_by_px4_and_obeyed_by_ardupilot() -> None:
    for style, is_armed in (("px4", True), ("ardupilot", False)):
        bench = Bench(style)
        bench.sim.pilot.switch_on()
        bench.take_off()
        bench.sim.pilot.disarm()
        bench.run(0.1)
        assert bench.is_armed is is_armed


@STYLES
def test_the_kill_switch_stops_the_motors(style: str, position: str) -> None:
    del position
    bench = Bench(style)
    bench.take_off()
    bench.sim.pilot.kill()
    bench.run(0.1)
    assert not bench.is_armed


def test_a_lost_transmitter_returns_in_flight_by_hand_but_not_in_a_mode_that_is_exempt() -> None:
    bench = Bench()
    bench.set_parameter("COM_RCL_EXCEPT", 4)
    bench.set_parameter("RTL_RETURN_ALT", 4.0)
    bench.sim.pilot.switch_on()
    bench.take_off()
    bench.start_streaming(HERE)
    bench.sim.pilot.switch_off()
    bench.stream(lambda _: (HERE, (0.0, 0.0, 0.0)), 8.0)
    assert bench.mode == "Offboard"
    bench.sim.pilot.switch_mode("Position")
    bench.run(1.0)
    assert bench.mode == "Position"
    bench.sim.pilot.switch_off()
    bench.run_until(lambda: bench.mode == "Return", 7.0)


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_a_pilot_arms_climbs_and_lands_by_hand(style: str) -> None:
    bench = Bench(style)
    bench.sim.pilot.switch_on()
    bench.get_ready()
    bench.sim.pilot.switch_mode("Altitude" if style == "px4" else "ALT_HOLD")
    bench.sim.pilot.arm()
    bench.run(0.5)
    assert bench.is_armed
    bench.sim.pilot.sticks(throttle=0.9)
    bench.run(2.5)
    bench.sim.pilot.sticks(throttle=0.5)
    bench.run(3.0)
    height = -bench.position[2]
    assert height > 1.5
    bench.run(2.0)
    assert abs(-bench.position[2] - height) < 0.3
    bench.sim.pilot.sticks(throttle=0.2)
    bench.run_until(lambda: bench.is_landed, 15.0)


def test_a_mode_that_needs_a_pilot_is_refused_in_flight_without_one() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.set_mode("Altitude") is Result.TEMPORARILY_REJECTED


def test_a_joystick_over_mavlink_flies_until_it_falls_silent() -> None:
    bench = Bench()
    bench.set_parameter("NAV_RCL_ACT", 3)
    bench.take_off()
    stick = {"x": 500, "y": 0, "z": 500, "r": 0, "target": 1}
    bench.send("MANUAL_CONTROL", **stick)
    bench.set_mode("Position")
    for _ in range(40):
        bench.send("MANUAL_CONTROL", **stick)
        bench.run(0.05)
    assert bench.mode == "Position"
    assert bench.position[0] > 0.8
    bench.run_until(lambda: bench.mode == "Land", 8.0)


def test_a_joystick_is_not_taken_where_the_parameters_forbid_it() -> None:
    px4, ardupilot = Bench(), Bench("ardupilot", system=200, component=190)
    px4.set_parameter("COM_RC_IN_MODE", 4)
    for bench in (px4, ardupilot):
        bench.send("MANUAL_CONTROL", x=500, y=0, z=500, r=0, target=1)
        bench.run(0.1)
        assert not bench.sim.pilot.is_on


def flown_by_joystick(bench: Bench, seconds: float, **axes: int) -> None:
    """Sends a joystick twenty times a second."""
    for _ in range(round(seconds * 20)):
        bench.send("MANUAL_CONTROL", **{"x": 0, "y": 0, "z": 500, "r": 0, "target": 1, **axes})
        bench.run(0.05)


@pytest.mark.parametrize(("style", "position", "limit_s"), [("px4", "Position", 0.5), ("ardupilot", "LOITER", 1.0)])
def test_a_joystick_that_falls_silent_is_a_lost_transmitter_after_the_autopilots_own_time(
    style: str, position: str, limit_s: float
) -> None:
    bench = Bench(style, system=255, component=190)
    bench.set_parameter(*(("NAV_RCL_ACT", 3) if style == "px4" else ("FS_THR_ENABLE", 3)))
    bench.take_off()
    flown_by_joystick(bench, 0.3)
    bench.set_mode(position)
    flown_by_joystick(bench, 2.0, x=600)
    assert bench.mode == position
    assert bench.position[0] > 0.8
    lost_s = bench.run_until(lambda: "Failsafe: transmitter lost" in bench.texts, 3.0)
    assert lost_s == pytest.approx(limit_s, abs=0.15)
    bench.run_until(lambda: bench.mode.upper() == "LAND", 8.0)


def test_a_joystick_is_for_the_vehicle_that_it_names_and_gives_only_the_axes_that_it_has() -> None:
    for style, takes_all in (("px4", True), ("ardupilot", False)):
        bench = Bench(style, system=255, component=190)
        bench.send("MANUAL_CONTROL", x=500, y=0, z=500, r=0, target=7)
        assert not bench.pilot.is_on
        bench.send("MANUAL_CONTROL", x=500, y=0, z=500, r=0, target=0)
        assert bench.pilot.is_on is takes_all
        bench.send("MANUAL_CONTROL", x=32767, y=-250, z=-300, r=32767, target=1)
        assert bench.pilot.roll == 0.0, "a multirotor has no thrust backwards"
        bench.send("MANUAL_CONTROL", x=32767, y=-250, z=800, r=32767, target=1)
        assert (bench.pilot.roll, bench.pilot.throttle, bench.pilot.yaw) == (-0.25, 0.8, 0.0)


def test_a_rovers_joystick_drives_both_ways() -> None:
    bench = Bench(None, vehicle="rover", system=255, component=190)
    bench.send("MANUAL_CONTROL", x=0, y=0, z=0, r=0, target=1)
    assert bench.pilot.throttle == 0.5
    bench.send("MANUAL_CONTROL", x=0, y=100, z=-1000, r=0, target=1)
    assert (bench.pilot.throttle, bench.pilot.roll) == (0.0, 0.1)


def test_a_submarines_joystick_that_falls_silent_disarms_it_as_the_parameter_says() -> None:
    bench = Bench(None, vehicle="rov", system=255, component=190)
    bench.run(12.0)
    flown_by_joystick(bench, 0.5)
    assert bench.set_mode("ALT_HOLD") is Result.ACCEPTED
    assert bench.command(400, 1) is Result.ACCEPTED
    flown_by_joystick(bench, 4.0, z=200)
    assert bench.position[2] > 0.3, "it dives"
    assert bench.is_armed
    gone_s = bench.run_until(lambda: not bench.is_armed, 5.0)
    assert gone_s == pytest.approx(3.0, abs=0.3)
