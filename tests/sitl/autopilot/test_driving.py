"""A rover and a boat under ArduPilot's Rover: armed, led, sent on missions, and brought back by their failsafes."""

from math import dist, hypot, nan
from typing import Any

import pytest

from gloc3.mavlink.services.plan import PlanItem, PlanResult
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.physics.water import Water, Waves
from gloc3_sitl.physics.wind import gusty
from gloc3_sitl.world import World

from .bench import ARM, POSITION, REPOSITION, TAKE_OFF, VELOCITY, Bench

BOTH = pytest.mark.parametrize("vehicle", ["rover", "boat"])
NEAR_M = {"rover": 0.6, "boat": 2.2}


def armed(vehicle: str, **settings: Any) -> Bench:
    bench = Bench(None, vehicle=vehicle, **settings)
    bench.run_until(lambda: bool(bench.autopilot.estimator.is_position_good(bench.autopilot.craft.now_s)), 30.0)
    assert bench.set_mode("GUIDED") is Result.ACCEPTED
    bench.get_ready()
    assert bench.command(ARM, 1) is Result.ACCEPTED
    bench.run(0.1)
    return bench


def away_m(bench: Bench, north_m: float, east_m: float) -> float:
    return dist(bench.position[:2], (north_m, east_m))


def speed_m_s(bench: Bench) -> float:
    return hypot(*bench.sim.truth().velocity_ned_m_s[:2])


def way(bench: Bench, *items: PlanItem) -> None:
    home = bench.item(16, 0.0, 0.0, 0.0)
    assert bench.upload([home, *items]) is PlanResult.ACCEPTED


@pytest.mark.parametrize(("vehicle", "kind"), [("rover", 10), ("boat", 11)])
def test_it_says_what_it_is_and_that_it_neither_flies_nor_lands(vehicle: str, kind: int) -> None:
    bench = Bench(None, vehicle=vehicle)
    bench.run(1.5)
    assert (bench.last("HEARTBEAT").type, bench.last("HEARTBEAT").autopilot) == (kind, 3)
    assert bench.command(512, 245) is Result.ACCEPTED
    assert bench.last("EXTENDED_SYS_STATE").landed_state == 0
    assert bench.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 5) is Result.UNSUPPORTED


@BOTH
def test_sent_to_a_place_it_drives_there_and_stays(vehicle: str) -> None:
    bench = armed(vehicle)
    place = bench.item(16, 12.0, 8.0)
    target = {"x": place.x, "y": place.y, "z": 0.0, "frame": 6}
    assert bench.command(REPOSITION, -1, 1, 0, nan, as_int=target) is Result.ACCEPTED
    bench.run_until(lambda: away_m(bench, 12.0, 8.0) < NEAR_M[vehicle], 30.0)
    bench.run(10.0)
    assert away_m(bench, 12.0, 8.0) < NEAR_M[vehicle]
    assert speed_m_s(bench) < 0.15


@BOTH
def test_a_streamed_velocity_is_a_heading_and_a_speed_and_three_seconds_without_stop_it(vehicle: str) -> None:
    bench = armed(vehicle)
    bench.stream(lambda _: ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), 12.0, mask=VELOCITY | 0b10000000000)
    vn, ve, _ = bench.sim.truth().velocity_ned_m_s
    assert (vn, ve) == pytest.approx((0.0, 1.0), abs=0.12)
    bench.run(2.0)
    assert speed_m_s(bench) > 0.8
    bench.run(8.0)
    assert speed_m_s(bench) < 0.2
    assert "target not received last 3secs, stopping" in bench.texts


def test_a_yaw_beside_no_speed_turns_the_rover_on_the_spot() -> None:
    bench = armed("rover")
    bench.stream(lambda _: ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 4.0, mask=VELOCITY, yaw=2.0)
    assert bench.autopilot.estimator.yaw_rad == pytest.approx(2.0, abs=0.05)
    assert away_m(bench, 0.0, 0.0) < 0.1


@BOTH
def test_a_streamed_place_is_driven_to(vehicle: str) -> None:
    bench = armed(vehicle)
    bench.stream(lambda _: ((10.0, -5.0, 0.0), (0.0, 0.0, 0.0)), 20.0, mask=POSITION)
    assert away_m(bench, 10.0, -5.0) < NEAR_M[vehicle]


@BOTH
def test_a_mission_passes_its_waypoints_waits_where_it_shall_and_skips_what_only_aircraft_do(vehicle: str) -> None:
    bench = armed(vehicle)
    legs = [(15.0, 0.0), (15.0, 12.0), (0.0, 12.0)]
    items = [bench.item(16, *leg, 0.0, param1=2.0 if leg == legs[1] else 0.0, param2=0.0) for leg in legs]
    way(bench, bench.item(TAKE_OFF, 0.0, 0.0, 5.0), *items, bench.item(20))
    assert bench.set_mode("AUTO") is Result.ACCEPTED
    nearest = [99.0] * len(legs)
    begin = bench.sim.now_s
    while "Mission finished" not in bench.texts:
        assert bench.sim.now_s - begin < 120.0, bench.texts
        bench.run(0.1)
        nearest = [min(least, away_m(bench, *leg)) for least, leg in zip(nearest, legs, strict=True)]
    assert max(nearest) < NEAR_M[vehicle]
    assert "Skipping invalid cmd #22" in bench.texts
    assert away_m(bench, 0.0, 0.0) < NEAR_M[vehicle] + 0.3, "and back home"
    bench.run(5.0)
    assert speed_m_s(bench) < 0.2
    assert bench.command(ARM, 0) is Result.ACCEPTED


