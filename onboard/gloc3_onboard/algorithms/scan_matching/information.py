"""What a fit says about each direction, and what it does not: a long corridor tells nothing along itself.

The information of points on lines is the sum over their normals. Normals that are only nearly parallel seem to say
something along the walls too; as much as their own uncertainty explains is taken off again.
"""

from math import atan2, cos, hypot, sin
from typing import Final, NamedTuple

import numpy as np

from gloc3_onboard.algorithms.scan_matching.planar import Array

SOLVED: Final = 6
"""Fewest points that are fitted."""
SUPPORT: Final = 3.0
"""A direction that fewer beams than this look at squarely, together, is not known."""
SUPPORT_SHARE: Final = 0.01
"""Nor one that less than this part of them looks at."""
TURN_SUPPORT_M2: Final = 0.75
"""A heading that the beams tell less of than three at half a metre from the middle is not known."""
EXCESS: Final = 4.0
"""So many times what the uncertainty of the normals explains is taken off."""


class Information(NamedTuple):
    """The normal equations of a fit, and how far they can be trusted."""

    matrix: Array
    """3 by 3: north, east, heading; in the map's axes, heading about the scanner; for residuals of variance 1 m²."""
    known: Array
    """Orthonormal directions that the fit tells, as columns; shape (3, k) with k of 0 to 3."""
    sigma_m: float
    """Standard deviation of the residuals."""

    @property
    def is_degenerate(self) -> bool:
        """Whether there is anything that the fit does not tell."""
        return len(self.known.T) < 3

    def solve(self, gradient: Array) -> Array:
        """The step that the fit asks for, without any part along a direction that is not known."""
        if not self.is_degenerate:
            return np.asarray(np.linalg.solve(self.matrix, gradient), np.float64)
        known = self.known
        step: Array = known @ np.linalg.solve(known.T @ self.matrix @ known, known.T @ gradient)
        return step

    def known_part(self, step: Array) -> Array:
        """What of a step goes along directions that are known."""
        part: Array = self.known @ (self.known.T @ step)
        return part

    def covariance(self, unknown_variance: float) -> Array:
        """3 by 3 covariance of north, east and heading."""
        known = self.known
        inverse = known @ np.linalg.inv(known.T @ self.matrix @ known) @ known.T
        result: Array = unknown_variance * (np.eye(3) - known @ known.T) + inverse * self.sigma_m**2
        return result


NOTHING: Final = Information(np.zeros((3, 3)), np.zeros((3, 0)), 1.0)
"""Of a fit to nothing."""


def information_of(jacobian: Array, swings: Array, weights: Array, angle_std_rad: Array, sigma_m: float) -> Information:
    """Sums up what some points on lines say.

    Args:
        jacobian: of the distance to the line: its normal, and by the heading; shape (n, 3).
        swings: the same jacobian, were each normal turned by a right angle: how it changes with the normal's direction.
        weights: of each point.
        angle_std_rad: how well the direction of each line is known.
        sigma_m: standard deviation of the distances.
    """
    matrix = jacobian.T @ (jacobian * weights[:, None])
    doubts = EXCESS * weights * angle_std_rad * angle_std_rad
    sure = matrix - swings.T @ (swings * doubts[:, None])
    (nn, ne, nh), (_, ee, eh), (_, _, hh) = sure.tolist()
    turning = max(float(matrix[2, 2]), 1e-9)
    needed = max(SUPPORT, SUPPORT_SHARE * float(weights.sum()))
    columns = [
        (n, e, 0.0)
        for value, n, e in _axes(nn - nh * nh / turning, ne - nh * eh / turning, ee - eh * eh / turning)
        if value >= needed
    ]
    if _turning_alone(nn, ne, ee, nh, eh, hh, columns) >= TURN_SUPPORT_M2:
        columns.append((0.0, 0.0, 1.0))
    return Information(matrix, np.array(columns).reshape(-1, 3).T, sigma_m)


def _axes(a: float, b: float, d: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Eigenvalues and unit eigenvectors of a symmetric 2 by 2 matrix, the larger first."""
    angle = 0.5 * atan2(2.0 * b, a - d)
    c, s = cos(angle), sin(angle)
    middle, spread = 0.5 * (a + d), hypot(0.5 * (a - d), b)
    return (middle + spread, c, s), (middle - spread, -s, c)


def _turning_alone(
    nn: float, ne: float, ee: float, nh: float, eh: float, hh: float, columns: list[tuple[float, float, float]]
) -> float:
    """What is said about the heading when the place is free along the directions that are known."""
    if len(columns) == 2:
        return hh - (ee * nh * nh - 2.0 * ne * nh * eh + nn * eh * eh) / (nn * ee - ne * ne)
    if len(columns) == 1:
        n, e, _ = columns[0]
        return hh - (n * nh + e * eh) ** 2 / (n * n * nn + 2.0 * n * e * ne + e * e * ee)
    return hh
