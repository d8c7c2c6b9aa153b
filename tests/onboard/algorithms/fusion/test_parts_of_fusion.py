"""The parts of the fusion: inertial solution, Jacobians, covariance with clones, trust, vote."""

import numpy as np
import pytest

from gloc3.messages.frames import (
    IDENTITY,
    Quaternion,
    Vector3,
    conjugate,
    from_euler,
    from_rotation_vector,
    from_yaw,
    multiply,
    rotate,
    to_rotation_vector,
    yaw_of,
)
from gloc3.messages.perception import UNKNOWN_VARIANCE, Odometry
from gloc3_onboard.algorithms.fusion.alignment import StartPose
from gloc3_onboard.algorithms.fusion.error_state import ROTATION, SIZE, VELOCITY, ErrorState, past_pose
from gloc3_onboard.algorithms.fusion.estimate import PoseEstimate
from gloc3_onboard.algorithms.fusion.fault_isolation import FaultIsolation, OtherAgreement
from gloc3_onboard.algorithms.fusion.inertial import Inertial, InertialState
from gloc3_onboard.algorithms.fusion.inertial_motion import InertialMotion
from gloc3_onboard.algorithms.fusion.measurements import Measured, covariance_of, level_of, matrix_of, place, relative
from gloc3_onboard.algorithms.fusion.odometers import OdometerReport
from gloc3_onboard.algorithms.fusion.settings import FusionSettings
from gloc3_onboard.algorithms.fusion.source_reports import SourceReports
from gloc3_onboard.algorithms.fusion.trust import Trust

LEVEL_AT_REST = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.80665))


def moved(state: tuple[Vector3, Quaternion], error: np.ndarray) -> tuple[Vector3, Quaternion]:
    """A pose with an error of six numbers."""
    (n, e, d), attitude = state
    a, b, c = error[3:].tolist()
    return (n + error[0], e + error[1], d + error[2]), multiply(from_rotation_vector((a, b, c)), attitude)


def test_a_circle_flown_with_its_centripetal_force_is_a_circle() -> None:
    inertial = Inertial()
    radius_m, rate = 2.0, 0.5
    inertial.place(InertialState(0.0, (radius_m, 0.0, -1.0), (0.0, radius_m * rate, 0.0), from_yaw(np.pi / 2)))
    for i in range(1, 1 + round(2 * np.pi / rate * 100)):
        inertial.move((0.0, 0.0, rate), (0.0, radius_m * rate**2, -9.80665), i / 100)
    assert np.allclose(inertial.now.position_ned_m, (radius_m, 0.0, -1.0), atol=0.02)


def test_the_past_is_asked_as_it_is_believed_after_a_correction() -> None:
    inertial = Inertial()
    inertial.place(InertialState(0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), IDENTITY))
    for i in range(1, 101):
        inertial.move(*LEVEL_AT_REST, i / 100)
    inertial.correct((0.5, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.2))
    past = inertial.at(0.755)
    assert past.position_ned_m[0] == pytest.approx(0.755 + 0.5 - 0.1 * 0.245)
    assert past.velocity_ned_m_s[0] == pytest.approx(1.1)
    assert yaw_of(past.ned_from_frd) == pytest.approx(0.2)
    assert inertial.covers(0.755)
    assert not inertial.covers(-0.5)
    assert not inertial.covers(1.1)


LEANS_UNKNOWN = np.diag([1.0, 1.0, 1.0, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, 1.0])


