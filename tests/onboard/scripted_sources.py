"""Sources of sensor data as a test sets them, and pictures and scans to give."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from gloc3.camera.model import CameraModel
from gloc3.errors import Gloc3Error
from gloc3.messages.perception import DepthImage, ImuSample, LaserScan
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import (
    Bell,
    StampedDepth,
    StampedImage,
    StampedImu,
    StampedPair,
    StampedScan,
    Unwatch,
)

WIDTH, HEIGHT = 64, 48


class ScriptedSource:
    """Every kind of source at once: it gives what the test has put."""

    def __init__(self) -> None:
        self.is_open = False
        self.lost = ""
        self.now_frame: StampedImage | None = None
        self.now_pair: StampedPair | None = None
        self.now_depth: StampedDepth | None = None
        self.now_scan: StampedScan | None = None
        self.measured: list[StampedImu] = []
        self.bell = Bell()

    def open(self) -> None:
        self._fail()
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        return self.bell.listen(ready)

    def frame(self) -> StampedImage | None:
        self._fail()
        return self.now_frame

    def pair(self) -> StampedPair | None:
        return self.now_pair

    def depth(self) -> StampedDepth | None:
        return self.now_depth

    def scan(self) -> StampedScan | None:
        return self.now_scan

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        return [stamped for stamped in self.measured if stamped.t_s > after_s]

    def _fail(self) -> None:
        if self.lost:
            raise Gloc3Error(self.lost)


class OneModel:
    """A rig whose every camera is the same."""

    def model(self, camera: str) -> CameraModel | None:
        return CameraModel(width=WIDTH, height=HEIGHT, focal_px=(50.0, 50.0), center_px=(31.5, 23.5))


def picture(number: int = 0, width: int = WIDTH, height: int = HEIGHT, camera: str = "front") -> Image:
    """A picture of noise, another one for each number."""
    data = np.random.default_rng(number).integers(40, 200, width * height, np.uint8).tobytes()
    return Image(camera=camera, width=width, height=height, data=data)


def depth(number: int = 0) -> DepthImage:
    """Depths of noise from 1 to 5 m, others for each number."""
    data = np.random.default_rng(number).integers(1000, 5000, WIDTH * HEIGHT).astype("<u2").tobytes()
    return DepthImage(camera="depth", width=WIDTH, height=HEIGHT, data=data, range_max_m=10.0)


def scan(ranges_m: Sequence[float]) -> LaserScan:
    """A scan to the front with these ranges."""
    return LaserScan(
        scanner="front",
        angle_min_rad=-math.pi / 2,
        angle_step_rad=math.pi / max(1, len(ranges_m) - 1),
        range_min_m=0.1,
        range_max_m=30.0,
        ranges_m=np.asarray(ranges_m, "<f4").tobytes(),
    )


def measured(t_s: float, rate_rad_s: float = 0.01) -> StampedImu:
    """A sample at rest, but for a rate about x."""
    sample = ImuSample(rate_frd_rad_s=(rate_rad_s, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, -9.81))
    return StampedImu(t_s, sample)


def euroc(tmp_path: Path, frames: int = 10) -> Path:
    """A data set of EuRoC's form: two cameras at 20 Hz, an inertial unit at 200 Hz."""
    top = tmp_path / "mav0"
    begin_ns = 1_403_715_273_262_142_976
    for camera in ("cam0", "cam1"):
        (top / camera / "data").mkdir(parents=True)
        rows = ["#timestamp [ns],filename"]
        for number in range(frames):
            stamp = begin_ns + number * 50_000_000
            pixels = np.frombuffer(picture(number + 100 * (camera == "cam1")).data, np.uint8).reshape(HEIGHT, WIDTH)
            cv2.imwrite(str(top / camera / "data" / f"{stamp}.png"), pixels)
            rows.append(f"{stamp},{stamp}.png")
        (top / camera / "data.csv").write_text("\n".join(rows))
    (top / "imu0").mkdir()
    samples = [f"{begin_ns + k * 5_000_000},{0.001 * k},0.2,0.3,9.81,0.0,0.5" for k in range(frames * 10)]
    (top / "imu0" / "data.csv").write_text("\n".join(["#timestamp", *samples]))
    return tmp_path
