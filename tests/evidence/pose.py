"""The pose of the whole stack in flight: cameras, scanner, tracker, odometers, fusion and controllers, for 60 m in the hold.

The vehicle flies by this pose. A second fusion, quiet, hears the same but for the tracker. Two flights are flown with
the tracker unplugged, so that the vehicle flies by a pose without it.
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri
from tests.evidence.page import Bar, Figure, Progress
from tests.flight.pose_trial import LOST_M, MOMENTS_S, ODOMETERS, fly

SEEDS = range(20)
UNPLUGGED = range(2)
MISSION = """mission: sixty metres along the walls of the hold
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: continue
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}}}
  sweep:
    after: [depart]
    actions:
      side: {follow_waypoints: {waypoints_m: [[2, 1, 2], [13, 1, 2], [13, 4, 3]], speed_m_s: 0.8}}
      wall:
        after: [side]
        follow_waypoints:
          waypoints_m: [[13, 8, 2.5], [4, 8, 2.5], [4, 8, 4], [13, 8, 4]]
          speed_m_s: 0.8
          heading: {look_at: [9, 13, 3]}
  recover: {after: [sweep], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""
"""Along the starboard side with the heading along the way, along the port side face on, at two heights, and home."""
NIS = (0.1, 1.3)
"""Of innovations; below 1 is careful, as it has to be where errors stay from one report to the next and do not show in them."""


def flight(seed: int, world: str, faults: tuple[str, ...] = ()) -> dict[str, Any]:
    """One flight's figures."""
    with tempfile.TemporaryDirectory() as folder:
        trial = fly(MISSION, "pelican", seed, Path(folder), world, faults)
    return {
        "state": trial.state,
        "way": trial.way_m,
        "odometers": trial.odometers,
        **{name: {key: getattr(judged, key) for key in judged.__struct_fields__} for name, judged in
           (("fused", trial.fused), ("blind", trial.blind))},
    }  # fmt: skip


def run(progress: Progress) -> list[Figure]:
    """All flights."""
    flights: dict[str, list[dict[str, Any]]] = {}
    for key, world, seeds, faults in (
        ("hold", "hold", SEEDS, ()),
        ("hard", "hold_hard", SEEDS, ()),
        ("unplugged", "hold", UNPLUGGED, ("device:tracker_camera=lost",)),
    ):
        for seed in seeds:
            progress.report(f"{key}, seed {seed}")
            found = progress.part(f"{key} {seed}", partial(flight, seed, world, faults))
            flights.setdefault(key, []).append(found)
    hold, hard, unplugged = flights["hold"], flights["hard"], flights["unplugged"]
    everything = hold + hard + unplugged
    done = sum(each["state"] == "done" for each in everything)
    distance_m = min(each["way"] for each in everything)
    return [
        Figure("missions done", f"{done} of {len(everything)}", "all", done == len(everything)),
        Figure("way flown, least", f"{distance_m:.1f} m", "≥ 60 m", distance_m >= 60.0),
        *_accuracy("hold", [each["fused"] for each in hold], 0.05),
        *_drift("hold, without the tracker", [(each["blind"], each["way"]) for each in hold]),
        *_drift("hold, flown with the tracker unplugged", [(each["fused"], each["way"]) for each in unplugged]),
        *_accuracy("hold_hard", [each["fused"] for each in hard], 0.15),
        *_honesty("hold", [each["fused"] for each in hold]),
        *_honesty("hold, without the tracker", [each["blind"] for each in hold]),
        *_honesty("hold_hard", [each["fused"] for each in hard]),
        *_truthfulness(everything),
        _alone("hold", hold),
        _alone("hold_hard", hard),
    ]


def _accuracy(name: str, runs: list[dict[str, Any]], bar_m: float) -> list[Figure]:
    ate, raw = (max(each[key] for each in runs) for key in ("ate_m", "rms_m"))
    turn = max(each["turn_deg"] for each in runs)
    mean = float(np.mean([each["ate_m"] for each in runs]))
    return [
        Figure(
            f"{name}: ATE RMS, worst seed (mean)",
            f"{1e3 * ate:.1f} mm ({1e3 * mean:.1f} mm)",
            f"≤ {1e3 * bar_m:.0f} mm",
            ate <= bar_m,
        ),
        Figure(
            f"{name}: the same in the declared frame, without any alignment",
            f"{1e3 * raw:.1f} mm",
            f"≤ {1e3 * bar_m:.0f} mm",
            raw <= bar_m,
        ),
        Figure(f"{name}: attitude, RMS, worst seed", f"{turn:.3f}°", "≤ 0.5°", turn <= 0.5),
        Figure(f"{name}: largest error of a valid pose", f"{1e3 * max(each['worst_m'] for each in runs):.0f} mm"),
    ]


def _drift(name: str, runs: list[tuple[dict[str, Any], float]]) -> list[Figure]:
    share, raw, end = (
        max(100.0 * judged[key] / distance_m for judged, distance_m in runs) for key in ("ate_m", "rms_m", "end_m")
    )
    return [
        Figure(f"{name}: ATE RMS, worst seed", f"{share:.3f} % of the way", "≤ 0.2 %", share <= 0.2),
        Figure(f"{name}: the same in the declared frame", f"{raw:.3f} %", "≤ 0.2 %", raw <= 0.2),
        Figure(f"{name}: at the end, worst seed", f"{end:.3f} %"),
    ]


def _honesty(name: str, runs: list[dict[str, Any]]) -> list[Figure]:
    """Errors and innovations, by what the covariance says of them."""
    figures = []
    for key, what, degrees in (("nees_place", "position", 3), ("nees", "position and attitude", 6)):
        count = min(len(each[key]) for each in runs)
        means = np.mean([each[key][:count] for each in runs], axis=0) / degrees
        low, high = (float(chdtri(len(runs) * degrees, 1.0 - p)) / (len(runs) * degrees) for p in (0.025, 0.975))
        mean = float(means.mean())
        inside = float(np.mean(means <= high))
        figures += [
            Figure(
                f"{name}: NEES of {what}, mean of {len(runs)} seeds and {count} moments",
                f"{mean:.2f}",
                f"≤ {high:.2f} (95 % bounds {low:.2f} to {high:.2f})",
                mean <= high,
            ),
            Figure(f"… moments, every {MOMENTS_S:g} s, at which the mean of the seeds is not above", f"{inside:.0%}"),
        ]
    for source in runs[0]["innovation"]:
        value = float(np.mean([each["innovation"].get(source, np.nan) for each in runs]))
        inside = float(np.mean([each["inside"].get(source, np.nan) for each in runs]))
        figures.append(
            Figure(
                f"{name}: NIS of {source}; innovations inside their own 95 % bound",
                f"{value:.2f}; {inside:.1%}",
                f"{NIS[0]:g} to {NIS[1]:g}; ≥ 93 %",
                NIS[0] <= value <= NIS[1] and inside >= 0.93,
            )
        )
    return figures


def _truthfulness(runs: list[dict[str, Any]]) -> list[Figure]:
    judged = [each[name] for each in runs for name in ("fused", "blind")]
    lied_s = max(each["lied_s"] for each in judged)
    return [
        Figure(
            f"all flights, both fusions: valid, yet wrong by more than {LOST_M:g} m and three standard deviations",
            f"{lied_s:.2f} s",
            "0 s",
            lied_s == 0.0,
        ),
        Figure(
            "… by more than three standard deviations, however little",
            f"{np.mean([each['beyond'] for each in judged]):.1%} of the time; worst flight "
            f"{max(each['beyond'] for each in judged):.1%}",
        ),
        Figure("poses that are valid, least", f"{min(each['valid'] for each in judged):.1%}"),
    ]


def _alone(world: str, runs: list[dict[str, Any]]) -> Figure:
    """Each odometer's own reports, put end to end; their bars are on pages of their own."""
    worst = {name: max(each["odometers"][name] for each in runs) for name in ODOMETERS}
    text = ", ".join(f"{name} {value:.2f} %" for name, value in worst.items())
    return Figure(f"{world}: odometers' reports put end to end, what is missing left out; ATE, worst seed", text)


BARS = (
    Bar(
        "pose",
        "Without satellites the vehicle flies 60 m through the hold with a pose error below 50 mm",
        "The vehicle flies 60 m by the pose that is fused from its sensors. The pose is within 50 mm and 0.5° of the "
        "truth, within 0.2 % of the path without the tracker, and within 0.15 m where lamps, dust, blur, repeated "
        "plates and a bare wall make it hard. It is never wrong without reporting it, and its uncertainty matches its "
        "errors. For the ATE, the first tenth of the poses aligns the path with the truth, without a change of scale.",
        run,
        seeds="0 to 19; 0 and 1 with the tracker unplugged",
    ),
)
