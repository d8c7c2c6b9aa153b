"""A second multirotor: less than half the weight, under the same autopilots."""

import pytest
from msgspec.structs import replace
from tests.sitl.autopilot.bench import Bench

from gloc3.errors import Misuse
from gloc3.messages.frames import GeoPoint
from gloc3.platform.reader import load_platform
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.vehicles import HUMMINGBIRD, PELICAN
from gloc3_sitl.vehicles.table import vehicle_of

LAND = 21


def test_it_is_a_body_of_its_own() -> None:
    small, large = (Quadrotor(name, GeoPoint(63.44, 10.4, 10.0)) for name in ("hummingbird", "pelican"))
    for _ in range(200):
        small.step((0.0, 0.0, 0.0, 0.0))
    assert small.mass_kg == pytest.approx(0.716)
    assert small.mass_kg < 0.5 * large.mass_kg
    assert small.truth().standing_height_m == pytest.approx(HUMMINGBIRD.foot_depth_m, abs=0.004)
    assert HUMMINGBIRD.foot_depth_m < PELICAN.foot_depth_m


@pytest.mark.parametrize(("style", "hover"), [("px4", "MPC_THR_HOVER"), ("ardupilot", "MOT_THST_HOVER")])
def test_it_takes_off_stands_and_lands_under_either_autopilot(style: str, hover: str) -> None:
    bench = Bench(style, vehicle="hummingbird")
    assert bench.autopilot.parameters[hover] == pytest.approx(0.29)
    bench.get_ready()
    bench.take_off(2.5)
    highest_m = 0.0
    for _ in range(80):
        bench.run(0.1)
        highest_m = max(highest_m, -bench.position[2])
    assert highest_m < 2.8
    assert bench.position == pytest.approx((0.0, 0.0, -2.5), abs=0.2)
    bench.send("COMMAND_LONG", target_system=1, target_component=1, command=LAND)
    bench.run_until(lambda: not bench.is_armed, 20.0)
    assert bench.sim.truth().is_on_ground


def test_a_platform_names_the_airframe_that_stands_for_it() -> None:
    assert vehicle_of(load_platform("hummingbird")) == "hummingbird"
    assert vehicle_of(load_platform("pelican")) == "pelican"
    known = load_platform("hummingbird")
    with pytest.raises(Misuse, match="unknown vehicle 'humingbird'"):
        vehicle_of(replace(known, vehicle=replace(known.vehicle, airframe="humingbird")))
