"""Trajectories and their errors: the forms they are read from, and agreement with the tool evo to 1e-6."""

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.errors import InputError, Refused
from gloc3.evaluation.metrics import Evaluation, TrajectoryAlignment, evaluate, relative_errors, steps
from gloc3.evaluation.trajectory import (
    Array,
    Trajectory,
    matrices_from_quaternions,
    quaternions_from_matrices,
    read_trajectory,
    write_tum,
)


def wandering(seed: int, count: int = 400, drift: float = 0.0) -> Trajectory:
    """A flight with climbs, turns and a rest; with drift, an estimate of the one of the same seed without."""
    random, share = np.random.default_rng(seed), np.linspace(0.0, 1.0, count)
    along = np.interp(share, [0.0, 0.4, 0.5, 1.0], [0.0, 14.0, 14.0, 40.0])
    position = np.column_stack([along, 3.0 * np.sin(along / 4.0), 1.5 + np.cos(along / 3.0)])
    angles = np.column_stack([0.1 * np.sin(along), 0.1 * np.cos(along), along / 5.0])
    if drift:
        position = position * (1.0 + drift) + np.cumsum(random.normal(0.0, drift / 5.0, (count, 3)), axis=0)
        angles = angles + np.cumsum(random.normal(0.0, drift / 20.0, (count, 3)), axis=0)
    half = angles / 2.0
    c, s = np.cos(half), np.sin(half)
    wxyz = np.column_stack([c.prod(axis=1), s[:, 0], s[:, 1], s[:, 2]])
    return Trajectory(t_s=100.0 + 20.0 * share, position_m=position, world_from_body=matrices_from_quaternions(wxyz))


def by_evo(estimate: Trajectory, truth: Trajectory, align: TrajectoryAlignment, over_m: float) -> dict[str, float]:
    """The same figures by the tool."""
    from evo.core import metrics, sync
    from evo.core.trajectory import PoseTrajectory3D

    def theirs(one: Trajectory) -> PoseTrajectory3D:
        wxyz = quaternions_from_matrices(one.world_from_body)
        return PoseTrajectory3D(one.position_m.copy(), wxyz, one.t_s.copy())

    true, found = sync.associate_trajectories(theirs(truth), theirs(estimate), max_diff=0.01)
    figures = {}
    for name, relation in (
        ("relative_m", metrics.PoseRelation.translation_part),
        ("relative_deg", metrics.PoseRelation.rotation_angle_deg),
    ):
        error = metrics.RPE(relation, over_m, metrics.Unit.meters, rel_delta_tol=0.1, all_pairs=True)
        error.process_data((true, found))
        figures[name] = error.get_statistic(metrics.StatisticsType.rmse)
        figures[f"{name}_max"] = error.get_statistic(metrics.StatisticsType.max)
        figures["pairs"] = float(len(error.error))
    if align is TrajectoryAlignment.ORIGIN:
        found.align_origin(true)
    elif align is not TrajectoryAlignment.NONE:
        found.align(true, n=-1 if align is TrajectoryAlignment.ALL else int(0.1 * found.num_poses))
    for name, relation in (
        ("absolute_m", metrics.PoseRelation.translation_part),
        ("absolute_deg", metrics.PoseRelation.rotation_angle_deg),
    ):
        whole = metrics.APE(relation)
        whole.process_data((true, found))
        figures[name] = whole.get_statistic(metrics.StatisticsType.rmse)
        figures[f"{name}_median"] = whole.get_statistic(metrics.StatisticsType.median)
    return figures


def ours(found: Evaluation) -> dict[str, float]:
    assert found.relative_m is not None
    assert found.relative_deg is not None
    return {
        "relative_m": found.relative_m.rms,
        "relative_m_max": found.relative_m.max,
        "relative_deg": found.relative_deg.rms,
        "relative_deg_max": found.relative_deg.max,
        "pairs": float(found.relative_pairs),
        "absolute_m": found.absolute_m.rms,
        "absolute_m_median": found.absolute_m.median,
        "absolute_deg": found.absolute_deg.rms,
        "absolute_deg_median": found.absolute_deg.median,
    }


@pytest.mark.thorough
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("align", TrajectoryAlignment)
def test_errors_agree_with_evo_to_a_millionth(align: TrajectoryAlignment) -> None:
    for seed in range(2):
        truth, estimate = wandering(seed), wandering(seed, drift=0.01)
        estimate = estimate.select(np.flatnonzero(np.random.default_rng(seed).random(len(estimate)) > 0.2))
        estimate = estimate.moved(np.linalg.qr(wandering(9).world_from_body[77])[0], np.array([5.0, -3.0, 1.0]))
        if np.linalg.det(estimate.world_from_body[0]) < 0.0:
            estimate = estimate.moved(-np.eye(3), np.zeros(3))
        for over_m in (1.0, 10.0):
            found = ours(evaluate(estimate, truth, align, over_m))
            assert found == pytest.approx(by_evo(estimate, truth, align, over_m), abs=1e-6, rel=0.0)


def test_a_trajectory_has_no_error_against_itself_and_a_rigid_move_is_aligned_away() -> None:
    truth = wandering(1)
    moved = truth.moved(truth.world_from_body[50], np.array([1.0, 2.0, 3.0]))
    for align in (TrajectoryAlignment.BEGIN, TrajectoryAlignment.ALL, TrajectoryAlignment.ORIGIN):
        found = evaluate(moved, truth, align)
        assert found.absolute_m.max < 1e-9
        assert found.absolute_deg.max < 1e-6
    assert evaluate(moved, truth, TrajectoryAlignment.NONE).absolute_m.rms > 1.0


