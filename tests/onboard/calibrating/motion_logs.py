"""Logs of a vehicle that is moved before a rendered board, and of one that is turned in a room, with known offsets in time."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from msgspec.structs import replace
from tests.common.log.samples import LogInMemory
from tests.onboard.algorithms.calibration.motions import HAND
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, BoardRenderer
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner

from gloc3.camera.model import CameraModel
from gloc3.log.reader import LogReader
from gloc3.messages.envelope import Message, Source
from gloc3.messages.perception import ImuSample
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.scan_matching.planar import Planar

SMALL: Final = replace(
    CAMERA, width=320, height=240, focal_px=(268.0, 267.0), center_px=(161.3, 118.2), distortion=(-0.2, 0.05, 0.0, 0.0)
)
OFFSET_S: Final = -0.021
"""Pictures and scans are stamped late by this."""
BEGIN_S: Final = 2.0
"""When the pictures begin, which the inertial unit precedes."""
ALL: Final = {"camera/*": True, "imu": True, "laser": True}
IMU: Final = Source("pelican", "imu", 1)


def _written(path: Path, entries: Iterable[tuple[float, str, Message]]) -> Path:
    log = LogInMemory(chosen=ALL)
    for t_s, topic, message in sorted(entries, key=lambda entry: entry[0]):
        log.loop._now_s = max(t_s, log.loop.time())
        log.recorder.record(log.envelope(topic, message, t_s, IMU))
    path.write_bytes(log.close())
    return path


def camera_log(path: Path, seconds: float = 8.0, rate_hz: float = 10.0, camera: CameraModel = SMALL) -> Path:
    """Pictures of a checkerboard as *front*, and the unit that the camera is on."""
    renderer = BoardRenderer(camera, CHECKERBOARD)
    stamps_s = BEGIN_S + np.arange(0.0, seconds, 1.0 / rate_hz)
    entries: list[tuple[float, str, Message]] = []
    for seed, (stamp_s, pose) in enumerate(zip(stamps_s.tolist(), HAND.poses(stamps_s + OFFSET_S), strict=True)):
        data = renderer.picture(pose, seed).tobytes()
        image = Image(camera="front", width=camera.width, height=camera.height, data=data)
        entries.append((stamp_s, "camera/front", image))
    motion = HAND.samples(np.arange(0.0, BEGIN_S + seconds + 2.0, 0.01))
    rows = zip(motion.times_s.tolist(), motion.rates_rad_s.tolist(), motion.forces_m_s2.tolist(), strict=True)
    entries += [
        (t_s, "imu", ImuSample(rate_frd_rad_s=tuple(rate), specific_force_frd_m_s2=tuple(force)))
        for t_s, rate, force in rows
    ]
    return _written(path, entries)


def camera_folder(folder: Path, log: Path) -> Path:
    """The same as a folder like EuRoC's, with the unit's columns forward, right, down."""
    (folder / "cam0" / "data").mkdir(parents=True)
    (folder / "imu0").mkdir()
    pictures, samples = ["#timestamp,filename"], ["#timestamp,w,a"]
    with LogReader(log) as reader:
        for _, entry in reader.entries("camera/front"):
            name, image = f"{round(entry.t_s * 1e9)}.png", entry.payload
            cv2.imwrite(
                str(folder / "cam0" / "data" / name),
                np.frombuffer(image.data, np.uint8).reshape(image.height, image.width),
            )
            pictures.append(f"{round(entry.t_s * 1e9)},{name}")
        for _, entry in reader.entries("imu"):
            values = (*entry.payload.rate_frd_rad_s, *entry.payload.specific_force_frd_m_s2)
            samples.append(",".join([str(round(entry.t_s * 1e9)), *map(str, values)]))
    (folder / "cam0" / "data.csv").write_text("\n".join(pictures))
    (folder / "imu0" / "data.csv").write_text("\n".join(samples))
    return folder


def yaw_rad(
    times_s: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]",
) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Heading of a vehicle that is turned to and fro."""
    return np.asarray(0.7 * np.sin(1.3 * times_s) + 0.25 * np.sin(4.1 * times_s + 1.0))


def laser_log(path: Path, seconds: float = 16.0, turn: float = 1.0) -> Path:
    """Scans of a hold, and a gyro.

    Args:
        path: of the log.
        seconds: how long it is turned.
        turn: factor of the turns.
    """
    random, scanner = np.random.default_rng(5), Scanner(HOLD)
    stamps_s = BEGIN_S + np.arange(0.0, seconds, 0.1)
    entries: list[tuple[float, str, Message]] = []
    for stamp_s, yaw in zip(stamps_s.tolist(), turn * yaw_rad(stamps_s + OFFSET_S), strict=True):
        entries.append((stamp_s, "laser", scanner.scan(Planar(2.0, -3.0, float(yaw)), random)))
    times_s = np.arange(0.0, BEGIN_S + seconds + 2.0, 0.01)
    rates = turn * (yaw_rad(times_s + 1e-4) - yaw_rad(times_s - 1e-4)) / 2e-4 + random.normal(
        0.003, 0.003, len(times_s)
    )
    entries += [
        (t_s, "imu", ImuSample(rate_frd_rad_s=(0.0, 0.0, rate), specific_force_frd_m_s2=(0.0, 0.0, -9.81)))
        for t_s, rate in zip(times_s.tolist(), rates.tolist(), strict=True)
    ]
    return _written(path, entries)
