"""The stereo odometer alone: 60 m inspection flights in the hold and in the hard one, real pictures, and a peer."""

import os
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from tests.benchmarks.world import remap_ms
from tests.data_folders import PICTURES, STEREO
from tests.evidence.machine import Cost, at_most
from tests.evidence.page import ROOT, SCRATCH, Bar, Figure, Progress
from tests.evidence.stereo_sets import SETS, SPOILED, libviso2, ours, plain, read_drive
from tests.onboard.algorithms.vision.flights import Pair, fly, inspection
from tests.onboard.algorithms.vision.moved_rest import drive, rectified
from tests.onboard.algorithms.vision.trial import BOUND_95, Trial, constant, follow, zero

from gloc3.camera.geometry import matrix
from gloc3.camera.model import Lens
from gloc3.evaluation.metrics import evaluate, relative_errors, steps
from gloc3.evaluation.trajectory import Trajectory, read_trajectory
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_onboard.cli.odometry_stereo import run_mono, run_stereo
from gloc3_onboard.datasets.stereo_set import read_mono_set, read_stereo_set
from gloc3_sitl.world.rig import FRONT_LEFT, FRONT_RIGHT

SEEDS = range(10)
IMAGES = PICTURES
PEER = Path(os.environ.get("GLOC3_VISO2", ROOT / "runs" / "peers" / "viso2"))
"""A program that runs libviso2 and speaks as `viso2_driver.cpp` does; neither it nor that library is in this project."""
LEFT = msgspec.structs.replace(FRONT_LEFT, lens=Lens.PINHOLE, distortion=(), center_px=(319.5, 239.5))
RIGHT = msgspec.structs.replace(LEFT, position_frd_m=FRONT_RIGHT.position_frd_m)
WARMED_UP = 3
TIMED = 3
"""Each pair's cost is the least of so many: a machine's pauses are at other pairs each time, the odometer's work is not."""
LEAST_SETS = 3
"""Of the public ones, where a peer is shown."""


def flight(world: str, seed: int) -> dict[str, Any]:
    """One flight's figures."""
    path = inspection(seed)
    pairs = list(fly(path, world, seed))
    trials = [Trial(path, pairs) for _ in range(TIMED)]
    costs_ms = np.min([trial.costs_ms for trial in trials], axis=0)[WARMED_UP:]
    trial = trials[0]
    found = evaluate(trial.estimate, trial.truth)
    squares = np.array(trial.squares)
    return {
        "path_m": found.path_m,
        "ate": 100.0 * found.absolute_share,
        "relative": 10.0 * found.relative_m.rms if found.relative_m is not None else 0.0,
        "valid": 1.0 - trial.reasons.total() / len(path),
        "reasons": dict(trial.reasons),
        "square": float(squares.mean()) / 6.0,
        "beyond": float((squares > BOUND_95).mean()),
        "wrong_m": max(trial.wrong_m),
        "mean_ms": float(np.mean(costs_ms)),
        "worst_ms": float(np.max(costs_ms)),
        "remap_ms": remap_ms(),
        "zero": _control(path, zero(path)),
        "constant": _control(path, constant(path)),
    }


def _control(path: Trajectory, control: Trajectory) -> float:
    """ATE of a control in percent of the path; the controls begin at the truth, and lie on a line or a point."""
    away = np.linalg.norm(control.position_m - path.position_m, axis=1)
    return float(100.0 * np.sqrt(np.mean(away**2)) / path.distances_m[-1])


def flights(progress: Progress) -> list[Figure]:
    """The bar in both worlds."""
    figures = []
    for world, bar in (("hold", 0.3), ("hold_hard", 1.5)):
        runs = []
        for seed in SEEDS:
            progress.report(f"{world}, seed {seed}")
            runs.append(progress.part(f"{world} {seed}", partial(flight, world, seed)))
        figures += _figures(world, bar, runs)
    return figures


