"""Calibration of a magnetometer: the ellipsoid on which its readings lie when it is turned (hard and soft iron)."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats

LEAST_SAMPLES: Final = 50
CELLS: Final = 64
"""Parts of the sphere, of equal area, by which coverage is counted."""
LEAST_SHARE: Final = 0.7
"""Of them, those that must have been shown."""
ROUGH_LEAST: Final = 0.05
"""Least singular value of the first fit, as a share of the largest, below which the readings lie in a plane."""
OUTLIER: Final = 0.03
"""Share of the field beyond which a reading counts less: soft L1."""
FAR: Final = 4.0
"""Times the distance of nearly all readings from the middle, beyond which one is far away."""
SAME: Final = 1e-6
BLOCKS: Final = 10
MOST_ROUNDS: Final = 40
FEW_ROUNDS: Final = 8
MOST_SAMPLES: Final = 1500
FACES: Final = {
    "nose": (1.0, 0.0, 0.0),
    "tail": (-1.0, 0.0, 0.0),
    "right side": (0.0, 1.0, 0.0),
    "left side": (0.0, -1.0, 0.0),
    "underside": (0.0, 0.0, 1.0),
    "top": (0.0, 0.0, -1.0),
}
"""Directions in the body, forward, right, down."""
FACE_COSINE: Final = 0.75


@dataclass(frozen=True, kw_only=True)
class EllipsoidFit:
    """A magnetometer as it was calibrated: the field is `matrix @ (reading - offset)`."""

    offset: Floats
    """Hard iron, (3,), in the readings' unit."""
    offset_std: Floats
    matrix: Floats
    """Soft iron, (3, 3), symmetric, with determinant 1."""
    radius: float
    """Strength of the field, in the readings' unit."""
    before: float
    """Standard deviation of the strength of the readings as they are, as a share of the field."""
    after: float
    """The same of the calibrated ones."""
    coverage: "SphereCoverage"

    def corrected(self, readings: Floats) -> Floats:
        """Calibrated readings, (n, 3)."""
        return np.asarray((readings - self.offset) @ self.matrix)

    @property
    def axis_ratio(self) -> float:
        """Of the longest to the shortest axis of the ellipsoid."""
        values = np.linalg.eigvalsh(self.matrix)
        return float(values[-1] / values[0])


class SphereCoverage:
    """Directions in the body from which the field has come.

    Args:
        directions: unit vectors, (n, 3).
    """

    def __init__(self, directions: Floats) -> None:
        number = np.arange(CELLS) + 0.5
        down, turn = 1.0 - 2.0 * number / CELLS, np.pi * (1.0 + math.sqrt(5.0)) * number
        across = np.sqrt(1.0 - down**2)
        self.centres: Final[Floats] = np.column_stack((across * np.cos(turn), across * np.sin(turn), down))
        self.counts = np.bincount((directions @ self.centres.T).argmax(axis=1), minlength=CELLS)
        """Readings in each part of the sphere."""

    @property
    def share(self) -> float:
        """Share of the parts that have been shown."""
        return float((self.counts > 0).mean())

    def faces(self) -> dict[str, float]:
        """Share of the parts around each face of the body from which the field has come."""
        is_near = {name: self.centres @ np.array(face) > FACE_COSINE for name, face in FACES.items()}
        return {name: float((self.counts[near] > 0).mean()) for name, near in is_near.items()}

    def advice(self) -> str:
        """How to turn the vehicle next; empty if enough has been shown."""
        if self.share >= LEAST_SHARE:
            return ""
        faces = self.faces()
        return f"point its {min(faces, key=lambda name: faces[name])} along the field (in the north: north and steeply down)"


