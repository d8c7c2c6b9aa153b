"""Ground odometry from a downward camera, the attitude and the height."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, project, unproject
from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.messages.perception import Odometry, no_motion
from gloc3_onboard.algorithms.vision import ground_plane
from gloc3_onboard.algorithms.vision.ground_height import GroundHeight
from gloc3_onboard.algorithms.vision.ground_plane import PlaneMotion, PlaneNoise, Prior
from gloc3_onboard.algorithms.vision.ground_report import SOURCE, BodyAttitude, ratio_std, report
from gloc3_onboard.algorithms.vision.ground_tracks import GroundTracks
from gloc3_onboard.algorithms.vision.picture import Picture, problem

Array = NDArray[np.float64]

_LEAST_POINTS: Final = 12
_LEAST_SHARE: Final = 0.35
"""Of the points that were found again, how many must move as the floor does."""
_KEPT_SHARE: Final = 0.6
"""A key frame of which fewer points are left is replaced."""
_FAR: Final = 0.35
"""Distance, in heights, after which a key frame is replaced…"""
_TURNED_RAD: Final = 0.15
"""... after this turn, ..."""
_SCALED: Final = 0.15
"""... after this share of change in height."""
_SURE_SHARE: Final = 0.06
"""A relief that is known to this share of the height is kept."""
_HIGHEST_M: Final = 200.0
"""Largest range of a range finder, m."""
_CLIMB_M_S: Final = 0.3
"""How fast the height may have changed while nothing was seen."""
_ECHO_FLAT: Final = 0.2
"""Search distance below the camera for the point hit by the range finder, in flat units."""
_MOST_M_S2: Final = 15.0
"""Largest acceleration of a vehicle, m/s²."""
_LARGEST_NOISE_PX: Final = 1.5
_SLOPE_CHANGE: Final = 0.003
"""How much the slope of a floor may change from key frame to key frame."""
_LOST_AFTER: Final = 3
"""Consecutive good pictures without a motion after which a new key frame starts."""
_TURNED_BACK_AFTER: Final = 5
"""Pictures older than the last in a row until their time is believed."""


class GroundSettings(NamedTuple):
    """Settings of a ground odometer. Lengths in metres, on the body's axes."""

    height_noise_m: float = 0.02
    """Standard deviation of one height."""
    height_scale_std: float = 0.007
    """Standard deviation of the share by which all heights (or the focal length) may be wrong."""
    is_slant: bool = False
    """The height is measured along the body's down axis, as a range finder does that is fixed to it, not vertically."""
    sensor_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Where the height is measured from."""
    tilt_std_rad: float = 0.003
    """Standard deviation of roll and pitch changes between two pictures, rad."""
    yaw_std_rad: float = 0.02
    """The same of heading."""
    level_std_rad: float = 0.006
    """How wrong the attitude may say where down is, all the time."""
    slope_std: float = 0.015
    """How far the floor may be from level (or the attitude wrong all the time), as a tangent."""
    pixel_std: float = 0.1
    """Least error of a point's place, in pixels."""
    gap_s: float = 1.0
    """Time without a picture after which a new key frame starts, s."""
    coast_s: float = 5.0
    """Time over a surface that contradicts the height before the new height is adopted, s."""
    key_frame_s: float = 4.0
    """Longest life of a key frame while the vehicle moves."""
    is_climb_reported: bool = True
    """Whether vertical motion is reported, which rests on heights and attitude."""


class _Key(NamedTuple):
    """A key frame: how it was held, and its points."""

    held: BodyAttitude
    pixels: Array
    flat: Array
    relief_m: Array
    """Height of each point above the floor, m."""


