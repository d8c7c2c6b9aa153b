"""A trajectory: poses over time as arrays, read from and written to the formats of common data sets."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Finding, InputError

Array = NDArray[np.float64]

TUM_COLUMNS: Final = 8
KITTI_COLUMNS: Final = 12
EUROC_COLUMNS: Final = 8
"""Time, position and attitude; the columns after them (velocity, biases) are not part of a pose."""
LONGEST: Final = 2.0
"""Length from which a quaternion is none: those of files are rounded, not scaled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectory:
    """Poses of one body in one frame, in order of time."""

    t_s: Array
    """Times, shape (n,)."""
    position_m: Array
    """Where the body is, shape (n, 3)."""
    world_from_body: Array
    """How it is turned: rotation matrices, shape (n, 3, 3)."""

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def distances_m(self) -> Array:
        """Length of the path from the first pose to each, shape (n,)."""
        steps = np.linalg.norm(np.diff(self.position_m, axis=0), axis=1)
        return np.concatenate([np.zeros(min(1, len(self))), np.cumsum(steps)])

    def select(self, which: NDArray[np.intp] | slice) -> "Trajectory":
        """Some of its poses."""
        return Trajectory(
            t_s=self.t_s[which], position_m=self.position_m[which], world_from_body=self.world_from_body[which]
        )

    def moved(self, rotation: Array, shift_m: Array) -> "Trajectory":
        """The same seen from another frame: `rotation @ p + shift_m`."""
        return Trajectory(
            t_s=self.t_s,
            position_m=self.position_m @ rotation.T + shift_m,
            world_from_body=rotation @ self.world_from_body,
        )


def matrices_from_quaternions(wxyz: Array) -> Array:
    """Rotation matrices of quaternions (n, 4), w first; each is scaled to unit length first."""
    w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows, np.float64).transpose(2, 0, 1)


def quaternions_from_matrices(rotations: Array) -> Array:
    """Quaternions (n, 4), w first and not negative, of rotation matrices (n, 3, 3).

    The largest of the four components is taken from the diagonal, the others from their products with it (Shepperd 1978).
    """
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.column_stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]])
    quarter = 1.0 + 2.0 * squares - trace[:, None]
    quarter[:, 0] = 1.0 + trace
    xy, xz, yz = r[:, 1, 0] + r[:, 0, 1], r[:, 2, 0] + r[:, 0, 2], r[:, 2, 1] + r[:, 1, 2]
    wx, wy, wz = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]
    products = np.array(
        [
            [quarter[:, 0], wx, wy, wz],
            [wx, quarter[:, 1], xy, xz],
            [wy, xy, quarter[:, 2], yz],
            [wz, xz, yz, quarter[:, 3]],
        ]
    ).transpose(2, 0, 1)
    best = products[np.arange(len(r)), np.argmax(quarter, axis=1)]
    unit: Array = best / np.linalg.norm(best, axis=1, keepdims=True)
    return np.where(unit[:, :1] < 0.0, -unit, unit)


def read_trajectory(path: Path, times_s: Array | None = None) -> Trajectory:
    """Reads a trajectory in TUM, EuRoC or KITTI format.

    TUM: time, position, quaternion xyzw. EuRoC: nanoseconds, position, quaternion wxyz, and more, separated by commas.
    KITTI: one line per pose, with the first three rows of its matrix; the times come from a separate source.

    Args:
        path: the file; its format is detected from its lines.
        times_s: times of the lines of a KITTI file; None counts them 0.1 s apart.

    Raises:
        InputError: the file has none of these formats, or its times do not increase.
    """
    rows, lines = _rows(path)
    if not rows:
        raise _wrong(path, 0, "there is no pose in it")
    width = len(rows[0])
    for row, (line, is_csv) in zip(rows, lines, strict=True):
        if len(row) != width or (is_csv and width < EUROC_COLUMNS):
            raise _wrong(path, line, f"{len(row)} numbers, where {max(width, EUROC_COLUMNS)} are expected")
    table = np.array(rows, np.float64)
    if not np.isfinite(table).all():
        raise _wrong(path, lines[int(np.argmin(np.isfinite(table).all(axis=1)))][0], "a number is not finite")
    if lines[0][1]:
        found = _of_quaternions(path, table[:, 0] * 1e-9, table[:, 1:4], table[:, 4:8])
    elif width == TUM_COLUMNS:
        found = _of_quaternions(path, table[:, 0], table[:, 1:4], table[:, [7, 4, 5, 6]])
    elif width == KITTI_COLUMNS:
        found = _of_kitti(path, table, times_s)
    else:
        raise _wrong(
            path, lines[0][0], f"{width} numbers in a line: neither TUM (8), KITTI (12) nor EuRoC (with commas)"
        )
    if not np.all(np.diff(found.t_s) > 0.0):
        raise _wrong(path, lines[int(np.argmin(np.diff(found.t_s) > 0.0)) + 1][0], "the time does not grow")
    return found


def _rows(path: Path) -> tuple[list[list[float]], list[tuple[int, bool]]]:
    """Numbers of each line, with its line number and whether they are separated by commas."""
    rows, lines = [], []
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _wrong(path, 0, "it is not text") from error
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.partition("#")[0].strip()
        if bare:
            try:
                rows.append([float(word) for word in bare.replace(",", " ").split()])
            except ValueError as error:
                word = next((word for word in bare.replace(",", " ").split() if not is_number(word)), bare)
                message = (
                    f"{word!r} is no number: poses are lines of TUM (8 numbers), KITTI (12) or EuRoC (with commas)"
                )
                raise _wrong(path, number, message) from error
            lines.append((number, "," in bare))
    return rows, lines


def is_number(word: str) -> bool:
    """Whether a word of a text file is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _wrong(path: Path, line: int, message: str) -> InputError:
    return InputError([Finding(file=str(path), line=line, column=1 if line else 0, message=message)])


def _of_quaternions(path: Path, t_s: Array, position_m: Array, wxyz: Array) -> Trajectory:
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(wxyz, axis=1)
    if not (lengths.min() > 0.5 and lengths.max() < LONGEST):
        raise _wrong(path, 0, "a quaternion is no attitude: its length is not 1")
    return Trajectory(t_s=t_s, position_m=position_m, world_from_body=matrices_from_quaternions(wxyz))


def _of_kitti(path: Path, table: Array, times_s: Array | None) -> Trajectory:
    poses = table.reshape(-1, 3, 4)
    known_s: Array = np.arange(len(poses), dtype=np.float64) * 0.1 if times_s is None else times_s
    if len(known_s) < len(poses):
        raise _wrong(path, 0, f"{len(poses)} poses, but {len(known_s)} times")
    return Trajectory(t_s=known_s[: len(poses)], position_m=poses[:, :, 3], world_from_body=poses[:, :, :3])


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """Writes a trajectory in TUM form: time, position, quaternion with w last; nothing is rounded that matters."""
    wxyz = quaternions_from_matrices(trajectory.world_from_body)
    lines = [
        f"{t_s:.9f} {x:.9f} {y:.9f} {z:.9f} {qx:.12f} {qy:.12f} {qz:.12f} {qw:.12f}\n"
        for t_s, (x, y, z), (qw, qx, qy, qz) in zip(
            trajectory.t_s.tolist(), trajectory.position_m.tolist(), wxyz.tolist(), strict=True
        )
    ]
    path.write_text("".join(lines), encoding="utf-8")
