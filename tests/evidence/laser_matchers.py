"""What the laser odometer is compared with: a plain matcher, other people's, and two that do not look at all."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from tests.evidence.page import ROOT, SCRATCH

from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

PEERS: Final = ("small_gicp==1.0.1", "kiss-icp==1.3.0")
STEPS: Final = 30


class Run(NamedTuple):
    """The poses (or motions) of one matcher, and its processor time for each."""

    poses: list[Planar]
    costs_ms: list[float]


def plain_match(target: Array, source: Array, guess: Planar) -> Planar:
    """Point to line as in any text book: nearest points, normals of five neighbours, trimmed, until nothing moves."""
    tree = cKDTree(target)
    _, near = tree.query(target, k=5)
    group = target[near] - target[near].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", group, group))
    normals, pose = vectors[:, :, 0], guess
    for _ in range(STEPS):
        turned = source @ pose.rotation().T
        here = np.array((pose.x_m, pose.y_m))
        distance, index = tree.query(turned + here, distance_upper_bound=1.0)
        kept = np.isfinite(distance)
        kept &= distance <= np.quantile(distance[kept], 0.9) if kept.any() else False
        if np.count_nonzero(kept) < 6:
            return pose
        n, p = normals[index[kept]], turned[kept]
        off = np.sum(n * (p + here - target[index[kept]]), axis=1)
        jacobian = np.column_stack((n, n[:, 1] * p[:, 0] - n[:, 0] * p[:, 1]))
        step = np.linalg.lstsq(jacobian, -off, rcond=None)[0]
        pose = Planar(pose.x_m + float(step[0]), pose.y_m + float(step[1]), wrap_pi(pose.yaw_rad + float(step[2])))
        if float(np.abs(step).max()) < 1e-5:
            break
    return pose


def plain_drive(scans: Sequence[Array], guesses: Sequence[Planar | None]) -> Run:
    """Scan to scan."""
    poses, costs_ms, last = [Planar()], [0.0], Planar()
    for before, scan, guess in zip(scans[:-1], scans[1:], guesses[1:], strict=True):
        begin_s = time.process_time()
        last = plain_match(before, scan, guess or last)
        costs_ms.append(1e3 * (time.process_time() - begin_s))
        poses.append(poses[-1] @ last)
    return Run(poses, costs_ms)


def zero_drive(count: int) -> Run:
    """A control: nothing ever moves."""
    return Run([Planar()] * count, [0.0] * count)


def constant_drive(truth: Sequence[Planar]) -> Run:
    """A control: the first true motion goes on for ever."""
    step, poses = truth[0].inverse() @ truth[1], [Planar()]
    for _ in truth[1:]:
        poses.append(poses[-1] @ step)
    return Run(poses, [0.0] * len(poses))


def peers(scans: Sequence[Array], guesses: Sequence[Planar | None] | None) -> dict[str, Run]:
    """Other people's matchers, in an environment of their own: a drive, or, without guesses, scans in pairs."""
    python = _environment()
    arrays = {"points": np.concatenate(scans), "begins": np.cumsum([0, *map(len, scans)])[:-1]}
    if guesses is None:
        arrays["is_pairs"] = np.ones(1)
    else:
        arrays["guesses"] = np.array([guess or (np.nan, np.nan, np.nan) for guess in guesses])
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(given, **arrays)  # type: ignore[arg-type]
        subprocess.run([python, str(Path(__file__).with_name("laser_peers.py")), given, out], check=True)
        found = dict(np.load(out))
    names = [name for name in found if not name.endswith(" s")]
    return {
        name: Run([Planar(*map(float, pose)) for pose in found[name]], (1e3 * found[f"{name} s"]).tolist())
        for name in names
    }


def _environment() -> str:
    """Made once; the project itself does not need these packages."""
    folder = SCRATCH / "peers"
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, cwd=ROOT)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", *PEERS], check=True, cwd=ROOT)
    return str(python)
