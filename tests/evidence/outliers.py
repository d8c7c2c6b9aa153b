"""The pose fusion with sources that are wrong now and then, for long, or together, beside a plain gated filter.

The sensors are modelled by their errors, without pictures. Every cell is 50 flights; all is in virtual time.
"""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.algorithms.fusion.outliers import LONGEST_S, Case, lasting, sporadic, together, trial
from tests.onboard.algorithms.fusion.plain_gate import PlainGate

SEEDS = range(50)
NEES = (0.3, 1.8)
"""As in the tests of consistency."""
VALID = 0.95
RMS_SHARE = 1.01
"""Of the plain filter's: both have the same noise, and the last digits differ."""


def cell(case: Case) -> dict[str, Any]:
    """All flights of a case, by both filters."""
    begin_s = time.process_time()
    fused = [trial(case, seed) for seed in SEEDS]
    plain = [trial(case, seed, PlainGate) for seed in SEEDS]
    return {
        "rms_m": float(np.sqrt(np.nanmean([outcome.square_m2 for outcome in fused]))),
        "worst_m": max(outcome.worst_m for outcome in fused),
        "lying_s": max(outcome.lying_s for outcome in fused),
        "liars": sum(outcome.lying_s > LONGEST_S for outcome in fused),
        "valid": min(outcome.valid_share for outcome in fused),
        "nees": float(np.nanmean([outcome.nees for outcome in fused])),
        "plain_rms_m": float(np.sqrt(np.mean([outcome.square_m2 for outcome in plain]))),
        "plain_lying_s": max(outcome.lying_s for outcome in plain),
        "cost_s": time.process_time() - begin_s,
    }


def row(case: Case, found: dict[str, Any], *, is_minority: bool) -> Figure:
    """A cell in a line; sources that are right are the majority, or not."""
    low, high = NEES
    text = (
        f"RMS {found['rms_m'] * 1e3:.1f} mm (plain {found['plain_rms_m'] * 1e3:.1f}), worst {found['worst_m'] * 1e3:.0f} mm, "
        f"over 4 sigma for {found['lying_s']:.2f} s (plain {found['plain_lying_s']:.2f}) in {found['liars']} of {len(SEEDS)}, "
        f"valid {found['valid']:.1%}, NEES {found['nees']:.2f}"
    )
    bar, is_met = f"over 4 sigma ≤ {LONGEST_S:g} s", found["lying_s"] <= LONGEST_S + 1e-9
    if is_minority:
        bar += f", valid ≥ {VALID:.0%}, NEES {low:g} to {high:g}, RMS ≤ plain"
        is_met = is_met and found["valid"] >= VALID and low <= found["nees"] <= high
        is_met = is_met and found["rms_m"] <= RMS_SHARE * found["plain_rms_m"]
    return Figure(case.name, text, bar, is_met)


def run(progress: Progress) -> Sequence[Figure]:
    """The bar."""
    figures, cost_s = [], 0.0
    for cases, is_minority in ((sporadic(), True), (lasting(), True), (together(), False)):
        for case in cases:
            progress.report(case.name)
            found = progress.part(case.name, partial(cell, case))
            cost_s += found["cost_s"]
            figures.append(row(case, found, is_minority=is_minority))
    return [*figures, Figure("processor time of all flights", f"{cost_s / 60.0:.0f} min")]


BARS = (
    Bar(
        "outliers",
        "A valid pose stays within four standard deviations while sources are wrong",
        "Two odometers, a tracker and a height (and a laser, on the Pelican) fly for 35 s, 50 seeds a row. From the "
        "9th second on each report of a source is displaced by N(0, 1 m) along each axis with a given probability, or "
        "a source is wrong for good, or half of the sources or more are. A valid pose is never off by more than four "
        "of its standard deviations along an axis for more than 0.3 s in any seed. Where most sources are right, the "
        "pose is valid for 95 % of the time in the worst seed, its squared error is what it claims (NEES by degrees "
        "of freedom), and its RMS error is no larger than that of a plain filter with the same models, noise and a "
        "chi-square gate. Where most are wrong, a pose that cannot be decided must be invalid or wide.",
        run,
        seeds="0 to 49",
    ),
)
