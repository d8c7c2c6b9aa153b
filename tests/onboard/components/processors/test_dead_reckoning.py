"""Dead reckoning: how far it is off, what it claims, what it says without bottom lock, and how satellites set it right."""

from math import cos, hypot, pi, radians, sin

import numpy as np
import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.messages.frames import GeoPoint, TangentPlane, from_yaw
from gloc3.messages.perception import BottomVelocity, SatelliteFix
from gloc3.messages.vehicle import AutopilotPose, Pose, Setpoint
from gloc3_onboard.algorithms.odometry.dead_reckoner import DeadReckoner, Errors
from gloc3_onboard.components.processors.dead_reckoning import DeadReckoningProcessor

pytestmark = pytest.mark.thorough

BAY = (41.52, -70.7, 0.0)
SPEED_M_S = 1.0


class Way:
    """A straight way north at 1 m/s with errors drawn as the filter is told, and what the filter makes of it."""

    def __init__(self, seed: int, errors: Errors, *, has_lock: bool = True, satellite_std_m: float = 0.0) -> None:
        random = np.random.default_rng(seed)
        self.filter = DeadReckoner(errors)
        self.filter.begin(0.0, 0.0, 0.01)
        self.turn_rad = errors.heading_rad * random.standard_normal()
        self.scale = errors.scale * random.standard_normal()
        self.true_m = 0.0
        self._random, self._has_lock, self._satellite_std_m = random, has_lock, satellite_std_m

    def run(self, seconds: float, *, course_rad: float = 0.0) -> "Way":
        """Goes on: predictions 20 times, velocities 5 times, fixes once a second."""
        for step in range(round(seconds * 20)):
            self.filter.predict(0.05, is_measured=self._has_lock)
            self.true_m += 0.05 * SPEED_M_S
            if self._has_lock and step % 4 == 0:
                # The device is turned to the right by the error, so what it meets goes to its left.
                noise = 0.005 * self._random.standard_normal(2)
                speed = SPEED_M_S * (1.0 + self.scale)
                along, across = speed * cos(self.turn_rad), -speed * sin(self.turn_rad)
                self.filter.use_velocity(along + noise[0], across + noise[1], course_rad, 0.005)
            if self._satellite_std_m and step % 20 == 0:
                north, east = self._satellite_std_m * self._random.standard_normal(2)
                self.filter.use_fix(self.true_m + north, east, self._satellite_std_m)
        return self

    @property
    def error_m(self) -> tuple[float, float]:
        """Of the position, north and east."""
        north, east = self.filter.position_m
        return north - self.true_m, east


def test_with_a_good_compass_it_is_off_by_less_than_a_hundredth_of_the_way() -> None:
    errors = Errors(heading_rad=radians(0.3), scale=0.001)
    shares = [hypot(*Way(seed, errors).run(200.0).error_m) / 200.0 for seed in range(6)]
    assert max(shares) < 0.012
    assert np.sqrt(np.mean(np.square(shares))) < 0.01


def test_its_covariance_is_that_of_its_errors() -> None:
    errors = Errors(heading_rad=radians(0.5), scale=0.003)
    squares = []
    for seed in range(24):
        way = Way(seed, errors).run(60.0)
        std_n, std_e = way.filter.std_m
        squares += [(way.error_m[0] / std_n) ** 2, (way.error_m[1] / std_e) ** 2]
    assert 0.6 < float(np.mean(squares)) < 1.6, "normalized errors squared have a mean of 1"


def test_the_claimed_error_grows_with_the_way() -> None:
    way = Way(1, Errors())
    near = max(way.run(50.0).filter.std_m)
    far = max(way.run(150.0).filter.std_m)
    assert far > 2.5 * near


def test_without_bottom_lock_it_claims_what_a_current_may_do() -> None:
    filter_ = DeadReckoner()
    filter_.begin(0.0, 0.0, 0.5)
    for _ in range(100):
        filter_.predict(0.1, is_measured=True)
        filter_.use_velocity(1.0, 0.0, 0.0, 0.005)
    locked = max(filter_.std_m)
    for _ in range(600):
        filter_.predict(0.1, is_measured=False)
    adrift_m = hypot(0.2 * 60.0, 0.0)
    assert max(filter_.std_m) > adrift_m / 2.0 > 3.0 * locked
    assert hypot(*filter_.velocity_m_s) < 0.1, "nothing is asked of it, so it is believed to stand"


