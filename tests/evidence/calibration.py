"""Calibrations beside the truth of rendered sets, and beside published results on public pictures, by the commands themselves."""

import math
import shutil
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from msgspec.structs import replace
from scipy.spatial.transform import Rotation
from tests.data_folders import CALIBRATIONS
from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.onboard.algorithms.calibration.fields import FIELD, OFFSET, readings
from tests.onboard.algorithms.calibration.motions import HAND
from tests.onboard.algorithms.calibration.rendered import CAMERA, FISHEYE, GRID, BoardRenderer
from tests.onboard.calibrating.motion_logs import OFFSET_S, camera_log, laser_log

from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3.cli.program import run
from gloc3_onboard.algorithms.calibration.bundle import then
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.calibration.rig_file import camera_section, read_sections, write_sections

SEEDS: Final = range(1, 6)
PICTURES: Final = 20
BOARD: Final = "aprilgrid:6x6:0.03:0.3"
CHECKERBOARD: Final = "checkerboard:9x6:0.025"
RIGHT: Final = replace(CAMERA, focal_px=(405.0, 403.2), center_px=(236.0, 181.0))
RIGHT_FROM_LEFT: Final = np.array([0.01, -0.03, 0.005, -0.07, 0.002, 0.004])
PICTURE: Final = "calibration.svg"
OPENCV: Final = CALIBRATIONS / "opencv"
"""left01.jpg to right14.jpg of OpenCV's samples, with left_intrinsics.yml and intrinsics.yml, its published results."""
PAIR: Final = CALIBRATIONS / "pair"
"""left1.jpg to right29.jpg of another public pair, without a result."""
KALIBR: Final = CALIBRATIONS / "camchain-imucam.yaml"
"""As Kalibr's repository publishes it."""


def calibrate(*arguments: str) -> dict[str, Any]:
    """Runs the command into a new rig file; its exit code, its lines, and what it wrote."""
    with TemporaryDirectory() as folder:
        rig, out, err = Path(folder) / "rig.yaml", StringIO(), StringIO()
        if "--rig" in arguments:
            rig = Path(arguments[arguments.index("--rig") + 1])
        else:
            arguments = (*arguments, "--rig", str(rig))
        with redirect_stdout(out), redirect_stderr(err):
            code = run(["calibrate", *arguments])
        return {"code": code, "said": out.getvalue() + err.getvalue(), "rig": read_sections(rig)}


def drawn(folder: Path, name: str, camera: CameraModel, poses: Sequence[Any], seed: int) -> str:
    """Rendered pictures of a grid of tags; the pattern that names them."""
    renderer, cv2 = BoardRenderer(camera, GRID), load_opencv()
    for number, pose in enumerate(poses):
        cv2.imwrite(str(folder / f"{name}{number:02}.png"), renderer.picture(pose, 1000 * seed + number))
    return str(folder / f"{name}*.png")


def lens(seed: int, camera: CameraModel) -> dict[str, Any]:
    """One camera with a rendered grid: errors, and these in standard deviations."""
    with TemporaryDirectory() as folder:
        poses = BoardRenderer(camera, GRID).poses(PICTURES, seed)
        pattern = drawn(Path(folder), "picture", camera, poses, seed)
        extra = ["--report", str(PAGES / PICTURE)] if seed == SEEDS[0] and camera is CAMERA else []
        found = calibrate("camera", pattern, "--board", BOARD, "--lens", camera.lens.value, *extra)
    section = found["rig"]["cam0"]
    values = np.array([*section["intrinsics"], *section["distortion_coeffs"]])
    std = np.array([*section["calibration"]["intrinsics_std"], *section["calibration"]["distortion_std"]])
    errors = values - np.array([*camera.focal_px, *camera.center_px, *camera.distortion])
    return {
        "code": found["code"],
        "focal": float(np.abs(errors[:2] / camera.focal_px).max()),
        "center_px": float(np.abs(errors[2:4]).max()),
        "sigmas": (errors / std).tolist(),
        "rms_px": section["calibration"]["rms_px"],
    }


