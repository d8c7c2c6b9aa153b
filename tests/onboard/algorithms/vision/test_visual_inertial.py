"""The stereo odometer with gyros, in the simulated hold: sudden turns, darkness, blur, and pictures that lie."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from tests.onboard.algorithms.vision.flights import Pair, fly
from tests.onboard.algorithms.vision.trial import follow
from tests.onboard.algorithms.vision.turning import BIAS_RAD_S, Gyros, flown

from gloc3.evaluation.trajectory import Array, Trajectory
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn
from gloc3_onboard.algorithms.vision.features import FeatureMatcher
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN, KeyFrameMotion, StereoMotion
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig
from gloc3_sitl.world.rig import FRONT_LEFT, FRONT_RIGHT

SECONDS = 2.4
CALM = 20
"""Pictures before anything happens."""


def straight(t_s: Array) -> Array:
    return 0.0 * t_s


def sudden(t_s: Array) -> Array:
    """From one picture to the next as fast as 3.5 rad/s, to and fro."""
    begin, end = CALM / 15.0, CALM / 15.0 + 0.2
    return 3.5 * np.clip(t_s - begin, 0.0, end - begin)


@pytest.fixture(scope="module")
def calm() -> tuple[Trajectory, list[Pair]]:
    path = flown(straight, SECONDS)
    return path, list(fly(path, "hold", 3))


def run(pairs: Iterable[Pair], gyros: Gyros | None) -> list[KeyFrameMotion]:
    odometer = StereoOdometer(FRONT_LEFT, FRONT_RIGHT, gyro=None if gyros is None else gyros.turn)
    motions = []
    for pair in pairs:
        if gyros is not None:
            gyros.feed(pair.t_s)
        motions.append(odometer.update(pair.left, pair.right, pair.t_s))
    return motions


def lost(motions: list[KeyFrameMotion]) -> list[int]:
    return [n for n, motion in enumerate(motions) if not motion.is_valid]


def worst_sigma(motions: list[KeyFrameMotion], path: Trajectory) -> float:
    """Largest error of a valid motion, position or attitude, in its standard deviations."""
    index, worst = {t_s: n for n, t_s in enumerate(path.t_s.tolist())}, 0.0
    for now, motion in enumerate(motions):
        if motion.is_valid:
            key = index[motion.reference_t_s]
            back = path.world_from_body[key].T
            shift = motion.position_m - back @ (path.position_m[now] - path.position_m[key])
            off = (back @ path.world_from_body[now]).T @ motion.rotation
            turn = np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]]) / 2.0
            for error, part in ((shift, motion.covariance[:3, :3]), (turn, motion.covariance[3:, 3:])):
                worst = max(worst, float(np.sqrt(error @ np.linalg.solve(part, error))))
    return worst


def spoiled(pairs: list[Pair], which: range, change: Callable[[Picture, int], Picture]) -> list[Pair]:
    return [
        Pair(t_s=pair.t_s, left=change(pair.left, n), right=change(pair.right, -n)) if n in which else pair
        for n, pair in enumerate(pairs)
    ]


def black(picture: Picture, _: int) -> Picture:
    return picture * 0


def smeared(picture: Picture, _: int) -> Picture:
    return np.asarray(cv2.blur(picture, (151, 151)), np.uint8)


def aside(picture: Picture, _: int) -> Picture:
    return np.roll(picture, 6, axis=1)


def test_a_sudden_turn_is_followed_where_pictures_alone_are_lost() -> None:
    path = flown(sudden, SECONDS)
    pairs = list(fly(path, "hold", 3))
    alone, motions = run(pairs, None), run(pairs, Gyros(sudden, SECONDS))
    assert any(motion.reason for motion in alone[CALM:])
    assert lost(motions) == [0]
    assert not any(motion.reason for motion in motions[1:])
    assert worst_sigma(motions, path) < 5.0


@pytest.mark.parametrize(("change", "count"), [(black, 3), (smeared, 2)])
def test_darkness_and_blur_are_bridged_with_a_growing_deviation(
    calm: tuple[Trajectory, list[Pair]], change: Callable[[Picture, int], Picture], count: int
) -> None:
    path, good = calm
    pairs = spoiled(good, range(CALM, CALM + count), change)
    assert lost(run(pairs, None))[1 : 1 + count] == list(range(CALM, CALM + count))
    motions = run(pairs, Gyros(straight, SECONDS))
    assert lost(motions) == [0]
    held = motions[CALM : CALM + count]
    assert all(motion.reason.startswith("held by the gyros: ") for motion in held)
    stds_m = [float(np.sqrt(np.trace(motion.covariance[:3, :3]))) for motion in motions[CALM - 1 : CALM + count]]
    assert stds_m == sorted(stds_m)
    assert stds_m[-1] > 3.0 * stds_m[0]
    assert worst_sigma(motions, path) < 5.0


def test_a_longer_darkness_is_told(calm: tuple[Trajectory, list[Pair]]) -> None:
    pairs = spoiled(calm[1], range(CALM, CALM + 7), black)
    motions = run(pairs, Gyros(straight, SECONDS))
    assert 2 <= sum(motion.is_valid for motion in motions[CALM : CALM + 7]) <= 4
    assert motions[CALM + 6].reason == "left: the picture is black"


def test_a_turn_in_the_dark_is_told_by_the_gyros() -> None:
    path = flown(sudden, SECONDS)
    pairs = spoiled(list(fly(path, "hold", 3)), range(CALM + 1, CALM + 4), black)
    motions = run(pairs, Gyros(sudden, SECONDS))
    assert lost(motions) == [0]
    assert worst_sigma(motions, path) < 5.0


def test_pictures_that_turn_while_the_gyros_do_not_are_refused(calm: tuple[Trajectory, list[Pair]]) -> None:
    path, good = calm
    pairs = spoiled(good, range(CALM, CALM + 2), aside)
    alone, motions = run(pairs, None), run(pairs, Gyros(straight, SECONDS))
    assert worst_sigma(alone, path) > 20.0, "pictures alone believe it"
    assert all("degrees more than the gyros" in motion.reason for motion in motions[CALM : CALM + 2])
    assert lost(motions) == [0]
    assert worst_sigma(motions, path) < 5.0
    assert not motions[CALM + 3].reason


def test_new_points_after_a_gap_go_on_from_the_old_ones(calm: tuple[Trajectory, list[Pair]]) -> None:
    path, good = calm
    rig = StereoRig(FRONT_LEFT, FRONT_RIGHT)
    for gyros in (None, Gyros(straight, SECONDS)):
        before, after, chain = FeatureMatcher(rig), FeatureMatcher(rig), OdometryChain()
        motion = StereoMotion(rig, gyro=None if gyros is None else gyros.turn)
        motions = []
        for n, pair in enumerate(good):
            if gyros is not None:
                gyros.feed(pair.t_s)
            features = (before if n < CALM else after).update(pair.left, pair.right, pair.t_s)
            if n >= CALM:
                features = replace(features, ids=features.ids + 10_000)
            if not CALM - 2 <= n < CALM:
                motions.append(motion.update(features))
                place = follow(chain, motions[-1])
        assert lost(motions) == ([0, CALM - 2] if gyros is None else [0])
        assert motions[CALM - 2].reason == (BEGUN if gyros is None else f"held by the gyros: {BEGUN}")
        assert motions[CALM].reference_t_s == good[CALM].t_s
        if gyros is not None:
            assert worst_sigma(motions[: CALM - 1], path.select(np.r_[: CALM - 2, CALM : len(path)])) < 5.0
    travelled = np.linalg.norm(path.position_m[-1] - path.position_m[0])
    assert np.linalg.norm(place) == pytest.approx(travelled, abs=0.05)


def test_the_bias_of_the_gyros_is_learned_at_rest_and_on_the_way(calm: tuple[Trajectory, list[Pair]]) -> None:
    rest = [
        Pair(t_s=n / 15.0, left=still(pair.left, n), right=still(pair.right, n))
        for n, pair in enumerate(calm[1][:1] * 20)
    ]
    for pairs in (rest, calm[1]):
        gyros = Gyros(straight, SECONDS)
        begin = gyros.turn.bias_std_rad_s
        run(pairs, gyros)
        error = np.abs(gyros.turn.bias_rad_s - BIAS_RAD_S)
        assert gyros.turn.bias_std_rad_s < 0.1 * begin
        assert error.max() < 4.0 * gyros.turn.bias_std_rad_s


def still(picture: Picture, seed: int) -> Picture:
    noise = np.random.default_rng(seed).normal(0.0, 1.0, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def rates(gyro: GyroTurn, times: Iterable[float]) -> GyroTurn:
    for t_s in times:
        gyro.add(t_s, (0.0, 0.0, 1.0))
    return gyro


def test_a_turn_is_known_only_where_samples_are() -> None:
    whole = rates(GyroTurn(), np.arange(0.0, 1.0, 0.01).tolist())
    turn = whole.turn(0.203, 0.703)
    assert turn is not None
    assert np.arctan2(turn.rotation[1, 0], turn.rotation[0, 0]) == pytest.approx(0.5, abs=1e-9)
    later = whole.turn(0.51, 1.005)
    assert later is not None
    assert whole.turn(-0.1, 0.5) is None
    assert whole.turn(0.5, 1.1) is None
    assert whole.turn(0.5, 0.5) is None
    assert rates(GyroTurn(), [0.0, 0.01, 0.3, 0.31]).turn(0.0, 0.31) is None
    assert rates(GyroTurn(), []).turn(0.0, 0.1) is None
    assert rates(whole, [0.2, 0.21]).turn(0.1, 0.21) is None, "the clock went back"
