"""Position of a vehicle from an external camera that sees its bright lamp."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, unproject
from gloc3.camera.model import CameraModel, misfit
from gloc3.camera.opencv import load_opencv
from gloc3.messages.frames import IDENTITY, Quaternion, Vector3
from gloc3.messages.perception import UNKNOWN_VARIANCE, PositionFix

Picture = NDArray[np.uint8]

_RIM_PX: Final = 4
"""Border around a spot that contributes to its centre, px: its flank carries more information than its saturated
middle."""
_MOST_SPOTS: Final = 32
"""Number of largest patches examined; noise makes thousands."""
_MOST: Final = 8
"""Number of brightest spots examined individually."""
Array = NDArray[np.float64]

_FULL_WEIGHT: Final = 2000.0
"""Sum of grey values at which a lamp has full weight."""
_OF_LENGTH: Final = 0.3
"""Additional uncertainty per pixel of an elongated spot's length."""
_TURNED_BACK_AFTER: Final = 5


class Spot(NamedTuple):
    """One bright spot."""

    column: float
    row: float
    area_px: int
    """Pixels above the threshold."""
    longer_px: int
    """By how much one side is longer than the other: blurred by motion, or two lamps in one."""
    weight: float
    """Sum of the grey values above the background."""


class SpotFinder:
    """Finds spots brighter than their surroundings and neither tiny nor large.

    Args:
        threshold_grey: Least grey value of a spot's pixels.
        most_area_px: Largest area of a lamp.
    """

    def __init__(self, threshold_grey: int, most_area_px: int) -> None:
        self._cv2 = load_opencv()
        self._threshold_grey, self._most_area_px = threshold_grey, most_area_px

    def find(self, picture: Picture) -> list[Spot]:
        """The spots of a picture (rows, columns), the brightest first."""
        mask = self._cv2.compare(picture, self._threshold_grey, self._cv2.CMP_GE)
        left, top, width, height = self._cv2.boundingRect(mask)
        if width == 0:
            return []
        # Only where anything is bright: looking for what hangs together costs much more than all the rest.
        bright = mask[top : top + height, left : left + width]
        _, _, stats, _ = self._cv2.connectedComponentsWithStats(bright, connectivity=8)
        stats += (left, top, 0, 0, 0)
        areas = stats[1:, self._cv2.CC_STAT_AREA]
        largest = 1 + np.argsort(-areas, kind="stable")[:_MOST_SPOTS]
        found = [self._spot(picture, row) for row in stats[largest]]
        spots = sorted((spot for spot in found if spot is not None), key=lambda spot: -spot.weight)
        return spots[:_MOST]

    def _spot(self, picture: Picture, stats: NDArray[np.int32]) -> Spot | None:
        left, top, width, height, area = (int(value) for value in stats)
        rows, columns = picture.shape
        is_whole = left > 0 and top > 0 and left + width < columns and top + height < rows
        if not is_whole or area > self._most_area_px or max(width, height) > 4 * min(width, height):
            return None
        # Background: median of the border; its spread: 1.48 times the median absolute deviation, as for normal noise.
        x0, y0 = max(0, left - _RIM_PX), max(0, top - _RIM_PX)
        cut = picture[y0 : top + height + _RIM_PX, x0 : left + width + _RIM_PX].astype(float)
        border = np.concatenate((cut[0], cut[-1], cut[:, 0], cut[:, -1]))
        background = float(np.median(border))
        spread = 1.48 * float(np.median(np.abs(border - background)))
        # Centre: first moments of the grey values above four spreads.
        above = np.maximum(cut - background - 4.0 * max(2.0, spread), 0.0)
        weight = float(above.sum())
        if weight <= 0.0:
            return None
        column = float(above.sum(axis=0) @ np.arange(cut.shape[1])) / weight + x0
        row = float(above.sum(axis=1) @ np.arange(cut.shape[0])) / weight + y0
        return Spot(column, row, area, abs(width - height), weight)


class FollowerSettings(NamedTuple):
    """Pose of the camera, and properties of the lamp."""

    position_ned_m: Vector3 = (0.0, 0.0, 0.0)
    """Origin of the stand."""
    ned_from_frd: Quaternion = IDENTITY
    """Attitude of the stand; the camera's mount on it is in its model."""
    lever_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the lamp on the vehicle's body."""
    threshold_grey: int = 200
    """The lamp is at least so bright in the picture."""
    most_area_px: int = 1500
    """And no larger than this."""
    spot_std_px: float = 0.3
    """How well its centre is found."""
    pointing_std_rad: float = 0.0005
    """Standard deviation of the camera's direction, rad."""
    range_m: float = 10.0
    """Typical distance of the vehicle, m; it matters only where the height does not constrain it."""
    range_std_m: float = 10.0
    is_range_reported: bool = True
    """Whether the lamp is located along the line of sight, by its height; otherwise only the direction is reported."""
    most_m_s2: float = 6.0
    """How fast the vehicle's motion may change."""


