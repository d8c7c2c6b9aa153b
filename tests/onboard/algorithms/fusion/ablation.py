"""Takes sources away from the fusion, or has them lie, in mid flight, and says what became of the pose."""

from typing import NamedTuple

import numpy as np

from .flown import inspection, sensors_of
from .fly import Flown, fly

FAULTS = ("removed", "frozen", "scale", "step", "late", "old", "garbage")
"""`late`: everything comes 200 ms later; `old`: and is stamped as if it were new."""
HARMLESS = ("late",)
"""What is taken in as if nothing were: there is nothing to be found."""
SOURCES = {
    "pelican": ("stereo", "ground", "laser", "tracker", "height"),
    "hummingbird": ("stereo", "ground", "tracker", "height"),
}


class Outcome(NamedTuple):
    """What became of the pose."""

    worst_m: float
    """Largest error of a pose that said it is valid."""
    detected_s: float | None
    """From the fault's begin to the first pose that does not rest on the source any more."""
    is_let_in: bool
    """Whether all are used again at the end."""
    valid_share: float
    wrong_s: float
    """How long it was wrong by more than 0.15 m, and by more than three of its own standard deviations, and said no word."""
    least_quality: float
    reason: str
    """Why it was not valid, where it was not."""


def suffer(
    platform: str,
    names: tuple[str, ...],
    fault: str,
    *,
    fault_s: tuple[float, float] = (30.0, 60.0),
    until_s: float = 1e9,
    seed: int = 0,
) -> Outcome:
    """Flies with a fault of some sources."""
    sensors = sensors_of(platform, seed)
    for sensor in sensors:
        if sensor.name in names:
            sensor.fault, sensor.fault_s = fault, fault_s
    return judge(fly(inspection(), sensors, seed, until_s=until_s), names, fault_s)


def judge(flown: Flown, names: tuple[str, ...], fault_s: tuple[float, float]) -> Outcome:
    """Looks at what was believed."""
    errors = np.linalg.norm(flown.error_m, axis=1)
    valid = np.array([pose.is_valid for pose in flown.poses])
    claimed = np.array([np.linalg.norm(pose.position_std_m) for pose in flown.poses])
    during = (flown.t_s >= fault_s[0] + 1.0) & (flown.t_s < fault_s[1])
    without = [
        float(t_s) - fault_s[0]
        for t_s, pose in zip(flown.t_s, flown.poses, strict=True)
        if t_s >= fault_s[0] and not any(name in pose.sources for name in names)
    ]
    is_wrong = valid & (errors > 0.15) & (errors > 3.0 * claimed)
    return Outcome(
        worst_m=float(errors[valid].max()),
        detected_s=without[0] if without else None,
        is_let_in=all(name in flown.poses[-1].sources for name in names),
        valid_share=float(valid.mean()),
        wrong_s=float(is_wrong.sum()) * 0.05,
        least_quality=min(
            (pose.quality for pose, is_in in zip(flown.poses, during, strict=True) if is_in), default=1.0
        ),
        reason=next((pose.reason for pose in flown.poses if not pose.is_valid), ""),
    )
