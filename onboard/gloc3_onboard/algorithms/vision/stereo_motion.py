"""Motion of a stereo camera from matched points, relative to a key frame that lasts while enough of it is seen."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import Array
from gloc3.messages.perception import UNKNOWN_VARIANCE
from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn, InertialTurn
from gloc3_onboard.algorithms.odometry.held_motion import HeldMotion
from gloc3_onboard.algorithms.vision.features import TURNED_BACK_AFTER, FeatureSet
from gloc3_onboard.algorithms.vision.pose_fit import (
    LARGEST_NOISE,
    Points,
    PoseFit,
    PoseFitNoise,
    fit_pose,
    pose_by_three_points,
    vector_of,
)
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

_LEAST_POINTS: Final = 12
_LEAST_SHARE: Final = 0.5
"""Share of points consistent with one motion below which none is reported."""
_SURE_SHARE: Final = 0.8
_RIVAL_SHARE: Final = 0.6
"""Share of the other points consistent with a second motion that makes less than the above ambiguous."""
_NOISE_MARGIN: Final = 2.0
_NOISE_LEAST: Final = 2.0
_NOISE_GROWTH: Final = 1.3
_NOISE_GAIN: Final = 0.5
"""The noise of the measurements is learnt, and a single picture may not have much more: else a torn one passes."""
_ALIKE: Final = 5.0
"""How many times less the points say of such a constant than if their errors were independent."""
_OFFSET_DRIFT_PX: Final = 0.006
"""How much the constant in the disparities may change from key frame to key frame, less by the same factor."""
_OFFSET_MAX: Final = 2.0
"""Largest such constant, in standard deviations of the calibration's errors."""
_OFF_SHARE: Final = 0.3
"""Share of the points' distance that counts where their directions are off."""
_TURN_MAX_RAD_S2: Final = 40.0
"""A turn that would have taken more is not believed."""
_ODD_SHARE: Final = 0.3
"""Distance from where the motion led, as a share of its step, above which a second motion is looked for."""
_LASTING_S: Final = 0.5
"""Time without a motion after which the key frame is dropped, s."""
_CONTRADICTION: Final = 25.0
"""Squared difference of the turns by points and by gyros, over its covariance, above which the points are wrong."""
_HELD_QUALITY: Final = 0.1
_SHARED: Final = 1.1
_OWN: Final = 1.5
"""What the covariance is multiplied by: a part for errors that neighbouring points share, and one for residuals that are
larger than expected (by their median). Found in the simulated hold, so that 5 % of the errors are outside of 95 %."""
BEGUN: Final = "motion is measured from this picture on"
"""Reason why the first report of a key frame without a predecessor has no motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionOptions:
    """Options of the odometer."""

    ray_px: float = 0.12
    """Standard deviation of where a point is found again, in pixels."""
    disparity_px: float = 0.15
    """The same of its disparity."""
    calibration_px: float = 0.0
    """Standard deviation of the calibration's errors, in pixels: what all points share. With 0 it is held to be exact;
    else a constant in the disparities is estimated, and the covariance is wider."""
    key_share: float = 0.6
    """With less of the key frame's points in use, there is a new one."""
    key_depth: float = 0.3
    """The same after a motion of this share of the distance of the points."""
    std_max_m: float = 0.1
    """With a standard deviation above it a motion is not valid."""
    acceleration_max_m_s2: float = 20.0
    """A motion that would have taken more is not believed."""
    hold_s: float = 0.3
    """With gyros: longest time without a motion over which their turn and the last speed stand in for one."""
    hold_m_s2: float = 1.5
    """Standard deviation of each component of the body's acceleration meanwhile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyFrameMotion:
    """Motion of the body since a key frame."""

    t_s: float
    reference_t_s: float
    """The key frame's time."""
    position_m: Array
    """Where the body is, in its axes at the key frame, (3,)."""
    rotation: Array
    """Key frame from now, (3, 3)."""
    covariance: Array
    """6 by 6: position in the key frame's axes, then rotation vector in the body's."""
    quality: float
    """0 to 1: share of the points that agree, less where they are few."""
    points: int
    """Points in use."""
    is_valid: bool
    reason: str = ""
    """Why it is not valid, or is held by the gyros."""


@dataclass(slots=True, kw_only=True)
class _Key:
    """A key frame: points by their ids, in growing order."""

    t_s: float
    ids: NDArray[np.int32]
    rays: Array
    inverse_m: Array
    inverse_variance: Array
    offset_share: Array
    """How much of an offset of the disparities is in the inverse depths, (n,)."""
    used: int


