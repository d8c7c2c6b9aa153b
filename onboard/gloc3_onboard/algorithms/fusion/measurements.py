"""Measurement models of the error state: residual, Jacobian and covariance. Pure functions."""

from math import isfinite
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import (
    Quaternion,
    Vector3,
    conjugate,
    multiply,
    rotate,
    rotate_back,
    to_rotation_vector,
    wrap_pi,
    yaw_of,
)
from gloc3_onboard.algorithms.fusion.error_state import Matrix, skew

UNKNOWN_FROM: Final = 1e3
"""Variance (m2 or rad2) from which a direction counts as unmeasured."""
CHI2_999: Final = (0.0, 10.83, 13.82, 16.27, 18.47, 20.52, 22.46)
"""Quantiles of the chi-square distribution at 99.9 %, by degrees of freedom."""


class Measured(NamedTuple):
    """A linear measurement of the error of a pose, and of a reference pose's where there is one."""

    residual: Matrix
    """(m,)."""
    by_pose: Matrix
    """(m, 6): by the error of the pose (position in NED, rotation vector in NED)."""
    by_reference: Matrix | None
    """(m, 6): the same of the reference."""
    noise: Matrix
    """(m, m)."""

    @property
    def degrees(self) -> int:
        """Degrees of freedom."""
        return int(self.residual.shape[0])


