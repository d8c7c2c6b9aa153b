"""The first flight in both styles: arm, take off, hold, follow streamed setpoints, land."""

from math import nan, sqrt

import pytest

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.physics.wind import gusty

from .bench import ARM, LAND, TAKE_OFF, Bench

pytestmark = pytest.mark.flight

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])


def rms(values: list[float]) -> float:
    return sqrt(sum(value * value for value in values) / len(values))


def along_x(t_s: float) -> tuple[Vector3, Vector3]:
    return (0.5 * t_s, 0.0, -2.5), (0.5, 0.0, 0.0)


@STYLES
def test_a_whole_flight_ends_disarmed_where_it_began(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    assert not bench.is_landed
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 15.0)
    north, east, down = bench.position
    assert abs(north) < 0.15
    assert abs(east) < 0.15
    assert abs(down) < 0.02


@STYLES
def test_a_range_finder_that_is_stuck_keeps_no_landing_from_its_end(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.sim.sensors.fail("height", "stuck")
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 20.0)
    assert abs(bench.position[2]) < 0.02


def test_a_climb_that_a_receiver_repeats_for_ever_keeps_no_landing_from_its_end() -> None:
    bench = Bench("px4")
    bench.get_ready()
    assert bench.command(ARM, 1) is Result.ACCEPTED
    assert bench.command(TAKE_OFF, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
    bench.run_until(lambda: bench.position[2] < -1.1, 10.0)
    bench.sim.sensors.fail("fix", "stuck")
    bench.run_until(lambda: bench.mode == "Hold", 10.0)
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 30.0)
    assert abs(bench.position[2]) < 0.02


@STYLES
def test_streamed_positions_with_velocities_are_followed_within_centimetres(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.start_streaming((0.0, 0.0, -2.5))
    errors = bench.stream(along_x, 10.0)
    assert rms(errors[40:]) < 0.06
    assert max(errors[40:]) < 0.12


@STYLES
def test_it_holds_within_five_centimetres_in_calm_air(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    bench.start_streaming((0.0, 0.0, -2.5))
    errors = bench.stream(lambda _: ((0.0, 0.0, -2.5), (0.0, 0.0, 0.0)), 10.0)
    assert rms(errors) < 0.04
    assert max(errors) < 0.1


@STYLES
def test_it_holds_in_gusty_wind(style: str) -> None:
    bench = Bench(style, wind=gusty(6.0, 45.0))
    bench.take_off()
    bench.start_streaming((0.0, 0.0, -2.5))
    errors = bench.stream(lambda _: ((0.0, 0.0, -2.5), (0.0, 0.0, 0.0)), 10.0)
    assert rms(errors) < 0.2


def test_a_take_off_while_disarmed_is_refused_with_the_result_of_the_style() -> None:
    px4, ardupilot = Bench("px4"), Bench("ardupilot")
    px4.get_ready()
    ardupilot.get_ready()
    ardupilot.set_mode("GUIDED")
    assert px4.command(TAKE_OFF) is Result.TEMPORARILY_REJECTED
    assert ardupilot.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 2.0) is Result.FAILED
    assert "Take-off denied: not armed" in px4.texts
    assert "Take-off denied: not armed" in ardupilot.texts


def test_arming_before_the_first_fix_is_refused_with_a_reason() -> None:
    bench = Bench()
    assert bench.command(ARM, 1) is Result.TEMPORARILY_REJECTED
    assert "attitude is still aligning" in bench.autopilot.commander.problems()
    assert "Arming denied: resolve the reported health failures first" in bench.texts


def test_a_vehicle_that_is_armed_and_does_not_fly_disarms_by_itself() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(ARM, 1) is Result.ACCEPTED
    used = bench.run_until(lambda: not bench.is_armed, 15.0)
    assert 9.0 < used < 11.0


def test_disarming_in_flight_needs_force() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.command(ARM, 0) is Result.TEMPORARILY_REJECTED
    assert bench.is_armed
    assert bench.command(ARM, 0, 21196) is Result.ACCEPTED
    assert not bench.is_armed


def test_the_same_seed_flies_the_same_way_and_another_does_not() -> None:
    places = []
    for seed in (7, 7, 8):
        bench = Bench(seed=seed, wind=gusty(4.0, 0.0))
        bench.take_off()
        places.append(bench.position)
    assert places[0] == places[1]
    assert places[0] != places[2]


def test_a_companion_can_take_off_and_land_in_offboard_alone() -> None:
    bench = Bench()
    bench.get_ready()
    bench.stream(lambda _: ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 1.0)
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.ACCEPTED
    bench.stream(lambda t: ((0.0, 0.0, -0.5 * t), (0.0, 0.0, -0.5)), 4.0)
    assert bench.position[2] < -1.5
    bench.stream(lambda t: ((0.0, 0.0, -2.0 + 0.4 * t), (0.0, 0.0, 0.4)), 9.0)
    assert not bench.is_armed


@STYLES
def test_it_flies_again_after_it_has_landed(style: str) -> None:
    bench = Bench(style)
    for _ in range(2):
        bench.take_off()
        assert bench.command(LAND) is Result.ACCEPTED
        bench.run_until(lambda: not bench.is_armed, 15.0)
    assert [log.number for log in bench.autopilot.logger.logs] == [1, 2]


def test_px4_stands_in_offboard_after_landing_from_it_and_arms_only_in_another_mode_or_with_a_stream() -> None:
    bench = Bench()
    bench.take_off()
    bench.start_streaming((0.0, 0.0, -2.5))
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 15.0)
    bench.run(1.0)
    assert bench.mode == "Offboard"
    assert bench.command(ARM, 1) is Result.TEMPORARILY_REJECTED
    assert "offboard control signal lost" in bench.autopilot.commander.problems()
    assert bench.set_mode("Hold") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.ACCEPTED


def test_px4_stands_in_its_hold_after_a_landing_that_began_there() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 15.0)
    assert bench.mode == "Hold"


def test_ardupilot_stays_in_land_after_it_has_landed() -> None:
    bench = Bench("ardupilot")
    bench.take_off()
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 15.0)
    assert bench.mode == "LAND"


def test_home_and_origin_are_told_once_they_are_known() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.counts["HOME_POSITION"] == 1
    assert bench.counts["GPS_GLOBAL_ORIGIN"] == 1
