"""Pose graph: the poses that agree best with measured motions between them (sparse least squares).

Gauss-Newton on all poses at once, the first one fixed; motions that contradict the others lose weight (Cauchy), so that
a wrong one does not bend the rest (Lu and Milios, Autonomous Robots 1997; Grisetti et al., "A tutorial on graph-based
SLAM", 2010).
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

STEPS: Final = 30
STILL: Final = 1e-6
"""It ends when no pose moves more, in metres and radians."""
DOUBT: Final = 3.0
"""Normalised error at which a motion that may be wrong has half its weight."""


class PoseRelation(NamedTuple):
    """A measured motion from one pose to another."""

    first: int
    second: int
    motion: Planar
    information: Array
    """Inverse covariance, 3 by 3, on the axes of the first pose."""
    is_certain: bool = True
    """Whether it cannot be plainly wrong."""


def optimized(poses: Sequence[Planar], relations: Sequence[PoseRelation]) -> tuple[list[Planar], Array]:
    """The poses that agree best with the relations, and the weight of each relation, 0 to 1.

    Args:
        poses: where to start.
        relations: between poses, by their numbers; all must hang together.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve

    state = np.array(poses, np.float64)
    edges = _Edges(relations)
    weights = np.ones(len(relations))
    size = 3 * (len(state) - 1)
    for _ in range(STEPS):
        errors, jacobians = edges.errors(state)
        whitened = np.einsum("mij,mj->mi", edges.roots, errors)
        squares = np.sum(whitened**2, axis=1)
        weights = np.where(edges.is_certain, 1.0, 1.0 / (1.0 + squares / DOUBT**2))
        root = np.sqrt(weights)
        values = np.einsum("mij,mjk->mik", edges.roots * root[:, None, None], jacobians)
        kept = edges.columns >= 0
        matrix = coo_matrix(
            (values[kept], (edges.rows[kept], edges.columns[kept])), shape=(3 * len(errors), size)
        ).tocsc()
        normal = matrix.T @ matrix
        step = spsolve(normal, -matrix.T @ (whitened * root[:, None]).ravel()).reshape(-1, 3)
        state[1:] += step
        if np.abs(step).max(initial=0.0) < STILL:
            break
    return [Planar(x, y, yaw) for x, y, yaw in np.column_stack((state[:, :2], _wrapped(state[:, 2]))).tolist()], weights


class _Edges:
    """The relations as arrays."""

    def __init__(self, relations: Sequence[PoseRelation]) -> None:
        self.first = np.array([relation.first for relation in relations])
        self.second = np.array([relation.second for relation in relations])
        self.motions = np.array([relation.motion for relation in relations], np.float64)
        self.is_certain = np.array([relation.is_certain for relation in relations])
        # W with W^T W = information; a direction without information has none.
        values, axes = np.linalg.eigh(np.array([relation.information for relation in relations]))
        self.roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * axes.transpose(0, 2, 1)
        part = np.arange(3)
        columns = 3 * (np.stack((self.first, self.second), axis=1) - 1)
        self.columns = np.repeat((columns[:, :, None] + part).reshape(-1, 1, 6), 3, axis=1)
        """Of the jacobian's values; negative for the first pose, which is fixed."""
        self.columns[self.columns < 0] = -1
        self.rows = np.repeat(np.arange(3 * len(relations)).reshape(-1, 3, 1), 6, axis=2)

    def errors(self, state: Array) -> tuple[Array, Array]:
        """Of each relation, shape (m, 3), and its jacobian by both poses, shape (m, 3, 6)."""
        begin, end = state[self.first], state[self.second]
        c, s = np.cos(begin[:, 2]), np.sin(begin[:, 2])
        north, east = (end - begin)[:, 0], (end - begin)[:, 1]
        ahead, aside = c * north + s * east, c * east - s * north
        # e = (R_i^T (t_j - t_i) - z_t, theta_j - theta_i - z_theta)
        errors = np.column_stack(
            (
                ahead - self.motions[:, 0],
                aside - self.motions[:, 1],
                _wrapped(end[:, 2] - begin[:, 2] - self.motions[:, 2]),
            )
        )
        none, one = np.zeros(len(c)), np.ones(len(c))
        rows = ((-c, -s, aside, c, s, none), (s, -c, -ahead, -s, c, none), (none, none, -one, none, none, one))
        return errors, np.array(rows).transpose(2, 0, 1)


def _wrapped(angles: Array) -> Array:
    wrapped: Array = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped
