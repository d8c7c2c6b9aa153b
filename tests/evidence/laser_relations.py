"""Public logs with published relations: the laser odometer and its map beside published figures, and their honesty.

The relations of the SLAM benchmark of Freiburg are motions between scans, checked by hand (Kümmerle et al., "On measuring
the accuracy of SLAM algorithms", Autonomous Robots 2009); the published figures are those of its table 2.
"""

import itertools
import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from tests.data_folders import LASER_LOGS, RELATIONS
from tests.evidence.page import Figure, Progress

from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.cli.odometry_laser import drive
from gloc3_onboard.cli.odometry_laser_map import laid_out
from gloc3_onboard.datasets.laser_log import LaserLog
from gloc3_onboard.datasets.laser_logs import read_laser_log

CHI_95, CHI_999 = 7.81, 16.27
"""Bounds of the squared normalised error, three degrees of freedom."""
INSIDE: Final = 0.95
BEYOND: Final = 0.02
"""Share of errors beyond the bound of one in a thousand, at most."""
Relation = tuple[int, int, Planar]
"""From one scan to another, by their numbers."""


class PublicLog(NamedTuple):
    """A log, and what has been published about it."""

    name: str
    file: str
    relations: str
    """A file of relations; empty where they are edges in the log itself, or the poses of a corrected one."""
    begin_s: float
    """What the relations' clock shows where the log's shows 0."""
    slack_s: float
    """By how much the times of a scan in both may differ."""
    published_m: tuple[float, float]
    """Error of graph mapping, mean and standard deviation."""
    bar_m: float
    has_wheels: bool = False
    needs_wheels: bool = False
    """Its corridors tell scans nothing along themselves: the bar is for scans and wheels."""


LOGS: Final = (
    PublicLog(
        "Freiburg 079, full rate",
        "freiburg-079-corrected.log",
        "fr079.relations",
        1211.445,
        0.12,
        (0.056, 0.042),
        0.06,
        has_wheels=True,
    ),
    PublicLog(
        "ACES, full rate",
        "aces.clf",
        "aces.relations",
        0.0,
        0.02,
        (0.044, 0.044),
        0.05,
        has_wheels=True,
        needs_wheels=True,
    ),
    PublicLog("CSAIL", "mit-cscail.log", "", 0.0, 0.0, (0.004, 0.009), 0.05),
    PublicLog("Intel", "intel-lab.log", "intel.relations", 0.0, 0.012, (0.031, 0.026), 0.034),
)
ACES: Final = PublicLog(
    "ACES, by the corrected poses",
    "aces/aces-corrected.log",
    "",
    0.0,
    0.0,
    (0.044, 0.044),
    0.05,
    has_wheels=True,
    needs_wheels=True,
)


def relations_of(public: PublicLog, log: LaserLog) -> list[Relation]:
    """The relations between scans of a log that has both."""
    found: list[Relation] = []
    if public.relations:
        stamps = np.array([scan.stamp_s for scan in log.scans]) + public.begin_s
        for line in (RELATIONS / public.relations).read_text().splitlines():
            begin_s, end_s, x, y, _, _, _, turn = map(float, line.split())
            first, second = (int(np.abs(stamps - at_s).argmin()) for at_s in (begin_s, end_s))
            if max(abs(stamps[first] - begin_s), abs(stamps[second] - end_s)) < public.slack_s:
                found.append((first, second, Planar(x, -y, -turn)))
        return found
    for line in (RELATIONS / public.file).read_text().splitlines():
        if line.startswith("EDGE2"):
            one, other, *motion = line.split()[1:6]
            x, y, turn = map(float, motion)
            found.append((int(one), int(other), Planar(x, -y, -turn)))
    return found


def steps_of(log: LaserLog) -> list[Relation]:
    """From scan to scan, by the poses of a corrected log."""
    poses = [scan.pose or Planar() for scan in log.scans]
    return [(n, n + 1, one.inverse() @ two) for n, (one, two) in enumerate(itertools.pairwise(poses))]


def errors_of(poses: Sequence[Planar], relations: Sequence[Relation]) -> dict[str, float]:
    """Errors of the motions, as the benchmark defines them."""
    off = [true.inverse() @ (poses[first].inverse() @ poses[second]) for first, second, true in relations]
    away = np.array([error.distance_m for error in off])
    turned = np.degrees([abs(error.yaw_rad) for error in off])
    return {
        "mean": float(away.mean()),
        "std": float(away.std()),
        "worst": float(away.max()),
        "deg": float(turned.mean()),
    }