class OpticalFollower:
    """Tracks the lamp and reports its position, with its uncertainty along the line of sight.

    One camera measures a direction. The lamp's height, if given, constrains it; the remaining uncertainty along the ray
    is in the covariance. Two lights that may both be the lamp yield no position.

    Args:
        camera: The external camera.
        settings: Its position, and data of the lamp.
    """

    def __init__(self, camera: CameraModel, settings: FollowerSettings | None = None) -> None:
        self.camera: Final = camera
        self.settings: Final = settings or FollowerSettings()
        self._finder = SpotFinder(self.settings.threshold_grey, self.settings.most_area_px)
        self._track = SpotTrack()
        stand = matrix(self.settings.ned_from_frd)
        self._ned_from_rdf = stand @ matrix(camera.frd_from_rdf)
        self._eye = np.array(self.settings.position_ned_m) + stand @ np.array(camera.position_frd_m)
        self._range_m = self.settings.range_m
        self._last_s = -math.inf
        self._last_picture: Picture | None = None
        self._turned_back = 0

    def update(self, picture: Picture, t_s: float, down_m: float = math.nan, down_std_m: float = 0.1) -> PositionFix:
        """Processes a picture.

        Args:
            picture: Grey values, (rows, columns), 8 bit.
            t_s: Its time of exposure.
            down_m: How far the lamp is below the origin of the platform's frame; not-a-number where it is not known.
            down_std_m: How well that is known.

        Returns:
            The place of the lamp; invalid, with a reason, where it is not seen or could be either of two lights.
        """
        reason = self._problem(picture, t_s)
        if reason:
            return self._nowhere(reason)
        self._last_s = t_s
        self._last_picture = picture.copy() if picture.flags.writeable else picture
        spots = self._finder.find(picture)
        most_px_s2 = self.settings.most_m_s2 * max(self.camera.focal_px) / max(self._range_m, 0.5)
        silent_s = self._track.silent_s(t_s)
        spot, reason = self._track.update(spots, t_s, most_px_s2)
        if spot is None:
            is_long = math.isfinite(silent_s) and silent_s > 0.5
            return self._nowhere(f"{reason} (lost for {silent_s:.1f} s)" if is_long else reason)
        return self._place(spot, down_m, down_std_m)

    def without_picture(self, reason: str) -> PositionFix:
        """The report without a usable picture."""
        return self._nowhere(reason)

    def _problem(self, picture: Picture, t_s: float) -> str:
        """Why a picture cannot be used at all; empty where it can."""
        if picture.ndim != 2 or picture.dtype != np.uint8:
            return "not a picture of grey bytes"
        reason = misfit(self.camera, picture.shape[1], picture.shape[0])
        if reason:
            return reason
        if not math.isfinite(t_s):
            return "the picture has no time"
        if t_s <= self._last_s:
            self._turned_back += 1
            if self._turned_back < _TURNED_BACK_AFTER:
                return "the picture is not newer than the last"
            self._last_s = -math.inf
            self._track = SpotTrack()
        self._turned_back = 0
        if self._last_picture is not None and np.array_equal(picture, self._last_picture):
            return "the picture is the last one again"
        return ""

    def _place(self, spot: Spot, down_m: float, down_std_m: float) -> PositionFix:
        flat = unproject(self.camera, np.array([[spot.column, spot.row]]))[0]
        if not np.isfinite(flat).all():
            return self._nowhere("the lens cannot show a light there")
        # Line of sight: r = R (x, y, 1) / |(x, y, 1)|, (x, y) undistorted (Hartley and Zisserman 2004, 6.1).
        ray = self._ned_from_rdf @ np.array([flat[0], flat[1], 1.0])
        ray = ray / np.linalg.norm(ray)
        range_m, range_std_m = self._range(float(ray[2]), down_m, down_std_m)
        if not range_m > 0.0:
            return self._nowhere("the height places the light behind the camera")
        self._range_m = range_m
        # Place: eye + range r; across the ray, range times the angles of spot and stand, which are independent.
        spot_std_px = self.settings.spot_std_px + _OF_LENGTH * max(0, spot.longer_px - 1)
        across_m = range_m * math.hypot(spot_std_px / min(self.camera.focal_px), self.settings.pointing_std_rad)
        along_m2 = range_std_m**2 if self.settings.is_range_reported else UNKNOWN_VARIANCE
        # C = across^2 (I - r r^T) + along^2 r r^T, r the line of sight.
        covariance = across_m**2 * np.eye(3) + (along_m2 - across_m**2) * np.outer(ray, ray)
        if along_m2 < across_m**2:
            covariance = across_m**2 * np.eye(3)
        place = self._eye + range_m * ray
        return PositionFix(
            source="tracker",
            position_ned_m=(float(place[0]), float(place[1]), float(place[2])),
            covariance=covariance.reshape(-1).tolist(),
            lever_frd_m=self.settings.lever_frd_m,
            quality=min(1.0, spot.weight / _FULL_WEIGHT),
        )

    def _range(self, slope: float, down_m: float, down_std_m: float) -> tuple[float, float]:
        """Distance along the ray and its standard deviation: from the height, where the ray is steep enough."""
        usual = self.settings.range_std_m**-2
        if not (math.isfinite(down_m) and math.isfinite(down_std_m)) or down_std_m <= 0.0:
            return self.settings.range_m, self.settings.range_std_m
        # Mean by information of the usual range and of the range (down - eye) / slope, deviation std / |slope|.
        reported = (slope / down_std_m) ** 2
        mean_m = (usual * self.settings.range_m + slope * (down_m - float(self._eye[2])) / down_std_m**2) / (
            usual + reported
        )
        return mean_m, 1.0 / math.sqrt(usual + reported)

    def _nowhere(self, reason: str) -> PositionFix:
        return PositionFix(
            source="tracker",
            position_ned_m=(0.0, 0.0, 0.0),
            covariance=(np.eye(3) * UNKNOWN_VARIANCE).reshape(-1).tolist(),
            lever_frd_m=self.settings.lever_frd_m,
            is_valid=False,
            reason=reason,
            quality=0.0,
        )


