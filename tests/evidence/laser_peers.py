"""Other people's scan matchers, run in an environment of their own: `python laser_peers.py IN.npz OUT.npz`.

IN holds scans as points (`points`, one below the other; `begins`), and either pairs to match (`guesses` are unused, each
scan is matched to the one before) or a drive. OUT gets, for each matcher, poses or motions (x, y, heading; y to the left
or right as in IN) and the processor time of each.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

FARTHEST_M = 1.0
FINEST_M = 0.01


def matrix(motion: Any) -> Any:
    """Of a motion in the plane, 4 by 4."""
    x, y, heading = motion
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def motion_of(whole: Any) -> Any:
    """The other way round."""
    return np.array([whole[0, 3], whole[1, 3], np.arctan2(whole[1, 0], whole[0, 0])])


def small_gicp(kind: str) -> Callable[[Any, Any, Any], Any]:
    """One of small_gicp's registrations, of a scan to another."""
    import small_gicp as library

    def match(target: Any, source: Any, guess: Any) -> Any:
        found = library.align(
            target,
            source,
            matrix(guess),
            registration_type=kind,
            downsampling_resolution=FINEST_M,
            max_correspondence_distance=FARTHEST_M,
            max_iterations=50,
        )
        return motion_of(found.T_target_source)

    return match


def pairwise(match: Callable[[Any, Any, Any], Any], scans: list[Any], guesses: Any) -> Iterator[tuple[Any, float]]:
    """A drive, scan to scan: the pose after each; not-a-number as guess stands for the motion before."""
    pose, before = np.eye(4), np.zeros(3)
    yield np.zeros(3), 0.0
    for last, scan, guess in zip(scans[:-1], scans[1:], guesses[1:], strict=True):
        begin_s = time.process_time()
        before = match(last, scan, before if np.isnan(guess).any() else guess)
        cost_s = time.process_time() - begin_s
        pose = pose @ matrix(before)
        yield motion_of(pose), cost_s


def kiss(scans: list[Any], guesses: Any) -> Iterator[tuple[Any, float]]:
    """A drive by KISS-ICP's own pipeline and map."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.deskew, config.data.max_range, config.mapping.voxel_size = False, 40.0, 0.2
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    for scan, guess in zip(scans, guesses, strict=True):
        if not np.isnan(guess).any():
            odometry.last_delta = matrix(guess)
        begin_s = time.process_time()
        odometry.register_frame(scan, np.zeros(len(scan)))
        yield motion_of(odometry.last_pose), time.process_time() - begin_s


def main(given: Path, out: Path) -> None:
    """Runs every matcher on what is given."""
    data = np.load(given)
    scans = [np.column_stack((part, np.zeros(len(part)))) for part in np.split(data["points"], data["begins"][1:])]
    results: dict[str, Any] = {}
    for name, kind in (("small_gicp ICP", "ICP"), ("small_gicp GICP", "GICP")):
        match = small_gicp(kind)
        if "is_pairs" in data:
            found = []
            for target, source in zip(scans[::2], scans[1::2], strict=True):
                begin_s = time.process_time()
                found.append((match(target, source, np.zeros(3)), time.process_time() - begin_s))
        else:
            found = list(pairwise(match, scans, data["guesses"]))
        results[name] = np.array([pose for pose, _ in found])
        results[f"{name} s"] = np.array([cost_s for _, cost_s in found])
    if "is_pairs" not in data:
        found = list(kiss(scans, data["guesses"]))
        results["KISS-ICP"] = np.array([pose for pose, _ in found])
        results["KISS-ICP s"] = np.array([cost_s for _, cost_s in found])
    np.savez(out, **results)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
