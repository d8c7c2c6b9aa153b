"""An autopilot without satellites flies by the messages that our driver sends, in either style, and lands without them."""

from math import dist, nan
from random import Random

import pytest

from gloc3.mavlink.message import Address
from gloc3.messages.vehicle import Pose
from gloc3_onboard.autopilot.style import LOCAL_FRD, LOCAL_NED
from gloc3_onboard.autopilot.vision import Spread, odometry_message, origin_message
from gloc3_sitl.autopilot.modes import Result

from .bench import Bench

pytestmark = pytest.mark.flight

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])


class Poses:
    """The pose of the truth with a centimetre of noise, 25 times a second, as our driver sends it."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.resets = 0
        self.shift = (0.0, 0.0, 0.0)
        self._random = Random(2)

    def run(self, seconds: float) -> None:
        end_s = self.bench.sim.now_s + seconds
        while self.bench.sim.now_s < end_s - 1e-9:
            self.bench.run(0.04)
            truth, noise = self.bench.sim.truth(), self._random.gauss
            n, e, d = (a + b + noise(0.0, 0.01) for a, b in zip(truth.position_ned_m, self.shift, strict=True))
            pose = Pose(
                position_ned_m=(n, e, d),
                velocity_ned_m_s=truth.velocity_ned_m_s,
                ned_from_frd=truth.attitude_wxyz,
                rate_frd_rad_s=truth.rate_frd_rad_s,
                position_std_m=(0.01, 0.01, 0.01),
                reset_counter=self.resets,
            )
            frame = LOCAL_NED if self.bench.is_px4 else LOCAL_FRD
            self.bench.send_message(odometry_message(pose, round(self.bench.sim.now_s * 1e6), Spread(), frame))


def arm(bench: Bench) -> Result:
    if not bench.is_px4:
        assert bench.set_mode("GUIDED") is Result.ACCEPTED
    return bench.command(400, 1)


def lift(bench: Bench, poses: Poses) -> None:
    poses.run(2.0)
    home = bench.sim.world.home
    place = (home.latitude_deg, home.longitude_deg, home.altitude_m)
    bench.send_message(origin_message(place, Address(1, 1)))
    poses.run(1.0)
    assert arm(bench) is Result.ACCEPTED
    height = (nan, 0, 0, nan, nan, nan, nan) if bench.is_px4 else (0, 0, 0, 0, 0, 0, 2.5)
    assert bench.command(22, *height) is Result.ACCEPTED
    poses.run(8.0)


@STYLES
def test_it_does_not_arm_before_it_is_told_where_it_is(style: str) -> None:
    bench = Bench(style, is_without_gps=True)
    bench.run(3.0)
    assert bench.command(400, 1) is not Result.ACCEPTED
    assert any("position" in text for text in bench.autopilot.commander.problems())


@STYLES
def test_it_holds_its_place_by_our_pose_and_lands_when_that_ends(style: str) -> None:
    bench = Bench(style, is_without_gps=True)
    poses = Poses(bench)
    lift(bench, poses)
    worst_m = 0.0
    for _ in range(10):
        poses.run(0.5)
        worst_m = max(worst_m, dist(bench.position, (0.0, 0.0, -2.5)))
    assert worst_m < 0.15
    bench.run_until(lambda: bench.mode.lower() == "land", 3.0)
    bench.run_until(lambda: not bench.is_armed, 20.0)


def test_a_pose_that_jumps_and_says_so_moves_the_vehicle_nowhere() -> None:
    bench = Bench(is_without_gps=True)
    poses = Poses(bench)
    lift(bench, poses)
    poses.resets, poses.shift = 1, (1.5, -1.0, 0.0)
    poses.run(4.0)
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.3
