"""`gloc3 calibrate laser-imu`: time of a range scanner on the inertial unit, from a log of a vehicle that is turned."""

from pathlib import Path
from typing import Final

import numpy as np

from gloc3.camera.opencv import load_opencv
from gloc3.errors import Finding, InputError
from gloc3.messages.perception import ImuSample, LaserScan
from gloc3_onboard.algorithms.calibration.laser_imu_fit import LaserImuFit, fit_laser_imu
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserOdometer
from gloc3_onboard.calibrating.camera_imu import imu_motion
from gloc3_onboard.calibrating.drawing import DiagramPanel, PanelSeries, svg
from gloc3_onboard.calibrating.outcome import CalibrationOutcome, OutcomeOptions, settle, today
from gloc3_onboard.calibrating.pictures import LOG
from gloc3_onboard.sensors.replay import topic_records

SECTION: Final = "laser"
MOST_OFFSET_STD_S: Final = 0.003
LEAST_CORRELATION: Final = 0.8
LEAST_RATE_RAD_S: Final = 0.1
"""Standard deviation of the yaw rate."""
MOST_SCALE_ERROR: Final = 0.03
MOST_UNMATCHED: Final = 0.1


def laser_imu(source: Path, /, *, laser: str = "laser", imu: str = "imu", options: OutcomeOptions | None = None) -> int:
    """Calibrate by how much the clocks of a range scanner and the inertial unit differ, and whether the scanner hangs upside down.

    Log both while you turn the vehicle to and fro about its down axis, briskly, level, for half a minute, in a room with
    walls. Turns do not show how the scanner is turned on the vehicle (`yaw_deg`): measure that.

    For example `gloc3 calibrate laser-imu runs/flight/log.mcap --rig laser.yaml --report laser.svg`.

    Args:
        source: A log of GLOC3 with both.
        laser: The scanner's topic.
        imu: The inertial unit's topic.
        options: Where to write the result: section laser.
    """
    options = options or OutcomeOptions()
    options.check()
    if source.suffix != LOG:
        raise InputError([Finding(file=str(source), message="this is no log of GLOC3", hint="logs end in .mcap")])
    samples = topic_records(source, imu, ImuSample)
    motion = imu_motion([record.log_s for record in samples], [record.load() for record in samples])
    scans = [(record.log_s, record.load()) for record in topic_records(source, laser, LaserScan)]
    times_s, yaws = match(scans)
    fit = fit_laser_imu(np.array(times_s), np.array(yaws), motion.times_s, motion.rates_rad_s[:, 2])
    return settle(
        CalibrationOutcome(
            lines=_lines(fit, len(times_s), len(scans)),
            sections={
                SECTION: {
                    "timeshift_laser_imu": fit.offset_s,
                    "is_flipped": fit.is_flipped,
                    "calibration": {
                        "date": today(),
                        "timeshift_std_s": float(f"{fit.offset_std_s:.2g}"),
                        "scale": round(fit.scale, 5),
                        "correlation": round(fit.correlation, 4),
                        "scans": len(times_s),
                    },
                }
            },
            doubts=doubts_of(fit, 1.0 - len(times_s) / len(scans)),
            drawing=svg(f"{SECTION} and inertial unit: {1e3 * fit.offset_s:.2f} ms", _panels(fit)),
            hints=[f"write {_options(fit)} into the scanner's source, such as hokuyo:///dev/ttyACM0?{_options(fit)}"],
        ),
        options,
    )


def _options(fit: LaserImuFit) -> str:
    """The options of the scanner's source that follow."""
    return f"time_shift_s={fit.offset_s:.4f}" + ("&is_flipped=1" if fit.is_flipped else "")


def match(scans: list[tuple[float, LaserScan]]) -> tuple[list[float], list[float]]:
    """Times and yaws of the scans that can be matched; a scan that cannot ends nothing: the odometer goes on from its map."""
    load_opencv()
    odometer = LaserOdometer()
    times_s, yaws = list[float](), list[float]()
    for t_s, scan in scans:
        motion = odometer.update(scan, t_s)
        if not motion.reason or not times_s:
            times_s.append(t_s)
            yaws.append(float(motion.pose.yaw_rad))
    return times_s, yaws


def doubts_of(fit: LaserImuFit, unmatched: float) -> list[str]:
    """Why a calibration is not trustworthy; empty if it is.

    Args:
        fit: the calibration.
        unmatched: share of the scans that could not be matched.
    """
    doubts = []
    if fit.rate_std_rad_s < LEAST_RATE_RAD_S:
        doubts.append(
            f"the vehicle was hardly turned ({fit.rate_std_rad_s:.2f} rad/s, {LEAST_RATE_RAD_S:g} is the least): turn it to and fro"
        )
    if fit.correlation < LEAST_CORRELATION:
        doubts.append(
            f"scanner and gyro agree to {fit.correlation:.0%} only, {LEAST_CORRELATION:.0%} is the least: are they on one body?"
        )
    if fit.offset_std_s > MOST_OFFSET_STD_S:
        doubts.append(f"the offset in time is known to {1e3 * fit.offset_std_s:.1f} ms only, 3 ms is the most")
    if abs(fit.scale - 1.0) > MOST_SCALE_ERROR:
        doubts.append(
            f"the scanner turns {fit.scale:.3f} times as far as the gyro: is the vehicle level, and the scanner?"
        )
    if unmatched > MOST_UNMATCHED:
        doubts.append(
            f"{unmatched:.0%} of the scans cannot be matched, {MOST_UNMATCHED:.0%} is the most: walls are missing"
        )
    return doubts


def _lines(fit: LaserImuFit, matched: int, count: int) -> list[str]:
    return [
        f"scans        {matched} of {count} matched",
        f"time         a scan's time on the unit's clock is its own {1e3 * fit.offset_s:+.3f} ± {1e3 * fit.offset_std_s:.3f} ms",
        f"scale        {fit.scale:.4f} ± {fit.scale_std:.4f}, turns of the scanner to those of the gyro",
        f"mounted      {'upside down' if fit.is_flipped else 'upright'}",
        f"gyro bias    {fit.gyro_bias_rad_s:.4f} rad/s",
        f"residuals    {np.degrees(np.sqrt((fit.residuals_rad**2).mean())):.3f} degrees (RMS over {len(fit.residuals_rad)} windows)",
    ]


def _panels(fit: LaserImuFit) -> list[DiagramPanel]:
    times = fit.window_times_s - fit.window_times_s[0]
    residuals = [PanelSeries("", times, np.degrees(fit.residuals_rad))]
    return [DiagramPanel("residuals of the turn", "time, s", "degrees", residuals)]
