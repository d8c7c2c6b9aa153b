"""Place and time of a camera on an inertial unit: by a board that is seen while both are moved.

The turn between pictures is the gyros' (rotation, time and bias follow); the second difference of the positions is the
accelerometers' double integral (place, gravity and bias follow, linearly). Standard deviations are by the jackknife over time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.gyro_turns import GyroTurns
from gloc3_onboard.algorithms.calibration.time_offset import STAMP_STD_S, jackknife_std, rate_offset

MOST_OFFSET_S: Final = 0.5
WINDOW_S: Final = 0.25
"""Between pictures that are compared."""
MOST_GAP: Final = 1.5
"""Of windows in which pictures lack a board, as a multiple."""
LEAST_PICTURES: Final = 30
TURN_OUTLIER_RAD: Final = 0.01
SCALE: Final = 1e-3
STEP: Final = 1e-5
MOST_ROUNDS: Final = 12
BAD_TIMES: Final = 5.0
"""A window that fits so many times worse than the median is left out."""


@dataclass(frozen=True, kw_only=True)
class CameraMotion:
    """Poses of a camera by a board."""

    times_s: Floats
    """(n,)."""
    turns: Any
    """`board_from_camera`, n of scipy's `Rotation`."""
    positions_m: Floats
    """Of the camera on the board's axes, (n, 3)."""


@dataclass(frozen=True, kw_only=True)
class ImuMotion:
    """Samples of an inertial unit."""

    times_s: Floats
    rates_rad_s: Floats
    """(n, 3)."""
    forces_m_s2: Floats
    """Specific forces, (n, 3)."""


@dataclass(frozen=True, kw_only=True)
class CameraImuFit:
    """A camera on an inertial unit, as it was calibrated."""

    offset_s: float
    """The time of a picture on the unit's clock is its own plus this."""
    offset_std_s: float
    camera_from_imu: Any
    """Rotation, scipy's `Rotation`."""
    turn_std_rad: Floats
    """(3,), on the camera's axes."""
    imu_in_camera_m: Floats
    """Place of the unit on the camera's axes, (3,)."""
    place_std_m: Floats
    gyro_bias_rad_s: Floats
    force_bias_m_s2: Floats
    gravity_m_s2: float
    """Strength, as it follows: a check of the board's measures."""
    correlation: float
    """Of the rates, at the first guess."""
    turn_residuals_rad: Floats
    """Of each window, (n, 3)."""
    place_residuals_m_s: Floats
    """Of each window, (n, 3): a change of velocity."""
    window_times_s: Floats
    spreads_rad_s: Floats
    """Standard deviations of the turn rates along their principal axes, largest first."""


def fit_camera_imu(camera: CameraMotion, imu: ImuMotion) -> CameraImuFit:
    """Calibrates a camera on an inertial unit.

    Raises:
        Refused: there are too few pictures, or they do not overlap with the unit's samples.
    """
    if len(camera.times_s) < LEAST_PICTURES:
        raise Refused(f"{len(camera.times_s)} pictures with a board are too few: {LEAST_PICTURES} are the least")
    gaps_s = np.diff(camera.times_s)
    rates = np.linalg.norm((camera.turns[:-1].inv() * camera.turns[1:]).as_rotvec(), axis=1) / gaps_s
    middle_s = 0.5 * (camera.times_s[1:] + camera.times_s[:-1])
    guess = rate_offset(middle_s, rates, imu.times_s, np.linalg.norm(imu.rates_rad_s, axis=1), MOST_OFFSET_S)
    turning = _Turning(camera, imu)
    begin = np.concatenate(([guess.offset_s], np.zeros(3), turning.rough(guess.offset_s)))
    best, slopes, lacks = turning.solve(begin)
    std = jackknife_std(len(turning.firsts), partial(_step, slopes, lacks))
    place = _Placing(camera, imu, best)
    found, residuals, kept = place.solve_well()
    place_std = jackknife_std(int(kept.sum()), lambda chosen: place.solve(np.flatnonzero(kept)[chosen]))
    from scipy.spatial.transform import Rotation

    return CameraImuFit(
        offset_s=float(best[0]),
        offset_std_s=float(np.hypot(std[0], STAMP_STD_S)),
        camera_from_imu=Rotation.from_rotvec(best[4:]),
        turn_std_rad=std[4:],
        imu_in_camera_m=found[:3],
        place_std_m=place_std[:3],
        gyro_bias_rad_s=best[1:4],
        force_bias_m_s2=found[3:6],
        gravity_m_s2=float(np.linalg.norm(found[6:])),
        correlation=guess.correlation,
        turn_residuals_rad=turning.residuals(best).reshape(-1, 3),
        place_residuals_m_s=residuals,
        window_times_s=camera.times_s[turning.firsts],
        spreads_rad_s=np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(imu.rates_rad_s.T))[::-1], 0.0)),
    )