@pytest.mark.parametrize(("is_level", "covariance"), [(False, np.eye(6)), (True, np.eye(6)), (True, LEANS_UNKNOWN)])
def test_the_jacobian_of_a_motion_is_that_of_its_differences(is_level: bool, covariance: np.ndarray) -> None:
    then = ((1.0, 2.0, -1.0), from_euler(0.1, -0.2, 0.7))
    now = ((1.6, 1.5, -1.2), from_euler(-0.05, 0.1, 1.0))

    def reported(then: tuple[Vector3, Quaternion], now: tuple[Vector3, Quaternion]) -> tuple[Vector3, Quaternion]:
        axes = from_yaw(yaw_of(then[1])) if is_level else then[1]
        way = [b - a for a, b in zip(then[0], now[0], strict=True)]
        return rotate(conjugate(axes), (way[0], way[1], way[2])), multiply(conjugate(axes), now[1])

    def measured(error: np.ndarray) -> Measured:
        axes = from_yaw(yaw_of(then[1])) if is_level else then[1]
        is_reported = reported(moved(then, error[6:]), moved(now, error[:6]))
        found = relative(then, axes, now, is_reported, covariance, is_level=is_level)
        assert found is not None
        return found

    exact = measured(np.zeros(12))
    assert exact.by_reference is not None
    assert np.allclose(exact.residual, 0.0, atol=1e-12)
    jacobian = np.hstack([exact.by_pose, exact.by_reference])
    for i in range(12):
        error = np.zeros(12)
        error[i] = 1e-6
        assert np.allclose(measured(error).residual / 1e-6, jacobian[:, i], atol=1e-4)


def test_the_heading_of_an_odometer_that_measures_no_roll_and_pitch_does_not_depend_on_those_that_it_takes() -> None:
    """It levels its scans by the autopilot's attitude, which leans by its accelerometers' bias."""
    pose = ((0.0, 0.0, -1.0), from_euler(0.15, -0.1, 0.7))
    axes, taken = from_yaw(0.2), from_euler(0.156, -0.107, 0.5)
    found = relative(pose, axes, pose, ((0.0, 0.0, 0.0), taken), LEANS_UNKNOWN, is_level=True)
    assert found is not None
    assert found.degrees == 4
    assert found.residual == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_the_jacobian_of_a_position_has_the_lever_of_the_lamp() -> None:
    pose = ((1.0, 2.0, -1.0), from_euler(0.1, -0.2, 0.7))
    lever = (0.2, -0.1, 0.05)
    for i in range(6):
        error = np.zeros(6)
        error[i] = 1e-6
        position, attitude = moved(pose, error)
        n, e, d = (p + a for p, a in zip(position, rotate(attitude, lever), strict=True))
        found = place(pose, (n, e, d), lever, np.eye(3))
        assert found is not None
        assert np.allclose(found.residual / 1e-6, found.by_pose[:, i], atol=1e-5)


def test_the_error_of_a_past_pose_follows_from_the_error_now() -> None:
    """Two inertial solutions that differ in everything, run on: their difference of then is told by that of now."""

    def run(error: np.ndarray) -> Inertial:
        inertial = Inertial()
        v, w, g, a = error[3:6].tolist(), error[6:9].tolist(), error[9:12].tolist(), error[12:15].tolist()
        inertial.gyroscope_bias_rad_s, inertial.accelerometer_bias_m_s2 = tuple(g), tuple(a)
        attitude = multiply(from_rotation_vector(tuple(w)), from_euler(0.1, 0.2, 0.5))
        inertial.place(InertialState(0.0, tuple(error[:3].tolist()), (1.0 + v[0], v[1], v[2]), attitude))
        for i in range(1, 21):
            inertial.move((0.1, -0.1, 0.2), (1.0, 0.5, -9.0), i / 100)
        return inertial

    rng = np.random.default_rng(3)
    error = rng.normal(size=15) * 1e-5
    wrong, right = run(error), run(np.zeros(15))

    def difference(a: InertialState, b: InertialState) -> np.ndarray:
        turn = to_rotation_vector(multiply(a.ned_from_frd, conjugate(b.ned_from_frd)))
        return np.concatenate([np.subtract(a.position_ned_m, b.position_ned_m), turn])

    now = np.zeros(SIZE)
    now[[0, 1, 2, 6, 7, 8]] = difference(wrong.now, right.now)
    now[3:6] = np.subtract(wrong.now.velocity_ned_m_s, right.now.velocity_ned_m_s)
    now[9:15] = error[9:15]
    then, state = right.at(0.0), right.now
    change = np.subtract(state.velocity_ned_m_s, then.velocity_ned_m_s) - (0, 0, 9.80665 * 0.2)
    way = np.subtract(state.position_ned_m, then.position_ned_m)
    way = way - np.multiply(then.velocity_ned_m_s, 0.2) - (0, 0, 9.80665 * 0.02)
    jacobian = past_pose(0.2, matrix_of(state.ned_from_frd), tuple(change.tolist()), tuple(way.tolist()))
    assert (jacobian @ now).tolist() == pytest.approx(difference(wrong.at(0.0), then).tolist(), abs=5e-7)


