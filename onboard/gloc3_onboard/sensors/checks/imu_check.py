"""Whether what an inertial unit says can be: finite, within what such units measure, and not the same for ever."""

import math
from typing import Final

from gloc3.messages.perception import ImuSample

MOST_RATE_RAD_S: Final = 70.0
"""4000 degrees a second."""
MOST_FORCE_M_S2: Final = 320.0
"""32 g."""
STUCK_AFTER: Final = 50
"""So many equal samples in a row: noise makes two equal ones rare."""


class ImuCheck:
    """Looks at the samples of one unit.

    Args:
        may_repeat: whether samples may be equal for ever, as those of a unit without noise at rest are.
    """

    def __init__(self, *, may_repeat: bool = False) -> None:
        self._may_repeat = may_repeat
        self._last: ImuSample | None = None
        self._equal = 0

    def problem(self, sample: ImuSample) -> str:
        """Why the sample cannot be used; empty if it can."""
        if not sample.is_valid:
            return sample.reason or "the unit says so"
        rate = math.hypot(*sample.rate_frd_rad_s)
        force = math.hypot(*sample.specific_force_frd_m_s2)
        if not math.isfinite(rate + force):
            return "it is no number"
        if rate > MOST_RATE_RAD_S:
            return f"{rate:.0f} rad/s is more than can be"
        if force > MOST_FORCE_M_S2:
            return f"{force:.0f} m/s2 is more than can be"
        self._equal = self._equal + 1 if sample == self._last else 0
        self._last = sample
        if self._equal >= STUCK_AFTER and not self._may_repeat:
            return f"the same for {self._equal} samples: the unit is stuck"
        return ""
