"""A plane under ArduPilot's Plane: it takes off, is sent about, flies missions, comes back and lands, in wind, too."""

from functools import partial
from math import dist, hypot, nan
from typing import Any

import pytest

from gloc3.mavlink.services.plan import PlanItem, PlanResult
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.physics.wind import gusty

from .bench import ARM, REPOSITION, TAKE_OFF, Bench

REQUEST_MESSAGE = 512


def ready(**settings: Any) -> Bench:
    bench = Bench(None, vehicle="plane", **settings)
    bench.run_until(lambda: bool(bench.autopilot.estimator.is_position_good(bench.autopilot.craft.now_s)), 10.0)
    bench.get_ready()
    return bench


def flying(**settings: Any) -> Bench:
    bench = ready(**settings)
    assert bench.set_mode("TAKEOFF") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.ACCEPTED
    bench.run_until(lambda: height_m(bench) > 45.0, 60.0)
    return bench


def height_m(bench: Bench) -> float:
    return -bench.position[2]


def landed_state(bench: Bench) -> int:
    assert bench.command(REQUEST_MESSAGE, 245) is Result.ACCEPTED
    return int(bench.last("EXTENDED_SYS_STATE").landed_state)


def away_m(bench: Bench, north_m: float, east_m: float) -> float:
    return dist(bench.position[:2], (north_m, east_m))


def is_near(bench: Bench, north_m: float, east_m: float) -> bool:
    return away_m(bench, north_m, east_m) < 40.0


def airspeed_m_s(bench: Bench) -> float:
    truth = bench.sim.truth()
    return hypot(*(v - w for v, w in zip(truth.velocity_ned_m_s, truth.wind_ned_m_s, strict=True)))


def way(bench: Bench, *items: PlanItem) -> None:
    home = bench.item(16, 0.0, 0.0, 0.0)
    assert bench.upload([home, *items]) is PlanResult.ACCEPTED


def test_it_says_that_it_is_a_plane_and_takes_off_by_a_mode_only() -> None:
    bench = ready()
    assert (bench.last("HEARTBEAT").type, bench.last("HEARTBEAT").autopilot) == (1, 3)
    assert bench.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 50) is Result.UNSUPPORTED
    assert bench.set_mode("RTL") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.FAILED


def test_it_takes_off_straight_along_its_runway_to_its_height_at_its_air_speed() -> None:
    bench = flying()
    north, east, _ = bench.position
    assert abs(east) < 15.0
    assert north > 200.0
    assert not bench.is_landed
    assert airspeed_m_s(bench) == pytest.approx(23.0, abs=2.0)
    assert bench.command(512, 74) is Result.ACCEPTED
    assert bench.last("VFR_HUD").airspeed == pytest.approx(airspeed_m_s(bench), abs=1.5)


def test_sent_to_a_place_it_goes_round_it_at_the_height_asked_for() -> None:
    bench = flying()
    place = bench.item(16, 500.0, 300.0)
    target = {"x": place.x, "y": place.y, "z": 70.0, "frame": 6}
    assert bench.command(REPOSITION, -1, 1, 0, nan, as_int=target) is Result.ACCEPTED
    bench.run(45.0)
    for _ in range(6):
        bench.run(4.0)
        assert away_m(bench, 500.0, 300.0) == pytest.approx(80.0, abs=12.0)
        assert height_m(bench) == pytest.approx(70.0, abs=3.0)


def test_a_mission_in_wind_takes_off_passes_its_waypoints_and_lands_beside_its_place() -> None:
    bench = ready(wind=gusty(6.0, 270.0))
    corners = ((500.0, 0.0), (500.0, 400.0), (-300.0, 400.0))
    way(
        bench,
        bench.item(22, 0.0, 0.0, 40.0),
        *(bench.item(16, *corner, 40.0) for corner in corners),
        bench.item(16, -500.0, 0.0, 25.0),
        bench.item(21, 0.0, 0.0, 0.0),
    )
    assert bench.set_mode("AUTO") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.ACCEPTED
    for north, east in corners:
        bench.run_until(partial(is_near, bench, north, east), 90.0)
        assert height_m(bench) == pytest.approx(40.0, abs=6.0)
    slowest = 30.0
    while not bench.is_landed:
        bench.run(1.0)
        if height_m(bench) > 4.0:
            slowest = min(slowest, airspeed_m_s(bench))
    assert slowest > 16.5
    assert abs(bench.position[0]) < 300.0
    assert abs(bench.position[1]) < 65.0  # its wheels are not steered, and the wind turns it
    bench.run(4.0)
    assert not bench.is_armed


def test_it_returns_to_a_circle_round_home_and_lands_from_there() -> None:
    bench = flying()
    assert bench.set_mode("RTL") is Result.ACCEPTED
    bench.run(60.0)
    assert away_m(bench, 0.0, 0.0) == pytest.approx(80.0, abs=12.0)
    assert height_m(bench) == pytest.approx(60.0, abs=3.0)
    assert bench.set_mode("AUTOLAND") is Result.ACCEPTED
    bench.run_until(lambda: bench.is_landed, 150.0)
    assert away_m(bench, 0.0, 0.0) < 220.0
    bench.run(4.0)
    assert not bench.is_armed


def test_it_lands_only_what_flies_and_may_be_disarmed_where_it_hardly_moves() -> None:
    bench = flying()
    assert bench.command(ARM, 0) is Result.FAILED
    bench = ready()
    assert bench.set_mode("AUTOLAND") is Result.FAILED
    assert bench.texts[-1] == "AUTOLAND denied: it does not fly"
    assert bench.set_mode("MANUAL") is Result.ACCEPTED
    bench.pilot.sticks(throttle=0.4)
    bench.pilot.arm()
    bench.run(0.5)
    assert bench.is_armed
    assert not bench.is_landed, "its motor turns"
    assert landed_state(bench) == 1
    assert bench.command(ARM, 0) is Result.ACCEPTED
    bench.pilot.sticks(throttle=1.0)
    bench.pilot.arm()
    bench.run(6.0)
    assert landed_state(bench) == 2
    assert bench.command(ARM, 0) is Result.FAILED


def test_a_lost_station_sends_it_home_after_the_time_that_is_set() -> None:
    bench = flying()
    bench.set_parameter("FS_GCS_ENABL", 1)
    bench.set_parameter("FS_LONG_ACTN", 1)
    bench.autopilot.failsafes.station_contact(255)
    bench.run(4.0)
    assert bench.mode == "TAKEOFF"
    bench.run(3.0)
    assert bench.mode == "RTL"


def test_without_a_motor_it_glides_and_the_pilot_flies_by_sticks() -> None:
    bench = flying()
    bench.pilot.switch_mode("FBWA")
    bench.pilot.sticks(roll=0.5, throttle=0.0)
    before = height_m(bench)
    bench.run(5.0)
    assert bench.mode == "FBWA"
    assert before - 25.0 < height_m(bench) < before - 3.0
    assert airspeed_m_s(bench) > 15.0
