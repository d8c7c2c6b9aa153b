"""Flies the fusion, and a plain gated filter beside it, with sources that are wrong now and then, for long, or together."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

from .flown import inspection, sensors_of
from .fly import Flown, Recorder, fly

ODOMETERS_AND_TRACKER = ("stereo", "ground", "tracker")
SHARES = (0.05, 0.1, 0.2)
LASTING = ("step", "ramp", "frozen", "late", "old", "scale")
BEGIN_S, UNTIL_S = 9.0, 35.0
"""The fault lasts from the begin to the end of the flight, over 20 m."""
SETTLED_S = 4.0
SIGMAS = 4.0
LONGEST_S = 0.3
"""So long a valid pose may be off by more than that."""


class Case(NamedTuple):
    """One flight's faults."""

    name: str
    platform: str
    faults: Mapping[str, str]
    """By source."""
    wrong_share: float = 0.0
    """Of the fault `outliers`."""


def sporadic() -> list[Case]:
    """Outliers of each source, and of all at once."""
    groups = [(name, (name,)) for name in ODOMETERS_AND_TRACKER] + [("all three", ODOMETERS_AND_TRACKER)]
    return [
        Case(f"{title}: {share:.0%} outliers", "hummingbird", dict.fromkeys(names, "outliers"), share)
        for share in SHARES
        for title, names in groups
    ]


def lasting() -> list[Case]:
    """Each lasting fault of each source."""
    return [
        Case(f"{name}: {fault}", "hummingbird", {name: fault}) for fault in LASTING for name in ODOMETERS_AND_TRACKER
    ]


def together() -> list[Case]:
    """Half of the sources of position or more are wrong, most of them in the same way."""
    pairs = {
        "hummingbird": (("stereo", "tracker"), ("ground", "tracker"), ("stereo", "ground")),
        "pelican": (("stereo", "tracker"), ("ground", "tracker"), ("laser", "tracker"), ("stereo", "laser")),
    }
    cases = [
        Case(f"{platform}: {' and '.join(names)} 5 % too long", platform, dict.fromkeys(names, "scale"))
        for platform, groups in pairs.items()
        for names in groups
    ]
    drift = dict.fromkeys(("stereo", "tracker"), "ramp")
    cases.append(Case("hummingbird: stereo and tracker drift by 0.05 m/s", "hummingbird", drift))
    mixed = {"stereo": "garbage", "laser": "scale", "tracker": "step"}
    return [*cases, Case("pelican: stereo garbage, laser 5 % too long, tracker 0.2 m off", "pelican", mixed)]


class Outcome(NamedTuple):
    """What became of the pose."""

    square_m2: float
    """Mean squared error of the valid poses."""
    worst_m: float
    """Largest error of a valid pose."""
    lying_s: float
    """Longest time that a valid pose was off by more than four of its standard deviations along some axis."""
    valid_share: float
    nees: float
    """Mean of the squared position error over its claimed variance, by its three degrees of freedom."""


def trial(case: Case, seed: int, kind: type[PoseFusion] = PoseFusion) -> Outcome:
    """Flies once."""
    sensors = sensors_of(case.platform, seed)
    for sensor in sensors:
        if sensor.name in case.faults:
            sensor.fault, sensor.fault_s, sensor.wrong_share = (
                case.faults[sensor.name],
                (BEGIN_S, 1e9),
                case.wrong_share,
            )
    return judge(fly(inspection(), sensors, seed, until_s=UNTIL_S, fusion=kind(Recorder.SETTINGS)))


def judge(flown: Flown) -> Outcome:
    """Looks at what was believed, once it has settled."""
    kept = flown.t_s >= SETTLED_S
    errors = flown.error_m[kept]
    poses = [pose for pose, is_kept in zip(flown.poses, kept, strict=True) if is_kept]
    deviations = np.array([pose.position_std_m for pose in poses])
    valid = np.array([pose.is_valid for pose in poses])
    is_lying = valid & (np.abs(errors) > SIGMAS * deviations).any(axis=1)
    longest = run = 0
    for lies in is_lying:
        run = run + 1 if lies else 0
        longest = max(longest, run)
    squares = np.sum(errors[valid] ** 2, axis=1)
    return Outcome(
        square_m2=float(squares.mean()),
        worst_m=float(np.sqrt(squares.max())),
        lying_s=longest * float(flown.t_s[1] - flown.t_s[0]),
        valid_share=float(valid.mean()),
        nees=float(np.mean(np.sum((errors / deviations) ** 2, axis=1)[valid]) / 3.0),
    )