def test_a_wrong_scale_is_not_corrected() -> None:
    truth = wandering(1)
    longer = Trajectory(t_s=truth.t_s, position_m=1.05 * truth.position_m, world_from_body=truth.world_from_body)
    found = evaluate(longer, truth, TrajectoryAlignment.ORIGIN)
    assert found.relative_m is not None
    assert found.relative_m.mean == pytest.approx(0.05 * 10.0, rel=0.1)


def test_an_odometer_that_says_nothing_and_one_that_only_goes_on_are_wrong() -> None:
    truth = wandering(2)
    nothing = Trajectory(
        t_s=truth.t_s,
        position_m=np.zeros_like(truth.position_m),
        world_from_body=np.tile(np.eye(3), (len(truth), 1, 1)),
    )
    assert evaluate(nothing, truth, TrajectoryAlignment.ORIGIN).absolute_share > 0.2
    on = nothing.t_s[:, None] - nothing.t_s[0]
    constant = Trajectory(
        t_s=truth.t_s,
        position_m=on * (truth.position_m[1] - truth.position_m[0]) / on[1],
        world_from_body=nothing.world_from_body,
    )
    assert evaluate(constant, truth, TrajectoryAlignment.ORIGIN).absolute_share > 0.2


def test_motions_between_neighbours_are_compared_one_by_one() -> None:
    truth = wandering(1, count=30)
    shift, turn = relative_errors(wandering(1, count=30, drift=0.01), truth, steps(truth))
    assert shift.shape == turn.shape == (29,)
    assert turn.max() < 0.5


def test_what_cannot_be_compared_is_refused() -> None:
    truth = wandering(1)
    later = Trajectory(t_s=truth.t_s + 1e3, position_m=truth.position_m, world_from_body=truth.world_from_body)
    with pytest.raises(Refused, match="no times in common"):
        evaluate(later, truth)
    line = Trajectory(
        t_s=truth.t_s, position_m=np.outer(truth.t_s, [1.0, 0.0, 0.0]), world_from_body=truth.world_from_body
    )
    with pytest.raises(Refused, match="one line"):
        evaluate(line, line)


def test_a_trajectory_is_written_in_tum_form_and_read_again(tmp_path: Path) -> None:
    given = wandering(3, count=40)
    write_tum(given, tmp_path / "t.txt")
    again = read_trajectory(tmp_path / "t.txt")
    np.testing.assert_allclose(again.position_m, given.position_m, atol=1e-8)
    np.testing.assert_allclose(again.world_from_body, given.world_from_body, atol=1e-9)
    np.testing.assert_allclose(again.t_s, given.t_s, atol=1e-8)


def test_kitti_and_euroc_forms_are_told_by_their_lines(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 1 1 0 0 2 0 0 1 3\n")
    kitti = read_trajectory(tmp_path / "poses.txt", np.array([7.0, 7.5, 8.0]))
    assert kitti.t_s.tolist() == [7.0, 7.5]
    assert kitti.position_m[1].tolist() == [1.0, 2.0, 3.0]
    (tmp_path / "data.csv").write_text(
        "#timestamp, p_x\n1403636580838555648,4.5,-1.5,0.75,0.5,0.5,0.5,0.5,0.1,0,0\n1403636580843555328,4.5,-1.5,0.75,0,0,0,1,0.1,0,0\n"
    )
    euroc = read_trajectory(tmp_path / "data.csv")
    assert euroc.t_s[1] - euroc.t_s[0] == pytest.approx(0.005, abs=1e-5)
    np.testing.assert_allclose(euroc.world_from_body[1], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no pose"),
        ("# only a comment\n", "no pose"),
        ("1 2 3\n", "neither TUM"),
        ("1 0 0 0 0 0 0 1\n2 0 0\n", r"t\.txt:2:1: 3 numbers"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", r"t\.txt:2:1: the time does not grow"),
        ("1 0 0 0 0 0 0 x\n", "'x' is no number"),
        ("1 0 0 nan 0 0 0 1\n", "not finite"),
        ("1 0 0 0 0 0 0 0\n", "is no attitude"),
    ],
)
def test_a_file_that_is_wrong_is_told_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(InputError, match=said):
        read_trajectory(tmp_path / "t.txt")


@given(
    st.text(alphabet="0123456789.,-e# \n", max_size=120)
    | st.binary(max_size=60).map(lambda data: data.decode("latin1"))
)
def test_any_text_is_a_trajectory_or_is_told_to_be_none(text: str) -> None:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "t.txt"
        file.write_bytes(text.encode("latin1"))
        with suppress(InputError):
            assert np.isfinite(read_trajectory(file).world_from_body).all()


def test_quaternions_and_matrices_are_the_same_rotations_at_every_angle() -> None:
    random = np.random.default_rng(4)
    wxyz: Array = np.concatenate([random.normal(size=(50, 4)), np.eye(4)])
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    wxyz[wxyz[:, 0] < 0.0] *= -1.0
    again = quaternions_from_matrices(matrices_from_quaternions(wxyz))
    np.testing.assert_allclose(np.abs(np.sum(again * wxyz, axis=1)), 1.0, atol=1e-12)
