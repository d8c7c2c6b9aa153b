"""The laser odometer in the hold and in a corridor: drift, honesty, and what it says where the walls tell nothing."""

from functools import partial
from itertools import pairwise
from math import pi
from typing import Any, Final

import numpy as np
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.algorithms.scan_matching.rays import CORRIDOR, Scanner, flight

from gloc3.messages.frames import from_euler, rotate, wrap_pi
from gloc3.messages.perception import UNKNOWN_VARIANCE, LaserScan
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserOdometer
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Tilt
from gloc3_sitl.world.world import World

SEEDS: Final = 10
BEAMS: Final = 360
DROP_OUT: Final = 0.002
TILT_NOISE_RAD: Final = 0.003
CHI_95: Final = (2.6, 3.4)
"""Mean of the squared normalised errors, three degrees of freedom, that would be exactly honest; below is careful."""


class Sight:
    """A scanner in one of the simulator's worlds, without a simulator."""

    def __init__(self, world: str, range_max_m: float, noise_m: float) -> None:
        self._geometry = World.load(world).geometry
        self._range_max_m, self._noise_m = range_max_m, noise_m
        self._angles = -pi + 2.0 * pi / BEAMS * np.arange(BEAMS)

    def scan(self, pose: Planar, random: np.random.Generator, tilt: Tilt, t_s: float) -> LaserScan:
        """One turn, all beams at once; the world has x north, y west and z up."""
        ned_from_frd = from_euler(tilt.roll_rad, tilt.pitch_rad, pose.yaw_rad)
        axes = np.array([rotate(ned_from_frd, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
        rays = np.column_stack((np.cos(self._angles), -np.sin(self._angles))) @ axes * (1.0, -1.0, -1.0)
        origins = np.tile((pose.x_m, -pose.y_m, tilt.height_m or 0.0), (BEAMS, 1))
        ranges = self._geometry.ranges(origins, rays, t_s) + random.normal(0.0, self._noise_m, BEAMS)
        is_seen = (ranges < self._range_max_m) & (random.random(BEAMS) >= DROP_OUT)
        return LaserScan(
            scanner="laser",
            angle_min_rad=-pi,
            angle_step_rad=2.0 * pi / BEAMS,
            range_min_m=0.1,
            range_max_m=self._range_max_m,
            ranges_m=np.where(is_seen, ranges, self._range_max_m).astype("<f4").tobytes(),
        )


def fly(
    seed: int, range_max_m: float = 30.0, noise_m: float = 0.01, world: str = "hold", length_m: float = 60.0
) -> dict[str, Any]:
    """One flight along the walls of a hold."""
    random, odometer = np.random.default_rng(seed), LaserOdometer()
    sight = Sight(world, range_max_m, noise_m)
    true: dict[float, Planar] = {}
    found, squares, degenerate, unsaid = [], [], 0, 0.0
    for t_s, pose, tilt in flight(length_m):
        roll, pitch = random.normal(0.0, TILT_NOISE_RAD, 2).tolist()
        seen = Tilt(tilt.roll_rad + roll, tilt.pitch_rad + pitch, tilt.height_m)
        true[t_s] = pose
        motion = odometer.update(sight.scan(pose, random, tilt, t_s), t_s, seen)
        found.append(motion.pose)
        if motion.is_valid:
            real = true[motion.reference_t_s].inverse() @ pose
            off = np.subtract(motion.motion, real)
            off[2] = wrap_pi(float(off[2]))
            squares.append(float(off @ np.linalg.solve(motion.covariance, off)))
            degenerate += motion.is_degenerate
            if not motion.is_degenerate:
                unsaid = max(unsaid, float(np.hypot(*off[:2])))
    poses = list(true.values())
    errors = [
        (poses[0].inverse() @ pose).inverse() @ (found[0].inverse() @ at) for pose, at in zip(poses, found, strict=True)
    ]
    steps = [(a.inverse() @ b).distance_m for a, b in pairwise(poses)]
    step = poses[0].inverse() @ poses[1]
    constant = Planar()
    for _ in poses[1:]:
        constant = constant @ step
    controls = [(at.inverse() @ (poses[0].inverse() @ poses[-1])).distance_m for at in (Planar(), constant)]
    return {
        "controls": [100.0 * off_m / sum(steps) for off_m in controls],
        "drift": 100.0 * errors[-1].distance_m / sum(steps),
        "rms_m": float(np.sqrt(np.mean([error.distance_m**2 for error in errors]))),
        "square": float(np.mean(squares)),
        "inside": float(np.mean(np.array(squares) < 7.81)),
        "degenerate": 100.0 * degenerate / len(squares),
        "unsaid_m": unsaid,
    }


def corridor(seed: int) -> dict[str, float]:
    """Along a corridor without ends: variance along over variance across, the smallest of the flight."""
    random, odometer, ratios = np.random.default_rng(seed), LaserOdometer(), []
    across_m = 0.0
    for number in range(60):
        pose = Planar(0.08 * number, 0.1 * np.sin(0.1 * number), 0.05 * np.sin(0.2 * number))
        motion = odometer.update(Scanner(CORRIDOR).scan(pose, random), 0.1 * number)
        if motion.is_valid:
            values = np.linalg.eigvalsh(motion.covariance[:2, :2])
            ratios.append(float(values[1] / values[0]))
            across_m = max(across_m, float(abs(motion.pose.y_m - pose.y_m)))
    return {"ratio": min(ratios), "across_m": across_m, "along_m2": float(values[1])}


def hold(progress: Progress) -> list[Figure]:
    """Bar 1, the laser, and bar 5, the corridor."""
    runs = [progress.part(f"hold {seed}", partial(fly, seed)) for seed in range(1, SEEDS + 1)]
    rough = [progress.part(f"rough {seed}", partial(fly, seed, noise_m=0.03)) for seed in range(1, 4)]
    busy = [progress.part(f"busy {seed}", partial(fly, seed, world="hold_busy")) for seed in range(1, 4)]
    short = [progress.part(f"short {seed}", partial(fly, seed, range_max_m=5.6)) for seed in range(1, 4)]
    bare = [progress.part(f"corridor {seed}", partial(corridor, seed)) for seed in range(1, 6)]
    drift = max(run["drift"] for run in runs)
    square, inside = (float(np.mean([run[key] for run in runs])) for key in ("square", "inside"))
    share = min(run["degenerate"] for run in short)
    unsaid_m = max(run["unsaid_m"] for run in short)
    honest = min(run["inside"] for run in short)
    ratio = min(run["ratio"] for run in bare)
    along = min(run["along_m2"] for run in bare)
    return [
        Figure(
            "60 m, 30 m range, 10 mm noise: drift at the end, worst seed", f"{drift:.3f} %", "≤ 0.2 %", drift <= 0.2
        ),
        Figure("error RMS, worst seed", f"{1e3 * max(run['rms_m'] for run in runs):.1f} mm"),
        Figure(
            "normalised error squared, mean (3 where exact)", f"{square:.2f}", f"≤ {CHI_95[1]}", square <= CHI_95[1]
        ),
        Figure("errors inside their 95 % bounds", f"{100 * inside:.1f} %", "≥ 95 %", inside >= 0.95),
        Figure("the same with 30 mm noise: drift, worst", f"{max(run['drift'] for run in rough):.3f} %"),
        Figure(
            "the same among boxes (hold_busy): drift, worst",
            f"{max(run['drift'] for run in busy):.3f} %",
            "≤ 0.2 %",
            max(run["drift"] for run in busy) <= 0.2,
        ),
        Figure("5.6 m range: scans told degenerate, least", f"{share:.0f} %", "> 20 %", share > 20.0),
        Figure(
            "5.6 m range: largest error of a motion that was not told degenerate",
            f"{1e3 * unsaid_m:.0f} mm",
            "≤ 100 mm",
            unsaid_m <= 0.1,
        ),
        Figure(
            "5.6 m range: errors inside their 95 % bounds, least", f"{100 * honest:.1f} %", "≥ 95 %", honest >= 0.95
        ),
        Figure("corridor: variance along over across, least", f"{ratio:.3g}", "≥ 10", ratio >= 10.0),
        Figure("corridor: variance along, least", f"{along:.3g} m²", "unknown", along > 0.5 * UNKNOWN_VARIANCE),
        Figure(
            "corridor: error across, largest",
            f"{1e3 * max(run['across_m'] for run in bare):.1f} mm",
            "≤ 20 mm",
            max(run["across_m"] for run in bare) <= 0.02,
        ),
        *(
            Figure(f"control, {name}: drift, least", f"{least:.0f} %", "fails 0.2 %", least > 0.2)
            for name, least in zip(
                ("nothing moves", "constant velocity"),
                [min(run["controls"][index] for run in runs) for index in (0, 1)],
                strict=True,
            )
        ),
    ]


BARS = (
    Bar(
        "laser-flight",
        "In flight the laser odometer drifts by at most 0.2 % and reports what it cannot measure",
        "360 beams at 10 Hz measure the walls of the hold while the vehicle rolls and pitches by 5°, with an attitude "
        "known to 0.2°. The rows give the drift, and whether the errors match the covariance. Where the walls do not "
        "determine a direction, the covariance shows it.",
        hold,
        seeds=f"1 to {SEEDS}",
    ),
)