class GroundOdometer:
    """Horizontal motion and turn over a floor, scaled by the height, relative to a key frame.

    The floor is a plane that may slope. Objects on it move differently in the picture; they are left out until their
    height is known. Steps of the height sensor over boxes are thus recognized, not followed.

    Args:
        camera: The camera.
        settings: Its settings.
    """

    def __init__(self, camera: CameraModel, settings: GroundSettings | None = None) -> None:
        settings = settings or GroundSettings()
        self._cv2 = load_opencv()
        self.camera: Final = camera
        self.settings: Final = settings
        self._tracks = GroundTracks(camera.width, camera.height)
        self._height = GroundHeight(settings.height_noise_m, settings.height_scale_std)
        focal_px = min(camera.focal_px)
        self._noise = PlaneNoise(settings.pixel_std / focal_px, _LARGEST_NOISE_PX / focal_px)
        self._frd_from_rdf = matrix(camera.frd_from_rdf)
        self._key: _Key | None = None
        self._slope: Array = np.zeros(2)
        self._slope_std = settings.slope_std
        self._velocity: Array = np.zeros(3)
        """Of the camera, in the key frame's level axes, m/s."""
        self._place: Array = np.zeros(3)
        """Of the camera, in the same, m."""
        self._last_s = self._moved_s = -math.inf
        self._last_picture: Picture | None = None
        self._lost = self._turned_back = 0

    def update(self, picture: Picture, t_s: float, ned_from_frd: Quaternion, height_m: float) -> Odometry:
        """Processes a picture.

        Args:
            picture: Grey values, (rows, columns), 8 bit.
            t_s: Its time of exposure.
            ned_from_frd: The attitude at that time; its heading may drift and have any offset.
            height_m: The height at that time, as defined by the settings; not-a-number if unknown.

        Returns:
            The motion since the key frame; invalid, with a reason, where it is unknown.
        """
        reason = self._problem(picture, t_s, ned_from_frd)
        if reason:
            return self._invalid(t_s, reason)
        period_s, self._last_s = min(t_s - self._last_s, self.settings.gap_s), t_s
        self._last_picture = picture = picture.copy() if picture.flags.writeable else picture
        held = BodyAttitude.of(t_s, ned_from_frd)
        silent_s = t_s - self._moved_s
        if self._key is None:
            return self._begin(picture, held, height_m, "the first picture")
        if silent_s > self.settings.gap_s:
            return self._begin(picture, held, height_m, f"no motion was seen for {silent_s:.1f} s")
        return self._move(self._key, picture, held, height_m, period_s)

    def without_picture(self, t_s: float, reason: str) -> Odometry:
        """The report for a time without a usable picture."""
        return self._invalid(t_s, reason)

    def _problem(self, picture: Picture, t_s: float, ned_from_frd: Quaternion) -> str:
        """Why a picture cannot be used at all; empty where it can."""
        reason = problem(picture, self.camera)
        if reason:
            return reason
        if not math.isfinite(t_s):
            return "the picture has no time"
        if not all(map(math.isfinite, ned_from_frd)) or abs(math.hypot(*ned_from_frd) - 1.0) > 0.01:
            return "there is no attitude"
        if t_s <= self._last_s:
            self._turned_back += 1
            if self._turned_back < _TURNED_BACK_AFTER:
                return "the picture is not newer than the last"
            self._last_s, self._key = -math.inf, None
        self._turned_back = 0
        if self._last_picture is not None and np.array_equal(picture, self._last_picture):
            self._last_s = t_s
            return "the picture is the last one again"
        return ""

    def _begin(self, picture: Picture, held: BodyAttitude, height_m: float, reason: str) -> Odometry:
        """Restarts at a picture with enough features and a known height."""
        vertical_m = self._vertical_m(height_m, held)
        silent_s = held.t_s - self._moved_s
        is_new = self._key is None or silent_s > self.settings.gap_s or self._height.is_lost(self.settings.coast_s)
        if is_new and not vertical_m > 0.0:
            return self._invalid(held.t_s, "there is no height")
        corners = self._tracks.begin(picture, np.zeros((0, 2)))
        if len(corners) < _LEAST_POINTS:
            self._key = None
            return self._invalid(held.t_s, f"only {len(corners)} points stand out in the picture")
        flat = self._flat(corners, held)
        if self._key is None or is_new:
            self._height.begin(vertical_m)
            relief_m = np.zeros(len(corners))
        else:
            relief_m = self._remembered(self._key, flat, held)
            self._height.rise(1.0, _CLIMB_M_S * silent_s / self._height.mean_m)
        self._slope, self._slope_std = np.zeros(2), self.settings.slope_std
        self._key = _Key(held, corners, flat, relief_m)
        self._velocity, self._place = np.zeros(3), np.zeros(3)
        self._moved_s, self._lost = held.t_s, 0
        return self._invalid(held.t_s, f"restarts: {reason}")

    def _remembered(self, key: _Key, flat: Array, held: BodyAttitude) -> Array:
        """Heights of new points above the floor, if only the vehicle has moved, as before."""
        ahead = (self._place + self._velocity * (held.t_s - self._moved_s)) / self._height.mean_m
        turn = _about_down(held.yaw_rad - key.held.yaw_rad)
        before = flat @ turn[:2, :2].T + ahead[:2]
        return _nearest(before, key.flat, key.relief_m)

    def _move(self, key: _Key, picture: Picture, held: BodyAttitude, height_m: float, period_s: float) -> Odometry:
        ahead_s = held.t_s - self._moved_s
        # Predict: constant velocity, the attitude's turn as prior, the relief as depth; then track the points.
        expected_m = self._place + self._velocity * ahead_s
        depth = 1.0 - key.relief_m / self._height.mean_m
        turn = _about_down(held.yaw_rad - key.held.yaw_rad)
        prior = Prior(turn, self._turn_std(), self._slope, self._slope_std)
        expected = self._pixels(key, depth, expected_m / self._height.mean_m, prior, held)
        pixels, is_found = self._tracks.follow(picture, key.pixels, expected, is_sure=ahead_s < 0.2)
        now = self._flat(pixels, held)
        is_found &= np.isfinite(now).all(axis=1) & np.isfinite(key.flat).all(axis=1)
        if is_found.sum() < _LEAST_POINTS:
            return self._lose(picture, held, height_m, f"only {is_found.sum()} points were found again")
        before, now, depth = key.flat[is_found], now[is_found], depth[is_found]
        motion = self._fit(before, now, depth, prior, expected_m / self._height.mean_m)
        reason = self._distrust(motion, expected_m, ahead_s)
        if reason:
            return self._lose(picture, held, height_m, reason)
        is_floor_hit = self._use_height(motion, before, now, height_m, held, period_s)
        if not is_floor_hit and self._height.is_lost(self.settings.coast_s):
            return self._begin(picture, held, height_m, "the height contradicts the pictures")
        # Scale: the translation is in heights of the key frame.
        place = motion.translation * self._height.mean_m
        self._velocity = (place - self._place) / ahead_s
        self._place, self._moved_s, self._lost = place, held.t_s, 0
        lever = np.array(self.camera.position_frd_m)
        moved = report(
            motion,
            self._height,
            key.held,
            held,
            lever,
            self.settings.level_std_rad,
            is_climb_reported=self.settings.is_climb_reported,
        )
        if self._is_worn(motion, len(key.pixels), held.t_s - key.held.t_s):
            self._renew(key, motion, picture, held, pixels[is_found], before, now, key.relief_m[is_found])
        return moved

    def _fit(self, before: Array, now: Array, depth: Array, prior: Prior, expected: Array) -> PlaneMotion:
        motion = ground_plane.fit(before, now, depth, prior, expected, self._noise)
        # Fit from the prediction; with too few inliers again from a RANSAC start, and the better one counts.
        if motion.is_inlier.mean() >= 0.7:
            return motion
        begun = ground_plane.start(self._cv2, before, now, depth, prior, 2.0 * self._noise.most)
        if begun is None:
            return motion
        other = ground_plane.fit(before, now, depth, prior, begun, self._noise)
        return other if other.is_inlier.sum() > motion.is_inlier.sum() else motion

    def _distrust(self, motion: PlaneMotion, expected_m: Array, ahead_s: float) -> str:
        """Why a motion is not believed; empty where it is."""
        count, share = int(motion.is_inlier.sum()), float(motion.is_inlier.mean())
        if not np.isfinite(motion.translation).all() or not np.isfinite(motion.covariance).all():
            return "the motion cannot be solved for"
        if count < _LEAST_POINTS or share < _LEAST_SHARE:
            return f"only {count} of {len(motion.is_inlier)} points move as the floor does"
        if motion.noise >= self._noise.most:
            return "the points move as no plane does that this camera could see"
        if not 0.3 < motion.height_ratio < 3.0:
            return "the height would have changed by more than three times"
        away_m = float(np.linalg.norm(motion.translation * self._height.mean_m - expected_m))
        if away_m > _MOST_M_S2 * ahead_s**2 + 0.05 * self._height.mean_m:
            return f"a jump of {away_m:.2f} m"
        return ""

    def _lose(self, picture: Picture, held: BodyAttitude, height_m: float, reason: str) -> Odometry:
        self._lost += 1
        if self._lost >= _LOST_AFTER:
            return self._begin(picture, held, height_m, reason)
        return self._invalid(held.t_s, reason)

    def _use_height(
        self, motion: PlaneMotion, before: Array, now: Array, height_m: float, held: BodyAttitude, period_s: float
    ) -> bool:
        """Whether the height is that of the floor, or of a known object on it."""
        vertical_m = self._vertical_m(height_m, held)
        if not math.isfinite(vertical_m):
            return False
        reliefs = [0.0]
        distance = np.linalg.norm(now, axis=1)
        nearest = int(distance.argmin())
        if distance[nearest] < _ECHO_FLAT:
            share, std, left = ground_plane.relief(before[nearest : nearest + 1], now[nearest : nearest + 1], motion)
            if std[0] < _SURE_SHARE and left[0] < ground_plane.INLIER * motion.noise:
                reliefs.append(float(1.0 - share[0]) * self._height.mean_m)
        return self._height.update(vertical_m, motion.height_ratio, tuple(reliefs), period_s)

    def _is_worn(self, motion: PlaneMotion, count: int, age_s: float) -> bool:
        """Whether a new key frame is due."""
        moved = float(np.linalg.norm(motion.translation[:2]))
        turned = abs(math.atan2(motion.turn[1, 0], motion.turn[0, 0]))
        left = int(motion.is_inlier.sum())
        return (
            moved > _FAR
            or turned > _TURNED_RAD
            or abs(motion.height_ratio - 1.0) > _SCALED
            or (left < max(_KEPT_SHARE * count, 2.0 * _LEAST_POINTS) and age_s > 0.2)
            or (age_s > self.settings.key_frame_s and moved > 0.02)
        )

    def _renew(
        self,
        key: _Key,
        motion: PlaneMotion,
        picture: Picture,
        held: BodyAttitude,
        pixels: Array,
        before: Array,
        now: Array,
        relief_m: Array,
    ) -> None:
        """Makes the picture the key frame, with the points of known position."""
        share, std, left = ground_plane.relief(before, now, motion)
        height_m = self._height.mean_m
        is_raised = ~motion.is_inlier & (std < _SURE_SHARE) & (left < ground_plane.INLIER * motion.noise)
        is_raised &= (share > 0.1) & (share < 2.0)
        relief_m = np.where(is_raised, (1.0 - share) * height_m, relief_m)
        kept = np.flatnonzero(motion.is_inlier | is_raised)
        corners = self._tracks.begin(picture, pixels[kept])
        flat = self._flat(corners, held)
        new_relief_m = _nearest(flat, now[kept], relief_m[kept])
        self._key = _Key(
            held,
            np.vstack((pixels[kept], corners)),
            np.vstack((now[kept], flat)),
            np.concatenate((relief_m[kept], new_relief_m)),
        )
        self._slope = motion.slope @ motion.turn[:2, :2]
        grown = math.sqrt(float(np.trace(motion.covariance[6:, 6:])) / 2.0 + _SLOPE_CHANGE**2)
        self._slope_std = min(grown, self.settings.slope_std)
        self._height.rise(motion.height_ratio, ratio_std(motion))
        self._velocity, self._place = self._velocity @ motion.turn, np.zeros(3)

    def _invalid(self, t_s: float, reason: str) -> Odometry:
        return no_motion(SOURCE, t_s if self._key is None else self._key.held.t_s, reason, is_level=True)

    def _vertical_m(self, height_m: float, held: BodyAttitude) -> float:
        """Vertical distance of the camera to the point hit by a range finder; not-a-number if unknown."""
        if not 0.0 < height_m < _HIGHEST_M:
            return math.nan
        level_from_frd = matrix(held.level_from_frd)
        beam = level_from_frd[:, 2] if self.settings.is_slant else np.array([0.0, 0.0, 1.0])
        lever = np.array(self.settings.sensor_frd_m) - np.array(self.camera.position_frd_m)
        hit = level_from_frd @ lever + height_m * beam
        return float(hit[2] - self._slope @ hit[:2])

    def _turn_std(self) -> Array:
        return np.array([self.settings.tilt_std_rad, self.settings.tilt_std_rad, self.settings.yaw_std_rad])

    def _flat(self, pixels: Array, held: BodyAttitude) -> Array:
        """Flat directions in level axes of pixels."""
        seen = unproject(self.camera, pixels)
        level = np.column_stack((seen, np.ones(len(seen)))) @ self._level_from_rdf(held).T
        return np.asarray(level[:, :2] / np.where(level[:, 2:] > 0.1, level[:, 2:], np.nan))

    def _pixels(self, key: _Key, depth: Array, translation: Array, prior: Prior, held: BodyAttitude) -> Array:
        """Where the points of the key frame are expected."""
        points = ground_plane.on_plane(key.flat, depth, prior.slope)
        flat = ground_plane.appear(points, translation, prior.turn)
        level = np.column_stack((flat, np.ones(len(flat))))
        pixels = project(self.camera, level @ self._level_from_rdf(held))
        return np.where(np.isfinite(pixels), pixels, key.pixels)

    def _level_from_rdf(self, held: BodyAttitude) -> Array:
        return matrix(held.level_from_frd) @ self._frd_from_rdf


def _nearest(places: Array, known: Array, values: Array) -> Array:
    """The value of the nearest known place, for each place."""
    distance = np.linalg.norm(places[:, None] - known[None], axis=2)
    return np.asarray(values[np.nan_to_num(distance, nan=np.inf).argmin(axis=1)])


def _about_down(angle_rad: float) -> Array:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
