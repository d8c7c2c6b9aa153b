"""The fusion over some seconds of a synthetic flight: what it must do with each kind of input."""

from math import nan

import msgspec
import numpy as np
import pytest

from gloc3.messages.perception import Odometry, PositionFix
from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.algorithms.fusion.inertial import InertialState
from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion
from gloc3_onboard.algorithms.fusion.settings import FusionSettings

from .flown import inspection, sensors_of
from .fly import fly

REST = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.80665))
AT_HOME = FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=0.0)


def standing(fusion: PoseFusion, until_s: float, begin_s: float = 0.0) -> None:
    for i in range(round(begin_s * 100) + 1, round(until_s * 100) + 1):
        noise = 1e-4 * (i % 7)
        fusion.imu((noise, 0.0, 0.0), (0.0, noise, -9.80665), i / 100)
        if i % 5 == 0:
            fusion.tick(i / 100)


def odometry(**fields: object) -> Odometry:
    values: dict[str, object] = {"reference_t_s": 0.8, "covariance": (np.eye(6) * 1e-6).ravel().tolist(), **fields}
    return Odometry(source="stereo", **values)  # type: ignore[arg-type]


def test_it_waits_until_it_knows_where_it_starts() -> None:
    fusion = PoseFusion()
    standing(fusion, 1.0)
    assert (fusion.pose().is_valid, fusion.pose().reason) == (False, "the start is not known yet")
    fusion.align_by(InertialState(0.0, (1.0, 2.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    fix = PositionFix(source="tracker", position_ned_m=(3.0, 4.0, 0.0), covariance=(np.eye(3) * 1e-4).ravel().tolist())
    fusion.fix(fix, 1.0)
    standing(fusion, 1.1, 1.0)
    assert fusion.pose().is_valid
    assert fusion.pose().position_ned_m == pytest.approx((3.0, 4.0, 0.0), abs=0.01)


def test_it_levels_itself_by_gravity_with_the_heading_that_is_declared() -> None:
    fusion = PoseFusion(FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=90.0))
    pitch = 0.05
    for i in range(1, 100):
        fusion.imu((0.0, 1e-5 * (i % 3), 0.0), (9.80665 * np.sin(pitch), 0.0, -9.80665 * np.cos(pitch)), i / 100)
    w, x, y, z = fusion.pose().ned_from_frd
    assert 2 * (w * y - z * x) == pytest.approx(np.sin(pitch), abs=1e-6)
    assert np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (odometry(position_m=(nan, 0.0, 0.0)), "not finite"),
        (odometry(reference_from_frd=(0.0, 0.0, 0.0, 0.0)), "rotation"),
        (odometry(covariance=[1.0]), "covariance"),
        (odometry(reference_t_s=9.0), "future"),
    ],
)
def test_what_cannot_be_used_is_turned_down_with_a_reason_and_changes_nothing(message: Odometry, reason: str) -> None:
    fusion = PoseFusion(AT_HOME)
    standing(fusion, 1.0)
    fusion.estimate.predict()
    before = fusion.estimate.errors.covariance.copy()
    position = fusion.estimate.inertial.now
    for i in range(5):
        fusion.odometry(message, 0.9 + i * 0.01)
    assert np.array_equal(fusion.estimate.errors.covariance, before)
    assert fusion.estimate.inertial.now == position
    state = {source.source: source for source in fusion.state().sources}["stereo"]
    assert (state.is_used, state.accepted) == (False, 0)
    assert reason in state.reason


def test_an_invalid_message_says_why_and_late_future_and_repeated_ones_are_refused() -> None:
    fusion = PoseFusion(AT_HOME)
    standing(fusion, 2.0)
    fusion.odometry(odometry(is_valid=False, reason="too few points"), 2.0)
    assert fusion.state().sources[-1].reason == "too few points"
    fusion.odometry(odometry(reference_t_s=1.9), 1.95)
    assert fusion.state().sources[-1].is_used
    accepted = fusion.state().sources[-1].accepted
    for t_s in (1.95, 1.4, 2.5, nan):
        fusion.odometry(odometry(reference_t_s=1.3), t_s)
    last = fusion.state().sources[-1]
    assert (last.accepted, last.rejected) == (accepted, 4)


