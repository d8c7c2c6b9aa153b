"""Flying on odometry from outside: no satellites, in each style's own way, and a switch between sources."""

from math import cos, dist, nan, sin
from random import Random

import pytest

from gloc3.messages.frames import conjugate, from_yaw, multiply, rotate_back
from gloc3_sitl.autopilot.modes import Result

from .bench import Bench

pytestmark = pytest.mark.flight

SET_ORIGIN, SET_SOURCES = 611, 42007
FRAME_HEADING_RAD = 0.7


class Odometer:
    """Sends ODOMETRY at 30 Hz from the truth with some noise, in a frame that points anywhere."""

    def __init__(
        self, bench: Bench, *, heading_rad: float = FRAME_HEADING_RAD, frame: int = 20, estimator: int = 2
    ) -> None:
        self.bench = bench
        self.heading_rad = heading_rad
        self.frame = frame
        self.estimator = estimator
        self.is_on = True
        self.resets = 0
        self.age_s = 0.0
        """How long ago it claims to have measured."""
        self.shift = (0.0, 0.0)
        self._random = Random(4)
        self._next_s = 0.0

    def run(self, seconds: float) -> None:
        end = self.bench.sim.now_s + seconds
        while self.bench.sim.now_s < end - 1e-9:
            self.bench.run(1.0 / 30.0)
            if self.is_on:
                self.send()

    def send(self) -> None:
        truth, noise = self.bench.sim.truth(), self._random.gauss
        cosine, sine = cos(self.heading_rad), sin(self.heading_rad)
        north, east, down = (value + noise(0.0, 0.01) for value in truth.position_ned_m)
        x, y = north * cosine + east * sine, -north * sine + east * cosine
        attitude = multiply(conjugate(from_yaw(self.heading_rad)), truth.attitude_wxyz)
        vx, vy, vz = rotate_back(truth.attitude_wxyz, truth.velocity_ned_m_s)
        covariance = (1e-4, *(0.0,) * 5, 1e-4, *(0.0,) * 14)
        self.bench.send(
            "ODOMETRY",
            time_usec=int((self.bench.sim.now_s - self.age_s) * 1e6),
            frame_id=self.frame,
            child_frame_id=12,
            x=x + self.shift[0],
            y=y + self.shift[1],
            z=down,
            q=attitude,
            vx=vx,
            vy=vy,
            vz=vz,
            pose_covariance=covariance,
            velocity_covariance=covariance,
            reset_counter=self.resets,
            estimator_type=self.estimator,
            quality=80,
        )


def indoors(style: str) -> Bench:
    bench = Bench(style)
    bench.sim.sensors.fail("fix", "lost")
    if style == "px4":
        bench.set_parameter("EKF2_GPS_CTRL", 0)
        bench.set_parameter("EKF2_EV_CTRL", 7)
    else:
        bench.set_parameter("VISO_TYPE", 1)
        bench.set_parameter("EK3_SRC1_POSXY", 6)
        bench.set_parameter("EK3_SRC1_VELXY", 6)
        bench.set_parameter("EK3_SRC1_POSZ", 6)
    return bench


def set_origin(bench: Bench) -> None:
    home = bench.sim.world.home
    place = {
        "frame": 0,
        "x": round(home.latitude_deg * 1e7),
        "y": round(home.longitude_deg * 1e7),
        "z": home.altitude_m,
    }
    assert bench.command(SET_ORIGIN, as_int=place) is Result.ACCEPTED