def test_a_speed_that_is_found_without_the_inertial_unit_tells_nothing_of_the_tilt() -> None:
    estimate, state = PoseEstimate(FusionSettings()), InertialState(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), IDENTITY)
    estimate.begin(StartPose(state, 0.01, 0.01, is_moving=False), state, (0.0, 0.0, 0.0))
    for step in range(1, 51):
        estimate.coast(0.02 * step)
    estimate.predict()
    rows = np.zeros((3, SIZE))
    rows[:, VELOCITY] = np.eye(3)
    estimate.correct(np.array((0.7, 0.0, 0.0)), rows, 1e-4 * np.eye(3))
    assert estimate.inertial.now.velocity_ned_m_s[0] == pytest.approx(0.7, abs=0.01)
    assert estimate.inertial.now.ned_from_frd == pytest.approx(IDENTITY, abs=1e-9)
    assert estimate.errors.covariance[VELOCITY, ROTATION] == pytest.approx(np.zeros((3, 3)), abs=1e-9)


def test_an_attitude_from_elsewhere_tells_where_down_is_and_not_the_heading() -> None:
    truth, turn = from_euler(0.1, -0.2, 0.5), (0.003, -0.002, 0.7)
    believed = multiply(from_rotation_vector((-0.003, 0.002, 0.0)), truth)
    reported = multiply(from_yaw(turn[2]), truth)
    measured = level_of(believed, reported, 0.02)
    assert measured.residual == pytest.approx((0.003, -0.002), abs=1e-5)
    assert measured.by_pose @ np.array((0.0, 0.0, 0.0, *turn)) == pytest.approx((0.003, -0.002))


def test_a_clone_is_the_pose_of_its_time_and_goes_without_trace() -> None:
    errors = ErrorState()
    errors.reset(np.full(SIZE, 0.1))
    before = errors.covariance.copy()
    jacobian = np.zeros((6, SIZE))
    jacobian[:3, :3] = jacobian[3:, 6:9] = np.eye(3)
    errors.clone("stereo", jacobian, np.zeros((6, 6)))
    errors.clone("laser", jacobian, np.eye(6))
    rows = np.zeros((3, errors.size))
    rows[:, :3], rows[:, SIZE : SIZE + 3] = np.eye(3), -np.eye(3)
    assert errors.test(np.full(3, 0.1), rows, np.eye(3) * 0.01) == pytest.approx(3.0)  # the difference is known to be 0
    errors.drop("stereo")
    assert errors.clones == ["laser"]
    assert errors.place_of("laser") == SIZE
    errors.drop("laser")
    assert np.array_equal(errors.covariance, before)


def test_a_direction_that_is_not_told_is_left_out_also_where_it_lies_askew() -> None:
    axes = matrix_of(from_yaw(0.5))
    covariance = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6])
    covariance[:3, :3] = axes @ np.diag([UNKNOWN_VARIANCE, 1e-6, 1e-6]) @ axes.T
    pose = ((0.0, 0.0, 0.0), IDENTITY)
    along = axes[:, 0] * 0.3
    found = relative(pose, IDENTITY, pose, ((along[0], along[1], 0.0), IDENTITY), covariance, is_level=False)
    assert found is not None
    assert found.degrees == 5
    assert np.allclose(found.residual, 0.0, atol=1e-9)
    assert place(pose, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), np.eye(3) * UNKNOWN_VARIANCE) is None