def _step(slopes: Floats, lacks: Floats, chosen: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> Floats:
    """How the solution changes if only some windows count, to first order."""
    rows = np.repeat(chosen, 3)
    found, *_ = np.linalg.lstsq(slopes[rows], -lacks[rows], rcond=None)
    return np.asarray(found, np.float64)


class _Turning:
    """Turns of the camera and of the gyros over windows; unknown are offset, gyro bias, and rotation `camera_from_imu`."""

    def __init__(self, camera: CameraMotion, imu: ImuMotion) -> None:
        self._camera, self._imu = camera, imu
        lasts = np.searchsorted(camera.times_s, camera.times_s + WINDOW_S - 1e-9)
        is_whole = lasts < len(camera.times_s)
        lasts = np.minimum(lasts, len(camera.times_s) - 1)
        is_whole &= camera.times_s[lasts] - camera.times_s < MOST_GAP * WINDOW_S
        margin_s = 2.0 * MOST_OFFSET_S
        is_whole &= (camera.times_s > imu.times_s[0] + margin_s) & (camera.times_s[lasts] < imu.times_s[-1] - margin_s)
        self.firsts, self.lasts = np.flatnonzero(is_whole), lasts[is_whole]
        if len(self.firsts) < LEAST_PICTURES:
            raise Refused(
                f"{len(self.firsts)} stretches of {WINDOW_S:g} s show the board throughout, {LEAST_PICTURES} are the least: "
                "keep the board in the picture, and take 10 pictures a second or more"
            )
        self._seen = camera.turns[self.firsts].inv() * camera.turns[self.lasts]

    def rough(self, offset_s: float) -> Floats:
        """Rotation vector of `camera_from_imu` that turns the gyros' turns into the camera's best (Kabsch)."""
        from scipy.spatial.transform import Rotation

        felt = self._felt(offset_s, np.zeros(3))
        found, _ = Rotation.align_vectors(self._seen.as_rotvec(), felt.as_rotvec())
        return np.asarray(found.as_rotvec())

    def _felt(self, offset_s: float, bias_rad_s: Floats) -> Any:
        turns = GyroTurns(self._imu.times_s, self._imu.rates_rad_s, bias_rad_s)
        times_s = self._camera.times_s + offset_s
        return turns.at(times_s[self.firsts]).inv() * turns.at(times_s[self.lasts])

    def residuals(self, x: Floats) -> Floats:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_rotvec(x[4:])
        felt = turn * self._felt(float(x[0]), x[1:4]) * turn.inv()
        return np.asarray((felt.inv() * self._seen).as_rotvec()).ravel()

    def solve(self, begin: Floats) -> tuple[Floats, Floats, Floats]:
        """The solution, with slopes and residuals there as they count: fewer where a window does not fit."""
        from scipy.optimize import least_squares

        found = least_squares(
            self.residuals,
            begin,
            loss="soft_l1",
            f_scale=TURN_OUTLIER_RAD,
            x_scale=SCALE,
            diff_step=1e-6,
            max_nfev=MOST_ROUNDS,
        )
        steps = np.diag(STEP * np.ones(len(begin)))
        here = self.residuals(found.x)
        slopes = np.column_stack([(self.residuals(found.x + step) - here) / STEP for step in steps])
        weight = (1.0 + (here / TURN_OUTLIER_RAD) ** 2) ** -0.25
        return np.asarray(found.x), slopes * weight[:, None], here * weight


class _Placing:
    """Second differences of positions over two windows; unknown, and linear, are place, bias of force, and gravity."""

    def __init__(self, camera: CameraMotion, imu: ImuMotion, turning: Floats) -> None:
        from scipy.spatial.transform import Rotation

        times_s, offset_s = camera.times_s, float(turning[0])
        turns = GyroTurns(imu.times_s, imu.rates_rad_s, turning[1:4])
        camera_from_imu = Rotation.from_rotvec(turning[4:])
        from_begin = turns.at(imu.times_s)
        axes = camera.turns.as_matrix()
        rows, sides = [], []
        for first in range(len(times_s)):
            middle, last = np.searchsorted(times_s, times_s[first] + WINDOW_S * np.array([1.0, 2.0]) - 1e-9)
            if last >= len(times_s) or times_s[last] - times_s[first] > 2.0 * MOST_GAP * WINDOW_S:
                continue
            t0, t1, t2 = times_s[[first, middle, last]] + offset_s
            inside = slice(*np.searchsorted(imu.times_s, [t0, t2]))
            felt_s = imu.times_s[inside]
            if len(felt_s) < 4 or not t0 < t1 < t2 or t0 < imu.times_s[0] or t2 > imu.times_s[-1]:
                continue
            before_s, after_s = t1 - t0, t2 - t1
            weight = np.where(felt_s < t1, (felt_s - t0) / before_s, (t2 - felt_s) / after_s)
            weight *= np.gradient(felt_s)
            weight *= 0.5 * (before_s + after_s) / weight.sum()
            anchor = camera.turns[middle] * camera_from_imu * turns.at(np.array([t1]))[0].inv()
            board_from_imu = (anchor * from_begin[inside]).as_matrix()
            change = (axes[last] - axes[middle]) / after_s - (axes[middle] - axes[first]) / before_s
            moved = (camera.positions_m[last] - camera.positions_m[middle]) / after_s
            moved = moved - (camera.positions_m[middle] - camera.positions_m[first]) / before_s
            turned = np.einsum("n,nij->ij", weight, board_from_imu)
            felt = np.einsum("n,nij,nj->i", weight, board_from_imu, imu.forces_m_s2[inside])
            rows.append(np.hstack((change, turned, -weight.sum() * np.eye(3))))
            sides.append(felt - moved)
        self._rows, self._sides = np.array(rows), np.array(sides)

    def solve(self, chosen: Any) -> Floats:
        found, *_ = np.linalg.lstsq(self._rows[chosen].reshape(-1, 9), self._sides[chosen].ravel(), rcond=None)
        return np.asarray(found)

    def solve_well(self) -> tuple[Floats, Floats, Any]:
        """The solution without windows that do not fit, the residuals of those that do, and which they are."""
        kept = np.ones(len(self._rows), bool)
        for _ in range(3):
            found = self.solve(kept)
            lacks = self._sides - self._rows @ found
            away = np.linalg.norm(lacks, axis=1)
            kept = away <= BAD_TIMES * float(np.median(away))
        return found, lacks[kept], kept


def motion_of(times_s: Sequence[float], poses: Floats) -> CameraMotion:
    """A camera's motion from the poses of a board in its pictures.

    Args:
        times_s: of the pictures.
        poses: rotation vectors and translations of `camera_from_board`, (n, 6).
    """
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(poses[:, :3]).inv()
    return CameraMotion(times_s=np.asarray(times_s, float), turns=turns, positions_m=-turns.apply(poses[:, 3:]))