def pair(seed: int) -> dict[str, Any]:
    """A pair of cameras with a rendered grid."""
    with TemporaryDirectory() as folder:
        poses = BoardRenderer(CAMERA, GRID).poses(PICTURES, seed)
        left = drawn(Path(folder), "left", CAMERA, poses, seed)
        right = drawn(Path(folder), "right", RIGHT, [then(RIGHT_FROM_LEFT, pose) for pose in poses], 100 + seed)
        found = calibrate("stereo", left, right, "--board", BOARD)
    rows = np.array(found["rig"]["cam1"]["T_cn_cnm1"])
    turn = Rotation.from_matrix(rows[:3, :3]) * Rotation.from_rotvec(RIGHT_FROM_LEFT[:3]).inv()
    baseline_m = math.sqrt(float(RIGHT_FROM_LEFT[3:] @ RIGHT_FROM_LEFT[3:]))
    return {
        "code": found["code"],
        "baseline": abs(float(np.linalg.norm(rows[:3, 3])) / baseline_m - 1.0),
        "turn_deg": math.degrees(float(turn.magnitude())),
    }


def camera_imu() -> dict[str, Any]:
    """A log of a camera that is moved before a rendered checkerboard."""
    with TemporaryDirectory() as folder:
        log, rig = camera_log(Path(folder) / "log.mcap", 16.0, 15.0, CAMERA), Path(folder) / "rig.yaml"
        write_sections(rig, {"cam0": camera_section(CAMERA, "cam0")})
        found = calibrate("camera-imu", f"{log}#camera/front", "--board", CHECKERBOARD, "--rig", str(rig))
    section = found["rig"]["cam0"]
    rows, about = np.array(section["T_cam_imu"]), section["imu_calibration"]
    turn = (Rotation.from_matrix(rows[:3, :3]) * HAND.camera_from_imu.inv()).as_rotvec()
    place = rows[:3, 3] - HAND.imu_in_camera_m
    sigmas = [(section["timeshift_cam_imu"] - OFFSET_S) / about["timeshift_std_s"]]
    sigmas += [*(np.degrees(turn) / about["turn_std_deg"]), *(place / about["place_std_m"])]
    return {
        "code": found["code"],
        "offset_ms": 1e3 * abs(section["timeshift_cam_imu"] - OFFSET_S),
        "turn_deg": math.degrees(float(np.linalg.norm(turn))),
        "place_mm": 1e3 * float(np.linalg.norm(place)),
        "sigmas": [float(value) for value in sigmas],
    }


def laser_imu() -> dict[str, Any]:
    """A log of a scanner that is turned in a hold."""
    with TemporaryDirectory() as folder:
        found = calibrate("laser-imu", str(laser_log(Path(folder) / "log.mcap", 30.0)))
    section = found["rig"]["laser"]
    error_s = section["timeshift_laser_imu"] - OFFSET_S
    return {
        "code": found["code"],
        "offset_ms": 1e3 * abs(error_s),
        "sigmas": error_s / section["calibration"]["timeshift_std_s"],
    }


def magnetometer(seed: int) -> dict[str, Any]:
    """A table of a magnetometer that is turned."""
    with TemporaryDirectory() as folder:
        table = Path(folder) / "turn.csv"
        table.write_text("".join(f"{x:.6f},{y:.6f},{z:.6f}\n" for x, y, z in readings(seed).tolist()))
        found = calibrate("magnetometer", str(table))
    section = found["rig"]["magnetometer"]
    error = float(np.abs(np.array(section["offset_gauss"]) - OFFSET).max())
    return {"code": found["code"], "offset": error / float(np.linalg.norm(FIELD)), **section["calibration"]}


def public_pair() -> dict[str, Any]:
    """OpenCV's pictures, and the results that it publishes."""
    left, right = (str(OPENCV / f"{side}[0-9]*.jpg") for side in ("left", "right"))
    found = calibrate("stereo", left, right, "--board", CHECKERBOARD)
    published = read_calibration(OPENCV / "left_intrinsics.yml").camera()
    error = (OPENCV / "left_intrinsics.yml").read_text().partition("avg_reprojection_error:")[2].split()[0]
    rows = np.array(found["rig"]["cam1"]["T_cn_cnm1"])
    return {
        "code": found["code"],
        "left": found["rig"]["cam0"],
        "right": found["rig"]["cam1"],
        "baseline_mm": 1e3 * float(np.linalg.norm(rows[:3, 3])),
        "published": [*published.focal_px, *published.center_px],
        "published_px": float(error),
    }