def test_what_is_no_covariance_is_none_or_loses_its_correlations() -> None:
    floor = np.full(3, 1e-6)
    assert covariance_of([1.0] * 8, 3, floor) is None
    assert covariance_of([float("nan")] * 9, 3, floor) is None
    assert covariance_of([-1.0, 0, 0, 0, 1, 0, 0, 0, 1], 3, floor) is None
    found = covariance_of([1.0, 5.0, 0, 5.0, 1.0, 0, 0, 0, 0.0], 3, floor)
    assert found is not None
    assert np.allclose(found, np.diag([1.0, 1.0, 1e-6]))


def test_a_source_that_does_not_agree_is_turned_down_and_used_again_after_its_probation() -> None:
    trust = Trust("stereo", probation_s=1.0)
    assert trust.judge(3.0, 6, 0.0)
    assert not any(trust.judge(500.0, 6, 0.1 * i) for i in range(1, 6))
    assert not trust.is_used
    used = [trust.judge(3.0, 6, 1.0 + 0.1 * i) for i in range(15)]
    assert used.index(True) == 10
    assert trust.is_used


def test_outliers_now_and_then_neither_turn_a_source_down_nor_widen_it_nor_end_its_probation() -> None:
    trust = Trust("stereo", probation_s=1.0)
    for i in range(200):
        is_outlier = i % 5 in (3, 4)
        assert trust.judge(1e5 if is_outlier else 6.0, 6, 0.1 * i, is_steady=False) is not is_outlier
    assert (trust.is_used, trust.widening) == (True, 1.0)
    assert [trust.judge(1e5, 6, 20.0 + 0.1 * i, is_steady=i > 1) for i in range(5)] == [False] * 5
    assert not trust.is_used, "five that say the same"
    used = [trust.judge(1e5 if i == 4 else 6.0, 6, 21.0 + 0.1 * i, is_steady=False) for i in range(12)]
    assert used.index(True) == 10


def test_one_that_only_said_nothing_is_used_again_at_once() -> None:
    trust = Trust("tracker", probation_s=1.0)
    trust.step_back("it does not see the lamp")
    assert trust.state().reason == "it does not see the lamp"
    assert trust.judge(3.0, 3, 1.0)
    assert trust.is_used


def test_the_one_that_contradicts_two_is_voted_out_and_two_that_contradict_each_other_are_told() -> None:
    def vote(names: tuple[str, ...]) -> str:
        vote = FaultIsolation(6.0, 0.01, InertialMotion(4e-3))
        for i in range(60):
            for name in names:
                excess = (0.004 if name == "bad" else 0.0, 0.0, 0.0)
                vote.record(name).add(i * 0.1, excess, np.eye(3) * 1e-5)
        position = (0.0, 0.0, 0.0)
        vote.update(dict.fromkeys(names, True), position, 0.0, 5.7)
        verdict = vote.update(dict.fromkeys(names, True), position, 0.0, 5.95)
        return verdict.voted_out or "/".join(sorted(verdict.against))

    assert vote(("a", "b", "c")) == ""
    assert vote(("a", "bad", "c")) == "bad"
    assert vote(("a", "bad")) == "a/bad"


def test_who_told_of_a_part_of_the_way_that_he_was_uncertain_there_is_not_held_to_what_he_claims_now() -> None:
    def vote(early_std_m: float) -> str:
        vote = FaultIsolation(6.0, 0.01, InertialMotion(4e-3))
        for i in range(60):
            for name in ("a", "b", "late"):
                is_early = name == "late" and i < 10
                covariance = np.eye(3) * (early_std_m**2 if is_early else 1e-6)
                excess = (0.05 if is_early else 0.0, 0.0, 0.0)
                vote.record(name).add(i * 0.1, excess, covariance, is_new_reference=i % 5 == 0)
        for now_s in (5.9, 6.15):
            verdict = vote.update(dict.fromkeys(("a", "b", "late"), True), (0.0, 0.0, 0.0), 0.0, now_s)
        return verdict.voted_out

    assert vote(1e-3) == "late"
    assert vote(0.2) == ""


