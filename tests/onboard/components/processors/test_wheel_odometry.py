"""Odometry by wheels: ways, turns and slip, what the component reports of them, and whether the pose believes it."""

from cmath import rect
from math import degrees, nan, pi, radians

import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.messages.frames import GeoPoint, TangentPlane, from_yaw, yaw_of
from gloc3.messages.perception import Odometry, SatelliteFix, WheelDistances
from gloc3.messages.vehicle import AutopilotPose, Pose, Setpoint
from gloc3_onboard.algorithms.odometry.wheel_odometer import Wheelbase, WheelOdometer, WheelStep
from gloc3_onboard.components.processors.dead_reckoning import DeadReckoningProcessor
from gloc3_onboard.components.processors.wheel_odometry import WheelOdometryProcessor

BASE = Wheelbase(track_m=0.4, turn_factor=1.5)
SITE = (-35.363261, 149.165230, 584.0)


def moved(left_m: float, right_m: float, measured_rad: float | None) -> WheelStep:
    """A tenth of a second."""
    odometer = WheelOdometer(BASE)
    assert odometer.update(10.0, 20.0, 0.1, 0.0) is None, "the first ways are from nowhere"
    step = odometer.update(10.0 + left_m, 20.0 + right_m, 0.1, measured_rad)
    assert step is not None
    return step


def test_wheels_that_turn_alike_move_it_straight_ahead() -> None:
    step = moved(0.15, 0.15, 0.0)
    assert step.place_m == pytest.approx((0.15, 0.0))
    assert (step.turn_rad, step.slip_m_s) == pytest.approx((0.0, 0.0))
    assert not step.reason
    assert step.ahead_std_m == pytest.approx(0.003, abs=0.0005), "2 % of the way"


def test_on_the_spot_it_turns_to_the_right_by_less_than_rolling_would_give() -> None:
    step = moved(0.06, -0.06, 0.2)
    assert step.ahead_m == pytest.approx(0.0)
    assert step.turn_rad == pytest.approx(0.12 / 0.4 / 1.5)
    assert not step.reason


def test_on_a_quarter_of_a_circle_it_comes_as_far_ahead_as_to_the_right() -> None:
    odometer, place, heading = WheelOdometer(BASE), complex(0.0, 0.0), 0.0
    arm_m, radius_m = BASE.track_m * BASE.turn_factor, 2.0
    odometer.update(0.0, 0.0, 0.1, 0.0)
    for count in range(1, 11):
        way = 0.5 * pi * radius_m * count / 10
        turn = 0.5 * pi * count / 10
        step = odometer.update(way + 0.5 * arm_m * turn, way - 0.5 * arm_m * turn, 1.0, 0.05 * pi)
        assert step is not None
        ahead, right = step.place_m
        place += rect(1.0, heading) * complex(ahead, right)
        heading += step.turn_rad
    assert degrees(heading) == pytest.approx(90.0)
    assert (place.real, place.imag) == pytest.approx((2.0, 2.0), rel=0.002)


def test_slip_shows_in_the_turn_that_gyroscopes_do_not_feel() -> None:
    held, slipping, spinning = moved(0.10, 0.10, 0.0), moved(0.12, 0.10, 0.0), moved(0.30, 0.10, 0.0)
    assert slipping.slip_m_s == pytest.approx(0.1)
    assert slipping.ahead_std_m > 4.0 * held.ahead_std_m
    assert not slipping.reason
    assert spinning.reason == "the wheels slip by 1.00 m/s"


def test_a_number_that_is_none_is_no_step_and_none_begins_from_it() -> None:
    odometer = WheelOdometer(BASE)
    for way in (1.0, nan, 2.0):
        assert odometer.update(way, way, 0.1, 0.0) is None
    step = odometer.update(2.1, 2.1, 0.1, 0.0)
    assert step is not None
    assert step.ahead_m == pytest.approx(0.1)


def test_encoders_that_count_anew_are_no_step() -> None:
    odometer = WheelOdometer(BASE)
    odometer.update(100.0, 100.0, 0.1, 0.0)
    assert odometer.update(0.0, 0.0, 0.1, 0.0) is None
    step = odometer.update(0.1, 0.1, 0.1, 0.0)
    assert step is not None
    assert step.ahead_m == pytest.approx(0.1)


# --- the components ---


