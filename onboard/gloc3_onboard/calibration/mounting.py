"""Mounting of a camera: transformations of calibration files, and the letters that map a file's axes to our body."""

import math
from typing import Final, NamedTuple

from gloc3.errors import Refused
from gloc3.messages.frames import IDENTITY, Quaternion, Vector3, multiply, normalize, rotate

Matrix = list[list[float]]

FORWARD: Final[Quaternion] = (0.5, 0.5, 0.5, 0.5)
"""`frd_from_rdf` of an upright camera facing along the body's x."""
ORTHONORMAL: Final = 1e-3
"""How far a rotation in a file may be from one: they are written with few digits."""
_LETTERS: Final[dict[str, Vector3]] = {
    "f": (1.0, 0.0, 0.0),
    "b": (-1.0, 0.0, 0.0),
    "r": (0.0, 1.0, 0.0),
    "l": (0.0, -1.0, 0.0),
    "d": (0.0, 0.0, 1.0),
    "u": (0.0, 0.0, -1.0),
}


class Transform(NamedTuple):
    """`a_from_b`: where b is in a, and how it is turned."""

    position_m: Vector3
    rotation: Quaternion

    def then(self, other: "Transform") -> "Transform":
        """`a_from_b` after `b_from_c`: `a_from_c`."""
        x, y, z = rotate(self.rotation, other.position_m)
        position = (self.position_m[0] + x, self.position_m[1] + y, self.position_m[2] + z)
        return Transform(position, normalize(multiply(self.rotation, other.rotation)))

    def inverse(self) -> "Transform":
        """`b_from_a`."""
        w, x, y, z = self.rotation
        back = (w, -x, -y, -z)
        px, py, pz = rotate(back, self.position_m)
        return Transform((-px, -py, -pz), back)


IN_PLACE: Final = Transform((0.0, 0.0, 0.0), IDENTITY)


def transform_problem(matrix: Matrix) -> str:
    """Why a 4 by 4 (or 3 by 3) matrix moves no rigid body; empty if it does."""
    columns = [[matrix[row][column] for row in range(3)] for column in range(3)]
    for one in range(3):
        for other in range(one, 3):
            dot = sum(a * b for a, b in zip(columns[one], columns[other], strict=True))
            if abs(dot - (one == other)) > ORTHONORMAL:
                return "its rotation is invalid: the columns are not of length 1 and perpendicular"
    a, b, c = columns
    mixed = sum(c[k] * (a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2]) for k in range(3))
    if mixed < 0.0:
        return "its rotation mirrors"
    if len(matrix) == 4 and any(abs(v - w) > ORTHONORMAL for v, w in zip(matrix[3], (0, 0, 0, 1), strict=True)):
        return "its last row must be 0, 0, 0, 1"
    return ""


def transform_of(matrix: Matrix) -> Transform:
    """Transform of a 4 by 4 matrix with a checked rotation."""
    return Transform((matrix[0][3], matrix[1][3], matrix[2][3]), quaternion_of(matrix))


def quaternion_of(m: Matrix) -> Quaternion:
    """The rotation of a matrix (Shepperd, 1978: by the largest of the four, so that nothing is lost)."""
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = (trace, m[0][0], m[1][1], m[2][2])
    largest = squares.index(max(squares))
    if largest == 0:
        parts = [1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        parts = [0.0] * 4
        parts[0] = m[k][j] - m[j][k]
        parts[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        parts[1 + j] = m[j][i] + m[i][j]
        parts[1 + k] = m[k][i] + m[i][k]
    sign = -1.0 if parts[0] < 0.0 else 1.0
    length = sign * math.sqrt(sum(part * part for part in parts))
    return (parts[0] / length, parts[1] / length, parts[2] / length, parts[3] / length)


def frd_from_axes(letters: str) -> Quaternion:
    """Rotation to FRD from a frame given by axis letters: `flu` is x forward, y left, z up.

    Raises:
        Refused: the letters are not the axes of a right-handed frame.
    """
    text = letters.lower()
    columns = [_LETTERS[letter] for letter in text if letter in _LETTERS]
    if len(text) == 3 and len(columns) == 3:
        matrix = [[columns[column][row] for column in range(3)] for row in range(3)]
        if not transform_problem(matrix):
            return quaternion_of(matrix)
    raise Refused(
        f"axes {letters!r}: name where x, y and z point, by f, b, r, l, d, u (forward, back, right, left, down, up), "
        "right-handed: frd, flu, urf"
    )
