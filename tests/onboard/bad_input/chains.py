"""Each sensor of the vehicle with the real components behind it, up to the fused pose, before a scene that stands still."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner
from tests.onboard.algorithms.vision import test_ground_odometer as floor
from tests.onboard.algorithms.vision import test_optical_follower as tracker
from tests.onboard.algorithms.vision import wall
from tests.onboard.scripted_sources import ScriptedSource

from gloc3.camera.model import CameraModel
from gloc3.component.component import Component
from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.messages.envelope import Message
from gloc3.messages.perception import LaserScan, Odometry, PositionFix
from gloc3.messages.vehicle import Image, Pose
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.components.processors.features import FeatureProcessor
from gloc3_onboard.components.processors.ground_odometry import GroundOdometryProcessor
from gloc3_onboard.components.processors.laser_odometry import LaserOdometryProcessor
from gloc3_onboard.components.processors.optical_follower import OpticalFollowerProcessor
from gloc3_onboard.components.processors.pose_fusion import PoseFusionProcessor
from gloc3_onboard.components.processors.stereo_odometry import StereoOdometryProcessor
from gloc3_onboard.components.samplers.camera import CameraSampler
from gloc3_onboard.components.samplers.laser import LaserSampler
from gloc3_onboard.components.samplers.stereo_camera import StereoCameraSampler
from gloc3_onboard.sensors.devices import StampedImage, StampedPair, StampedScan

HEIGHT_M = floor.HEIGHT_M
LAMP = tracker.place(0)
LEVER = tracker.SETTINGS.lever_frd_m
START = (LAMP[0], LAMP[1], LAMP[2] - LEVER[2])
"""Where the body is, all the time."""
FOLLOWER = {
    "position_ned_m": tracker.SETTINGS.position_ned_m,
    "euler_deg": (0.0, math.degrees(-0.5), math.degrees(0.3)),
    "lever_frd_m": LEVER,
    "floor_height_m": -START[2] - HEIGHT_M,
}
FUSION = {"start_ned_m": START, "start_heading_deg": 0.0}

SIGMAS = 4.0

Shot = tuple[Image, ...] | tuple[LaserScan]
"""What a sensor gives at a time."""


class Calibrations:
    """The cameras as they were calibrated; a test may put others."""

    def __init__(self) -> None:
        self.models: dict[str, CameraModel] = {"ground": floor.CAMERA, "tracker": tracker.CAMERA}
        self.models |= dict(zip(("front_left", "front_right"), wall.cameras(), strict=True))

    def model(self, camera: str) -> CameraModel | None:
        return self.models.get(camera)


class Chain(NamedTuple):
    """A sensor and what follows it."""

    sensor: str
    topics: tuple[str, ...]
    """What its sampler reports."""
    output: str
    """What the fusion hears of it."""
    poll: Callable[[int], Shot]
    """The scene for the n-th time."""
    sampler: Callable[[ScriptedSource, Calibrations], Component[Any]]
    stamp: Callable[[ScriptedSource, float, Any], None]
    """Has the device give something with a time."""
    processors: Mapping[str, Callable[[Calibrations], Component[Any]]]
    rows: Mapping[str, ComponentRow]

    def host(self, bench: Bench, rig: Calibrations, source: ScriptedSource, *, with_sampler: bool) -> None:
        """Puts its components on a bench: the sampler too, or only what follows."""
        if with_sampler:
            bench.host(self.rows["sampler"], lambda: self.sampler(source, rig))
        for name, create in self.processors.items():
            bench.host(self.rows[name], lambda create=create: create(rig))  # type: ignore[misc]
        bench.host(self.rows["fusion"], PoseFusionProcessor)

    def reports(self, *, with_sampler: bool) -> dict[str, str]:
        """The topic that tells how each component is."""
        found = {"sampler": self.topics[0]} if with_sampler else {}
        outputs = {"features": "features/front", "odometry": self.output, "follower": self.output}
        return {**found, **{name: outputs[name] for name in self.processors}, "fusion": "pose"}


def row(name: str, rate_hz: float, ports: dict[str, Any], settings: Mapping[str, Any] = {}) -> ComponentRow:
    """A row of a deployment."""
    return ComponentRow(name=name, class_name="x:Y", rate_hz=rate_hz, ports=ports, settings=dict(settings))


def fusion(odometry: Sequence[str] = (), fixes: Sequence[str] = ()) -> ComponentRow:
    """The row of the pose fusion, with its sources."""
    return row("fusion", 25.0, {"odometry": [*odometry], "position_fix": [*fixes], "primary": "pose"}, FUSION)


def pictures(cameras: Sequence[str], pixels: Sequence[Any]) -> tuple[Image, ...]:
    """Pictures of these cameras."""
    return tuple(
        Image(camera=camera, width=one.shape[1], height=one.shape[0], data=one.tobytes())
        for camera, one in zip(cameras, pixels, strict=True)
    )


def grainy(pixels: Any, number: int) -> Any:
    """With the noise of another exposure."""
    noise = np.random.default_rng(number).integers(-2, 3, pixels.shape, np.int16)
    return np.clip(pixels.astype(np.int16) + noise, 0, 255).astype(np.uint8)


def _frame(source: ScriptedSource, t_s: float, shot: Any) -> None:
    source.now_frame = StampedImage(t_s, shot[0])


def _pair(source: ScriptedSource, t_s: float, shot: Any) -> None:
    source.now_pair = StampedPair(t_s, *shot)


def _turn(source: ScriptedSource, t_s: float, shot: Any) -> None:
    source.now_scan = StampedScan(t_s, shot[0])


def _scan(number: int) -> tuple[LaserScan]:
    return (Scanner(HOLD).scan(Planar(), np.random.default_rng(number)),)


EYES = ("front_left", "front_right")
CAMERAS = tuple(f"camera/{eye}" for eye in EYES)
CHAINS = {
    "stereo": Chain(
        "stereo cameras",
        CAMERAS,
        "odometry/stereo",
        lambda number: pictures(EYES, wall.poll(0.0, seed=number)),
        StereoCameraSampler,
        _pair,
        {"features": FeatureProcessor, "odometry": StereoOdometryProcessor},
        {
            "sampler": row("sampler", 15.0, dict(zip(("left", "right"), CAMERAS, strict=True))),
            "features": row(
                "features", 20.0, dict(zip(("left", "right"), CAMERAS, strict=True)) | {"features": "features/front"}
            ),
            "odometry": row("odometry", 20.0, {"features": "features/front", "odometry": "odometry/stereo"}),
            "fusion": fusion(["odometry/stereo"]),
        },
    ),
    "ground": Chain(
        "ground camera",
        ("camera/ground",),
        "odometry/ground",
        lambda number: pictures(["ground"], [grainy(floor.seen(0), number)]),
        CameraSampler,
        _frame,
        {"odometry": GroundOdometryProcessor},
        {
            "sampler": row("sampler", 15.0, {"image": "camera/ground"}),
            "odometry": row("odometry", 20.0, {"image": "camera/ground", "odometry": "odometry/ground"}),
            "fusion": fusion(["odometry/ground"]),
        },
    ),
    "laser": Chain(
        "laser scanner",
        ("laser",),
        "odometry/laser",
        _scan,
        lambda source, rig: LaserSampler(source),
        _turn,
        {"odometry": lambda rig: LaserOdometryProcessor()},
        {
            "sampler": row("sampler", 15.0, {}),
            "odometry": row("odometry", 20.0, {"odometry": "odometry/laser"}),
            "fusion": fusion(["odometry/laser"]),
        },
    ),
    "tracker": Chain(
        "tracker",
        ("camera/tracker",),
        "position_fix/tracker",
        lambda number: pictures(["tracker"], [tracker.seen(LAMP, seed=number)]),
        CameraSampler,
        _frame,
        {"follower": OpticalFollowerProcessor},
        {
            "sampler": row("sampler", 15.0, {"image": "camera/tracker"}),
            "follower": row(
                "follower", 20.0, {"image": "camera/tracker", "position_fix": "position_fix/tracker"}, FOLLOWER
            ),
            "fusion": fusion(fixes=["position_fix/tracker"]),
        },
    ),
}


def error_m(message: Message) -> float:
    """How wrong a valid report is, beyond what its covariance admits; 0 for what tells no place."""
    match message:
        case Odometry():
            covariance = np.reshape(message.covariance, (6, 6))[:3, :3]
            error = np.array(message.position_m)
        case PositionFix():
            covariance = np.reshape(message.covariance, (3, 3))
            error = np.subtract(message.position_ned_m, LAMP)
        case Pose():
            covariance = np.diag(np.square(message.position_std_m))
            error = np.subtract(message.position_ned_m, START)
        case _:
            return 0.0
    is_admitted = float(error @ np.linalg.solve(covariance, error)) <= SIGMAS**2
    return 0.0 if is_admitted else float(np.linalg.norm(error))


def is_finite(message: Message) -> bool:
    """Whether every number in a message is one."""
    return all(math.isfinite(value) for value in _numbers(msgspec.to_builtins(message)))


def _numbers(value: Any) -> list[float]:
    if isinstance(value, float):
        return [value]
    if isinstance(value, dict):
        return [number for one in value.values() for number in _numbers(one)]
    if isinstance(value, list | tuple):
        return [number for one in value for number in _numbers(one)]
    return []
