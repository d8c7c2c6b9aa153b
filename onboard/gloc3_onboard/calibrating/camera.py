"""`gloc3 calibrate camera`: the lens of one camera, by pictures of a board."""

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gloc3.camera.model import Lens
from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import CalibrationBoard
from gloc3_onboard.algorithms.calibration.coverage import BoardCoverage, covered
from gloc3_onboard.algorithms.calibration.lens_fit import LensFit, fit_lens
from gloc3_onboard.calibrating.board_file import read_board
from gloc3_onboard.calibrating.drawing import DiagramPanel, PanelSeries, coverage_lines, svg
from gloc3_onboard.calibrating.live import is_live, watch
from gloc3_onboard.calibrating.outcome import CalibrationOutcome, OutcomeOptions, settle, today
from gloc3_onboard.calibrating.pictures import BoardsFound, find_boards, find_pictures
from gloc3_onboard.calibration.rig_file import camera_section

SECTION: Final = re.compile(r"cam\d{1,2}")
MOST_RMS_PX: Final = 1.0
MOST_FOCAL_STD: Final = 0.01
"""As a share of the focal length."""
MOST_LEFT_OUT: Final = 0.25
"""Share of the pictures with a board that do not fit."""
NAMES: Final[dict[Lens, tuple[str, ...]]] = {
    Lens.PINHOLE: (),
    Lens.RADTAN: ("k1", "k2", "p1", "p2", "k3"),
    Lens.EQUIDISTANT: ("k1", "k2", "k3", "k4"),
}


def camera(
    pictures: str,
    /,
    *,
    board: str,
    name: str = "cam0",
    lens: Lens = Lens.RADTAN,
    k3: bool = False,
    options: OutcomeOptions | None = None,
) -> int:
    """Calibrate the lens of one camera by pictures of a board.

    Hold the board still in all parts of the picture, also near its corners, tilted to all four sides, from near and far:
    about 20 pictures. From a live source, pictures are taken by themselves when they show something new; a drawing shows
    what is covered and what to show next, and Ctrl-C ends early.

    For example `gloc3 calibrate camera pictures --board checkerboard:9x6:0.025`, or live
    `gloc3 calibrate camera v4l2:///dev/video0 --board aprilgrid.yaml --report report.svg`.

    Args:
        pictures: A folder, a pattern in quotes ("data/left*.jpg"), a log (log.mcap#camera/front), a folder like EuRoC's
            (V1_01_easy#cam0), or a live source (v4l2:///dev/video0).
        board: checkerboard:9x6:0.025 (inner corners, side in metres), aprilgrid:6x6:0.088:0.3 (tags, side in metres, gap as
            share of the side), or a YAML file as for Kalibr.
        name: The camera's section in the rig file: cam0, cam1 and so on.
        lens: radtan for most lenses, equidistant for fisheyes, pinhole for pictures without distortion.
        k3: Have a third radial coefficient; Kalibr has none.
        options: Where to write the result.
    """
    options = options or OutcomeOptions()
    options.check()
    if not SECTION.fullmatch(name):
        raise Refused(f"--name {name!r} must be cam0, cam1 and so on: the camera's number in the chain")
    target = read_board(board)
    found = _find(pictures, target)
    fit = fit_lens(found.seen, found.size, lens, has_k3=k3)
    coverage = covered(fit.views, fit.poses, found.size)
    return settle(
        CalibrationOutcome(
            lines=[*camera_lines(fit), *coverage_lines(coverage)],
            sections={name: camera_entries(fit, name, coverage)},
            doubts=camera_doubts(fit, coverage),
            drawing=svg(f"{name}: {fit.rms_px:.3f} px from {len(fit.views)} pictures", camera_panels(fit)),
            hints=[f"use it in the platform file: cameras: {{front: {options.rig}#{name}}}"],
        ),
        options,
    )


