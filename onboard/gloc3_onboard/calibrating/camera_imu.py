"""`gloc3 calibrate camera-imu`: place and time of a camera on the inertial unit, from a log of a board that is seen moving."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gloc3.camera.model import CameraModel, misfit
from gloc3.cli.narration import narrate
from gloc3.errors import Finding, InputError, Refused
from gloc3.messages.perception import ImuSample
from gloc3_onboard.algorithms.calibration.boards import BoardView, CalibrationBoard, Floats
from gloc3_onboard.algorithms.calibration.camera_imu_fit import CameraImuFit, ImuMotion, fit_camera_imu, motion_of
from gloc3_onboard.algorithms.calibration.lens_fit import board_pose
from gloc3_onboard.calibrating.board_file import read_board
from gloc3_onboard.calibrating.drawing import DiagramPanel, PanelSeries, svg
from gloc3_onboard.calibrating.outcome import CalibrationOutcome, OutcomeOptions, settle, today
from gloc3_onboard.calibrating.pictures import LOG, find_boards, find_pictures
from gloc3_onboard.calibration.mounting import Transform, quaternion_of
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.calibration.rig_file import chain_from_imu, read_sections, rows_of
from gloc3_onboard.sensors.replay import topic_records
from gloc3_onboard.sensors.sources import euroc

MOST_OFFSET_STD_S: Final = 0.002
MOST_TURN_STD_DEG: Final = 0.5
MOST_PLACE_STD_M: Final = 0.01
LEAST_CORRELATION: Final = 0.8
LEAST_SPREAD_RAD_S: Final = 0.15
"""Standard deviation of the turn rates about the second of their principal axes."""
GRAVITY_M_S2: Final = 9.81
MOST_GRAVITY_ERROR: Final = 0.02
BAD_PX: Final = 2.0
"""A view whose corners are farther from where the lens puts them is left out."""


def camera_imu(
    source: str,
    /,
    *,
    board: str,
    camera: str = "cam0",
    imu: str = "",
    axes: str = "",
    options: OutcomeOptions | None = None,
) -> int:
    """Calibrate where a camera is on the inertial unit, how it is turned, and by how much their clocks differ.

    Log pictures and the inertial unit while you move the vehicle before a fixed board for half a minute: turn it about all
    axes and push it along all axes, briskly, with the board in the picture. Calibrate the lens first: it is read from the rig
    file. Of the other cameras of its chain (`T_cn_cnm1`), the place follows.

    For example `gloc3 calibrate camera-imu runs/flight/log.mcap#camera/front --board aprilgrid.yaml --rig rig.yaml`.

    Args:
        source: A log with pictures (log.mcap#camera/front), or a folder like EuRoC's (calibration#cam0).
        board: The board, in the forms of `gloc3 calibrate camera`.
        camera: The camera's section in the rig file.
        imu: The unit's topic in the log (imu), or its folder in one like EuRoC's (imu0).
        axes: Where x, y and z of the unit point in a folder like EuRoC's, by f, b, r, l, d, u: urf as in EuRoC's own (up,
            right, forward), which is the default, frd, flu.
        options: Where to write the result.
    """
    options = options or OutcomeOptions()
    options.check()
    target, model = read_board(board), _model(options.rig, camera)
    samples = _samples(source, imu, axes)
    pictures = find_pictures(source, camera)
    if any(picture.t_s is None for picture in pictures):
        raise Refused(f"{source}: its pictures have no times; name a log, or a folder like EuRoC's")
    first = pictures[0].load()
    if first.is_valid and (problem := misfit(model, first.width, first.height)):
        raise Refused(f"{source}: {problem}")
    found = find_boards(pictures, target, narrate)
    views, poses = _poses(model, found.seen, target)
    fit = fit_camera_imu(motion_of([view.t_s for view in views], poses), samples)
    return settle(
        CalibrationOutcome(
            lines=_lines(fit),
            sections=_sections(options.rig, camera, fit),
            doubts=doubts_of(fit),
            drawing=svg(f"{camera} and inertial unit: {1e3 * fit.offset_s:.2f} ms", _panels(fit)),
            hints=_hints(fit, options.rig, camera),
        ),
        options,
    )


def _model(rig: Path, camera: str) -> CameraModel:
    if not rig.exists():
        hint = "calibrate the lens first: gloc3 calibrate camera"
        raise InputError([Finding(file=str(rig), message="there is no such rig file", hint=hint)])
    return read_calibration(rig).camera(camera)


def _samples(source: str, imu: str, axes: str) -> ImuMotion:
    path = Path(source.partition("#")[0])
    if path.suffix == LOG:
        if axes:
            raise Refused("--axes is of folders like EuRoC's; the unit's axes in a log are forward, right, down")
        records = topic_records(path, imu or "imu", ImuSample)
    else:
        records = euroc.imu_records(path, imu or "imu0", axes or euroc.AXES)
    return imu_motion([record.log_s for record in records], [record.load() for record in records])


def imu_motion(times_s: Sequence[float], samples: Sequence[ImuSample]) -> ImuMotion:
    """The valid samples of an inertial unit in the order of their times."""
    rows = sorted(
        (t_s, *sample.rate_frd_rad_s, *sample.specific_force_frd_m_s2)
        for t_s, sample in zip(times_s, samples, strict=True)
        if sample.is_valid
    )
    table = np.array(rows).reshape(-1, 7)
    is_new = np.diff(table[:, 0], prepend=-np.inf) > 0.0
    return ImuMotion(times_s=table[is_new, 0], rates_rad_s=table[is_new, 1:4], forces_m_s2=table[is_new, 4:])


def _poses(model: CameraModel, views: Sequence[BoardView], board: CalibrationBoard) -> tuple[list[BoardView], Floats]:
    """The views that fit the lens, with poses; a checkerboard stays the same way round from picture to picture."""
    from scipy.spatial.transform import Rotation

    from gloc3.camera.geometry import project

    kept, poses = list[BoardView](), list[Floats]()
    for view in views:
        candidates = [(each, board_pose(model, each)) for each in (view, *board.others(view))]
        if poses:
            before = Rotation.from_rotvec(poses[-1][:3]).inv()
            candidates.sort(key=lambda each: float((before * Rotation.from_rotvec(each[1][:3])).magnitude()))
        chosen, pose = candidates[0]
        places = Rotation.from_rotvec(pose[:3]).apply(chosen.points_m) + pose[3:]
        away_px = np.linalg.norm(project(model, places) - chosen.pixels, axis=1)
        if np.sqrt(np.mean(away_px**2)) <= BAD_PX:
            kept.append(chosen)
            poses.append(pose)
    if len(kept) < len(views):
        narrate(
            f"{len(views) - len(kept)} of {len(views)} boards do not fit the lens of the rig file, and are left out"
        )
    return kept, np.array(poses).reshape(-1, 6)


def doubts_of(fit: CameraImuFit) -> list[str]:
    """Why a calibration is not trustworthy; empty if it is."""
    doubts = []
    if fit.spreads_rad_s[1] < LEAST_SPREAD_RAD_S:
        doubts.append(
            f"the unit was turned about one axis only (the second has {fit.spreads_rad_s[1]:.2f} rad/s, "
            f"{LEAST_SPREAD_RAD_S:g} is the least): turn it about all axes"
        )
    if fit.correlation < LEAST_CORRELATION:
        doubts.append(
            f"camera and gyro agree to {fit.correlation:.0%} only, {LEAST_CORRELATION:.0%} is the least: are they of one log, "
            "and on one body?"
        )
    if fit.offset_std_s > MOST_OFFSET_STD_S:
        doubts.append(f"the offset in time is known to {1e3 * fit.offset_std_s:.1f} ms only, 2 ms is the most")
    turn_std_deg = float(np.degrees(fit.turn_std_rad.max()))
    if turn_std_deg > MOST_TURN_STD_DEG:
        doubts.append(
            f"the camera's turn is known to {turn_std_deg:.2f} degrees only, {MOST_TURN_STD_DEG:g} is the most"
        )
    if fit.place_std_m.max() > MOST_PLACE_STD_M:
        doubts.append(f"the camera's place is known to {1e3 * fit.place_std_m.max():.0f} mm only, 10 mm is the most")
    if abs(fit.gravity_m_s2 / GRAVITY_M_S2 - 1.0) > MOST_GRAVITY_ERROR:
        doubts.append(
            f"gravity follows as {fit.gravity_m_s2:.2f} m/s², and is {GRAVITY_M_S2:g}: is the board as large as described?"
        )
    return doubts


def _camera_from_imu(fit: CameraImuFit) -> Transform:
    x, y, z = fit.imu_in_camera_m.tolist()
    return Transform((x, y, z), quaternion_of(fit.camera_from_imu.as_matrix().tolist()))


def _sections(rig: Path, camera: str, fit: CameraImuFit) -> dict[str, dict[str, Any]]:
    """The camera's section, and those of the other cameras of its chain."""
    about = {
        "date": today(),
        "timeshift_std_s": float(f"{fit.offset_std_s:.2g}"),
        "turn_std_deg": [float(f"{value:.2g}") for value in np.degrees(fit.turn_std_rad)],
        "place_std_m": [float(f"{value:.2g}") for value in fit.place_std_m],
        "gravity_m_s2": round(fit.gravity_m_s2, 4),
    }
    chain = chain_from_imu(read_sections(rig), camera, _camera_from_imu(fit))
    return {name: _imu_entries(transform, fit, about) for name, transform in chain.items()}


def _imu_entries(transform: Transform, fit: CameraImuFit, about: dict[str, Any]) -> dict[str, Any]:
    return {"T_cam_imu": rows_of(transform), "timeshift_cam_imu": fit.offset_s, "imu_calibration": about}


def _lines(fit: CameraImuFit) -> list[str]:
    place = _camera_from_imu(fit).inverse().position_m
    turn, turn_std = np.degrees(fit.camera_from_imu.as_rotvec()), np.degrees(fit.turn_std_rad)
    place_std = np.linalg.norm(fit.place_std_m) / np.sqrt(3.0)
    bias = ", ".join(f"{value:.4f}" for value in fit.gyro_bias_rad_s)
    forces = ", ".join(f"{value:.3f}" for value in fit.force_bias_m_s2)
    turns = ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(turn, turn_std, strict=True))
    places = ", ".join(f"{1e3 * value:.1f}" for value in place)
    turn_rms_deg = np.degrees(np.sqrt((fit.turn_residuals_rad**2).mean()))
    place_rms_mm_s = 1e3 * np.sqrt((fit.place_residuals_m_s**2).mean())
    offset_ms, offset_std_ms = 1e3 * fit.offset_s, 1e3 * fit.offset_std_s
    return [
        f"time         a picture's time on the unit's clock is its own {offset_ms:+.3f} ± {offset_std_ms:.3f} ms",
        f"turn         {turns} degrees (camera from unit)",
        f"place        {places} ± {1e3 * place_std:.1f} mm (forward, right, down of the unit)",
        f"biases       gyro {bias} rad/s, accelerometer {forces} m/s²",
        f"gravity      {fit.gravity_m_s2:.3f} m/s², a check of the board's measures",
        f"residuals    {turn_rms_deg:.3f} degrees, {place_rms_mm_s:.1f} mm/s (RMS of an axis)",
    ]


def _hints(fit: CameraImuFit, rig: Path, camera: str) -> list[str]:
    hints = [
        f"use it in the platform file: cameras: {{front: {rig}#{camera}}}; the unit's axes are forward, right, down"
    ]
    if fit.offset_s < 0.0:
        hints.append(
            "pictures are stamped late; the vehicle takes that from the rig file, beyond delay_s of the source"
        )
    return hints


def _panels(fit: CameraImuFit) -> list[DiagramPanel]:
    times = fit.window_times_s - fit.window_times_s[0]
    turns = np.degrees(fit.turn_residuals_rad)
    order = np.arange(len(fit.place_residuals_m_s), dtype=float)
    return [
        DiagramPanel(
            "residuals of the turn",
            "time, s",
            "degrees",
            [PanelSeries(axis, times, turns[:, n]) for n, axis in enumerate("xyz")],
        ),
        DiagramPanel(
            "residuals of the place",
            "window, in order",
            "m/s",
            [PanelSeries(axis, order, fit.place_residuals_m_s[:, n]) for n, axis in enumerate("xyz")],
        ),
    ]
