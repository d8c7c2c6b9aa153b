"""Odometry message of the body from a fit over the ground."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix
from gloc3.messages.frames import Quaternion, conjugate, from_yaw, multiply, normalize, yaw_of
from gloc3.messages.perception import UNKNOWN_VARIANCE, Odometry
from gloc3_onboard.algorithms.vision.ground_height import GroundHeight
from gloc3_onboard.algorithms.vision.ground_plane import PlaneMotion

Array = NDArray[np.float64]

SOURCE: Final = "ground"
_CAUTION: Final = 2.0
"""The corners of one picture err alike in the next; so their number promises too much."""
_SHARED: Final = 0.98
_DRIFT: Final = 8.0
"""What a height, an attitude or the points' places are wrong by stays from picture to picture, and from key frame to
key frame: found in flights of 60 m in the hold."""
_GOOD_POINTS: Final = 60
"""So many points that move together are as good as it gets."""


class BodyAttitude(NamedTuple):
    """Tilt and heading of the body at a time."""

    t_s: float
    level_from_frd: Quaternion
    """Roll and pitch alone."""
    yaw_rad: float

    @staticmethod
    def of(t_s: float, ned_from_frd: Quaternion) -> "BodyAttitude":
        """Splits an attitude into tilt and heading."""
        yaw_rad = yaw_of(ned_from_frd)
        return BodyAttitude(t_s, normalize(multiply(conjugate(from_yaw(yaw_rad)), ned_from_frd)), yaw_rad)


def ratio_std(motion: PlaneMotion) -> float:
    """Standard deviation of the height ratio of a motion."""
    by = np.zeros(8)
    by[:2], by[2], by[6:] = motion.slope, -1.0, motion.translation[:2]
    return math.sqrt(max(float(by @ motion.covariance @ by), 0.0))


def report(
    motion: PlaneMotion,
    height: GroundHeight,
    key: BodyAttitude,
    now: BodyAttitude,
    lever_frd_m: Array,
    level_std_rad: float,
    *,
    is_climb_reported: bool = True,
) -> Odometry:
    """The motion of the body's origin since the key frame.

    Roll and pitch are inputs: their variance is `UNKNOWN_VARIANCE`.
    """
    yaw_rad = math.atan2(motion.turn[1, 0], motion.turn[0, 0])
    reference_from_frd = normalize(multiply(from_yaw(yaw_rad), now.level_from_frd))
    # Lever arm: the camera's place changes by R l - R_key l as the body turns.
    swung = matrix(reference_from_frd) @ lever_frd_m - matrix(key.level_from_frd) @ lever_frd_m
    place = motion.translation * height.mean_m - swung
    covariance = _covariance(motion, height, key, now, level_std_rad)
    if not is_climb_reported:
        covariance[2, :] = covariance[:, 2] = 0.0
        covariance[2, 2] = UNKNOWN_VARIANCE
    return Odometry(
        source=SOURCE,
        reference_t_s=key.t_s,
        position_m=(float(place[0]), float(place[1]), float(place[2])),
        reference_from_frd=reference_from_frd,
        covariance=covariance.reshape(-1).tolist(),
        is_level=True,
        quality=min(1.0, float(motion.is_inlier.sum()) / _GOOD_POINTS) * float(motion.is_inlier.mean()),
        shared=_SHARED,
        drift=_DRIFT,
    )


def _covariance(
    motion: PlaneMotion, height: GroundHeight, key: BodyAttitude, now: BodyAttitude, level_std_rad: float
) -> Array:
    """(6, 6): position in the reference's level axes, rotation in the body's without roll and pitch."""
    covariance = np.zeros((6, 6))
    scale = height.std_m / height.mean_m
    seen = motion.covariance * _CAUTION
    place = motion.translation * height.mean_m
    # Scale: C h^2 + p p^T (sigma_h / h)^2.
    covariance[:3, :3] = seen[:3, :3] * height.mean_m**2 + np.outer(place, place) * scale**2
    # The axes of the reference are as level as its attitude was.
    north, east, down = place
    tipped = np.array([[0.0, down], [-down, 0.0], [east, -north]])
    covariance[:3, :3] += tipped @ tipped.T * level_std_rad**2
    covariance[:3, 5] = covariance[5, :3] = seen[:3, 5] * height.mean_m
    covariance[3, 3] = covariance[4, 4] = UNKNOWN_VARIANCE
    # Heading is turned about a vertical that is as wrong as the attitude: it leaks in where the body is not level.
    tipped_square = sum(x * x + y * y for _, x, y, _ in (key.level_from_frd, now.level_from_frd)) * 4.0
    covariance[5, 5] = seen[5, 5] + level_std_rad**2 * tipped_square
    return covariance
