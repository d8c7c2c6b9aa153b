"""`gloc3 calibrate stereo`: two cameras that expose together, and the place of the right one."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from gloc3.camera.model import Lens
from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import CalibrationBoard, Floats
from gloc3_onboard.algorithms.calibration.coverage import covered
from gloc3_onboard.algorithms.calibration.stereo_fit import StereoFit, fit_pair
from gloc3_onboard.calibrating.board_file import read_board
from gloc3_onboard.calibrating.camera import camera_doubts, camera_entries, camera_lines, camera_panels
from gloc3_onboard.calibrating.drawing import DiagramPanel, coverage_lines, svg
from gloc3_onboard.calibrating.live import is_live, watch
from gloc3_onboard.calibrating.outcome import CalibrationOutcome, OutcomeOptions, settle
from gloc3_onboard.calibrating.pictures import BoardsFound, find_boards, find_pictures, paired
from gloc3_onboard.calibration.mounting import Transform, quaternion_of
from gloc3_onboard.calibration.rig_file import chain_from_imu, read_sections, rows_of, transform_in

SIDES: Final = ("left", "right")
MOST_APART: Final = 0.25
"""Share of the pairs that do not fit together."""
MOST_RATIO: Final = 1.5
"""Of the error together to that of each picture alone."""
MOST_BASELINE_STD: Final = 0.01
"""As a share of the baseline."""
IMU_ENTRIES: Final = ("timeshift_cam_imu", "imu_calibration")


def stereo(
    left: str,
    right: str,
    /,
    *,
    board: str,
    lens: Lens = Lens.RADTAN,
    k3: bool = False,
    within: float = 0.005,
    options: OutcomeOptions | None = None,
) -> int:
    """Calibrate a pair of cameras that expose together: both lenses, and where the right one is.

    Show the board as for one camera, where both see it whole. Pictures belong together by their times where they have some,
    else by the number that ends their names (left01.png, right01.png).

    For example `gloc3 calibrate stereo "data/left*.jpg" "data/right*.jpg" --board checkerboard:9x6:0.025`, or live
    `gloc3 calibrate stereo v4l2:///dev/video2 v4l2:///dev/video4 --board aprilgrid.yaml`.

    Args:
        left: The left camera's pictures, in the forms of `gloc3 calibrate camera`.
        right: The right camera's.
        board: The board, in the forms of `gloc3 calibrate camera`.
        lens: radtan for most lenses, equidistant for fisheyes, pinhole for pictures without distortion; for both cameras.
        k3: Have a third radial coefficient; Kalibr has none.
        within: How far apart the times of a pair may be, in seconds.
        options: Where to write the result: sections cam0 (left) and cam1 (right).
    """
    options = options or OutcomeOptions()
    options.check()
    if not 0.0 < within < 10.0:
        raise Refused("--within must be above 0 and below 10 seconds")
    target = read_board(board)
    found = _find((left, right), target, within)
    views = list(zip(found[0].views, found[1].views, strict=True))
    fit = fit_pair(views, (found[0].size, found[1].size), lens, target, has_k3=k3)
    fits = (fit.left, fit.right)
    coverages = [covered(each.views, each.poses, one.size) for each, one in zip(fits, found, strict=True)]
    lines, doubts, panels = list[str](), _doubts(fit), list[DiagramPanel]()
    sections: dict[str, dict[str, Any]] = {}
    for number, (side, each, coverage) in enumerate(zip(SIDES, fits, coverages, strict=True)):
        name = f"cam{number}"
        lines += [f"{side} camera, {name}", *camera_lines(each), *coverage_lines(coverage), ""]
        doubts += camera_doubts(each, coverage, side)
        sections[name] = camera_entries(each, name, coverage)
        panels += camera_panels(each, side)
    sections["cam1"]["T_cn_cnm1"] = rows_of(transform_of_pose(fit.right_from_left))
    _place_on_imu(options.rig, sections)
    sections["cam0"]["cam_overlaps"], sections["cam1"]["cam_overlaps"] = [1], [0]
    title = f"stereo: baseline {1e3 * fit.baseline_m:.2f} mm, {fit.rms_px:.3f} px from {fit.pairs} pairs"
    return settle(
        CalibrationOutcome(
            lines=[*lines, *_lines(fit)],
            sections=sections,
            doubts=doubts,
            drawing=svg(title, panels),
            hints=[
                f"use it in the platform file: cameras: {{front_left: {options.rig}#cam0, front_right: {options.rig}#cam1}}"
            ],
        ),
        options,
    )


def _place_on_imu(rig: Path, sections: dict[str, dict[str, Any]]) -> None:
    """Adds the places on the inertial unit that follow from the left camera's, or from the right one's if that is known."""
    known = read_sections(rig)
    whole = known | {name: known.get(name, {}) | section for name, section in sections.items()}
    for camera in ("cam0", "cam1"):
        if (camera_from_imu := transform_in(whole[camera], "T_cam_imu")) is not None:
            for name, transform in chain_from_imu(whole, camera, camera_from_imu).items():
                missing = {key: whole[camera][key] for key in IMU_ENTRIES if key in whole[camera].keys() - whole[name]}
                sections.setdefault(name, {}).update(missing, T_cam_imu=rows_of(transform))
            return


def transform_of_pose(pose: Floats) -> Transform:
    """A transform from a rotation vector and a translation."""
    from scipy.spatial.transform import Rotation

    x, y, z = pose[3:].tolist()
    return Transform((x, y, z), quaternion_of(Rotation.from_rotvec(pose[:3]).as_matrix().tolist()))


def _find(places: tuple[str, str], board: CalibrationBoard, within_s: float) -> tuple[BoardsFound, BoardsFound]:
    lives = [is_live(place) for place in places]
    if any(lives) and not all(lives):
        raise Refused("both cameras must be live, or neither: one of them is a folder or a log")
    if all(lives):
        names = [f"{side}_camera" for side in SIDES]
        urls = dict(zip(names, places, strict=True))
        urls["stereo_camera"] = f"pair://{','.join(names)}?within_s={within_s:g}"
        left, right = watch(urls, "stereo_camera", board)
        if not left.seen or not right.seen:
            raise Refused("no pair of pictures showed the board in both; do the cameras expose together?")
        return left, right
    pairs = paired(find_pictures(places[0]), find_pictures(places[1], "cam1"), within_s)
    left, right = (find_boards([pair[side] for pair in pairs], board, narrate) for side in (0, 1))
    return left, right


def _doubts(fit: StereoFit) -> list[str]:
    doubts = []
    whole = fit.pairs + len(fit.apart)
    alone_px = max(fit.left.rms_px, fit.right.rms_px)
    if len(fit.apart) > MOST_APART * whole:
        doubts.append(
            f"in {len(fit.apart)} of {whole} pairs the cameras do not see the board at the same place: they do not expose "
            "together, or one has moved"
        )
    if fit.rms_px > MOST_RATIO * max(alone_px, 0.1):
        doubts.append(f"both cameras together fit to {fit.rms_px:.2f} px only, each alone to {alone_px:.2f} px")
    baseline_std = float(np.linalg.norm(fit.std[3:])) / fit.baseline_m
    if baseline_std > MOST_BASELINE_STD:
        doubts.append(f"the baseline is known to {baseline_std:.1%} only, {MOST_BASELINE_STD:.0%} is the most")
    return doubts


def _lines(fit: StereoFit) -> list[str]:
    turn, shift = np.degrees(fit.right_from_left[:3]), 1e3 * fit.right_from_left[3:]
    turn_std, shift_std = np.degrees(fit.std[:3]), 1e3 * fit.std[3:]
    lines = [
        "right camera from the left one",
        f"baseline     {1e3 * fit.baseline_m:.2f} mm",
        "shift        " + ", ".join(f"{v:.2f} ± {s:.2f}" for v, s in zip(shift, shift_std, strict=True)) + " mm",
        "turn         " + ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(turn, turn_std, strict=True)) + " degrees",
        f"residuals    {fit.rms_px:.3f} px (RMS) in {fit.pairs} pairs",
    ]
    return lines + [f"left out     {names}: {error_px:.2f} px together" for names, error_px in fit.apart]