def test_what_leaving_one_out_would_change_is_told_and_noise_is_not() -> None:
    def separation(
        drift_m_s: float,
        names: tuple[str, ...] = ("a", "b", "c"),
        std_m: Vector3 = (0.005, 0.005, 0.005),
    ) -> Vector3:
        vote, rng = FaultIsolation(6.0, 0.01, InertialMotion(4e-3)), np.random.default_rng(1)
        for name in names:
            noise = rng.normal(size=61) * 0.005
            for i in range(60):
                excess = (float(noise[i + 1] - noise[i]) + (0.0 if name == "a" else drift_m_s * 0.1), 0.0, 0.0)
                vote.record(name).add(i * 0.1, excess, np.diag(np.square(std_m)))
        vote.update(dict.fromkeys(names, True), (0.0, 0.0, 0.0), 0.0, 5.9)
        return vote.separation(list(names), 5.9)

    assert separation(0.0) == (0.0, 0.0, 0.0)
    north, east, down = separation(-0.02)
    assert north == pytest.approx(0.12, abs=0.02)
    assert (east, down) == (0.0, 0.0)
    assert separation(-0.02, ("b",))[0] == pytest.approx(0.12, abs=0.02), "where there is one, what it says alone"
    # Two that are left and know the motion north to 0.4 m: at 1.5 of that they say nothing, at 3 they do.
    assert separation(-0.1, std_m=(0.4, 0.005, 0.005)) == (0.0, 0.0, 0.0)
    assert separation(-0.2, std_m=(0.4, 0.005, 0.005))[0] > 0.5
    # Those that know nothing better than that, as a laser on the floor, say it only where they contradict one another.
    assert separation(-0.2, std_m=(0.2, 0.2, 0.2)) == (0.0, 0.0, 0.0)
    assert separation(-0.4, std_m=(0.2, 0.2, 0.2))[0] > 2.0


def test_two_that_say_together_that_the_body_is_elsewhere_are_heard_and_two_that_say_different_things_are_not() -> None:
    def elsewhere(a_m: Vector3, b_m: Vector3, blind_std_m: float = 0.002) -> OtherAgreement | None:
        vote = FaultIsolation(6.0, 0.01, InertialMotion(4e-3))
        for name, by_m, std_m in (("a", a_m, 0.002), ("b", b_m, 0.002), ("c", (0.0, 0.0, 0.0), blind_std_m)):
            for i in range(20):
                excess = by_m if i == 12 else (0.0, 0.0, 0.0)
                vote.record(name).add(i * 0.1, excess, np.eye(3) * std_m**2)
        vote.update({"a": True, "b": True, "c": True}, (0.0, 0.0, 0.0), 0.0, 1.9)
        return vote.elsewhere(["a", "b", "c"], 1.15, 1.9)

    found = elsewhere((0.1, 0.0, 0.0), (0.1, 0.0, 0.01))
    assert found is not None
    assert found.names == ("a", "b")
    assert found.by_m == pytest.approx((0.1, 0.0, 0.005), abs=1e-3)
    assert elsewhere((0.1, 0.0, 0.0), (0.1, 0.0, 0.01), blind_std_m=9.0) is not None
    assert elsewhere((0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)) is None
    assert elsewhere((0.1, 0.0, 0.0), (0.005, 0.0, 0.0)) is None
    assert elsewhere((0.005, 0.0, 0.0), (0.005, 0.0, 0.0)) is None


def test_what_a_level_odometer_does_not_know_of_the_height_does_not_hide_its_motion() -> None:
    """Its own attitude and the estimated one differ by some tenths of a degree."""
    vote, inertial = FaultIsolation(2.0, 0.01, InertialMotion(0.0)), Inertial()
    inertial.place(InertialState(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), from_rotation_vector((0.004, -0.003, 0.4))))
    reports, covariance = SourceReports(inertial, vote), np.diag([1e-6, 1e-6, UNKNOWN_VARIANCE, 1e6, 1e6, 1e-8])
    for t_s in (0.0, 0.1):
        message = Odometry(
            source="laser",
            reference_t_s=0.0,
            position_m=(t_s, 0.0, 0.0),
            reference_from_frd=from_rotation_vector((0.0, 0.0, 0.2)),
            is_level=True,
        )
        reports.book(OdometerReport(message, t_s, covariance), inertial.now)
    assert float(vote.record("laser").covariance[:2, :2].max()) < 1e-4
