"""Readings of a magnetometer with known hard and soft iron while its vehicle is turned."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FIELD: Final = np.array([0.2, 0.02, 0.43])
"""North, east, down, in gauss: central Europe."""
OFFSET: Final = np.array([0.08, -0.12, 0.05])
SOFT: Final = np.array([[1.05, 0.03, -0.02], [0.03, 0.96, 0.01], [-0.02, 0.01, 1.0]])
"""What the calibration must find, up to its scale."""


def readings(seed: int, *, tilt_rad: float = np.pi, count: int = 1200, noise: float = 0.003) -> NDArray[np.float64]:
    """Readings while a vehicle is turned about all its axes, (n, 3).

    Args:
        seed: of the motion and the noise.
        tilt_rad: how far it is pitched and rolled.
        count: how many.
        noise: standard deviation, in gauss.
    """
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, count)
    pitch, roll = (
        share * tilt_rad * np.sin(rate * time + random.uniform(0.0, 6.0)) for share, rate in ((0.5, 23.0), (1.0, 17.0))
    )
    turned = Rotation.from_euler("ZYX", np.column_stack((60.0 * time, pitch, roll)))
    body = turned.inv().apply(FIELD)
    return np.asarray(body @ np.linalg.inv(SOFT).T + OFFSET + random.normal(0.0, noise, body.shape))