def test_a_message_ahead_of_the_inertial_unit_waits_for_it() -> None:
    fusion = PoseFusion(AT_HOME)
    standing(fusion, 1.0)
    fusion.odometry(odometry(), 1.03)
    assert fusion.state().sources[-1].accepted == 0
    standing(fusion, 1.05, 1.0)
    assert fusion.state().sources[-1].accepted == 1


def fixes(away_m: float, times_s: tuple[float, ...]) -> PoseFusion:
    """Positions from outside that are elsewhere, after a start that is hardly known."""
    fusion = PoseFusion(msgspec.structs.replace(AT_HOME, start_std_m=0.3))
    standing(fusion, 1.0)
    covariance = (np.eye(3) * 1e-4).ravel().tolist()
    fix = PositionFix(source="tracker", position_ned_m=(away_m, 0.0, 0.0), covariance=covariance)
    for t_s in times_s:
        fusion.fix(fix, t_s)
    standing(fusion, 1.02, 1.0)
    fusion.tick(1.02)
    return fusion


@pytest.mark.parametrize(("away_m", "jumps"), [(0.5, 1), (0.05, 0)])
def test_a_large_correction_is_a_jump_and_counted_and_a_small_one_is_blended_in(away_m: float, jumps: int) -> None:
    fusion = fixes(away_m, (0.96, 0.98, 1.0))
    first = fusion.pose()
    standing(fusion, 2.0, 1.02)
    last = fusion.pose()
    assert (first.reset_counter, last.reset_counter) == (jumps, jumps)
    assert last.position_ned_m[0] == pytest.approx(away_m, abs=0.01)
    assert (first.position_ned_m[0] > 0.9 * away_m) == bool(jumps), "at once, or by and by"


def test_one_position_alone_does_not_make_a_jump() -> None:
    pose = fixes(0.5, (1.0,)).pose()
    assert pose.reset_counter == 0
    assert pose.position_ned_m[0] == pytest.approx(0.0, abs=0.01)


def test_garbage_of_every_kind_never_makes_it_not_a_number() -> None:
    rng = np.random.default_rng(5)
    fusion = PoseFusion(AT_HOME)
    bad = (nan, float("inf"), -1e30, 1e-30, 0.0, 1e6)

    def number() -> float:
        return float(rng.choice(bad) if rng.random() < 0.3 else rng.normal())

    def vector() -> tuple[float, float, float]:
        return (number(), number(), number())

    for i in range(1, 800):
        t_s = i / 100
        is_bad = i > 100 and rng.random() < 0.2
        rate, force = (vector(), vector()) if is_bad else ((1e-4 * (i % 5), 0.0, 0.0), (0.0, 0.0, -9.80665))
        fusion.imu(rate, force, t_s if rng.random() < 0.95 else number())
        when_s = t_s - float(rng.uniform(0.0, 0.6))
        match i % 4:
            case 0:
                turn = (number(), *vector())
                covariance = [number() for _ in range(36)]
                message = odometry(
                    position_m=vector(), reference_from_frd=turn, covariance=covariance, reference_t_s=when_s - 0.1
                )
                fusion.odometry(message, when_s)
            case 1:
                covariance = [number() for _ in range(9)]
                fusion.fix(PositionFix(source="tracker", position_ned_m=vector(), covariance=covariance), when_s)
            case 2:
                fusion.height(HeightAboveGround(height_m=number(), is_valid=True), when_s)
        fusion.tick(t_s)
        pose = fusion.pose()
        numbers = (*pose.position_ned_m, *pose.velocity_ned_m_s, *pose.ned_from_frd, *pose.position_std_m, pose.quality)
        assert np.isfinite(numbers).all()
    assert np.linalg.eigvalsh(fusion.estimate.errors.covariance)[0] > -1e-9


def test_with_all_sources_it_is_within_two_centimetres_and_tells_what_it_rests_on() -> None:
    flown = fly(inspection(), sensors_of("pelican", 1), 1, until_s=10.0)
    assert flown.worst_m() < 0.02
    assert flown.poses[-1].quality > 0.95
    assert sorted(flown.poses[-1].sources) == ["ground", "height", "imu", "laser", "stereo", "tracker"]
    assert flown.poses[-1].reset_counter == 0