def halves() -> dict[str, Any]:
    """Another public pair: its odd and its even pairs, each by itself."""
    found = []
    with TemporaryDirectory() as folder:
        for half in (0, 1):
            place = Path(folder) / str(half)
            place.mkdir()
            for path in PAIR.glob("*.jpg"):
                if int(path.stem.lstrip("leftrigh")) % 2 == half:
                    shutil.copy(path, place)
            left, right = (str(place / f"{side}*.jpg") for side in ("left", "right"))
            run_of = calibrate("stereo", left, right, "--board", "checkerboard:9x6:0.02423", "--force")
            sections = run_of["rig"]
            shift = np.array(sections["cam1"]["T_cn_cnm1"])[:3, 3]
            found.append((float(np.linalg.norm(shift)), sections["cam0"]))
    focal = [section["intrinsics"][0] for _, section in found]
    std = math.hypot(*(section["calibration"]["intrinsics_std"][0] for _, section in found))
    return {
        "baseline_mm": [1e3 * shift for shift, _ in found],
        "focal_px": focal,
        "sigmas": abs(focal[0] - focal[1]) / std,
        "rms_px": max(section["calibration"]["rms_px"] for _, section in found),
    }


def kalibr() -> dict[str, Any]:
    """A camchain of Kalibr: read, written and read again."""
    before = read_calibration(KALIBR).cameras
    with TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.yaml"
        write_sections(rig, read_sections(KALIBR))
        sections = {name: camera_section(model, name) for name, model in before.items()}
        write_sections(rig, sections)
        after, kept = read_calibration(rig).cameras, read_sections(rig)
    known = read_sections(KALIBR)
    return {
        "cameras": len(before),
        "is_same": before == after,
        "is_kept": all(
            kept[name][key] == known[name][key]
            for name in known
            for key in ("T_cam_imu", "timeshift_cam_imu", "intrinsics")
        ),
    }


def calibration(progress: Progress) -> list[Figure]:
    """Rendered sets, then public ones."""
    parts: dict[str, list[dict[str, Any]]] = {}
    works: dict[str, Callable[[int], dict[str, Any]]] = {
        "radtan": partial(lens, camera=CAMERA),
        "equidistant": partial(lens, camera=FISHEYE),
        "pair": pair,
        "magnetometer": magnetometer,
    }
    for name, work in works.items():
        parts[name] = []
        for seed in SEEDS:
            progress.report(f"{name} {seed}")
            parts[name].append(progress.part(f"{name} {seed}", partial(work, seed)))
    figures = [*_lenses(parts), *_pairs(parts["pair"])]
    progress.report("with an inertial unit")
    figures += _with_imu(progress.part("camera_imu", camera_imu), progress.part("laser_imu", laser_imu))
    figures += _magnetometers(parts["magnetometer"])
    if not OPENCV.is_dir() or not PAIR.is_dir() or not KALIBR.is_file():
        return [*figures, Figure("public sets", f"not at {CALIBRATIONS.name}", "at hand", False)]
    progress.report("public sets")
    figures += _public(progress.part("opencv", public_pair))
    return [*figures, *_halves(progress.part("halves", halves)), *_kalibr(progress.part("kalibr", kalibr))]


def _at_most(name: str, value: float, most: float, unit: str, digits: int = 3) -> Figure:
    return Figure(name, f"{value:.{digits}f} {unit}", f"≤ {most:g} {unit}", value <= most)


def _written(name: str, runs: Sequence[dict[str, Any]]) -> Figure:
    done = sum(each["code"] == 0 for each in runs)
    return Figure(
        f"{name}: calibrations that are trusted and written", f"{done} of {len(runs)}", "all", done == len(runs)
    )


def _sigmas(name: str, values: Sequence[float]) -> Figure:
    found = float(np.sqrt(np.mean(np.square(values))))
    return Figure(name, f"{found:.2f}", "0.3 to 1.6", 0.3 <= found <= 1.6)


def _lenses(parts: dict[str, list[dict[str, Any]]]) -> list[Figure]:
    figures = []
    for name in ("radtan", "equidistant"):
        runs = parts[name]
        figures += [
            _written(f"rendered, {name}, grid of AprilTags", runs),
            _at_most("… focal length, worst seed", 100.0 * max(each["focal"] for each in runs), 0.2, "%"),
            _at_most("… optical axis, worst seed", max(each["center_px"] for each in runs), 1.0, "px", 2),
            _sigmas("… errors in standard deviations as claimed (RMS)", [v for each in runs for v in each["sigmas"]]),
            Figure("… residuals, worst seed", f"{max(each['rms_px'] for each in runs):.3f} px"),
        ]
    return figures


def _pairs(runs: list[dict[str, Any]]) -> list[Figure]:
    return [
        _written("rendered pair", runs),
        _at_most("… baseline, worst seed", 100.0 * max(each["baseline"] for each in runs), 0.3, "%"),
        _at_most("… turn of the right camera, worst seed", max(each["turn_deg"] for each in runs), 0.1, "degrees"),
    ]


