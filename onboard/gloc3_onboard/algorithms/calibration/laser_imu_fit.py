"""Time of a range scanner on an inertial unit: the turns that scan matching finds against those that the gyro feels."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.time_offset import STAMP_STD_S, jackknife_std, rate_offset

MOST_OFFSET_S: Final = 0.5
WINDOW_S: Final = 0.3
LEAST_SCANS: Final = 50
OUTLIER_RAD: Final = 0.01


@dataclass(frozen=True, kw_only=True)
class LaserImuFit:
    """A scanner's time on an inertial unit, as it was calibrated."""

    offset_s: float
    """The time of a scan on the unit's clock is its own plus this."""
    offset_std_s: float
    gyro_bias_rad_s: float
    scale: float
    """Turns of the scans to those of the gyro."""
    scale_std: float
    is_flipped: bool
    """Whether the scanner is mounted upside down."""
    correlation: float
    residuals_rad: Floats
    """Of the turn over each window."""
    window_times_s: Floats
    rate_std_rad_s: float
    """Standard deviation of the yaw rate."""


def fit_laser_imu(times_s: Floats, yaws_rad: Floats, imu_s: Floats, rates_rad_s: Floats) -> LaserImuFit:
    """Calibrates a scanner's time on an inertial unit.

    Args:
        times_s: of the scans, increasing, (n,).
        yaws_rad: of the scanner by scan matching, clockwise seen from above, (n,).
        imu_s: of the gyro's samples, (m,).
        rates_rad_s: about the down axis, (m,).

    Raises:
        Refused: there are too few scans, or they do not overlap with the gyro's samples.
    """
    from scipy.optimize import least_squares

    if len(times_s) < LEAST_SCANS:
        raise Refused(f"{len(times_s)} scans that could be matched are too few: {LEAST_SCANS} are the least")
    yaws = np.unwrap(yaws_rad)
    middle_s = 0.5 * (times_s[1:] + times_s[:-1])
    guess = rate_offset(middle_s, np.diff(yaws) / np.diff(times_s), imu_s, rates_rad_s, MOST_OFFSET_S)
    sign = -1.0 if guess.correlation < 0.0 else 1.0
    felt = np.concatenate(([0.0], np.cumsum(0.5 * (rates_rad_s[1:] + rates_rad_s[:-1]) * np.diff(imu_s))))
    lasts = np.searchsorted(times_s, times_s + WINDOW_S - 1e-9)
    is_whole = (lasts < len(times_s)) & (times_s > imu_s[0] + MOST_OFFSET_S)
    lasts = np.minimum(lasts, len(times_s) - 1)
    is_whole &= (times_s[lasts] < imu_s[-1] - MOST_OFFSET_S) & (times_s[lasts] - times_s < 2.0 * WINDOW_S)
    firsts, lasts = np.flatnonzero(is_whole), lasts[is_whole]
    if len(firsts) < LEAST_SCANS:
        raise Refused(f"{len(firsts)} scans overlap with the gyro's samples, {LEAST_SCANS} are the least")
    turned, spans_s = sign * (yaws[lasts] - yaws[firsts]), times_s[lasts] - times_s[firsts]

    def residuals(x: Floats, chosen: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> Floats:
        by_gyro = _at(times_s[lasts[chosen]] + x[0], imu_s, felt, rates_rad_s)
        by_gyro -= _at(times_s[firsts[chosen]] + x[0], imu_s, felt, rates_rad_s)
        return np.asarray(turned[chosen] - x[2] * (by_gyro - x[1] * spans_s[chosen]))

    def solve(chosen: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]", begin: Floats) -> Floats:
        found = least_squares(
            residuals, begin, args=(chosen,), loss="soft_l1", f_scale=OUTLIER_RAD, x_scale=[1e-3, 1e-3, 1e-2]
        )
        return np.asarray(found.x)

    every = np.ones(len(firsts), bool)
    best = solve(every, np.array([guess.offset_s, 0.0, 1.0]))
    std = jackknife_std(len(firsts), lambda chosen: solve(chosen, best))
    return LaserImuFit(
        offset_s=float(best[0]),
        offset_std_s=float(np.hypot(std[0], STAMP_STD_S)),
        gyro_bias_rad_s=float(best[1]),
        scale=float(best[2]),
        scale_std=float(std[2]),
        is_flipped=sign < 0.0,
        correlation=abs(guess.correlation),
        residuals_rad=residuals(best, every),
        window_times_s=times_s[firsts],
        rate_std_rad_s=float(rates_rad_s.std()),
    )


def _at(times_s: Floats, imu_s: Floats, felt: Floats, rates: Floats) -> Floats:
    """The gyro's integral at any time, to second order between samples."""
    before = np.clip(np.searchsorted(imu_s, times_s, "right") - 1, 0, len(imu_s) - 2)
    since = times_s - imu_s[before]
    slope = (rates[before + 1] - rates[before]) / (imu_s[before + 1] - imu_s[before])
    return np.asarray(felt[before] + since * (rates[before] + 0.5 * slope * since))
