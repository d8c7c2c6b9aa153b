"""What the fusion makes of single samples of the inertial unit."""

import numpy as np
import pytest

from gloc3_onboard.algorithms.fusion.imu_watch import ImuWatch
from gloc3_onboard.algorithms.fusion.trust import Trust


def test_a_jolt_between_two_samples_leaves_the_velocity_in_doubt() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    still, struck = (0.0, 0.0, -9.8), (0.0, 0.0, -60.0)
    doubts = []
    for count, force in enumerate((still, still, struck, still, still)):
        mean = watch.add_sample((0.0, 0.0, 0.0), force, 0.01 * count, 0.01 * count, -1.0, trust)
        doubts.append(mean.jolt_m_s if mean is not None else None)
    assert doubts == [0.0, 0.0, pytest.approx(0.25, abs=0.01), pytest.approx(0.25, abs=0.01), 0.0]


def test_a_sample_that_is_turned_down_leaves_the_velocity_in_doubt_too() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    for count in range(3):
        watch.add_sample((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), 0.01 * count, 0.01 * count, -1.0, trust)
    assert watch.add_sample((0.0, 0.0, 0.0), (0.0, 0.0, -120.0), 0.03, 0.03, -1.0, trust) is None
    mean = None
    for count in range(4, 30):
        mean = mean or watch.add_sample((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), 0.01 * count, 0.01 * count, -1.0, trust)
    assert mean is not None
    assert mean.jolt_m_s > 0.5


def test_of_garbage_within_what_it_can_measure_next_to_nothing_is_believed() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    random = np.random.default_rng(1)
    believed = 0
    for i in range(100):
        is_garbage = i >= 20
        rate = tuple(random.uniform(-20.0, 20.0, 3).tolist()) if is_garbage else (0.0, 0.0, 0.001 * i)
        force = tuple(random.uniform(-60.0, 60.0, 3).tolist()) if is_garbage else (0.0, 0.0, -9.8)
        t_s = 0.01 * i
        believed += watch.add_sample(rate, force, t_s, t_s, -1.0, trust) is not None and is_garbage
    assert believed == 0
    assert not trust.is_used


def test_who_is_doubted_again_and_again_is_left_out_for_longer_and_longer() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    now_s, spans = 0.0, []
    for _ in range(7):
        watch.distrust(now_s, "it contradicts everybody", trust)
        begin_s = now_s
        while watch.is_distrusted(now_s):
            now_s += 0.5
        spans.append(now_s - begin_s)
    assert spans == [3.0, 6.0, 12.0, 24.0, 48.0, 60.0, 60.0]


def test_samples_older_than_the_estimate_do_not_keep_the_unit_in_use() -> None:
    """The estimate has gone on without it, and cannot take back what it has coasted."""
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    force, was_used = (0.0, 0.0, -9.8), []
    for count in range(60):
        t_s = 0.01 * count
        is_late = 20 <= count < 30
        now_s = t_s + 0.2 if is_late else t_s
        mean = watch.add_sample((0.0, 0.0, 1e-4 * count), force, t_s, now_s, now_s - 0.005, trust)
        assert not (is_late and mean is not None)
        was_used.append(trust.is_used)
        if count == 29:
            assert trust.reason == "late by 0.20 s"
    assert was_used[19]
    assert not any(was_used[24:45])
    assert was_used[-1], "it is timely again"