def honesty_of(motions: Sequence[LaserMotion], smooth: Sequence[Planar]) -> dict[str, float]:
    """Squared normalised errors of the odometer's motions, against the map's poses."""
    numbers = {motion.t_s: number for number, motion in enumerate(motions)}
    squares = []
    for number, motion in enumerate(motions):
        if motion.is_valid:
            true = smooth[numbers[motion.reference_t_s]].inverse() @ smooth[number]
            off = np.subtract(motion.motion, true)
            off[2] = wrap_pi(float(off[2]))
            squares.append(float(off @ np.linalg.solve(motion.covariance, off)))
    found = np.array(squares)
    return {
        "median": float(np.median(found)),
        "inside": float(np.mean(found < CHI_95)),
        "beyond": float(np.mean(found > CHI_999)),
    }


def run(public: PublicLog, folder: Path, *, wheels: bool) -> dict[str, Any]:
    """The odometer and the map on a log."""
    log = read_laser_log(folder / public.file)
    relations = steps_of(log) if public is ACES else relations_of(public, log)
    begin_s = time.process_time()
    motions, _ = drive(log, wheels=wheels)
    between_s = time.process_time()
    poses, graph = laid_out(log, motions)
    end_s = time.process_time()
    return {
        "relations": len(relations),
        "scans": len(motions),
        "valid": sum(motion.is_valid for motion in motions),
        "odometer": errors_of([motion.pose for motion in motions], relations),
        "map": errors_of(poses, relations),
        "loops": graph.loops,
        "honesty": honesty_of(motions, poses),
        "ms": 1e3 * (between_s - begin_s) / len(motions),
        "map_s": end_s - between_s,
        "log_s": log.times_s[-1] - log.times_s[0],
    }


def relation_figures(progress: Progress) -> list[Figure]:
    """Each log that is at hand: the scans alone, and with the wheels where it has them."""
    figures: list[Figure] = []
    for public, wheels in ((log, wheels) for log in (*LOGS, ACES) for wheels in (True, False)[not log.has_wheels :]):
        folder = LASER_LOGS if public is ACES else RELATIONS
        source = "with the wheels" if wheels else "scans alone"
        progress.report(f"{public.name}, {source}")
        mean_m, std_m = public.published_m
        published = f"published graph mapping {mean_m:.3f} ± {std_m:.3f} m"
        if not (folder / public.file).is_file():
            figures.append(Figure(f"{public.name}, {source}", "not at hand", f"≤ {public.bar_m:g} m", False))
            continue
        found: dict[str, Any] = progress.part(f"{public.name} {wheels}", partial(run, public, folder, wheels=wheels))
        is_bound = wheels or not public.needs_wheels
        for part in ("odometer", "map"):
            error = found[part]
            text = (
                f"{error['mean']:.4f} ± {error['std']:.4f} m and {error['deg']:.2f}° over {found['relations']} relations, "
                f"worst {error['worst']:.2f} m"
            )
            text += (
                f", {found['ms']:.1f} ms a scan"
                if part == "odometer"
                else (f", {found['loops']} loops closed in {found['map_s']:.0f} s")
            )
            bar = f"≤ {public.bar_m:g} m; {published}" if part == "map" and is_bound else ""
            is_met = not bar or (math.isfinite(error["mean"]) and error["mean"] <= public.bar_m)
            figures.append(Figure(f"{public.name}, {source}: {part}", text, bar, is_met))
        honesty = found["honesty"]
        bar = f"≥ {100 * INSIDE:.0f} %, ≤ {100 * BEYOND:.0f} %" if is_bound else ""
        is_met = not bar or (honesty["inside"] >= INSIDE and honesty["beyond"] <= BEYOND)
        text = (
            f"{100 * honesty['inside']:.1f} % inside the 95 % bound, {100 * honesty['beyond']:.1f} % beyond that of 0.1 %, "
            f"median {honesty['median']:.2f}; {found['valid']} of {found['scans']} motions valid"
        )
        figures.append(Figure(f"{public.name}, {source}: normalised errors", text, bar, is_met))
    return figures