def test_it_finds_the_biases_of_the_inertial_unit() -> None:
    flown = fly(inspection(), sensors_of("pelican", 2), 2, until_s=14.0)
    rng = np.random.default_rng((2, 99))
    gyroscope, accelerometer = rng.normal(size=3) * 0.002, rng.normal(size=3) * 0.03
    state = flown.fusion.state()
    assert np.allclose(state.gyroscope_bias_rad_s, gyroscope, atol=4e-4)
    assert state.accelerometer_bias_m_s2[2] == pytest.approx(accelerometer[2], abs=0.01)


def test_a_frozen_odometer_is_found_within_half_a_second_and_let_in_again() -> None:
    sensors = sensors_of("hummingbird", 0)
    sensors[0].fault, sensors[0].fault_s = "frozen", (7.0, 9.0)
    flown = fly(inspection(), sensors, until_s=11.5)
    used = ["stereo" in pose.sources for pose in flown.poses]
    assert not used[np.searchsorted(flown.t_s, 7.5)]
    assert not used[np.searchsorted(flown.t_s, 8.9)]
    assert used[-1]
    assert flown.worst_m() < 0.03


def test_without_any_source_the_pose_is_soon_not_valid_and_says_why_and_comes_back() -> None:
    sensors = sensors_of("hummingbird", 0)
    for sensor in sensors:
        sensor.fault, sensor.fault_s = "removed", (6.0, 10.0)
    flown = fly(inspection(), sensors, until_s=11.5)
    valid = np.array([pose.is_valid for pose in flown.poses])
    first = flown.t_s[~valid][0]
    assert 8.0 < first < 9.0
    reason = flown.poses[int(np.flatnonzero(~valid)[0])].reason
    assert "nothing has held the position" in reason
    assert "stereo: nothing comes from it" in reason
    assert flown.poses[np.searchsorted(flown.t_s, 7.2)].quality < 0.3
    assert valid[-1]
    assert flown.worst_m(11.0) < 0.06


def test_without_the_inertial_unit_it_goes_on_with_the_odometers() -> None:
    sensors = sensors_of("hummingbird", 0)
    flown = fly(
        inspection(), sensors, imu=lambda t_s, rate, force: None if 6.0 < t_s < 9.0 else (rate, force), until_s=10.0
    )
    assert all(pose.is_valid for pose in flown.poses)
    assert "imu" not in flown.poses[np.searchsorted(flown.t_s, 8.0)].sources
    assert "imu" in flown.poses[-1].sources
    assert flown.worst_m() < 0.12
    told_m = [min(pose.position_std_m) for pose in flown.poses if "imu" not in pose.sources]
    assert 0.05 <= min(told_m) <= max(told_m) < 0.1, "it knows that it knows less"


def test_without_the_inertial_unit_and_the_stereo_pair_the_autopilot_tells_where_down_is() -> None:
    flown = fly(
        inspection(),
        [sensor for sensor in sensors_of("pelican", 0) if sensor.name != "stereo"],
        imu=lambda t_s, rate, force: None if 6.0 < t_s < 12.0 else (rate, force),
        until_s=13.0,
        has_autopilot=True,
    )
    assert np.abs(flown.turn_rad).max() < 0.02
    assert flown.worst_m() < 0.05
    assert all(pose.is_valid for pose in flown.poses)
    assert "autopilot" in flown.poses[np.searchsorted(flown.t_s, 11.0)].sources
    assert "autopilot" not in flown.poses[-1].sources


def test_the_reported_position_has_no_steps_where_nothing_was_reset() -> None:
    sensors = sensors_of("hummingbird", 3)
    sensors[2].fault, sensors[2].fault_s = "removed", (4.0, 12.0)
    flown = fly(inspection(), sensors, 3, until_s=13.0)
    position = np.array([pose.position_ned_m for pose in flown.poses])
    velocity = np.array([pose.velocity_ned_m_s for pose in flown.poses])
    steps = np.linalg.norm(np.diff(position, axis=0) - 0.5 * (velocity[1:] + velocity[:-1]) * 0.05, axis=1)
    assert flown.poses[-1].reset_counter == 0
    assert steps.max() < 0.02
