"""Costs of the stereo pair's features and of the odometer on them, in processor time."""

import time

import numpy as np
from tests.onboard.algorithms.vision.flights import Pair, fly, inspection

from gloc3_onboard.algorithms.vision.features import FeatureMatcher
from gloc3_onboard.algorithms.vision.stereo_motion import StereoMotion
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig
from gloc3_sitl.world.rig import FRONT_LEFT, FRONT_RIGHT

WARMED_UP = 5
COUNT = 150
BAR_MS = 6.0


def costs_ms(pairs: list[Pair]) -> tuple[list[float], list[float]]:
    """Of features, and of motions, for each pair, once warmed up."""
    rig = StereoRig(FRONT_LEFT, FRONT_RIGHT)
    matcher, motion = FeatureMatcher(rig), StereoMotion(rig)
    found: tuple[list[float], list[float]] = [], []
    for pair in pairs:
        begin_s = time.thread_time()
        features = matcher.update(pair.left, pair.right, pair.t_s)
        between_s = time.thread_time()
        motion.update(features)
        found[0].append(1e3 * (between_s - begin_s))
        found[1].append(1e3 * (time.thread_time() - between_s))
    return found[0][WARMED_UP:], found[1][WARMED_UP:]


def run() -> list[str]:
    """The costs in both holds."""
    lines = []
    for world in ("hold", "hold_hard"):
        features, motions = costs_ms(list(fly(inspection(1).select(slice(200, 200 + COUNT)), world, 1)))
        both = np.add(features, motions)
        for name, costs, bar in (
            ("features", features, ""),
            ("motion", motions, ""),
            ("both", both, f"   bar {BAR_MS:g} ms, worst 20 ms"),
        ):
            title = f"{world}: {name}, a pair of 640 x 480"
            lines.append(f"{title:<42} mean {np.mean(costs):6.2f} ms   worst {np.max(costs):6.2f} ms{bar}")
    return lines
