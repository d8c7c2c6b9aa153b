"""FDM, feature detection and matching (paper §VI): points detected once, tracked, and matched left to right."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn, InertialTurn
from gloc3_onboard.algorithms.vision.corners import GridCorners, Pixels
from gloc3_onboard.algorithms.vision.lucas_kanade import PatchTracker
from gloc3_onboard.algorithms.vision.picture import LightEvener, Picture, problem
from gloc3_onboard.algorithms.vision.point_tracker import NO_PIXELS, Ids, PointTracker
from gloc3_onboard.algorithms.vision.pose_fit import vector_of
from gloc3_onboard.algorithms.vision.rigid_guess import RigidGuess, match_patches
from gloc3_onboard.algorithms.vision.stereo_match import StereoMatcher
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

_GAP_S: Final = 1.0
"""Time without a usable picture after which tracked points are dropped, s."""
TURNED_BACK_AFTER: Final = 5
"""Consecutive non-increasing times after which the clock counts as reset."""
_FEW: Final = 8
_TURNING_PX: Final = 2.0
"""By how much gyros must shift the points from where they were headed for, to be asked where these are, px."""
_MATCHED_SHARE: Final = 0.4
"""With less of the points matched that were matched before a pair of pictures is held to be a bad one, at first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatcherOptions:
    """Options of the feature matcher."""

    cell_px: int = 40
    """One point in each square of this side."""
    levels: int = 4
    """Pyramid levels searched for points that are not at their predicted position."""
    nearest_m: float = 0.4
    """Nearest that anything is expected to be."""
    keep_share: float = 0.7
    """With less of the points left, new ones are added."""
    may_repeat: bool = False
    """Whether two pictures may be the same to the last bit; else the second is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSet:
    """The points of one pair of pictures."""

    t_s: float
    ids: Ids
    """Growing numbers, (n,): the same for the same point from picture to picture."""
    pixels: Pixels
    """Column and row in the left picture, (n, 2)."""
    right_pixels: Pixels
    """The same in the right one, (n, 2); not-a-number for points without a match."""
    reason: str = ""
    """Why there are none; empty where all is well."""


class FeatureMatcher:
    """Tracks points from pair to pair and matches them between the two pictures.

    Args:
        rig: the calibrated pair.
        options: how it works.
        gyro: has the samples up to the pictures; None without an inertial unit.
    """

    def __init__(self, rig: StereoRig, options: MatcherOptions | None = None, gyro: GyroTurn | None = None) -> None:
        self._rig = rig
        self._gyro = gyro
        self._options = options or MatcherOptions()
        self._light = LightEvener()
        self._patches = PatchTracker()
        self._points = PointTracker(GridCorners(self._options.cell_px), self._patches, self._options.levels)
        self._stereo = StereoMatcher(rig, self._options.nearest_m, self._patches)
        self._guess = RigidGuess(rig)
        self._raw: tuple[Picture, Picture] | None = None
        self.reset()

    def reset(self) -> None:
        """Drops all points: later ones have nothing in common with them."""
        self._points.reset()
        self._guess.reset()
        self._offset_ids: Ids = self._points.ids
        self._offset_px: Pixels = NO_PIXELS
        self._t_s = -np.inf
        self._rate_rad_s = np.zeros(3)
        self._is_poor = False
        self._turned_back = 0

    def update(self, left: Picture, right: Picture, t_s: float) -> FeatureSet:
        """The points of a pair of pictures taken at one time.

        Args:
            left: grey values, of the size that the calibration says.
            right: the same of the right camera.
            t_s: when; must grow.
        """
        reason = self._problem(left, right, t_s)
        if reason:
            return _nothing(t_s, reason)
        if t_s - self._t_s > _GAP_S:
            self.reset()
        # Track from the anchor picture, then match along the epipolar lines (each in its own module).
        left, right = self._light.even(left), self._light.even(right)
        points = self._points
        turn = None if self._gyro is None else self._gyro.turn(self._t_s, t_s)
        if points.has_anchor:
            reason = points.follow(left, t_s - self._t_s, _Guide(self._guess, t_s, self._sudden(turn, t_s)))
            if reason:
                return _nothing(t_s, reason)
        offsets = self._known_offsets()
        guess = points.pixels + offsets * points.zoom[:, None]
        right_px = self._stereo.match(left, points.pixels, points.contrast, right, guess)
        is_matched = np.isfinite(right_px[:, 0])
        # A bad pair: what was matched before is not any more; the tracks go back to the pair before.
        if points.has_anchor and is_matched.sum() < _MATCHED_SHARE * np.isfinite(offsets[:, 0]).sum():
            reason = points.undo(self._stereo.problem() or "the right picture does not show what the left one does")
            if reason:
                return _nothing(t_s, reason)
            right_px = NO_PIXELS
        points.accept()
        # Few points are left: this picture is the new anchor, with new corners in empty cells.
        is_due = not points.has_anchor or self._is_poor or points.is_surprised
        if is_due or len(points.ids) < self._options.keep_share * points.anchored:
            right_px = self._anchor(left, right, right_px)
        self._offset_ids, self._offset_px = points.ids, right_px - points.pixels
        self._guess.learn(t_s, points.ids, points.pixels, right_px)
        self._rate_rad_s = np.zeros(3) if turn is None else vector_of(turn.rotation) / (t_s - self._t_s)
        self._t_s = t_s
        self._is_poor = int(np.isfinite(right_px[:, 0]).sum()) < _FEW
        if self._is_poor:
            return _nothing(t_s, self._stereo.problem() or "too little to see that both pictures show")
        return FeatureSet(t_s=t_s, ids=points.ids, pixels=points.pixels, right_pixels=right_px)

    def _sudden(self, turn: InertialTurn | None, t_s: float) -> InertialTurn | None:
        """The turn if it is another than that of the last step, so that the points are elsewhere than they headed for."""
        if turn is None:
            return None
        change = vector_of(turn.rotation) - self._rate_rad_s * (t_s - self._t_s)
        return turn if float(np.linalg.norm(change)) * self._rig.focal_px > _TURNING_PX else None

    def _problem(self, left: Picture, right: Picture, t_s: float) -> str:
        if not np.isfinite(t_s):
            return "the time is not a number"
        if t_s <= self._t_s:
            self._turned_back += 1
            if self._turned_back < TURNED_BACK_AFTER:
                return "the time does not grow"
            self.reset()
        self._turned_back = 0
        for name, picture, camera in (("left", left, self._rig.left), ("right", right, self._rig.right)):
            found = problem(picture, camera)
            if found:
                return f"{name}: {found}"
        before, self._raw = self._raw, (left, right)
        if before is not None and not self._options.may_repeat:
            for name, previous, new in (("left", before[0], left), ("right", before[1], right)):
                if np.array_equal(previous, new):
                    return f"{name}: the same picture again"
        return ""

    def _known_offsets(self) -> Pixels:
        """From the left to the right place of each point, as it last was; not-a-number where that is not known."""
        ids = self._points.ids
        if len(ids) == 0 or len(self._offset_ids) == 0:
            return np.full((len(ids), 2), np.nan, np.float32)
        at = np.searchsorted(self._offset_ids, ids).clip(max=len(self._offset_ids) - 1)
        return np.where((self._offset_ids[at] == ids)[:, None], self._offset_px[at], np.float32(np.nan))

    def _anchor(self, left: Picture, right: Picture, right_px: Pixels) -> Pixels:
        """Takes this picture as the anchor, keeps the points that both pictures show, and adds others."""
        is_kept = np.isfinite(right_px[:, 0])
        self._points.select(is_kept)
        new_px = self._points.candidates(left)
        contrast = self._patches.contrast(left, new_px)
        new_right = self._stereo.match(left, new_px, contrast, right, self._stereo.search(left, new_px, right))
        is_new = np.isfinite(new_right[:, 0])
        self._points.anchor(left, new_px[is_new])
        return np.concatenate([right_px[is_kept], new_right[is_new]])


class _Guide:
    """Where the points of the last pair may be in a picture."""

    def __init__(self, guess: RigidGuess, t_s: float, sudden: InertialTurn | None) -> None:
        self._guess, self._t_s, self._sudden = guess, t_s, sudden

    @property
    def is_turning(self) -> bool:
        """Whether gyros tell that the points do not go on as before."""
        return self._sudden is not None

    def expected(self) -> tuple[Pixels, Pixels] | None:
        """By the motion so far, with the turn that gyros tell."""
        motion = self._guess.ahead(self._t_s, self._sudden)
        return None if motion is None else self._guess.places(motion)

    def searched(self, picture: Picture, anchor: Picture, anchor_px: Pixels) -> tuple[Pixels, Pixels] | None:
        """By a search in all of the picture for what the anchor shows at the points."""
        which, pixels = match_patches(anchor, anchor_px, picture)
        motion = self._guess.by_matches(which, pixels)
        return None if motion is None else self._guess.places(motion)


def _nothing(t_s: float, reason: str) -> FeatureSet:
    return FeatureSet(t_s=t_s, ids=np.zeros(0, np.int32), pixels=NO_PIXELS, right_pixels=NO_PIXELS, reason=reason)