def _with_imu(camera: dict[str, Any], laser: dict[str, Any]) -> list[Figure]:
    return [
        _written("rendered log of camera and inertial unit", [camera]),
        _at_most("… offset in time", camera["offset_ms"], 0.5, "ms"),
        _at_most("… turn", camera["turn_deg"], 0.1, "degrees"),
        _at_most("… place", camera["place_mm"], 5.0, "mm", 1),
        _sigmas("… errors in standard deviations as claimed (RMS)", camera["sigmas"]),
        _written("simulated log of scanner and gyro", [laser]),
        _at_most("… offset in time", laser["offset_ms"], 2.0, "ms"),
        _at_most("… in standard deviations as claimed", abs(laser["sigmas"]), 3.0, "", 1),
    ]


def _magnetometers(runs: list[dict[str, Any]]) -> list[Figure]:
    before, after = min(each["before"] for each in runs), max(each["after"] for each in runs)
    return [
        _written("simulated turns of a magnetometer", runs),
        _at_most("… hard iron, worst seed, of the field", 100.0 * max(each["offset"] for each in runs), 0.3, "%"),
        Figure("… spread of the strength, before and after", f"{before:.1%}, {after:.2%}", "after ≤ 1%", after <= 0.01),
    ]


def _public(found: dict[str, Any]) -> list[Figure]:
    left, right, published = found["left"], found["right"], found["published"]
    focal = abs(left["intrinsics"][0] / published[0] - 1.0)
    center = math.dist(left["intrinsics"][2:], published[2:])
    stds = left["calibration"]["intrinsics_std"]
    return [
        Figure(
            "OpenCV's sample pair (13 pairs): trusted and written",
            "yes" if found["code"] == 0 else "no",
            "yes",
            found["code"] == 0,
        ),
        Figure(
            "… left focal length; OpenCV publishes",
            f"{left['intrinsics'][0]:.2f} ± {stds[0]:.2f} px; {published[0]:.2f} px",
            "within 0.5%",
            focal <= 0.005,
        ),
        Figure(
            "… left optical axis; OpenCV publishes",
            f"{left['intrinsics'][2]:.1f}, {left['intrinsics'][3]:.1f} px; {published[2]:.1f}, {published[3]:.1f} px",
            "within 3 px",
            center <= 3.0,
        ),
        Figure(
            "… residuals of the left camera; OpenCV publishes",
            f"{left['calibration']['rms_px']:.3f} px; {found['published_px']:.3f} px",
            "no more",
            left["calibration"]["rms_px"] <= found["published_px"],
        ),
        Figure(
            "… right focal length", f"{right['intrinsics'][0]:.2f} ± {right['calibration']['intrinsics_std'][0]:.2f} px"
        ),
        Figure("… baseline", f"{found['baseline_mm']:.2f} mm"),
    ]


def _halves(found: dict[str, Any]) -> list[Figure]:
    (one_px, other_px), (one_mm, other_mm) = found["focal_px"], found["baseline_mm"]
    return [
        Figure("another public pair, its odd and even pairs: focal length", f"{one_px:.2f} and {other_px:.2f} px"),
        _at_most("… apart, in standard deviations as claimed", found["sigmas"], 3.0, "", 1),
        Figure("… baseline", f"{one_mm:.2f} and {other_mm:.2f} mm", "within 1%", abs(one_mm / other_mm - 1.0) <= 0.01),
        _at_most("… residuals", found["rms_px"], 0.5, "px"),
    ]


def _kalibr(found: dict[str, Any]) -> list[Figure]:
    is_met = found["is_same"] and found["is_kept"] and found["cameras"] > 0
    words = "the same cameras, places and offsets in time" if is_met else "not the same"
    return [Figure("a camchain-imucam that Kalibr publishes: read, written, read again", words, "the same", is_met)]


BARS = (
    Bar(
        "calibration",
        "Calibrations are right within what they claim, on rendered and on public pictures",
        "The commands run as a user runs them. Rendered pictures show Kalibr's grid of AprilTags or a checkerboard through a "
        "known lens, with blur and noise; logs have offsets in time, biases and noise put in. Public pictures are those of "
        "OpenCV's samples, beside the results that OpenCV publishes for them, and a second pair without a published result, of "
        "which two halves are compared. The public pictures are not part of the repository.",
        calibration,
        seeds=f"{SEEDS[0]} to {SEEDS[-1]}",
        pictures=(PICTURE,),
    ),
)