def matrix_of(a_from_b: Quaternion) -> Matrix:
    """The rotation as a matrix (3, 3)."""
    w, x, y, z = a_from_b
    return np.array(
        (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
            (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
    )


def heading_gradient(ned_from_frd: Quaternion) -> Vector3:
    """Gradient of the forward axis's heading by a small rotation vector in NED."""
    forward = rotate(ned_from_frd, (1.0, 0.0, 0.0))
    # psi = atan2(f_e, f_n) and df = dtheta x f: dpsi/dtheta = (-f_d f_n, -f_d f_e, f_n^2 + f_e^2) / (f_n^2 + f_e^2).
    across = max(forward[0] * forward[0] + forward[1] * forward[1], 1e-6)
    return (-forward[2] * forward[0] / across, -forward[2] * forward[1] / across, 1.0)


def _outer(a: Vector3, b: Vector3) -> Matrix:
    (x, y, z), (u, v, w) = a, b
    return np.array(((x * u, x * v, x * w), (y * u, y * v, y * w), (z * u, z * v, z * w)))


def relative(
    reference: tuple[Vector3, Quaternion],
    axes: Quaternion,
    pose: tuple[Vector3, Quaternion],
    reported: tuple[Vector3, Quaternion],
    covariance: Matrix,
    *,
    is_level: bool,
) -> Measured | None:
    """An odometer's motion since a reference; None where it measures nothing.

    Args:
        reference: estimated position and attitude of the reference.
        axes: `ned_from_reference`: the reference's attitude, levelled if the odometer's axes are.
        pose: estimated position and attitude at the end.
        reported: position in the reference's axes, and attitude on them.
        covariance: (6, 6): position in the axes of the reference, rotation vector in the body's.
        is_level: the axes turn with the reference's heading only.
    """
    (cx, cy, cz), attitude_then = reference
    (px, py, pz), attitude = pose
    # Residual: z_p - A^T (p - c), log((A^T R)^T Z), with the reference's place c and axes A.
    shift = (px - cx, py - cy, pz - cz)
    expected = rotate_back(axes, shift)
    turned = multiply(conjugate(axes), attitude)
    rotation = to_rotation_vector(multiply(conjugate(turned), reported[1]))
    residual = np.array(
        (reported[0][0] - expected[0], reported[0][1] - expected[1], reported[0][2] - expected[2], *rotation),
        dtype=np.float64,
    )
    back, body = matrix_of(conjugate(axes)), matrix_of(conjugate(attitude))
    # Jacobians: A^T, R^T by the pose; -A^T, A^T [p - c]x, -R^T by the reference (level: its heading alone).
    by_pose, by_reference = np.zeros((6, 6)), np.zeros((6, 6))
    by_pose[:3, :3] = back
    by_pose[3:, 3:] = body
    by_reference[:3, :3] = -back
    if is_level:
        gradient = heading_gradient(attitude_then)
        by_reference[:3, 3:] = _outer(rotate_back(axes, (shift[1], -shift[0], 0.0)), gradient)
        by_reference[3:, 3:] = _outer(rotate_back(attitude, (0.0, 0.0, -1.0)), gradient)
        if min(covariance[3, 3], covariance[4, 4]) >= UNKNOWN_FROM:
            # Heading alone: where the body leans, errors of a roll and pitch that were not measured turn it about its own
            # down axis, but not its heading. Row 5: psi_z - (psi_R - psi_A) with the headings' gradients.
            residual[5] = wrap_pi(yaw_of(reported[1]) - yaw_of(turned))
            by_pose[5, 3:] = heading_gradient(attitude)
            by_reference[5, 3:] = np.negative(gradient)
    else:
        by_reference[:3, 3:] = back @ skew(shift)
        by_reference[3:, 3:] = -body
    return _reported(Measured(residual, by_pose, by_reference, covariance))


def place(
    pose: tuple[Vector3, Quaternion], position_ned_m: Vector3, lever_frd_m: Vector3, covariance: Matrix
) -> Measured | None:
    """An absolute position of a point on the body, with covariance (3, 3); None where it measures nothing."""
    # Residual z - (p + R l), H = [I, -[R l]x].
    lever = rotate(pose[1], lever_frd_m)
    residual = np.array([z - p - a for z, p, a in zip(position_ned_m, pose[0], lever, strict=True)])
    by_pose = np.zeros((3, 6))
    by_pose[0, 0] = by_pose[1, 1] = by_pose[2, 2] = 1.0
    if lever_frd_m != (0.0, 0.0, 0.0):
        by_pose[:, 3:] = -skew(lever)
    return _reported(Measured(residual, by_pose, None, covariance))


def level_of(ned_from_frd: Quaternion, reported: Quaternion, std_rad: float) -> Measured:
    """Roll and pitch from another attitude, whose heading is ignored."""
    # The other attitude's down in our NED is e_d - dtheta x e_d: (e, -n) measures dtheta about north and east.
    north, east, _ = rotate(ned_from_frd, rotate_back(reported, (0.0, 0.0, 1.0)))
    by_pose = np.zeros((2, 6))
    by_pose[0, 3] = by_pose[1, 4] = 1.0
    return Measured(np.array((east, -north)), by_pose, None, np.eye(2) * std_rad**2)


class HeightMeasurement(NamedTuple):
    """A range to the floor as a vertical distance."""

    vertical_m: float
    """Vertical distance to the surface that was hit."""
    by_pose: Matrix
    """(1, 6): how the believed height over a floor that is known less this follows from the error of the pose."""


def height_over(range_m: float, ned_from_frd: Quaternion, *, is_slant: bool) -> HeightMeasurement:
    """A range to the floor, measured along the body's down axis where it is slant, else vertically."""
    by_pose = np.zeros((1, 6))
    by_pose[0, 2] = -1.0
    if not is_slant:
        return HeightMeasurement(range_m, by_pose)
    # Along d = R (0, 0, 1): vertical r d_d; H = -1 on down, r (-d_e, d_n) on the rotation.
    north, east, down = rotate(ned_from_frd, (0.0, 0.0, 1.0))
    by_pose[0, 3], by_pose[0, 4] = -range_m * east, range_m * north
    return HeightMeasurement(range_m * down, by_pose)


def covariance_of(numbers: list[float], rows: int, floor: Matrix) -> Matrix | None:
    """The covariance of a message with at least the variances of `floor`; None if it is not a covariance.

    One that is not positive definite is left with its variances alone: its correlations cannot be believed.
    """
    if len(numbers) != rows * rows or not all(map(isfinite, numbers)):
        return None
    given = np.array(numbers).reshape(rows, rows)
    covariance: Matrix = 0.5 * (given + given.T)
    diagonal = covariance.diagonal()
    if diagonal.min() < 0.0:
        return None
    covariance.reshape(-1)[:: rows + 1] = np.maximum(diagonal, floor)
    from scipy.linalg.lapack import dpotrf  # loaded only by vehicles that fuse

    _, problem = dpotrf(covariance)
    return np.diag(covariance.diagonal()) if problem else covariance


def _reported(measured: Measured) -> Measured | None:
    """The measurement without unmeasured directions."""
    noise = measured.noise
    known = [value < UNKNOWN_FROM for value in noise.diagonal().tolist()]
    if all(known):
        return measured
    rows = noise.tolist()
    lost = [row for row, is_known in zip(rows, known, strict=True) if not is_known]
    if all(row.count(0.0) == len(row) - 1 for row in lost):  # they are axes, and have nothing to do with the others
        if len(lost) == len(rows):
            return None
        kept = np.array([index for index, is_known in enumerate(known) if is_known])
        by_reference = None if measured.by_reference is None else measured.by_reference[kept]
        return Measured(measured.residual[kept], measured.by_pose[kept], by_reference, noise[np.ix_(kept, kept)])
    # Keep the known eigenvectors V alone: V^T r, V^T H, diag(lambda).
    values, vectors = np.linalg.eigh(noise)
    is_reported = values < UNKNOWN_FROM
    if not is_reported.any():
        return None
    view = vectors[:, is_reported].T
    return Measured(
        view @ measured.residual,
        view @ measured.by_pose,
        None if measured.by_reference is None else view @ measured.by_reference,
        np.diag(values[is_reported]),
    )