CONFIRMED_AFTER: Final = 3
"""Pictures in a row with one spot that moves steadily, until it is the lamp."""
SUSPECT_AFTER_S: Final = 0.5
"""Time out of sight after which a candidate must be seen for as long to count, s."""
FORGOTTEN_AFTER_S: Final = 2.0
"""Time out of sight after which the prediction is dropped, s."""
_LOOSE_PX: Final = 10.0
"""Allowance for noise and a shaking stand, px."""
_VELOCITY_GAIN: Final = 0.4


class SpotTrack:
    """Tracks one spot; where a second one is near, it chooses neither."""

    def __init__(self) -> None:
        self._place: tuple[float, float] | None = None
        self._velocity = (0.0, 0.0)
        self._seen_s = -math.inf
        self._count = 0

    @property
    def is_confirmed(self) -> bool:
        """Whether the spot has been seen often enough."""
        return self._count >= CONFIRMED_AFTER

    def silent_s(self, t_s: float) -> float:
        """Time since it was last seen."""
        return t_s - self._seen_s

    def reset(self) -> None:
        """Drops the track."""
        self._place, self._count, self._velocity = None, 0, (0.0, 0.0)

    def update(self, spots: list[Spot], t_s: float, most_px_s2: float) -> tuple[Spot | None, str]:
        """Finds the lamp among the spots of a new picture.

        Args:
            spots: What there is.
            t_s: When.
            most_px_s2: How fast the lamp's motion in the picture may change.

        Returns:
            The lamp, or None and why not.
        """
        ahead_s = t_s - self._seen_s
        if self._place is not None and ahead_s > FORGOTTEN_AFTER_S:
            self.reset()
        if self._place is None:
            return self._first(spots, t_s)
        x, y = (self._place[i] + self._velocity[i] * ahead_s for i in (0, 1))
        # Predict at constant velocity; gate: as far as the acceleration allows, a t^2 / 2.
        reach_px = _LOOSE_PX + 0.5 * most_px_s2 * ahead_s**2 + (0.0 if self._count > 1 else most_px_s2 * ahead_s)
        near = [spot for spot in spots if math.hypot(spot.column - x, spot.row - y) <= reach_px]
        if len(near) > 1:
            return None, "two lights"
        if not near:
            if not self.is_confirmed:
                self.reset()
            return None, "a light, but not where the vehicle's could be" if spots else "no light in sight"
        if ahead_s > SUSPECT_AFTER_S and self.is_confirmed:
            self.reset()
            return self._first(near, t_s)
        self._follow(near[0], ahead_s, t_s)
        return (near[0], "") if self.is_confirmed else (None, "a light appears")

    def _first(self, spots: list[Spot], t_s: float) -> tuple[None, str]:
        if len(spots) != 1:
            return None, "two lights" if spots else "no light in sight"
        self._place, self._seen_s, self._count = (spots[0].column, spots[0].row), t_s, 1
        return None, "a light appears"

    def _follow(self, spot: Spot, ahead_s: float, t_s: float) -> None:
        previous, place = self._place or (spot.column, spot.row), (spot.column, spot.row)
        # Alpha-beta filter with alpha = 1: v <- v + beta (dx / dt - v) (Bar-Shalom, Li, Kirubarajan 2001, 6.5).
        gain = 1.0 if self._count == 1 else _VELOCITY_GAIN
        vx, vy = ((place[i] - previous[i]) / ahead_s for i in (0, 1))
        self._velocity = (
            self._velocity[0] + gain * (vx - self._velocity[0]),
            self._velocity[1] + gain * (vy - self._velocity[1]),
        )
        self._place, self._seen_s, self._count = place, t_s, self._count + 1
