"""Conversion of features and motions between arrays and messages."""

from typing import Final

import numpy as np

from gloc3.evaluation.trajectory import quaternions_from_matrices
from gloc3.messages.perception import Features, Odometry
from gloc3_onboard.algorithms.vision.features import FeatureSet
from gloc3_onboard.algorithms.vision.stereo_motion import KeyFrameMotion

SHARED: Final = 0.95
DRIFT: Final = 3.0
"""Points err alike from picture to picture, and go with their depths from key frame to key frame: found in flights of
60 m in the hold."""


def message_of(found: FeatureSet, camera: str) -> Features:
    """The message for a set of features."""
    return Features(
        camera=camera,
        ids=found.ids.astype("<i4").tobytes(),
        pixels=found.pixels.astype("<f4").tobytes(),
        right_pixels=found.right_pixels.astype("<f4").tobytes(),
        is_valid=not found.reason,
        reason=found.reason,
    )


def features_of(message: Features, t_s: float) -> FeatureSet | None:
    """The features of a message; None if its parts do not fit each other."""
    count = len(message.ids) // 4
    if len(message.ids) % 4 or len(message.pixels) != 8 * count or len(message.right_pixels) != 8 * count:
        return None
    ids = np.frombuffer(message.ids, "<i4")
    pixels = np.frombuffer(message.pixels, "<f4").reshape(-1, 2)
    right = np.frombuffer(message.right_pixels, "<f4").reshape(-1, 2)
    if count == 0 or not np.all(np.diff(ids) > 0) or not np.isfinite(pixels).all():
        return None
    return FeatureSet(t_s=t_s, ids=ids, pixels=pixels, right_pixels=right)


def odometry_of(motion: KeyFrameMotion, source: str) -> Odometry:
    """The message for a motion."""
    x, y, z = motion.position_m.tolist()
    qw, qx, qy, qz = quaternions_from_matrices(motion.rotation[None])[0].tolist()
    return Odometry(
        source=source,
        reference_t_s=motion.reference_t_s,
        position_m=(x, y, z),
        reference_from_frd=(qw, qx, qy, qz),
        covariance=motion.covariance.ravel().tolist(),
        is_valid=motion.is_valid,
        reason=motion.reason,
        quality=motion.quality,
        shared=SHARED,
        drift=DRIFT,
    )
