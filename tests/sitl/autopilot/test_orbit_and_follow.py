"""PX4's orbit and follow-me, flown; ArduPilot's refusals."""

from itertools import pairwise
from math import atan2, dist, hypot, nan

import pytest

from gloc3.messages.frames import TangentPlane, wrap_pi
from gloc3_sitl.autopilot.behaviours.orbit import Facing, circle
from gloc3_sitl.autopilot.modes import Result

from .bench import ARM, Bench

ORBIT, FOLLOW = 34, (4, 8)


def orbit(bench: Bench, radius_m: float, speed_m_s: float, facing: float = 0.0) -> Result:
    """As mavsdk sends it: over the sea, in a frame that says over home, at which PX4 does not look."""
    centre = bench.item(16, 10.0, 0.0)
    altitude = bench.sim.world.home.altitude_m + 4.0
    place = {"frame": 6, "x": centre.x, "y": centre.y, "z": altitude}
    return bench.command(ORBIT, radius_m, speed_m_s, facing, nan, as_int=place)


@pytest.mark.flight
@pytest.mark.parametrize(("radius_m", "sign"), [(5.0, 1.0), (-5.0, -1.0)])
def test_an_orbit_keeps_its_radius_height_and_sense_and_looks_at_the_centre(radius_m: float, sign: float) -> None:
    bench = Bench()
    bench.take_off()
    assert orbit(bench, radius_m, 2.0) is Result.ACCEPTED
    assert bench.mode == "Orbit"
    bench.run(10.0)
    angles = []
    for _ in range(40):
        bench.run(0.25)
        north, east, down = bench.position
        assert hypot(north - 10.0, east) == pytest.approx(5.0, abs=0.4)
        assert down == pytest.approx(-4.0, abs=0.3)
        to_centre = atan2(-east, 10.0 - north)
        assert abs(wrap_pi(bench.autopilot.estimator.yaw_rad - to_centre)) < 0.25
        angles.append(atan2(east, north - 10.0))
    turned = sum(wrap_pi(now - then) for then, now in pairwise(angles))
    assert turned * sign == pytest.approx(39 * 0.25 * 2.0 / 5.0, rel=0.1)
    bench.command(512, 360)
    assert bench.last("ORBIT_EXECUTION_STATUS").radius == radius_m
    assert bench.set_mode("Hold") is Result.ACCEPTED
    bench.run(4.0)
    rest = bench.position
    bench.run(2.0)
    assert dist(rest, bench.position) < 0.2


def test_an_orbit_that_nobody_can_fly_is_brought_within_bounds() -> None:
    tight = circle((0.0, 0.0, -3.0), 0.1, 50.0, Facing.CENTRE, 100.0)
    assert tight.radius_m == 1.0
    assert tight.speed_m_s**2 / tight.radius_m <= 2.0 + 1e-9
    assert circle((0.0, 0.0, -3.0), 1e6, nan, Facing.CENTRE, 100.0).radius_m == 100.0


def test_an_orbit_is_refused_on_the_ground_and_in_ardupilot_style() -> None:
    px4, ardupilot = Bench(), Bench("ardupilot")
    for bench in (px4, ardupilot):
        bench.get_ready()
    assert orbit(px4, 5.0, 1.0) is Result.TEMPORARILY_REJECTED
    assert px4.command(ARM, 1) is Result.ACCEPTED
    assert orbit(px4, 5.0, 1.0) is Result.TEMPORARILY_REJECTED
    assert orbit(ardupilot, 5.0, 1.0) is Result.UNSUPPORTED


def tell_target(bench: Bench, north_m: float, speed_m_s: float) -> None:
    plane = TangentPlane(bench.sim.world.home)
    place = plane.geo_from_ned((north_m, 0.0, 0.0))
    bench.send(
        "FOLLOW_TARGET",
        timestamp=0,
        est_capabilities=3,
        lat=round(place.latitude_deg * 1e7),
        lon=round(place.longitude_deg * 1e7),
        alt=place.altitude_m,
        vel=(speed_m_s, 0.0, 0.0),
        acc=(nan, nan, nan),
        attitude_q=(1.0, nan, nan, nan),
        rates=(nan, nan, nan),
        position_cov=(nan, nan, nan),
        custom_state=0,
    )


@pytest.mark.flight
def test_it_follows_who_walks_behind_him_at_the_height_set_and_holds_when_he_is_silent() -> None:
    bench = Bench()
    bench.set_parameter("FLW_TGT_DST", 6.0)
    bench.take_off()
    assert bench.command(176, 1, *FOLLOW) is Result.ACCEPTED
    bench.run(2.0)
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.3
    for step in range(60):
        tell_target(bench, 10.0 + 0.5 * step, 1.0)
        bench.run(0.5)
    north, east, down = bench.position
    assert 40.0 - north == pytest.approx(6.0, abs=1.5)
    assert abs(east) < 0.5
    assert down == pytest.approx(-8.0, abs=0.4)
    assert abs(bench.autopilot.estimator.yaw_rad) < 0.2
    bench.run(10.0)
    rest = bench.position
    bench.run(2.0)
    assert dist(rest, bench.position) < 0.2
