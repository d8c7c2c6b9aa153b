"""Point tracking from picture to picture of one camera, with lasting ids."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3_onboard.algorithms.vision.corners import GridCorners, Pixels
from gloc3_onboard.algorithms.vision.lucas_kanade import PatchTracker
from gloc3_onboard.algorithms.vision.picture import Picture

Ids = NDArray[np.int32]

NO_PIXELS: Final[Pixels] = np.zeros((0, 2), np.float32)

_FEW: Final = 8
_MOST_MISSES: Final = 3
"""Consecutive bad pictures after which new points are found."""
_BACK_MAX_PX: Final = 1.0
"""Largest distance from its start of a point tracked forth and back, px."""
_NEAR_LEVELS: Final = 1
_NEAR_SHARE: Final = 0.7
"""Share of points found at their predicted position below which the search is widened."""


class PointTracker:
    """Tracks points from an anchor picture.

    Patches come from one picture, the anchor, as long as enough are visible, so that errors do not accumulate from
    picture to picture.

    Args:
        corners: finds points.
        patches: tracks them.
        levels: pyramid levels searched for points that are not at their predicted position.
        least_share: share of tracked points below which a picture counts as bad at first.
    """

    def __init__(self, corners: GridCorners, patches: PatchTracker, levels: int, least_share: float = 0.5) -> None:
        self._least_share = least_share
        self._corners = corners
        self._patches = patches
        self._levels = levels
        self._next_id = 0
        self.reset()

    def reset(self) -> None:
        """Drops all points: later ones have nothing in common with them."""
        self.ids: Ids = np.zeros(0, np.int32)
        """Growing numbers, (n,)."""
        self.pixels: Pixels = NO_PIXELS
        """Where the points are, (n, 2)."""
        self.anchored = 0
        """Points that the anchor had."""
        self.contrast: Pixels = NO_PIXELS[:, 0]
        """Of the patches around the points, (n,)."""
        self._anchor: Picture | None = None
        self._anchor_px: Pixels = NO_PIXELS
        self._speed_px_s: Pixels = NO_PIXELS
        self._bad = 0
        self._before = (self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s)

    @property
    def has_anchor(self) -> bool:
        """Whether there is a picture to track from."""
        return self._anchor is not None

    def follow(self, picture: Picture, after_s: float) -> str:
        """Tracks the points into a picture taken some time after the last one; returns why it could not.

        After some pictures in a row in which they are not found, there is no anchor any more, and no complaint.
        """
        assert self._anchor is not None
        headed_for = (self.pixels + self._speed_px_s * np.float32(after_s)).astype(np.float32)
        start, contrast = self._anchor_px, self.contrast
        found, is_good = self._patches.find(self._anchor, start, contrast, picture, headed_for, _NEAR_LEVELS)
        if is_good.sum() < _NEAR_SHARE * len(found):
            found, is_good = self._search_wide(picture)
        count = int(is_good.sum())
        if count < max(_FEW, self._least_share * len(found)):
            return self._report_fault(f"only {count} of {len(found)} points are seen again")
        self._before = (self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s)
        self._speed_px_s = ((found - self.pixels) / np.float32(after_s)).astype(np.float32)
        self.pixels = found
        self.select(is_good)
        return ""

    def undo(self, reason: str) -> str:
        """Undoes the last `follow`, as the picture proved to be a bad one; returns why, as that does."""
        self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s = self._before
        return self._report_fault(reason)

    def accept(self) -> None:
        """Accepts the last picture as a good one."""
        self._bad = 0

    def _report_fault(self, reason: str) -> str:
        self._bad += 1
        if self._bad < _MOST_MISSES:
            return reason
        self.reset()
        return ""

    def _search_wide(self, picture: Picture) -> tuple[Pixels, NDArray[np.bool_]]:
        """Finds points that are not at their predicted position, forth and back, because distant patches look alike."""
        assert self._anchor is not None
        start, contrast, find = self._anchor_px, self.contrast, self._patches.find
        found, is_good = find(self._anchor, start, contrast, picture, self.pixels, self._levels)
        # Forward-backward error (Kalal, Mikolajczyk, Matas, ICPR 2010).
        back, is_back = find(picture, found, contrast, self._anchor, start - self.pixels + found, self._levels)
        return found, is_good & is_back & (np.abs(back - start).max(axis=1, initial=0.0) < _BACK_MAX_PX)

    def select(self, which: NDArray[np.bool_]) -> None:
        """Drops all other points."""
        self.ids, self.pixels, self._anchor_px = self.ids[which], self.pixels[which], self._anchor_px[which]
        self.contrast, self._speed_px_s = self.contrast[which], self._speed_px_s[which]

    def candidates(self, picture: Picture) -> Pixels:
        """Points that could be added, (m, 2)."""
        return self._corners.find(picture, self.pixels)

    def anchor(self, picture: Picture, added: Pixels) -> None:
        """Makes this picture the anchor, in which the points are now, and adds others."""
        ids = np.arange(self._next_id, self._next_id + len(added), dtype=np.int32)
        self._next_id += len(added)
        drift = np.median(self._speed_px_s, axis=0) if len(self._speed_px_s) else np.zeros(2, np.float32)
        self._speed_px_s = np.concatenate([self._speed_px_s, np.tile(drift, (len(added), 1))]).astype(np.float32)
        self.ids = np.concatenate([self.ids, ids])
        self.pixels = np.concatenate([self.pixels, added]).astype(np.float32)
        self.contrast = self._patches.contrast(picture, self.pixels)
        self._anchor, self._anchor_px, self.anchored = picture, self.pixels, len(self.ids)
