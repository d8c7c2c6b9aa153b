"""Point tracking from picture to picture of one camera, with lasting ids."""

from dataclasses import dataclass
from typing import Final, Protocol

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
_SURPRISE_PX: Final = 2.0
_SURPRISED_SHARE: Final = 0.8
"""With less than this share of points so near to where they were headed for, they do not move evenly."""


class PointGuide(Protocol):
    """Tells where the points may be. Each answer is the places (n, 2) and the sizes they appear in (n,), or None."""

    @property
    def is_turning(self) -> bool:
        """Whether the points are known not to go on as before."""

    def expected(self) -> tuple[Pixels, Pixels] | None:
        """By the motion so far."""

    def searched(self, picture: Picture, anchor: Picture, anchor_px: Pixels) -> tuple[Pixels, Pixels] | None:
        """By a search in all of the picture for what the anchor shows at the points."""


@dataclass(frozen=True, slots=True)
class _Found:
    """Where the points were found."""

    found: Pixels
    is_good: NDArray[np.bool_]
    zoom: Pixels
    inside: int
    """How many of them can be in the picture."""

    @property
    def share(self) -> float:
        """Share of those that can be in the picture."""
        return float(self.is_good.sum()) / max(1, self.inside)


def _count(found: _Found) -> int:
    return int(found.is_good.sum())


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
        self.zoom: Pixels = self.contrast
        """How much larger than in the anchor they were expected to look, (n,)."""
        self.is_surprised = True
        """Whether the points did not go on as before."""
        self._anchor: Picture | None = None
        self._anchor_px: Pixels = NO_PIXELS
        self._speed_px_s: Pixels = NO_PIXELS
        self._bad = 0
        self._before = (self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s, self.zoom)

    @property
    def has_anchor(self) -> bool:
        """Whether there is a picture to track from."""
        return self._anchor is not None

    def follow(self, picture: Picture, after_s: float, guide: PointGuide | None = None) -> str:
        """Tracks the points into a picture taken some time after the last one; returns why it could not.

        After some pictures in a row in which they are not found, there is no anchor any more, and no complaint.

        Args:
            picture: the picture.
            after_s: time since the last one.
            guide: where the points may be if they do not go on as they did.
        """
        assert self._anchor is not None
        by_speed = (self.pixels + self._speed_px_s * np.float32(after_s)).astype(np.float32)
        one = np.ones(len(by_speed), np.float32)
        tried = guide.expected() if guide is not None and (self.is_surprised or guide.is_turning) else None
        best = self._find(picture, *(tried or (by_speed, one)))
        if best.share < _NEAR_SHARE:
            found, is_good = self._search_wide(picture)
            best = max(best, _Found(found, is_good, one, len(one)), key=_count)
        if best.share < _NEAR_SHARE and guide is not None:
            tried = guide.searched(picture, self._anchor, self._anchor_px)
            best = best if tried is None else max(best, self._find(picture, *tried), key=_count)
        count = _count(best)
        if count < _FEW or best.share < self._least_share:
            return self._report_fault(f"only {count} of {len(best.found)} points are seen again")
        off_px = np.abs(best.found - by_speed)[best.is_good].max(axis=1)
        self.is_surprised = float(np.quantile(off_px, _SURPRISED_SHARE)) > _SURPRISE_PX
        self._before = (self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s, self.zoom)
        self._speed_px_s = ((best.found - self.pixels) / np.float32(after_s)).astype(np.float32)
        self.pixels, self.zoom = best.found, best.zoom
        self.select(best.is_good)
        return ""

    def _find(self, picture: Picture, guess: Pixels, zoom: Pixels) -> "_Found":
        """Looks for the points near a guess."""
        assert self._anchor is not None
        start, contrast, patches = self._anchor_px, self.contrast, self._patches
        if (zoom == 1.0).all():
            found, is_good = patches.find(self._anchor, start, contrast, picture, guess, _NEAR_LEVELS)
        else:
            found, is_good = patches.find_zoomed(self._anchor, start, contrast, picture, guess, _NEAR_LEVELS, zoom)
        height, width = picture.shape
        is_inside = (guess >= 0.0).all(axis=1) & (guess[:, 0] < width) & (guess[:, 1] < height)
        return _Found(found, is_good, zoom, int(is_inside.sum()))

    def undo(self, reason: str) -> str:
        """Undoes the last `follow`, as the picture proved to be a bad one; returns why, as that does."""
        self.ids, self.pixels, self.contrast, self._anchor_px, self._speed_px_s, self.zoom = self._before
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
        self.zoom = self.zoom[which]

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
        self.zoom = np.ones(len(self.ids), np.float32)
        self._anchor, self._anchor_px, self.anchored = picture, self.pixels, len(self.ids)