def test_the_boat_keeps_its_way_in_wind_current_and_waves() -> None:
    world = World.load("open")
    world.water = Water(current_ned_m_s=(0.0, 0.3, 0.0), waves=Waves(height_m=0.3, from_deg=270.0))
    bench = armed("boat", wind=gusty(6.0, 270.0), world=world)
    # It has drifted aside before its alignment has averaged the waves.
    way(bench, bench.item(16, 10.0, 0.0, 0.0), bench.item(16, 60.0, 0.0, 0.0), bench.item(16, 60.0, 1.0, 0.0))
    assert bench.set_mode("AUTO") is Result.ACCEPTED
    aside = []
    while bench.position[0] < 55.0:
        bench.run(0.5)
        assert bench.sim.now_s < 120.0
        if bench.position[0] > 30.0:
            aside.append(abs(bench.position[1]))
    assert max(aside) < 1.0


def test_return_goes_straight_home_and_smart_return_the_way_it_came() -> None:
    bench = armed("rover")
    bench.autopilot.commander.go_to((12.0, 0.0, 0.0), nan, nan)
    bench.run_until(lambda: away_m(bench, 12.0, 0.0) < 0.6, 30.0)
    bench.autopilot.commander.go_to((12.0, 12.0, 0.0), nan, nan)
    bench.run_until(lambda: away_m(bench, 12.0, 12.0) < 0.6, 30.0)
    assert bench.set_mode("SMART_RTL") is Result.ACCEPTED
    bench.run_until(lambda: away_m(bench, 12.0, 0.0) < 1.5, 30.0)
    assert bench.set_mode("RTL") is Result.ACCEPTED
    bench.run_until(lambda: away_m(bench, 0.0, 0.0) < 0.6, 30.0)
    assert abs(bench.position[1]) < 0.6


@BOTH
def test_by_hand_the_sticks_are_throttle_and_steering_and_hold_stops(vehicle: str) -> None:
    bench = armed(vehicle)
    bench.pilot.sticks(throttle=0.9)
    assert bench.set_mode("MANUAL") is Result.ACCEPTED
    bench.run(4.0)
    assert speed_m_s(bench) > 1.0
    left, right = bench.autopilot.outputs
    bench.pilot.sticks(throttle=0.7, roll=0.3)
    bench.run(1.0)
    assert left == right
    assert bench.autopilot.outputs[0] > bench.autopilot.outputs[1]
    assert bench.autopilot.estimator.inertial.rate_frd_rad_s[2] > 0.1
    assert bench.set_mode("HOLD") is Result.ACCEPTED
    bench.run(6.0)
    assert bench.autopilot.outputs == (0.0, 0.0)
    assert speed_m_s(bench) < 0.15


def test_a_station_that_falls_silent_stops_it_or_brings_it_back_as_its_parameters_say() -> None:
    for action, mode in ((2, "HOLD"), (1, "RTL")):
        bench = armed("rover", parameters={"FS_GCS_ENABLE": 1, "FS_ACTION": action})
        bench.send("HEARTBEAT", type=6, autopilot=8)
        bench.autopilot.failsafes.station_contact(255)
        bench.autopilot.commander.go_to((30.0, 0.0, 0.0), nan, nan)
        bench.run(7.0)
        assert bench.mode == mode


def test_the_fence_turns_it_back() -> None:
    bench = armed("rover", parameters={"FENCE_ENABLE": 1, "FENCE_RADIUS": 30})
    bench.autopilot.commander.go_to((60.0, 0.0, 0.0), nan, nan)
    bench.run_until(lambda: bench.mode == "RTL", 40.0)
    assert bench.position[0] < 31.5


def test_the_rovers_wheels_tell_how_far_they_have_turned_and_the_boat_has_none() -> None:
    bench = armed("rover")
    bench.autopilot.commander.go_to((10.0, 0.0, 0.0), nan, nan)
    bench.run(15.0)
    assert bench.command(512, 9000) is Result.ACCEPTED
    reported = bench.last("WHEEL_DISTANCE")
    assert reported.count == 2
    assert reported.distance[:2] == pytest.approx(bench.sim.truth().wheels_m, rel=0.02)
    boat = armed("boat")
    boat.command(512, 9000)
    assert not boat.counts["WHEEL_DISTANCE"]


def test_px4_does_not_steer_it() -> None:
    with pytest.raises(Exception, match="does not support 'boat'; use ardupilot"):
        Bench("px4", vehicle="boat")
