"""Dead reckoning of the diving platforms: how far it is off by its Doppler velocity log, and without."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.flight.diving import Dive, dive

from gloc3.log.report.figure import drawing

SEEDS = range(1, 11)
ADRIFT = range(1, 7)
SHARE = 0.01
PICTURE = "dead_reckoning_errors.svg"
WORLD = """\
world: bay_current
based_on: bay
water: {surface_m: 0, floor_m: -20, current_ned_m_s: [0.05, 0.08, 0.0]}
"""
MISSION = """\
mission: lanes under water
frame: bay
geofence: {polygon_m: [[-60, -60], [120, -60], [120, 60], [-60, 60]], ceiling_m: 3}
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  down:
    actions:
      dive: {dive: {depth_m: 3}}
  sweep:
    after: [down]
    actions:
      lanes:
        follow_waypoints:
          waypoints_m: [[45, 0, -5], [45, 10, -5], [0, 10, -6]]
          speed_m_s: SPEED
  up:
    after: [sweep]
    actions:
      surface: {land: {}}
"""
SPEEDS = {"auv": "0.8", "rov": "0.5"}


def dived(platform: str, seed: int, faults: tuple[str, ...] = ()) -> Dive:
    """A dive of some 100 m in a current of 0.09 m/s."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "world.yaml").write_text(WORLD)
        mission = MISSION.replace("SPEED", SPEEDS[platform])
        return dive(mission, platform, seed, folder, world=str(folder / "world.yaml"), faults=faults)


def run(progress: Progress) -> list[Figure]:
    """Dives with the DVL, and the AUV's without it soon after the begin."""
    figures: list[Figure] = []
    for platform in SPEEDS:
        kept = [_part(progress, platform, seed, "dvl") for seed in SEEDS]
        figures += _with(platform, kept)
    adrift = [_part(progress, "auv", seed, "adrift", ("device:dvl=lost@50..3000",)) for seed in ADRIFT]
    _draw(
        {
            **{f"{platform}, with DVL": _known(progress, platform, SEEDS, "dvl") for platform in SPEEDS},
            "auv, without": adrift,
        }
    )
    return [*figures, *_without(adrift)]


def _known(progress: Progress, platform: str, seeds: range, what: str) -> list[dict[str, Any]]:
    return [_part(progress, platform, seed, what) for seed in seeds]


def _draw(kinds: dict[str, list[dict[str, Any]]]) -> None:
    """Errors over the way, with and without."""
    with drawing(PAGES / PICTURE, 8.0, 3.6) as figure:
        axes = figure.subplots(1, len(kinds), sharex=True)
        for plot, (name, dives) in zip(axes, kinds.items(), strict=True):
            for one in dives:
                plot.plot(*zip(*one["errors"], strict=True), color="#1f4fd8", linewidth=0.9)
            far_m = max(one["way_m"] for one in dives)
            plot.plot([0.0, far_m], [0.0, SHARE * far_m], color="#e02020", linestyle="--", linewidth=1.2)
            plot.set(title=name, xlabel="way under water, m", ylim=(0.0, None))
        axes[0].set(ylabel="error of the pose, m (dashed: 1 %)")


def _part(progress: Progress, platform: str, seed: int, what: str, faults: tuple[str, ...] = ()) -> dict[str, Any]:
    key = f"{platform} {what} {seed}"
    if not progress.knows(key):
        progress.report(key)
    found: dict[str, Any] = progress.part(key, lambda: dived(platform, seed, faults)._asdict())
    return found


def _with(platform: str, dives: list[dict[str, Any]]) -> list[Figure]:
    shares = np.array([one["off_m"] / one["way_m"] for one in dives])
    done = sum(one["state"] == "done" for one in dives)
    inside = sum(one["off_m"] < 3.0 * max(one["claimed_m"], 0.1) for one in dives)
    rms = float(np.sqrt(np.mean(shares**2)))
    return [
        Figure(f"{platform}, dives done", f"{done} of {len(dives)}", "all", done == len(dives)),
        Figure(f"{platform}, way under water, m", f"{np.mean([one['way_m'] for one in dives]):.0f} each"),
        Figure(f"{platform}, off when it comes up, RMS", f"{100.0 * rms:.2f} % of the way", "≤ 1 %", rms <= SHARE),
        Figure(
            f"{platform}, off when it comes up, worst",
            f"{100.0 * shares.max():.2f} %",
            "≤ 1 %",
            bool(shares.max() <= SHARE),
        ),
        Figure(
            f"{platform}, largest on the way (after 30 m), RMS",
            f"{100.0 * _rms(dives, 'worst'):.2f} %, at most {100.0 * max(one['worst'] for one in dives):.2f} %",
            "≤ 1 %",
            _rms(dives, "worst") <= SHARE,
        ),
        Figure(f"{platform}, along the way where it is farthest (scale), RMS", f"{100.0 * _rms(dives, 'along'):.2f} %"),
        Figure(f"{platform}, across it (heading, mounting, noise), RMS", f"{100.0 * _rms(dives, 'across'):.2f} %"),
        Figure(
            f"{platform}, off by less than three times the claim",
            f"{inside} of {len(dives)}",
            "all",
            inside == len(dives),
        ),
    ]


def _rms(dives: list[dict[str, Any]], what: str) -> float:
    return float(np.sqrt(np.mean([one[what] ** 2 for one in dives])))


def _without(dives: list[dict[str, Any]]) -> list[Figure]:
    shares = np.array([one["off_m"] / one["way_m"] for one in dives])
    inside = sum(one["off_m"] < 3.0 * one["claimed_m"] for one in dives)
    text = sum(any(reason.startswith("adrift") for reason in one["reasons"]) for one in dives)
    return [
        Figure("auv without the DVL, off when it comes up, median", f"{100.0 * np.median(shares):.0f} % of the way"),
        Figure(
            "auv without the DVL, worst", f"{100.0 * shares.max():.0f} %, {max(one['off_m'] for one in dives):.0f} m"
        ),
        Figure("auv without the DVL, says that it is adrift", f"{text} of {len(dives)}", "all", text == len(dives)),
        Figure(
            "auv without the DVL, off by less than three times the claim",
            f"{inside} of {len(dives)}",
            "all",
            inside == len(dives),
        ),
    ]


BARS = (
    Bar(
        "dead-reckoning",
        "Under water, dead reckoning is off by at most 1 % of the distance travelled",
        "AUV and ROV dive lanes by dead reckoning: velocity over the floor (0.1 % of scale, 0.15° of mounting, 6 mm/s "
        "of noise), a heading error of 0.15°, and depth, in a current of 0.09 m/s that is not in their models. The "
        "figure is the growth of the pose error between diving and surfacing. Without bottom lock the vehicle is "
        "assumed to move as commanded; the error is then the current's, and the pose reports it. The path leads out "
        "and back, which cancels errors of heading and scale, so the error during the dive counts as well. Scale "
        "causes the error along the path, heading and mounting cause the error across it.",
        run,
        seeds="1 to 10; 1 to 6 without the DVL",
        pictures=(PICTURE,),
    ),
)
