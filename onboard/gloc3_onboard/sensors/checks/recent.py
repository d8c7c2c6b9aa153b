"""Recent measurements, looked up by the time of a picture or a scan."""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable
from typing import Final

from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Quaternion, Vector3, from_rotation_vector, multiply, normalize, slerp
from gloc3.messages.vehicle import AutopilotPose, HeightAboveGround

_KEPT: Final = 64
_LEAP_M: Final = 0.3
"""A height leaps that differs from the one before by more than this…"""
_LEAP_SHARE: Final = 0.05
"""…and this share of it, for a body that tilts…"""
_LEAP_M_S: Final = 3.0
"""…and what a vehicle climbs meanwhile."""
_LOOKED_AT: Final = 8
_MOST_LEAPS: Final = 2
"""Of so many heights no more leap where there are boxes and steps below."""


class RecentHeights:
    """Heights of the last seconds; between two of them it is a line, beyond the newest the newest.

    A height that leaps counts once the next two confirm it. While more than a few leap, none counts: the sensor is broken, and
    whoever needs the height would be wrong in the same way as all others who do.
    """

    def __init__(self, gap_s: float) -> None:
        self._gap_s = gap_s
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._values: deque[float] = deque(maxlen=_KEPT)
        self._last = (-math.inf, math.nan)
        """The newest height of all, and its time."""
        self._leaps: deque[bool] = deque(maxlen=_LOOKED_AT)
        """Whether the last ones have leapt."""

    def put(self, t_s: float, height_m: float) -> None:
        """Adds a height; older ones than the newest are not taken."""
        if not math.isfinite(height_m) or t_s <= self._last[0]:
            return
        if self._times:
            self._leaps.append(self._is_leap(*self._last, t_s, height_m))
        self._last = (t_s, height_m)
        is_confirmed = not any(list(self._leaps)[-2:])
        if not is_confirmed and self._times:
            is_confirmed = not self._is_leap(self._times[-1], self._values[-1], t_s, height_m)
        if is_confirmed and sum(self._leaps) <= _MOST_LEAPS:
            self._times.append(t_s)
            self._values.append(height_m)

    def _is_leap(self, begin_s: float, before_m: float, t_s: float, height_m: float) -> bool:
        climbed_m = _LEAP_M_S * min(t_s - begin_s, self._gap_s)
        return abs(height_m - before_m) > _LEAP_M + _LEAP_SHARE * abs(before_m) + climbed_m

    def add(self, heights: Iterable[Envelope[HeightAboveGround]]) -> None:
        """Adds those that are valid."""
        for height in heights:
            if height.payload.is_valid:
                self.put(height.t_s, height.payload.height_m)

    def at(self, t_s: float) -> float:
        """The height at a time; not-a-number where none is near enough."""
        index = bisect_right(self._times, t_s)
        near = [i for i in (index - 1, index) if 0 <= i < len(self._times) and abs(self._times[i] - t_s) <= self._gap_s]
        if len(near) < 2:
            return self._values[near[0]] if near else math.nan
        before, after = near
        share = (t_s - self._times[before]) / (self._times[after] - self._times[before])
        return self._values[before] + share * (self._values[after] - self._values[before])


class RecentAttitudes:
    """Attitudes of the last seconds, interpolated the shorter way round, and extrapolated by the newest rate."""

    def __init__(self, gap_s: float) -> None:
        self._gap_s = gap_s
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._values: deque[tuple[Quaternion, Vector3]] = deque(maxlen=_KEPT)

    def put(self, t_s: float, ned_from_frd: Quaternion, rate_frd_rad_s: Vector3) -> None:
        """Adds an attitude; older ones than the newest are not taken."""
        is_finite = all(map(math.isfinite, (*ned_from_frd, *rate_frd_rad_s)))
        if is_finite and (not self._times or t_s > self._times[-1]):
            self._times.append(t_s)
            self._values.append((ned_from_frd, rate_frd_rad_s))

    def add(self, poses: Iterable[Envelope[AutopilotPose]], attitudes: Iterable[Envelope[AutopilotPose]] = ()) -> None:
        """Adds the attitudes of an autopilot's poses, and those that it reports while it has no position."""
        for pose in in_time_order(poses, attitudes):
            self.put(pose.t_s, pose.payload.ned_from_frd, pose.payload.rate_frd_rad_s)

    def at(self, t_s: float) -> Quaternion | None:
        """The attitude at a time; None where none is near enough."""
        index = bisect_right(self._times, t_s)
        if index == 0 or t_s - self._times[index - 1] > self._gap_s:
            return None
        attitude, rate = self._values[index - 1]
        ahead_s = t_s - self._times[index - 1]
        if index < len(self._times) and self._times[index] - t_s <= self._gap_s:
            share = ahead_s / (self._times[index] - self._times[index - 1])
            return slerp(attitude, self._values[index][0], share)
        turned = from_rotation_vector((rate[0] * ahead_s, rate[1] * ahead_s, rate[2] * ahead_s))
        return normalize(multiply(attitude, turned))


def in_time_order(
    poses: Iterable[Envelope[AutopilotPose]], attitudes: Iterable[Envelope[AutopilotPose]]
) -> list[Envelope[AutopilotPose]]:
    """The autopilot's poses and, from when it has no position, its attitudes, by their times."""
    return sorted((*poses, *attitudes), key=lambda envelope: envelope.t_s)
