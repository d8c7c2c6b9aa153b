"""Height of a camera above the floor: echoes of a range finder, filtered with the height changes seen."""

import math
from typing import Final

_GATE: Final = 4.0
_GATE_SHARE: Final = 0.04
"""Difference of an echo from the height, as a share, above which it does not come from the floor."""

_LOST_SHARE: Final = 0.1
"""A height that is known less well than to this share of it is none."""


class GroundHeight:
    """A scalar Kalman filter of the vertical distance to the floor under the odometer.

    Args:
        noise_m: Standard deviation of a single echo.
        scale_std: Standard deviation of the common scale error of all echoes; it does not average out.
    """

    def __init__(self, noise_m: float, scale_std: float) -> None:
        self._noise_m, self._scale_std = noise_m, scale_std
        self._mean_m, self._variance = math.nan, math.inf
        self._fitting_s = self._denied_s = 0.0

    @property
    def is_known(self) -> bool:
        """Whether there has been an echo."""
        return math.isfinite(self._mean_m)

    @property
    def mean_m(self) -> float:
        """The height."""
        return self._mean_m

    @property
    def std_m(self) -> float:
        """How well it is known, the error that all echoes share included."""
        return math.hypot(math.sqrt(self._variance), self._scale_std * self._mean_m)

    def begin(self, height_m: float) -> None:
        """Starts from one echo, whatever was before."""
        self._mean_m, self._variance = height_m, self._noise_m**2
        self._fitting_s = self._denied_s = 0.0

    def is_lost(self, coast_s: float) -> bool:
        """Whether echoes have contradicted the height for `coast_s`, or longer than they confirmed it.

        Without echoes its accuracy is that of the change measured in pictures, until that no longer suffices.
        """
        is_denied = self._denied_s > coast_s or self._denied_s > self._fitting_s
        return is_denied or math.sqrt(self._variance) > _LOST_SHARE * self._mean_m

    def reset(self) -> None:
        """Makes the height unknown."""
        self._mean_m, self._variance = math.nan, math.inf

    def rise(self, ratio: float, ratio_std: float, floor_shift_m: float = 0.0) -> None:
        """Predicts the height at another place: its height in heights here, and how far its floor lies below."""
        # Predict: h <- r h + s, P <- r^2 P + (sigma_r h)^2.
        self._variance = ratio**2 * self._variance + (ratio_std * self._mean_m) ** 2
        self._mean_m = ratio * self._mean_m + floor_shift_m

    def update(self, height_m: float, ratio: float, reliefs_m: tuple[float, ...], period_s: float) -> bool:
        """Updates with an echo at a point where the height is `ratio` times the filtered one.

        Args:
            height_m: Vertical distance to the hit surface.
            ratio: Height there relative to the height here.
            reliefs_m: Heights above the floor of surfaces that may have been hit; the best fitting one counts.
            period_s: Time since the previous echo.

        Returns:
            Whether it fits one of them; otherwise it is ignored.
        """
        candidates = [(height_m + relief_m) / ratio for relief_m in reliefs_m]
        used_m = min(candidates, key=lambda candidate: abs(candidate - self._mean_m))
        noise = (self._noise_m / ratio) ** 2
        # Gate: |y| against 4 sqrt(P + R) plus 4 % of the height, y = z - h.
        away_m = used_m - self._mean_m
        gate_m = _GATE * math.sqrt(self._variance + noise) + _GATE_SHARE * self._mean_m
        if abs(away_m) > gate_m:
            self._denied_s += period_s
            return False
        # Update: K = P / (P + R), h <- h + K y, P <- (1 - K) P.
        gain = self._variance / (self._variance + noise)
        self._mean_m += gain * away_m
        self._variance *= 1.0 - gain
        self._fitting_s += period_s
        self._denied_s = 0.0
        return True