def _figures(world: str, bar: float, runs: list[dict[str, Any]]) -> list[Figure]:
    def column(key: str) -> list[float]:
        return [run[key] for run in runs]

    beyond = float(np.mean(column("beyond")))
    usual_ms = float(np.mean(column("remap_ms")))
    mean, worst = Cost(float(np.mean(column("mean_ms"))), usual_ms), Cost(max(column("worst_ms")), usual_ms)
    reasons = sorted(
        {reason.split(":")[-1].strip() for run in runs for reason in run["reasons"] if "points" not in reason}
    )
    controls = min(*column("zero"), *column("constant"))
    return [
        Figure(f"{world}: path, metres", f"{min(column('path_m')):.1f} at least"),
        Figure(
            "… ATE after alignment on the first 10 %, % of the path",
            f"worst {max(column('ate')):.3f}, mean {np.mean(column('ate')):.3f}",
            f"≤ {bar}",
            max(column("ate")) <= bar,
        ),
        Figure(
            "… relative error over 10 m, %",
            f"worst {max(column('relative')):.3f}, mean {np.mean(column('relative')):.3f}",
        ),
        Figure(
            "… pairs with a valid output", f"{min(column('valid')):.2%} at least; else: {'; '.join(reasons) or 'none'}"
        ),
        Figure(
            "… normalised squared error since the key frame, mean (1 is honest)", f"{np.mean(column('square')):.2f}"
        ),
        Figure("… motions beyond the 95 % bound of their covariance", f"{beyond:.1%}", "≤ 8 %", beyond <= 0.08),
        Figure(
            "… largest error since a key frame of an output said to be valid, m",
            f"{max(column('wrong_m')):.3f}",
            "≤ 0.1",
            max(column("wrong_m")) <= 0.1,
        ),
        Figure(
            f"… FDM and odometer, processor time a pair, the least of {TIMED}: mean",
            str(mean),
            at_most(6.0),
            mean.is_at_most(6.0),
        ),
        Figure("… worst", str(worst), at_most(20.0), worst.is_at_most(20.0)),
        Figure(
            "… the better of the controls (no motion; constant velocity), ATE, %",
            f"{controls:.1f}",
            f"> {bar}",
            controls > bar,
        ),
    ]


def real(progress: Progress) -> list[Figure]:
    """The bars on pictures that are not ours, and the peer."""
    if not IMAGES.is_dir():
        return [Figure("pictures", "not on this machine", "there", is_met=False)]
    rest = progress.part("rest", at_rest)
    figures = [Figure("EuRoC at rest, 40 pairs: largest drift, mm", f"{rest:.2f}", "≤ 3", rest <= 3.0)]
    for velocity in ((0.2, 0.0, 0.0), (0.0, 0.0, 0.2), (0.1, 0.1, -0.1414)):
        progress.report(f"EuRoC moved by {velocity}")
        speed = progress.part(f"moved {velocity}", partial(moving, velocity))
        figures.append(
            Figure(
                f"EuRoC warped by its depth to {velocity} m/s (right, down, ahead): speed, m/s",
                f"{speed:.4f}",
                "0.2 ± 3 %",
                abs(speed / 0.2 - 1.0) <= 0.03,
            )
        )
    mean, worst = progress.part("mono", mono)
    figures += [
        Figure(
            "KITTI, one camera: error of the turn from picture to picture, rms, degrees",
            f"{mean:.3f}",
            "≤ 0.1",
            mean <= 0.1,
        ),
        Figure("… largest", f"{worst:.3f}"),
    ]
    return figures + peers(progress) + (public(progress) if PEER.is_file() else [])


def at_rest() -> float:
    """Farthest from the begin, in mm."""
    estimate, _ = run_stereo(read_stereo_set(IMAGES / "euroc_rest"))
    return float(1e3 * np.linalg.norm(estimate.position_m - estimate.position_m[0], axis=1).max())


def moving(velocity: tuple[float, float, float]) -> float:
    """The speed that the odometer tells."""
    left, right, *_ = rectified(IMAGES / "euroc_rest")
    odometer, chain = StereoOdometer(left, right), OdometryChain()
    found = [
        (t_s, follow(chain, odometer.update(one, other, t_s)))
        for t_s, one, other in drive(IMAGES / "euroc_rest", np.array(velocity), every=2)
    ]
    (begin_s, begin), (end_s, end) = found[0], found[-1]
    return float(np.linalg.norm(end - begin)) / (end_s - begin_s)


def mono() -> tuple[float, float]:
    """Errors of the turns between pictures: root mean square, and largest."""
    estimate, _ = run_mono(read_mono_set(IMAGES / "kitti_mono"))
    truth = read_trajectory(IMAGES / "kitti_mono" / "poses.txt")
    _, turns = relative_errors(estimate, truth, steps(truth))
    return float(np.sqrt(np.mean(turns**2))), float(turns.max())


def peers(progress: Progress) -> list[Figure]:
    """Ours and libviso2 on the same rectified pictures of the hold."""
    if not PEER.is_file():
        return [Figure("libviso2", "not run: GLOC3_VISO2 names no program", "there", is_met=False)]
    figures = []
    for seed in (0, 1):
        progress.report(f"libviso2, seed {seed}")
        ours, theirs = progress.part(f"peer {seed}", partial(against_peer, seed))
        for key, what in (
            ("ate", "ATE, % of the path"),
            ("relative", "relative error over 10 m, %"),
            ("ms", "processor time a pair, ms"),
        ):
            figures.append(
                Figure(
                    f"rendered, rectified, 40 m, seed {seed}: {what}",
                    f"ours {ours[key]:.3f}, libviso2 {theirs[key]:.3f}",
                    "ours ≤ libviso2's",
                    ours[key] <= theirs[key],
                )
            )
    return figures