def lift(bench: Bench, odometer: Odometer) -> None:
    odometer.run(4.0)
    set_origin(bench)
    odometer.run(0.5)
    if bench.is_px4:
        assert bench.command(400, 1) is Result.ACCEPTED
        assert bench.command(22, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
    else:
        assert bench.set_mode("GUIDED") is Result.ACCEPTED
        assert bench.command(400, 1) is Result.ACCEPTED
        assert bench.command(22, 0, 0, 0, 0, 0, 0, 2.5) is Result.ACCEPTED
    odometer.run(8.0)


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_it_takes_off_and_holds_on_odometry_alone(style: str) -> None:
    bench = indoors(style)
    odometer = Odometer(bench)
    lift(bench, odometer)
    worst = 0.0
    for _ in range(20):
        odometer.run(0.5)
        worst = max(worst, dist(bench.position, (0.0, 0.0, -2.5)))
    assert worst < 0.25


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_it_lands_when_the_odometry_ends(style: str) -> None:
    bench = indoors(style)
    odometer = Odometer(bench)
    lift(bench, odometer)
    odometer.is_on = False
    bench.run_until(lambda: bench.mode.lower() == "land", 3.0)
    bench.run_until(lambda: not bench.is_armed, 20.0)


@pytest.mark.parametrize(("age_s", "is_used"), [(0.4, True), (2.4, False), (-3600.0, True)])
def test_px4_drops_odometry_that_was_long_on_its_way_and_takes_another_clock_s_for_now(
    age_s: float, is_used: bool
) -> None:
    px4 = indoors("px4")
    odometer = Odometer(px4)
    odometer.run(8.0)
    odometer.age_s = age_s
    odometer.run(4.0)
    assert px4.autopilot.estimator.is_position_good(px4.sim.now_s) is is_used


def test_ardupilot_ignores_other_frames_and_px4_refuses_other_estimators() -> None:
    ardupilot = indoors("ardupilot")
    Odometer(ardupilot, frame=1).run(2.0)
    assert not ardupilot.autopilot.estimator.is_position_good(ardupilot.sim.now_s)
    px4 = indoors("px4")
    Odometer(px4, estimator=7).run(2.0)
    assert px4.sim.front.refusal == "estimator type 7 is not supported"


def test_odometry_beside_a_fix_takes_over_without_a_jump_when_the_fix_is_lost() -> None:
    bench = Bench()
    bench.set_parameter("EKF2_EV_CTRL", 1)
    odometer = Odometer(bench)
    odometer.shift = (3.0, -2.0)
    odometer.run(1.0)
    bench.take_off()
    odometer.run(3.0)
    before = bench.autopilot.estimator.reset_count
    bench.sim.sensors.fail("fix", "lost")
    odometer.run(8.0)
    assert bench.mode == "Hold"
    assert bench.autopilot.estimator.reset_count == before
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.3


def test_a_reset_of_the_odometer_moves_the_vehicle_nowhere() -> None:
    bench = indoors("px4")
    odometer = Odometer(bench)
    lift(bench, odometer)
    odometer.resets, odometer.shift = 1, (2.0, 0.0)
    odometer.run(5.0)
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.4


def test_ardupilot_switches_its_set_of_sources_by_command() -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("VISO_TYPE", 1)
    bench.set_parameter("EK3_SRC2_POSXY", 6)
    bench.set_parameter("EK3_SRC2_YAW", 1)
    bench.take_off()
    odometer = Odometer(bench, heading_rad=0.0)
    assert bench.command(SET_SOURCES, 2) is Result.ACCEPTED
    bench.sim.sensors.fail("fix", "lost")
    odometer.run(6.0)
    assert bench.mode == "GUIDED"
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.4
    assert bench.command(SET_SOURCES, 4) is Result.DENIED


def px4_without_a_compass() -> Bench:
    bench = Bench(is_without_gps=True)
    set_origin(bench)
    return bench


def test_px4_believes_a_heading_in_the_north_frame_alone_and_takes_off_and_holds_by_it() -> None:
    bench = px4_without_a_compass()
    odometer = Odometer(bench, heading_rad=0.0, frame=1)
    odometer.run(4.0)
    assert bench.autopilot.commander.problems() == []
    assert bench.command(512, 33) is Result.ACCEPTED
    assert bench.command(400, 1) is Result.ACCEPTED
    assert bench.command(22, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
    odometer.run(10.0)
    assert bench.mode == "Hold"
    assert dist(bench.position, (0.0, 0.0, -2.5)) < 0.25


@pytest.mark.parametrize("mode", ["Hold", "Takeoff"])
def test_px4_does_not_align_its_heading_by_odometry_in_a_frame_of_its_own(mode: str) -> None:
    bench = px4_without_a_compass()
    odometer = Odometer(bench, heading_rad=0.0, frame=20)
    odometer.run(4.0)
    assert bench.autopilot.estimator.is_position_good(bench.sim.now_s)
    assert bench.command(512, 33) is Result.TEMPORARILY_REJECTED
    assert bench.set_mode(mode) is Result.ACCEPTED
    odometer.run(0.5)
    assert bench.command(400, 1) is Result.TEMPORARILY_REJECTED


def test_px4_arms_in_offboard_on_a_heading_that_is_not_aligned_and_is_not_taken_into_hold() -> None:
    bench = px4_without_a_compass()
    odometer = Odometer(bench, heading_rad=0.0, frame=20)
    odometer.run(4.0)

    def stream(seconds: float, down: float) -> None:
        for _ in range(round(seconds * 20)):
            bench.send(
                "SET_POSITION_TARGET_LOCAL_NED",
                target_system=1,
                target_component=1,
                coordinate_frame=1,
                type_mask=0b100111111000,
                z=down,
            )
            odometer.run(0.05)

    stream(1.0, 0.0)
    assert bench.set_mode("Offboard") is Result.ACCEPTED
    stream(0.3, 0.0)
    assert bench.command(400, 1) is Result.ACCEPTED
    stream(6.0, -2.0)
    assert bench.position[2] < -1.5
    assert bench.set_mode("Hold") is Result.TEMPORARILY_REJECTED
    odometer.run(2.0)
    assert bench.mode == "Land"
