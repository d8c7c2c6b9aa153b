"""Pose graphs and the maps of whole drives: loops are closed, and what contradicts the rest does not bend it."""

import itertools
from math import hypot, pi

import numpy as np
import pytest
from tests.onboard.algorithms.scan_matching.rays import Scanner, Wall, box

from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.pose_graph import PoseRelation, optimized
from gloc3_onboard.algorithms.scan_matching.scan_graph import ScanGraph, poses_of_all
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt, points_of

COURT: list[Wall] = [
    *box(-2.0, -2.0, 16.0, 12.0),
    *box(2.0, 2.0, 8.0, 4.0),
    *box(-1.8, 5.0, 0.5, 0.7),
    *box(12.6, 1.0, 0.6, 0.9),
    *box(7.0, 9.2, 1.2, 0.5),
    *box(4.0, -1.9, 0.8, 0.4),
]
"""A corridor around a block, 12 m by 8 m in the middle, with things in it."""


def around(steps: int) -> list[Planar]:
    """Once around the block and a bit further, a scan each 0.25 m."""
    corners = [(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]
    poses, at, side = [], np.array(corners[0]), 0
    for _ in range(steps):
        goal = np.array(corners[(side + 1) % 4])
        left = goal - at
        if np.hypot(*left) < 0.25:
            side, at = side + 1, goal
            continue
        at = at + left / np.hypot(*left) * 0.25
        poses.append(Planar(float(at[0]), float(at[1]), wrap_pi(side * pi / 2.0)))
    return poses


def test_a_loop_spreads_its_error_and_a_wrong_loop_spreads_none() -> None:
    true = [Planar(float(n), 0.0, 0.0) for n in range(10)] + [Planar(9.0, float(n), pi / 2.0) for n in range(1, 10)]
    steps = [one.inverse() @ other for one, other in itertools.pairwise(true)]
    drifting = [step @ Planar(0.0, 0.0, 0.01) for step in steps]
    odometry = np.diag((1 / 0.05**2, 1 / 0.05**2, 1 / 0.02**2))
    loop = np.diag((1 / 0.01**2, 1 / 0.01**2, 1 / 0.005**2))
    relations = [PoseRelation(n, n + 1, step, odometry) for n, step in enumerate(drifting)]
    poses = [Planar()]
    for step in drifting:
        poses.append(poses[-1] @ step)
    before_m = (true[-1].inverse() @ poses[-1]).distance_m
    good = [PoseRelation(0, k, true[k], loop, is_certain=False) for k in (9, 12, 15, 18)]
    wrong = PoseRelation(3, 16, Planar(2.0, -3.0, 1.0), loop, is_certain=False)
    found, weights = optimized(poses, [*relations, *good, wrong])
    assert before_m > 1.0
    assert max((a.inverse() @ b).distance_m for a, b in zip(true, found, strict=True)) < 0.1
    assert weights[-1] < 0.01
    assert weights[-5:-1].min() > 0.3


def test_what_no_relation_measures_stays_with_the_rest() -> None:
    along = np.diag((0.0, 1e4, 1e4))
    known = np.diag((1e2, 1e2, 1e3))
    relations = [PoseRelation(0, 1, Planar(1.0), known), PoseRelation(0, 1, Planar(5.0, 0.2, 0.0), along)]
    found, _ = optimized([Planar(), Planar(0.9)], relations)
    assert found[1].x_m == pytest.approx(1.0, abs=0.01)
    assert found[1].y_m == pytest.approx(0.2, abs=0.01)


def test_after_a_loop_the_drift_of_the_odometer_is_gone_everywhere() -> None:
    random, scanner = np.random.default_rng(1), Scanner(COURT, angle_min_rad=-pi / 2.0, angle_span_rad=pi)
    true, graph = around(175), ScanGraph()
    drifting = [true[0]]
    for one, other in itertools.pairwise(true):
        step = one.inverse() @ other
        drifting.append(drifting[-1] @ Planar(1.02 * step.x_m, step.y_m, step.yaw_rad + 0.0015))
    for number, (pose, said) in enumerate(zip(true, drifting, strict=True)):
        points = points_of(scanner.scan(pose, random), Tilt(), Mount(), Planar())
        graph.add(number, points, said, is_sure=True)
    found = poses_of_all(drifting, graph.keys, graph.lay_out())

    def worst_m(poses: list[Planar]) -> float:
        return max(
            hypot(*((true[0].inverse() @ a).inverse() @ (poses[0].inverse() @ b))[:2])
            for a, b in zip(true, poses, strict=True)
        )

    assert worst_m(drifting) > 0.8
    assert graph.loops > 5
    assert worst_m(found) < 0.08