def _find(pictures: str, board: CalibrationBoard) -> BoardsFound:
    if is_live(pictures):
        (found,) = watch({"camera": pictures}, "camera", board)
        if not found.seen:
            raise Refused(f"{pictures}: no picture showed the board")
        return found
    return find_boards(find_pictures(pictures), board, narrate)


def camera_doubts(fit: LensFit, coverage: BoardCoverage, name: str = "") -> list[str]:
    """Why a calibrated lens is not trustworthy; empty if it is."""
    before = f"{name}: " if name else ""
    doubts = coverage.lacks()
    if fit.rms_px > MOST_RMS_PX:
        doubts.append(
            f"corners are {fit.rms_px:.2f} px (RMS) from where they should be, {MOST_RMS_PX:g} px is the most"
        )
    focal_std = float(np.max(fit.std[:2] / fit.intrinsics[:2]))
    if focal_std > MOST_FOCAL_STD:
        doubts.append(f"the focal length is known to {focal_std:.1%} only, {MOST_FOCAL_STD:.0%} is the most")
    whole = len(fit.views) + len(fit.left_out)
    if len(fit.left_out) > MOST_LEFT_OUT * whole:
        doubts.append(f"{len(fit.left_out)} of {whole} pictures do not fit: is the board flat, and described rightly?")
    return [before + doubt for doubt in doubts]


def camera_lines(fit: LensFit) -> list[str]:
    """A calibrated lens for people, with standard deviations."""
    values, std = fit.intrinsics, fit.std
    lines = [
        f"lens         {fit.model.lens}, pictures of {fit.model.width} x {fit.model.height}",
        f"focal length {_both(values[:2], std[:2])} px",
        f"optical axis {_both(values[2:4], std[2:4])} px",
    ]
    names = NAMES[fit.model.lens]
    lines += [f"  {name:<11}{v:.5f} ± {s:.5f}" for name, v, s in zip(names, values[4:], std[4:], strict=False)]
    lines.append(f"residuals    {fit.rms_px:.3f} px (RMS) in {len(fit.views)} pictures")
    return lines + [f"left out     {name}: {error_px:.2f} px" for name, error_px in fit.left_out]


def _both(values: Any, std: Any) -> str:
    return ", ".join(f"{v:.2f} ± {s:.2f}" for v, s in zip(values, std, strict=True))


def camera_entries(fit: LensFit, name: str, coverage: BoardCoverage) -> dict[str, Any]:
    """A calibrated lens for the rig file."""
    std = [float(f"{each:.2g}") for each in fit.std]
    about = {
        "date": today(),
        "rms_px": round(fit.rms_px, 4),
        "pictures": len(fit.views),
        "coverage": round(coverage.share, 3),
        "intrinsics_std": std[:4],
        "distortion_std": std[4:],
    }
    return {**camera_section(fit.model, name), "calibration": about}


def camera_panels(fit: LensFit, name: str = "") -> Sequence[DiagramPanel]:
    """Diagrams of a calibrated lens: corners in the picture, residuals, and errors by picture."""
    pixels = np.concatenate([view.pixels for view in fit.views])
    residuals = np.concatenate(fit.residuals_px)
    errors = np.array([np.sqrt((part**2).sum(axis=1).mean()) for part in fit.residuals_px])
    most = float(np.abs(residuals).max()) * 1.1 or 1.0
    before = f"{name}: " if name else ""
    return (
        DiagramPanel(
            f"{before}corners in the picture",
            "column, px",
            "row, px",
            [PanelSeries("", pixels[:, 0], pixels[:, 1])],
            (0.0, float(fit.model.width)),
            (float(fit.model.height), 0.0),
        ),
        DiagramPanel(
            f"{before}residuals",
            "column, px",
            "row, px",
            [PanelSeries("", residuals[:, 0], residuals[:, 1])],
            (-most, most),
            (-most, most),
        ),
        DiagramPanel(
            f"{before}error of each picture",
            "picture, in order",
            "RMS, px",
            [PanelSeries("", np.arange(1.0, len(errors) + 1.0), errors)],
            y_range=(0.0, float(errors.max()) * 1.2),
        ),
    )
