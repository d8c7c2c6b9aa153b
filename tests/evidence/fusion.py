"""The pose fusion on a synthetic inspection flight: accuracy, honesty of the covariance, and every fault of every source.

The sensors are modelled by their errors, without pictures: what is shown is the fusion, not the odometers.
"""

from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtri
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.algorithms.fusion.ablation import FAULTS, HARMLESS, SOURCES, suffer
from tests.onboard.algorithms.fusion.consistency import consistency

SEEDS = range(10)
LARGEST_M = 0.3
"""As in flight."""
SLOW = "scale"
NEVER_FOUND = {("height", fault) for fault in ("frozen", "old", "scale")}
"""At a constant height these hardly say anything wrong, and nothing is lost by them."""


def flights(platform: str, without: tuple[str, ...]) -> dict[str, Any]:
    """Ten flights of 60 m."""
    found = consistency(platform, without, SEEDS)
    return {
        "ate": float(max(found.ate_m)),
        "turn": float(max(found.turn_deg)),
        "end": float(np.mean(found.end_m)),
        "worst_end": float(max(found.end_m)),
        "way": found.distance_m,
        "nees": found.nees.ravel().tolist(),
        "innovation": found.innovation,
    }


def accuracy(progress: Progress) -> list[Figure]:
    """With all sources, and without the tracker."""
    figures = []
    for platform in SOURCES:
        for without in ((), ("tracker",)):
            progress.report(f"{platform} without {without}")
            found = progress.part(f"{platform} {without}", partial(flights, platform, without))
            name = f"{platform}{', without the tracker' if without else ''}"
            share = found["worst_end"] / found["way"]
            if without:
                figures.append(
                    Figure(
                        f"{name}: error at the end, worst seed", f"{share:.3%} of the way", "≤ 0.2 %", share <= 0.002
                    )
                )
            else:
                ate, turn = found["ate"], found["turn"]
                figures.append(Figure(f"{name}: ATE RMS, worst seed", f"{ate * 1e3:.1f} mm", "≤ 50 mm", ate <= 0.05))
                figures.append(Figure(f"{name}: attitude RMS, worst seed", f"{turn:.3f}°", "≤ 0.5°", turn <= 0.5))
            figures += _honesty(name, found)
    return figures


def _honesty(name: str, found: dict[str, Any]) -> list[Figure]:
    """Errors and innovations, by what the covariance says of them."""
    nees = np.array(found["nees"])
    inside = float(np.mean(nees <= chdtri(6, 0.05)))
    figures = [
        Figure(
            f"{name}: squared error of the pose over what is claimed, mean of {nees.size}", f"{nees.mean() / 6.0:.2f}"
        ),
        Figure(f"{name}: poses inside their own 95 % bound", f"{inside:.1%}", "≥ 90 %", inside >= 0.9),
    ]
    for source, value in found["innovation"].items():
        is_met = 0.75 <= value <= 1.25
        figures.append(
            Figure(f"{name}: innovations of {source} over what is claimed", f"{value:.2f}", "0.75 to 1.25", is_met)
        )
    return figures


def table(platform: str, progress: Progress) -> list[Figure]:
    """Every fault of every source, and every pair removed."""
    figures = []
    for name in SOURCES[platform]:
        for fault in FAULTS:
            progress.report(f"{platform}: {name} {fault}")
            found = progress.part(f"{platform} {name} {fault}", partial(_suffered, platform, (name,), fault))
            limit_s = 5.0 if fault == SLOW else 0.8
            must_be_found = fault not in HARMLESS and (name, fault) not in NEVER_FOUND
            bar = f"≤ {LARGEST_M} m{f', ≤ {limit_s:g} s' if must_be_found else ''}"
            detected_s = found["detected_s"]
            is_met = found["worst_m"] <= LARGEST_M and found["wrong_s"] == 0.0 and found["valid_share"] == 1.0
            is_met = is_met and (not must_be_found or (detected_s is not None and detected_s <= limit_s))
            figures.append(Figure(f"{platform}: {name} {fault}", _row(found), bar, is_met))
    for names in combinations(SOURCES[platform], 2):
        progress.report(f"{platform}: without {names}")
        found = progress.part(f"{platform} {names}", partial(_suffered, platform, names, "removed"))
        is_met = found["worst_m"] <= LARGEST_M and found["is_let_in"] and found["valid_share"] == 1.0
        figures.append(Figure(f"{platform}: {' and '.join(names)} removed", _row(found), f"≤ {LARGEST_M} m", is_met))
    return figures


def _suffered(platform: str, names: tuple[str, ...], fault: str) -> dict[str, Any]:
    return dict(suffer(platform, names, fault)._asdict())


def _row(found: dict[str, Any]) -> str:
    detected_s = found["detected_s"]
    reported = "taken in as it is" if detected_s is None else f"found after {detected_s:.2f} s"
    return f"{found['worst_m'] * 1e3:.0f} mm at most, {reported}, quality {found['least_quality']:.2f} at least"


def ablation(progress: Progress) -> list[Figure]:
    """Both platforms."""
    return [figure for platform in SOURCES for figure in table(platform, progress)]


BARS: tuple[Bar, ...] = (
    Bar(
        name="fusion",
        title="The pose fusion is within 50 mm over a flight of 60 m, and its covariance is honest",
        claim="Sensors are modelled by their errors (no pictures). The pose is within 50 mm and 0.5° with the tracker, "
        "within 0.2 % of the path without it, and its covariance is honest.",
        run=accuracy,
        seeds="0 to 9",
    ),
    Bar(
        name="fusion-ablation",
        title="Whichever source fails, a valid fused pose is at most 0.3 m off",
        claim="From the 30th to the 60th second of a flight of 60 m one source is removed, frozen, biased, late, stamped "
        "late or garbage, or two are removed. A row gives the largest error of a valid pose, the time until the "
        "source is no longer used, and the lowest quality reported meanwhile. Late data is used with its true time. A "
        "height that is wrong by no more than a floor may rise changes nothing.",
        run=ablation,
        seeds="0",
    ),
)
