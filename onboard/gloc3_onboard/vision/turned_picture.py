"""A picture laid over a later one: moved, turned and scaled as its points have been, so that patches of both look alike.

A patch that is only shifted (Lucas and Kanade) is found beside its place when the picture turns or grows, by as much as
what is seen of it lies off its middle: some tenths of a pixel for a turn of five degrees.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.opencv import load_opencv
from gloc3_onboard.vision.corners import Pixels
from gloc3_onboard.vision.picture import Picture

_FEW: Final = 8
_APART: Final = 0.03
"""A turn (in radians) or a growth, as a share, from which on patches are too unlike."""
_GROWTH_MAX: Final = 2.0


class TurnedPicture:
    """A picture as it would look now.

    Args:
        picture: as it was taken.
    """

    def __init__(self, picture: Picture) -> None:
        self._taken = picture
        self._factor, self._shift = 1.0 + 0.0j, 0.0j
        self.picture = picture
        """The picture, turned."""

    def places(self, points: Pixels) -> Pixels:
        """Where points of the picture as it was taken are in the turned one, (n, 2)."""
        if self._factor == 1.0 and self._shift == 0.0:
            return points
        moved = self._factor * _complex(points) + self._shift
        return np.column_stack([moved.real, moved.imag]).astype(np.float32)

    def turn(self, points: Pixels, found: Pixels) -> bool:
        """Lays it over a picture in which its points were found; whether it has turned or grown so much that it had to.

        Args:
            points: in the picture as it was taken, (n, 2).
            found: the same in the other one, (n, 2).
        """
        if len(points) < _FEW:
            return False
        before, after = _complex(points), _complex(found)
        middle, place = before.mean(), after.mean()
        before, after = before - middle, after - place
        spread = float((before.conj() * before).real.sum())
        factor = complex((before.conj() * after).sum() / spread) if spread > 0.0 else 0.0j
        if not 1.0 / _GROWTH_MAX < abs(factor) < _GROWTH_MAX or abs(factor / self._factor - 1.0) < _APART:
            return False
        shift = complex(place - factor * middle)
        cv2 = load_opencv()
        height, width = self._taken.shape
        matrix = np.array([[factor.real, -factor.imag, shift.real], [factor.imag, factor.real, shift.imag]], np.float64)
        self._factor, self._shift = factor, shift
        self.picture = cv2.warpAffine(self._taken, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
        return True


def _complex(points: Pixels) -> NDArray[np.complex128]:
    return points[:, 0].astype(np.float64) + 1j * points[:, 1].astype(np.float64)