def test_without_bottom_lock_it_is_believed_to_do_what_it_is_asked_to() -> None:
    filter_ = DeadReckoner()
    filter_.begin(0.0, 0.0, 0.5)
    for _ in range(400):
        filter_.predict(0.1, is_measured=False, commanded_m_s=(0.0, -0.5))
    assert filter_.velocity_m_s == pytest.approx((0.0, -0.5), abs=0.01)
    assert filter_.position_m == pytest.approx((0.0, -0.5 * 35.0), abs=0.3), "after a time constant of 5 s"


def test_satellites_on_the_way_teach_it_its_heading_error() -> None:
    errors = Errors(heading_rad=radians(2.0))
    way = Way(5, errors, satellite_std_m=0.05).run(100.0)
    assert abs(way.turn_rad) > radians(0.5)
    assert way.filter.heading_error_rad == pytest.approx(way.turn_rad, abs=radians(0.15))


def test_a_velocity_that_does_not_fit_is_left_out() -> None:
    way = Way(2, Errors()).run(20.0)
    assert way.filter.use_velocity(9.0, 0.0, 0.0, 0.005) > 1.0
    assert way.filter.velocity_m_s[0] == pytest.approx(1.0, abs=0.05)


# --- the component ---


class Sea:
    """A bench with the processor, and what its samplers would say."""

    def __init__(self, bench: Bench, *, satellite_std_m: float = 1.0, **settings: object) -> None:
        self.bench = bench
        self.satellite_std_m = satellite_std_m
        self.wave_m = 0.0
        """Amplitude of what the vehicle bobs by, every five seconds."""
        self.heading_rad = 0.0
        row = ComponentRow(
            name="pose",
            class_name="x:Y",
            rate_hz=20.0,
            settings={"origin_geo": list(BAY), "heading_std_deg": 0.3, **settings},
        )
        bench.host(row, DeadReckoningProcessor)
        self._plane = TangentPlane(GeoPoint(*BAY))

    def run(
        self, seconds: float, *, speed_m_s: float = 0.0, lock: bool = True, at: tuple[float, float] | None = None
    ) -> Pose:
        """Ten estimates a second, five velocities, and a fix a second where there is a place."""
        for step in range(round(seconds * 10)):
            estimate = AutopilotPose(
                position_ned_m=(70.0, -30.0, 4.0 + self.wave_m * sin(radians(7.2 * step))),
                velocity_ned_m_s=(0.0, 0.0, 0.0),
                ned_from_frd=from_yaw(self.heading_rad),
                rate_frd_rad_s=(0.0, 0.0, 0.0),
                origin_geo=BAY,
            )
            self.bench.send("autopilot_pose", estimate)
            if step % 2 == 0:
                velocity = BottomVelocity(velocity_frd_m_s=(speed_m_s, 0.0, 0.0), std_m_s=0.005, altitude_m=9.0)
                self.bench.send("dvl", velocity if lock else BottomVelocity(is_valid=False, reason="no bottom lock"))
            if step % 10 == 0 and at is not None:
                latitude, longitude, _ = self._plane.geo_from_ned((at[0], at[1], 0.0))
                fix = SatelliteFix(place_geo=(latitude, longitude, 0.0), std_m=self.satellite_std_m, satellites=9)
                self.bench.send("satellites", fix)
            self.bench.run(0.1)
        pose: Pose = self.bench.last("pose")
        return pose


def test_it_has_no_place_before_the_first_fixes_and_dives_on_from_them() -> None:
    with Bench() as bench:
        sea = Sea(bench)
        nowhere = sea.run(2.0)
        assert not nowhere.is_valid
        assert nowhere.reason == "the start position is not known: no fixes yet"
        sea.run(6.0, at=(10.0, -5.0))
        pose = sea.run(20.0, speed_m_s=0.5)
        assert pose.is_valid
        assert pose.position_ned_m == pytest.approx((20.0, -5.0, 4.0), abs=0.3), "depth is the autopilot's"
        assert pose.sources == ["dvl", "heading", "depth"]


def test_waves_in_which_the_autopilot_took_its_zero_are_told_also_under_water() -> None:
    with Bench() as bench:
        sea = Sea(bench)
        assert sea.run(8.0, at=(0.0, 0.0)).position_std_m[2] == pytest.approx(0.1)
        sea.wave_m = 0.2
        bobbing = sea.run(120.0, at=(0.0, 0.0)).position_std_m[2]
        assert bobbing == pytest.approx(hypot(0.1, 0.2 / 2**0.5), rel=0.02)
        bench.send("setpoint", Setpoint(action_id="a", velocity_ned_m_s=(0.0, 0.0, 0.5)))
        sea.wave_m = 3.0  # it dives and climbs
        assert sea.run(20.0).position_std_m[2] == pytest.approx(bobbing)