def against_peer(seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Figures of both; libviso2 with subpixel refinement, with which it is best."""
    path, frames = inspection(seed, length_m=40.0), SCRATCH / f"stereo-{seed}.bin"
    with frames.open("wb") as file:

        def kept() -> Iterator[Pair]:
            for pair in fly(path, "hold", seed, (LEFT, RIGHT)):
                file.write(pair.left.tobytes() + pair.right.tobytes())
                yield pair

        trial = Trial(path, kept(), (LEFT, RIGHT))
    ours = _errors(trial.estimate, path, float(np.mean(trial.costs_ms[WARMED_UP:])))
    numbers = np.array([[float(word) for word in line.split()] for line in _drive_peer(frames).splitlines()])
    frames.unlink()
    poses = numbers[:, :12].reshape(-1, 3, 4)
    lever, turn = np.array(LEFT.position_frd_m), matrix(LEFT.frd_from_rdf)
    truth = Trajectory(
        t_s=path.t_s,
        position_m=path.position_m + path.world_from_body @ lever,
        world_from_body=path.world_from_body @ turn,
    )
    estimate = Trajectory(t_s=path.t_s, position_m=poses[:, :, 3], world_from_body=poses[:, :, :3])
    return ours, _errors(estimate, truth, float(numbers[WARMED_UP:, 13].mean()))


def _errors(estimate: Trajectory, truth: Trajectory, cost_ms: float) -> dict[str, float]:
    found = evaluate(estimate, truth)
    relative = found.relative_m.rms if found.relative_m is not None else float("nan")
    return {"ate": 100.0 * found.absolute_share, "relative": 10.0 * relative, "ms": cost_ms}


def _drive_peer(frames: Path) -> str:
    focal, (column, row) = LEFT.focal_px[0], LEFT.center_px
    words = [LEFT.width, LEFT.height, focal, column, row, 0.15, 1, 2]
    command = [str(PEER), str(frames), *map(str, words)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def public(progress: Progress) -> list[Figure]:
    """Ours, libviso2 and a plain odometer on public sets, as they are and spoiled in seven ways."""
    there = [name for name in SETS if (STEREO / name).is_dir()]
    figures = [Figure("public sets with truth at hand", f"{len(there)}", f"≥ {LEAST_SETS}", len(there) >= LEAST_SETS)]
    for name, what in SETS.items():
        if name not in there:
            figures.append(Figure(what, "not at hand"))
            continue
        for how in SPOILED:
            progress.report(f"{name}, {how}")
            figures += _beside(f"{what}, {how}", *progress.part(f"{name} {how}", partial(beside, name, how)))
    return figures


def beside(name: str, how: str) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Figures of ours, libviso2's and the plain odometer's."""
    cv2.setNumThreads(1)
    drive = SPOILED[how](read_drive(name))
    return ours(drive), libviso2(drive, PEER), plain(drive)


def _beside(name: str, own: dict[str, float], peer: dict[str, float], simple: dict[str, float]) -> list[Figure]:
    def all_three(key: str) -> str:
        return f"ours {own[key]:.2f}, libviso2 {peer[key]:.2f}, plain {simple[key]:.2f}"

    return [
        Figure(f"{name}: error at the end, %", all_three("end"), "ours ≤ libviso2's", own["end"] <= peer["end"]),
        Figure("… rms on the way, %", all_three("ate")),
        Figure(
            "… processor time a pair, ms", all_three("ms"), "ours ≤ 1.5 × libviso2's", own["ms"] <= 1.5 * peer["ms"]
        ),
        Figure(
            "… ours: valid; normalised squared error; beyond the 95 % bound",
            f"{own['valid']:.0%}; {own['square']:.2f}; {own['beyond']:.0%}",
            "squared error 0.05 to 2",
            0.05 <= own["square"] <= 2.0,
        ),
    ]


BARS = (
    Bar(
        "stereo-odometry",
        "Stereo odometry in the hold drifts by at most 0.3 % of the path",
        "Alone, the stereo odometer stays within 0.3 % of a 60 m inspection flight, and within 1.5 % where lamps, "
        "dust, blur, jumps of the exposure, repeated plates and a bare wall make it hard. It reports when it cannot "
        "measure.",
        flights,
        seeds="0 to 9",
    ),
    Bar(
        "stereo-real",
        "On public data sets stereo odometry is accurate, and in the hold it is ahead of libviso2",
        "At rest the odometer reports no motion. Real pictures that are warped to a motion give that motion. A single "
        "camera gives the turns of a car. On pictures of the hold the odometer is ahead of libviso2.",
        real,
        seeds="0 and 1",
    ),
)