def fit_ellipsoid(readings: Floats) -> EllipsoidFit:
    """Calibrates a magnetometer.

    Args:
        readings: the field in the body, (n, 3), in any unit.

    Raises:
        Refused: there are too few, some jump, they lie in a plane, or on no ellipsoid.
    """
    from scipy.optimize import least_squares

    if len(readings) < LEAST_SAMPLES:
        raise Refused(f"{len(readings)} readings of the magnetometer are too few: {LEAST_SAMPLES} are the least")
    readings = readings[:: -(-len(readings) // MOST_SAMPLES)]
    middle = readings.mean(axis=0)
    scale = float(np.linalg.norm(readings - middle, axis=1).mean())
    if scale <= SAME * float(np.linalg.norm(middle)):
        raise Refused("all readings of the magnetometer are the same: it is stuck, or the vehicle was not turned")
    points = (readings - middle) / scale
    try:
        begin = _algebraic(points)
    except Refused:
        _refuse_jumps(readings)
        raise
    rough = (points - begin[:3]) @ _symmetric(begin[3:])
    counts = SphereCoverage(_unit(rough))
    cell = (_unit(rough) @ counts.centres.T).argmax(axis=1)
    weights = 1.0 / np.sqrt(counts.counts[cell])  # a rest in one attitude counts as one moment
    weights /= math.sqrt(float((weights**2).mean()))

    def solved(chosen: NDArray[np.bool_], first: Floats, rounds: int) -> Floats:
        def residuals(x: Floats) -> Floats:
            lengths = np.linalg.norm((points[chosen] - x[:3]) @ _symmetric(x[3:]), axis=1)
            return np.asarray((lengths - 1.0) * weights[chosen])

        return np.asarray(least_squares(residuals, first, loss="soft_l1", f_scale=OUTLIER, max_nfev=rounds).x)

    every = np.ones(len(points), bool)
    best = solved(every, begin, MOST_ROUNDS)
    blocks = np.arange(len(points)) * BLOCKS // len(points)
    others = np.array([solved(blocks != block, best, FEW_ROUNDS) for block in range(BLOCKS)])
    spread = np.sqrt((BLOCKS - 1) / BLOCKS * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    shape = _symmetric(best[3:])
    volume = float(np.linalg.det(shape)) ** (1.0 / 3.0)
    matrix, radius = shape / volume, scale / volume
    fixed = (points - best[:3]) @ shape
    lengths = np.linalg.norm(readings, axis=1)
    return EllipsoidFit(
        offset=middle + scale * best[:3],
        offset_std=scale * spread[:3],
        matrix=matrix,
        radius=radius,
        before=float(lengths.std()) / radius,
        after=float(np.linalg.norm(fixed, axis=1).std()),
        coverage=SphereCoverage(_unit(fixed)),
    )


def _refuse_jumps(readings: Floats) -> None:
    """Refuses readings that jump far away from all others, and back in the next one.

    Raises:
        Refused: there are some.
    """
    away = np.linalg.norm(readings - np.median(readings, axis=0), axis=1)
    is_far = away > FAR * np.quantile(away, 0.9)
    beside = np.pad(is_far, 1)
    jumps = readings[is_far & ~beside[:-2] & ~beside[2:]]
    if len(jumps):
        first = ", ".join(f"{value:.3g}" for value in jumps[0])
        raise Refused(
            f"some readings are far away from those before and after, such as {first}: the magnetometer or its line is "
            "disturbed; leave them out"
        )


def _algebraic(points: Floats) -> Floats:
    """The quadric of least algebraic error: offset and upper triangle of the matrix that makes it a unit sphere."""
    x, y, z = points.T
    table = np.column_stack(
        (x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z, np.ones(len(x)))
    )
    _, values, rows = np.linalg.svd(table, full_matrices=False)
    if values[-2] < ROUGH_LEAST * values[0] / math.sqrt(len(values)):
        raise Refused(
            "the readings lie in a plane or on a line: turn the vehicle about all its axes, each side down once"
        )
    a, b, c, d, e, f, g, h, i, k = rows[-1] * np.sign(rows[-1][:3].sum())
    form = np.array([[a, d, e], [d, b, f], [e, f, c]])
    centre = -np.linalg.solve(form, np.array([g, h, i]))
    level = float(centre @ form @ centre) - k
    sizes, axes = np.linalg.eigh(form / level)
    if level <= 0.0 or sizes.min() <= 0.0:
        raise Refused(
            "the readings lie on no ellipsoid: turn the vehicle about all its axes, away from steel and currents"
        )
    root = (axes * np.sqrt(sizes)) @ axes.T
    return np.concatenate((centre, root[np.triu_indices(3)]))


def _symmetric(upper: Floats) -> Floats:
    xx, xy, xz, yy, yz, zz = upper.tolist()
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