def test_it_says_that_it_is_adrift_and_at_last_that_it_is_lost() -> None:
    with Bench() as bench:
        sea = Sea(bench, lost_std_m=15.0, blind_s=600.0)
        sea.run(8.0, at=(0.0, 0.0))
        adrift = sea.run(5.0, lock=False)
        assert adrift.is_valid
        assert adrift.reason == "adrift: no bottom lock"
        assert adrift.sources == ["heading", "depth"]
        lost = sea.run(60.0, lock=False)
        assert not lost.is_valid
        assert lost.reason.startswith("lost: its standard deviation is")


def test_it_is_lost_after_a_while_without_any_velocity_and_satellites_and_back_with_them() -> None:
    with Bench() as bench:
        sea = Sea(bench)
        sea.run(8.0, at=(0.0, 0.0))
        assert sea.run(7.0, lock=False).is_valid, "1.5 s of which count as locked"
        lost = sea.run(1.0, lock=False)
        assert (lost.is_valid, lost.reason) == (False, "adrift: no bottom lock for 7 s")
        assert sea.run(3.0, at=(0.0, 0.0), lock=False).is_valid


def test_adrift_it_believes_that_it_does_what_it_is_asked_to() -> None:
    with Bench() as bench:
        sea = Sea(bench)
        begun = sea.run(8.0, at=(0.0, 0.0))
        sea.run(2.0, lock=False)
        bench.send("setpoint", Setpoint(action_id="a", velocity_ned_m_s=(0.3, 0.0, 0.0)))
        for _ in range(20):
            bench.send("setpoint", Setpoint(action_id="a", velocity_ned_m_s=(0.3, 0.0, 0.0)))
            adrift = sea.run(1.0, lock=False)
        assert adrift.position_ned_m[0] - begun.position_ned_m[0] == pytest.approx(0.3 * (20.0 - 5.0), abs=1.0)
        assert adrift.velocity_ned_m_s[0] == pytest.approx(0.3, abs=0.05)


def test_a_fix_after_the_dive_sets_it_right_and_counts_as_a_jump() -> None:
    with Bench() as bench:
        sea = Sea(bench)
        sea.run(8.0, at=(0.0, 0.0))
        adrift = sea.run(30.0, lock=False)
        up = sea.run(15.0, at=(12.0, 8.0))
        assert up.position_ned_m[:2] == pytest.approx((12.0, 8.0), abs=0.6)
        assert up.reset_counter > adrift.reset_counter


def test_a_receiver_that_is_stuck_does_not_hold_a_moving_vehicle_back() -> None:
    with Bench() as bench:
        sea = Sea(bench, satellite_std_m=0.05)
        sea.run(8.0, at=(0.0, 0.0))
        pose = sea.run(5.0, speed_m_s=0.1, at=(0.0, 0.0))
        assert pose.position_ned_m[0] == pytest.approx(0.5, abs=0.04)
        assert pose.sources == ["dvl", "heading", "depth"]
        moved = sea.run(1.0, speed_m_s=0.1, at=(0.6, 0.0))
        assert "satellites" in moved.sources


def test_in_a_tank_it_begins_at_the_origin() -> None:
    with Bench() as bench:
        pose = Sea(bench, begins_at_origin=True).run(3.0)
        assert pose.is_valid
        assert pose.position_ned_m[:2] == pytest.approx((0.0, 0.0), abs=0.05)


def test_what_is_carried_on_after_a_crash_knows_the_heading_before_it_takes_in_a_velocity() -> None:
    """The first velocity comes before the first attitude; taken as one to the north, the right ones did not fit any more."""
    with Bench() as bench:
        sea = Sea(bench)
        sea.heading_rad = pi
        sea.run(6.0, at=(0.0, 0.0))
        before = sea.run(20.0, speed_m_s=0.5)
        assert bench.command("pose", "stop").is_accepted
        bench.run(8.0)
        assert bench.command("pose", "start").is_accepted
        bench.send("dvl", BottomVelocity(velocity_frd_m_s=(0.5, 0.0, 0.0), std_m_s=0.005, altitude_m=9.0))
        bench.run(0.05)
        pose = sea.run(10.0, speed_m_s=0.5)
    assert before.position_ned_m[0] == pytest.approx(-10.0, abs=0.3)
    assert pose.sources == ["dvl", "heading", "depth"]
    assert -18.5 < pose.position_ned_m[0] < -14.5, "adrift for 8 s, then 5 m"