class Drive:
    """A bench with odometry and pose as a rover has them; it drives north."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.true_m = self.wheels_m = 0.0
        odometry: dict[str, str | list[str]] = {"odometry": "odometry/wheels"}
        bench.host(
            ComponentRow(name="wheel_odometry", class_name="x:Y", trigger="wheels", ports=odometry),
            WheelOdometryProcessor,
        )
        settings = {"origin_geo": list(SITE), "is_level": True, "first_fixes": 1, "scale_std": 0.02}
        settings |= {"acceleration_m_s2": 2.0, "autopilot_std_m_s": 0.1, "adrift_std_m_s": 1.0}
        bench.host(
            ComponentRow(name="pose", class_name="x:Y", rate_hz=20.0, ports=odometry, settings=settings),
            DeadReckoningProcessor,
        )
        self._plane = TangentPlane(GeoPoint(*SITE))

    def run(
        self,
        seconds: float,
        speed_m_s: float,
        *,
        wheels_m_s: float | None = None,
        sees: bool = True,
        yaw_rad: float = 0.0,
        topic: str = "autopilot_pose",
    ) -> Pose:
        """Ten of each a second, and two fixes; wheels that fail tell another speed."""
        for step in range(round(seconds * 10)):
            self.true_m += 0.1 * speed_m_s
            self.wheels_m += 0.1 * (speed_m_s if wheels_m_s is None else wheels_m_s)
            estimate = AutopilotPose(
                position_ned_m=(0.0, 0.0, 4.0),
                velocity_ned_m_s=(speed_m_s, 0.0, 0.0),
                ned_from_frd=from_yaw(yaw_rad),
                rate_frd_rad_s=(0.0, 0.0, 0.0),
                origin_geo=SITE,
            )
            self.bench.send(topic, estimate)
            self.bench.send("setpoint", Setpoint(action_id="x", velocity_ned_m_s=(speed_m_s, 0.0, 0.0)))
            self.bench.send("wheels", WheelDistances(distances_m=(self.wheels_m, self.wheels_m)))
            if step % 5 == 0:
                latitude, longitude, _ = self._plane.geo_from_ned((self.true_m, 0.0, 0.0))
                fix = SatelliteFix(place_geo=(latitude, longitude, 0.0), std_m=0.02)
                self.bench.send("satellites", fix if sees else SatelliteFix(is_valid=False))
            self.bench.run(0.1)
        pose: Pose = self.bench.last("pose")
        return pose


def test_slip_is_told_by_the_gyroscopes_also_while_the_autopilot_has_no_position() -> None:
    with Bench() as bench:
        drive = Drive(bench)
        drive.run(1.0, 1.0)
        drive.run(0.2, 1.0, yaw_rad=0.02, topic="autopilot_attitude")
        assert min(step.quality for step in bench.all("odometry/wheels")) < 0.95


def test_each_reading_is_a_step_from_the_one_before_and_a_bad_one_says_why_it_is_none() -> None:
    with Bench() as bench:
        Drive(bench).run(1.0, 1.0)
        first, second = bench.all("odometry/wheels")[-2:]
        assert first.position_m == pytest.approx((0.1, 0.0, 0.0), abs=1e-6)
        assert second.reference_t_s == pytest.approx(first.reference_t_s + 0.1)
        assert yaw_of(second.reference_from_frd) == pytest.approx(0.0, abs=radians(0.1))
        bench.send("wheels", WheelDistances(distances_m=(5.0,)))
        bench.run(0.1)
        reported: Odometry = bench.last("odometry/wheels")
        assert (reported.is_valid, reported.reason) == (False, "1 wheels are reported")


def test_satellites_teach_the_pose_the_radius_of_the_wheels_and_it_drives_on_without_them() -> None:
    with Bench() as bench:
        drive = Drive(bench)
        drive.run(4.0, 0.0)
        seen = drive.run(30.0, 1.5, wheels_m_s=1.47)
        assert seen.sources == ["wheels", "heading", "satellites"]
        assert seen.position_ned_m == pytest.approx((drive.true_m, 0.0, 0.0), abs=0.25)
        blind = drive.run(40.0, 1.5, wheels_m_s=1.47, sees=False)
        assert blind.sources == ["wheels", "heading"]
        assert (blind.is_valid, blind.reason) == (True, "")
        assert blind.position_ned_m[0] == pytest.approx(drive.true_m, abs=0.6), "1 % of 60 m; 2 % without the lesson"
        assert blind.position_std_m[0] > 2.0 * seen.position_std_m[0]


def test_wheels_that_stand_while_satellites_move_are_not_believed_until_they_agree_again() -> None:
    with Bench() as bench:
        drive = Drive(bench)
        drive.run(4.0, 0.0)
        drive.run(8.0, 1.5)
        stuck = drive.run(12.0, 1.5, wheels_m_s=0.0)
        assert stuck.sources == ["autopilot", "heading", "satellites"]
        assert stuck.position_ned_m[0] == pytest.approx(drive.true_m, abs=0.5)
        assert drive.run(10.0, 1.5).sources == ["wheels", "heading", "satellites"]


def test_wheels_that_stand_although_motion_is_asked_for_are_said_to_tell_nothing() -> None:
    with Bench() as bench:
        drive = Drive(bench)
        drive.run(4.0, 0.0)
        drive.run(8.0, 1.5)
        lost = drive.run(5.0, 1.5, wheels_m_s=0.0, sees=False)
        assert lost.reason == "adrift: the wheels stand although motion is asked for"
        assert lost.position_std_m[0] > 2.0


@pytest.mark.parametrize(("speed_m_s", "is_believed"), [(1.5, False), (0.3, True)])
def test_wheels_that_stand_from_one_reading_to_the_next_have_not_braked(speed_m_s: float, is_believed: bool) -> None:
    with Bench() as bench:
        drive = Drive(bench)
        drive.run(4.0, 0.0)
        drive.run(8.0, speed_m_s)
        frozen = drive.run(0.5, speed_m_s, wheels_m_s=0.0)
        assert (abs(frozen.velocity_ned_m_s[0]) < 0.5 * speed_m_s) is is_believed
        assert frozen.position_ned_m[0] == pytest.approx(drive.true_m, abs=0.2)
        assert drive.run(2.5, speed_m_s).sources == ["wheels", "heading", "satellites"]