class StereoMotion:
    """Estimates the motion of a stereo pair from features; holds the key frame.

    With gyros it expects the turn that they measure, refuses points that contradict it, and goes on by it for a short
    time in which the points tell no motion.

    Args:
        rig: the calibrated pair.
        options: how it works.
        gyro: has the samples up to the features; None without an inertial unit.
    """

    def __init__(self, rig: StereoRig, options: MotionOptions | None = None, gyro: GyroTurn | None = None) -> None:
        self._rig = rig
        self._gyro = gyro
        self._options = options or MotionOptions()
        self._hold = HeldMotion(self._options.hold_s, self._options.hold_m_s2)
        self._noise = PoseFitNoise(
            ray=self._options.ray_px / rig.focal_px,
            disparity=self._options.disparity_px / rig.focal_px,
            offset=self._options.calibration_px / _ALIKE / rig.focal_px,
        )
        self._offset = 0.0
        self._level = LARGEST_NOISE
        self.reset()

    def reset(self) -> None:
        """Drops the key frame and the motion."""
        self._key: _Key | None = None
        self._position: Array = np.zeros(3)
        self._rotation: Array = np.eye(3)
        self._speed_m_s: Array = np.zeros(3)
        self._turn: Array = np.eye(3)
        self._turn_s = 0.0
        self._last_s = -np.inf
        self._good_s = -np.inf
        self._turned_back = 0
        self._inertial: InertialTurn | None = None
        self._turn_covariance: Array = np.zeros((3, 3))
        self._hold.begin(-np.inf)

    def update(self, features: FeatureSet) -> KeyFrameMotion:
        """The motion since the key frame."""
        t_s = features.t_s
        self._inertial = None if self._gyro is None else self._gyro.turn(self._last_s, t_s)
        motion = self._measured(features)
        return motion if motion.is_valid else self._held(t_s, motion.reason) or motion

    def hold(self, t_s: float, reason: str) -> KeyFrameMotion | None:
        """The motion by the gyros and the last speed, where there are no features.

        Args:
            t_s: when.
            reason: why there are none.

        Returns:
            None without gyros, too long after the last motion, or where it is not known well enough.
        """
        self._inertial = None if self._gyro is None else self._gyro.turn(self._last_s, t_s)
        return self._held(t_s, reason)

    def _measured(self, features: FeatureSet) -> KeyFrameMotion:
        t_s = features.t_s
        if features.reason or not np.isfinite(t_s):
            return self._lost(t_s, features.reason or "the time is not a number")
        if t_s <= self._last_s:
            self._turned_back += 1
            if self._turned_back < TURNED_BACK_AFTER:
                return self._lost(t_s, "the time does not grow")
            self.reset()
        self._turned_back = 0
        left, right = self._rig.left_rays(features.pixels), self._rig.right_rays(features.right_pixels)
        seen = np.column_stack([left, left[:, 0] - right[:, 0] - self._offset])
        key = self._key
        if key is None or t_s - self._good_s > _LASTING_S or features.ids[0] > key.ids[-1]:
            return self._begin(features, seen)
        _, of_key, of_now = np.intersect1d(key.ids, features.ids, assume_unique=True, return_indices=True)
        if len(of_key) < _LEAST_POINTS:
            return self._lost(t_s, f"{len(of_key)} points of the key frame are seen")
        points = Points(
            rays=key.rays[of_key],
            inverse_m=key.inverse_m[of_key],
            inverse_variance=key.inverse_variance[of_key],
            seen=seen[of_now],
            offset_share=key.offset_share[of_key],
        )
        self._noise = replace(self._noise, largest=min(max(_NOISE_MARGIN * self._level, _NOISE_LEAST), LARGEST_NOISE))
        fit = self._fit(points, t_s)
        reason = self._distrust(fit, points, t_s)
        if fit is None or reason:
            self._level *= _NOISE_GROWTH
            return self._lost(t_s, reason)
        if self._gyro is not None and self._inertial is not None:
            turned, covariance = self._turned(fit)
            self._gyro.learn(self._last_s, t_s, turned, float(np.trace(covariance)) / 3.0)
        self._apply_fit(fit, t_s)
        self._level += _NOISE_GAIN * (fit.noise - self._level)
        count = int(fit.is_inlier.sum())
        motion = self._motion(fit, t_s, count)
        self._hold.follow(t_s, motion.position_m, motion.rotation, motion.covariance)
        key.inverse_m[of_key[fit.is_inlier]] = fit.inverse_m[fit.is_inlier]
        key.inverse_variance[of_key[fit.is_inlier]] = self._floored(fit.inverse_variance[fit.is_inlier])
        raw = (self._noise.disparity / self._rig.baseline_m) ** 2
        key.offset_share[of_key] = np.minimum(key.inverse_variance[of_key] / raw, 1.0)
        moved = float(np.linalg.norm(fit.position_m)) * float(np.median(points.inverse_m))
        if count < self._options.key_share * key.used or moved > self._options.key_depth:
            self._renew(features, seen, fit, of_key, of_now)
            self._hold.renew(t_s, motion.rotation)
            self._turn_covariance = np.zeros((3, 3))
        return motion

    def _floored(self, variance: Array) -> Array:
        least = (0.4 * self._noise.disparity / self._rig.baseline_m) ** 2
        return np.maximum(variance, least)

    def _begin(self, features: FeatureSet, seen: Array) -> KeyFrameMotion:
        """The first key frame, or one after a gap; the gyros lead to it over a short one."""
        t_s, is_placed = features.t_s, _all_finite(seen)
        if int(is_placed.sum()) < _LEAST_POINTS:
            return self._lost(t_s, f"{int(is_placed.sum())} points are seen by both cameras")
        held = self._held(t_s, BEGUN)
        if held is not None:
            self._speed_m_s = (self._rig.frd_from_rectified.T @ held.rotation.T @ self._rig.frd_from_rectified) @ (
                self._speed_m_s
            )
            self._hold.renew(t_s, held.rotation)
            self._turn_covariance, self._turn_s = np.zeros((3, 3)), 0.0
        else:
            self.reset()
            self._hold.begin(t_s)
        self._set_key(features, seen, is_placed)
        self._last_s = self._good_s = t_s
        return held or self._lost(t_s, BEGUN)

    def _held(self, t_s: float, reason: str) -> KeyFrameMotion | None:
        found = self._hold.ahead(t_s, self._inertial)
        key = self._key
        if found is None or key is None or np.sqrt(np.trace(found[2][:3, :3])) > self._options.std_max_m:
            return None
        position, rotation, covariance = found
        return KeyFrameMotion(
            t_s=t_s,
            reference_t_s=key.t_s,
            position_m=position,
            rotation=rotation,
            covariance=covariance,
            quality=_HELD_QUALITY,
            points=0,
            is_valid=True,
            reason=f"held by the gyros: {reason}",
        )

    def _set_key(self, features: FeatureSet, seen: Array, is_placed: NDArray[np.bool_]) -> None:
        base = self._rig.baseline_m
        # Triangulate: inverse depth w = disparity / baseline, variance (sigma_disparity / baseline)^2.
        self._key = _Key(
            t_s=features.t_s,
            ids=features.ids[is_placed],
            rays=seen[is_placed, :2],
            inverse_m=np.maximum(seen[is_placed, 2] / base, 1e-4),
            inverse_variance=np.full(int(is_placed.sum()), (self._noise.disparity / base) ** 2),
            offset_share=np.ones(int(is_placed.sum())),
            used=int(is_placed.sum()),
        )
        self._position, self._rotation = np.zeros(3), np.eye(3)

    def _renew(
        self, features: FeatureSet, seen: Array, fit: PoseFit, of_key: NDArray[np.intp], of_now: NDArray[np.intp]
    ) -> None:
        """Makes this view the key frame; depths that are known well go with it."""
        key = self._key
        assert key is not None
        is_outlier = np.zeros(len(features.ids), bool)
        is_outlier[of_now[~fit.is_inlier]] = True
        is_placed = _all_finite(seen) & ~is_outlier
        speed = fit.rotation.T @ self._speed_m_s
        ray3 = np.column_stack([key.rays[of_key], np.ones(len(of_key))])
        ahead = ((ray3 - fit.inverse_m[:, None] * fit.position_m) @ fit.rotation)[:, 2]
        # Transfer depths: w' = w / z, z = r_3 . (ray - w p); dw'/dw is about 1 / z^2.
        inverse = fit.inverse_m / ahead
        variance = self._floored(fit.inverse_variance / ahead**4)
        seen = seen - np.array([0.0, 0.0, self._learn_offset(fit)])
        self._set_key(features, seen, is_placed)
        new = self._key
        assert new is not None
        place = np.cumsum(is_placed) - 1
        is_carried = fit.is_inlier & is_placed[of_now] & (ahead > 0.05)
        to = place[of_now[is_carried]]
        new.inverse_m[to] = inverse[is_carried]
        new.inverse_variance[to] = np.minimum(variance[is_carried], new.inverse_variance[to])
        raw = (self._noise.disparity / self._rig.baseline_m) ** 2
        new.offset_share[to] = np.minimum(new.inverse_variance[to] / raw, 1.0)
        self._speed_m_s = speed

    def _learn_offset(self, fit: PoseFit) -> float:
        """Takes in what a key frame says of the constant in the disparities; returns by how much it changes."""
        if self._noise.offset == 0.0:
            return 0.0
        drift = _OFFSET_DRIFT_PX / self._rig.focal_px
        std = float(np.sqrt(fit.offset_variance + drift**2))
        self._noise = replace(self._noise, offset=std)
        most = _OFFSET_MAX * self._options.calibration_px / self._rig.focal_px
        before, self._offset = self._offset, float(np.clip(self._offset + fit.offset, -most, most))
        return self._offset - before

    def _predicted(self, t_s: float) -> tuple[Array, Array]:
        """Predicted pose of the camera for unchanged motion."""
        # Constant velocity: p + v dt; the last step's turn once more, R dR, unless pictures are missing between.
        ahead_s = t_s - self._last_s
        turned = self._rotation @ self._turn if ahead_s < 1.5 * self._turn_s else self._rotation
        if self._inertial is not None:
            axes = self._rig.frd_from_rectified
            turned = self._rotation @ (axes.T @ self._inertial.rotation @ axes)
        return self._position + self._speed_m_s * ahead_s, turned

    def _fit(self, points: Points, t_s: float) -> PoseFit | None:
        # Fit from the predicted pose; with too few inliers again from P3P with RANSAC, and the better one counts.
        fit = fit_pose(points, self._rig.baseline_m, self._noise, *self._predicted(t_s))
        if fit is not None and fit.is_inlier.mean() >= 0.6:
            return fit
        start = pose_by_three_points(points, 3.0 / self._rig.focal_px)
        if start is None:
            return fit
        other = fit_pose(points, self._rig.baseline_m, self._noise, *start)
        if fit is None or (other is not None and other.is_inlier.sum() > fit.is_inlier.sum()):
            return other
        return fit

    def _distrust(self, fit: PoseFit | None, points: Points, t_s: float) -> str:
        if fit is None:
            return "the points do not determine a motion"
        count, share = int(fit.is_inlier.sum()), float(fit.is_inlier.mean())
        if count < _LEAST_POINTS or share < _LEAST_SHARE:
            return f"only {count} of {len(fit.is_inlier)} points agree on a motion"
        # Uncertainty of the place: the root of its covariance's trace.
        std_m = float(np.sqrt(np.trace(fit.covariance[:3, :3])))
        if std_m > self._options.std_max_m:
            return f"the points determine the motion only to {std_m:.2f} m"
        reason = self._contradiction(fit)
        if reason:
            return reason
        if self._turn_s == 0.0:  # nothing is known yet of how it moves
            return ""
        # Gate: an acceleration a between two steps changes the place by a dt^2 from the predicted one.
        predicted = self._predicted(t_s)[0]
        jump_m = float(np.linalg.norm(fit.position_m - predicted))
        if jump_m > self._options.acceleration_max_m_s2 * (t_s - self._last_s) ** 2 + 5.0 * std_m:
            return f"a jump of {jump_m:.2f} m"
        turned = float(np.linalg.norm(vector_of(self._predicted(t_s)[1].T @ fit.rotation)))
        if turned > _TURN_MAX_RAD_S2 * (t_s - self._last_s) ** 2:
            return f"a jump of {np.degrees(turned):.0f} degrees by which too few points agree"
        is_odd = jump_m > _ODD_SHARE * float(np.linalg.norm(predicted - self._position))
        if share < _SURE_SHARE and is_odd and self._is_rivalled(fit, points, t_s, jump_m):
            return "the points fit two motions"
        return ""

    def _contradiction(self, fit: PoseFit) -> str:
        """Why the turn by the points cannot be; empty if it agrees with the gyros, or there are none."""
        if self._inertial is None:
            return ""
        turned, covariance = self._turned(fit)
        off = vector_of(self._inertial.rotation.T @ turned)
        covariance = covariance + self._inertial.variance_rad2 * np.eye(3)
        if float(off @ np.linalg.solve(covariance, off)) <= _CONTRADICTION:
            return ""
        return f"the points turn by {np.degrees(np.linalg.norm(off)):.1f} degrees more than the gyros"

    def _turned(self, fit: PoseFit) -> tuple[Array, Array]:
        """Turn of the body since the last motion, then from now, FRD, and the covariance of its rotation vector."""
        axes = self._rig.frd_from_rectified
        covariance = self._covariance(fit)[3:, 3:] + self._turn_covariance
        return axes @ self._rotation.T @ fit.rotation @ axes.T, axes @ covariance @ axes.T

    def _is_rivalled(self, fit: PoseFit, points: Points, t_s: float, jump_m: float) -> bool:
        """Whether the inconsistent points fit another motion, closer to the previous one.

        This happens with a torn picture, part of which is older.
        """
        rest = ~fit.is_inlier
        if int(rest.sum()) < _LEAST_POINTS:
            return False
        others = Points(
            rays=points.rays[rest],
            inverse_m=points.inverse_m[rest],
            inverse_variance=points.inverse_variance[rest],
            seen=points.seen[rest],
            offset_share=points.offset_share[rest] if points.offset_share is not None else None,
        )
        rival = fit_pose(others, self._rig.baseline_m, self._noise, *self._predicted(t_s))
        if rival is None or float(rival.is_inlier.mean()) < _RIVAL_SHARE:
            return False
        return float(np.linalg.norm(rival.position_m - self._predicted(t_s)[0])) < jump_m

    def _apply_fit(self, fit: PoseFit, t_s: float) -> None:
        # Velocity and turn of the last step, in the axes of the key frame and of the step before.
        after_s = t_s - self._last_s
        self._speed_m_s = (fit.position_m - self._position) / after_s
        self._turn, self._turn_s = self._rotation.T @ fit.rotation, after_s
        self._position, self._rotation = fit.position_m, fit.rotation
        self._last_s = self._good_s = t_s
        self._turn_covariance = self._covariance(fit)[3:, 3:]

    def _motion(self, fit: PoseFit, t_s: float, count: int) -> KeyFrameMotion:
        key = self._key
        assert key is not None
        turn = self._rig.frd_from_rectified
        rotation = turn @ fit.rotation @ turn.T
        lever = self._rig.position_frd_m
        # Camera to body: p_b = l + T p - R l with R = T R_c T^T; the covariance by the Jacobian below.
        position = lever + turn @ fit.position_m - rotation @ lever
        # How the body's pose changes with the camera's: its lever turns with it.
        x, y, z = lever.tolist()
        change = np.zeros((6, 6))
        change[:3, :3] = turn
        change[:3, 3:] = rotation @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
        change[3:, 3:] = turn
        covariance = change @ self._covariance(fit) @ change.T
        share = float(fit.is_inlier.mean())
        return KeyFrameMotion(
            t_s=t_s,
            reference_t_s=key.t_s,
            position_m=position,
            rotation=rotation,
            covariance=covariance,
            quality=share * min(1.0, count / 60.0),
            points=count,
            is_valid=True,
        )

    def _covariance(self, fit: PoseFit) -> Array:
        """Of the camera's motion since the key frame, (6, 6)."""
        scale = _SHARED + float(np.median(fit.squares)) * _OWN
        return np.asarray(fit.covariance * scale + self._of_calibration(fit))

    def _of_calibration(self, fit: PoseFit) -> Array:
        """What errors of the calibration add to the covariance of the camera's motion, (6, 6)."""
        off = self._options.calibration_px / self._rig.focal_px
        inverse_m = float(np.median(fit.inverse_m))
        added = np.diag([(_OFF_SHARE * off / inverse_m) ** 2] * 3 + [off**2] * 3)
        # A constant in the disparities changes all depths, and with them the motion, by the same share.
        share = off / (self._rig.baseline_m * inverse_m)
        added[:3, :3] += share**2 * np.outer(fit.position_m, fit.position_m)
        return added

    def _lost(self, t_s: float, reason: str) -> KeyFrameMotion:
        return KeyFrameMotion(
            t_s=t_s,
            reference_t_s=self._key.t_s if self._key is not None else t_s,
            position_m=np.zeros(3),
            rotation=np.eye(3),
            covariance=np.eye(6) * UNKNOWN_VARIANCE,
            quality=0.0,
            points=0,
            is_valid=False,
            reason=reason,
        )


def _all_finite(rows: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(rows).all(axis=1))
