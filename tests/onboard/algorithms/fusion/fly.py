"""Flies the fusion over a synthetic flight and keeps what it believed."""

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3, conjugate, from_yaw, multiply, to_rotation_vector
from gloc3.messages.perception import Odometry, PositionFix
from gloc3.messages.vehicle import AutopilotPose, HeightAboveGround, Pose
from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion
from gloc3_onboard.algorithms.fusion.settings import FusionSettings

from .flown import IMU_HZ, Array, Flight, Sensor

GYRO_NOISE, FORCE_NOISE = 7e-5, 3e-3
GYRO_BIAS, FORCE_BIAS = 0.002, 0.03


class Flown(NamedTuple):
    """What was believed, every 0.05 s."""

    t_s: Array
    error_m: Array
    """(n, 3): of the reported position, in NED."""
    turn_rad: Array
    """(n, 3): of the attitude, as a rotation vector in NED."""
    nees: Array
    """(n,): of position and attitude together, six degrees of freedom."""
    poses: list[Pose]
    fusion: PoseFusion
    innovations: dict[str, list[float]]
    """By source: normalised squared innovations over their degrees of freedom."""

    def ate_m(self) -> float:
        return float(np.sqrt(np.mean(np.sum(self.error_m**2, axis=1))))

    def worst_m(self, begin_s: float = 0.0) -> float:
        return float(np.linalg.norm(self.error_m[self.t_s >= begin_s], axis=1).max())

    def innovation(self, source: str) -> float:
        """Mean of all innovations of a source, over their degrees of freedom."""
        return float(np.mean(self.innovations[source]))

    def turn_deg(self) -> float:
        return float(np.degrees(np.sqrt(np.mean(np.sum(self.turn_rad**2, axis=1)))))


def fly(
    flight: Flight,
    sensors: list[Sensor],
    seed: int = 0,
    settings: FusionSettings | None = None,
    imu: Callable[[float, Any, Any], tuple[Any, Any] | None] = lambda _, rate, force: (rate, force),
    until_s: float = 1e9,
    fusion: PoseFusion | None = None,
    *,
    has_autopilot: bool = False,
) -> Flown:
    """Feeds everything in the order of its arrival; `imu` may change a sample, or drop it. The autopilot tells attitudes only."""
    rng = np.random.default_rng((seed, 99))
    gyro_bias, force_bias = rng.normal(size=3) * GYRO_BIAS, rng.normal(size=3) * FORCE_BIAS
    fusion = fusion or PoseFusion(settings or FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=0.0))
    innovations: dict[str, list[float]] = {}
    fusion.on_innovation = lambda source, value, degrees: innovations.setdefault(source, []).append(value / degrees)
    arriving: list[tuple[float, int, float, Any]] = []
    kept: list[tuple[float, Array, Array, float, Pose]] = []
    count = 0
    root = np.sqrt(IMU_HZ)
    for i, t in enumerate(flight.t_s):
        t_s = float(t)
        if t_s > until_s:
            break
        rate = flight.rate[i] + gyro_bias + rng.normal(size=3) * GYRO_NOISE * root
        force = flight.force[i] + force_bias + rng.normal(size=3) * FORCE_NOISE * root
        sample = imu(t_s, tuple(rate.tolist()), tuple(force.tolist()))
        if sample is not None:
            fusion.imu(*sample, t_s)
        if has_autopilot and i % 5 == 0:
            fusion.attitude(attitude_of(flight, i), t_s)
        for sensor in sensors:
            for arrives_s, valid_s, message in sensor.reports(flight, t_s):
                count += 1
                heappush(arriving, (arrives_s, count, valid_s, message))
        while arriving and arriving[0][0] <= t_s + 1e-9:
            _, _, valid_s, message = heappop(arriving)
            if isinstance(message, Odometry):
                fusion.odometry(message, valid_s)
            elif isinstance(message, PositionFix):
                fusion.fix(message, valid_s)
            else:
                fusion.height(message, valid_s)
        if i % 5 == 0:
            fusion.tick(t_s)
            if fusion.is_aligned:
                pose = fusion.pose()
                truth_i = flight.index(fusion.estimate.t_s)
                kept.append((t_s, *_errors(fusion, pose, flight, truth_i), pose))
    columns = list(zip(*kept, strict=True))
    return Flown(
        np.array(columns[0]),
        np.array(columns[1]),
        np.array(columns[2]),
        np.array(columns[3]),
        list(columns[4]),
        fusion,
        innovations,
    )


def attitude_of(flight: Flight, i: int) -> AutopilotPose:
    """What the autopilot tells: with a heading that is another, and a position that is nowhere."""
    p, q, r = flight.rate[i].tolist()
    attitude = multiply(from_yaw(2.0), flight.attitude[i])
    return AutopilotPose(
        position_ned_m=(99.0, 0.0, 0.0),
        velocity_ned_m_s=(9.0, 0.0, 0.0),
        ned_from_frd=attitude,
        rate_frd_rad_s=(p, q, r),
    )


def _errors(fusion: PoseFusion, pose: Pose, flight: Flight, i: int) -> tuple[Array, Array, float]:
    error = np.array(pose.position_ned_m) - flight.position[i]
    turn = np.array(to_rotation_vector(multiply(flight.attitude[i], conjugate(pose.ned_from_frd))))
    believed = np.array(fusion.estimate.inertial.now.position_ned_m)
    both = np.concatenate([flight.position[i] - believed, turn])
    rows = [0, 1, 2, 6, 7, 8]
    covariance = fusion.estimate.errors.covariance[np.ix_(rows, rows)]
    return error, turn, float(both @ np.linalg.solve(covariance, both))


class Recorder(PoseFusion):
    """Remembers how it was fed, to feed others the same."""

    SETTINGS = FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=0.0)

    def __init__(self, settings: FusionSettings | None = None) -> None:
        super().__init__(settings)
        self.calls: list[tuple[str, Any]] = []

    @classmethod
    def of(cls, flight: Flight, sensors: list[Sensor], until_s: float = 1e9) -> list[tuple[str, Any]]:
        """The methods that a flight calls, with their arguments."""
        recorder = cls(cls.SETTINGS)
        fly(flight, sensors, until_s=until_s, fusion=recorder)
        return recorder.calls

    def imu(self, rate_frd_rad_s: Vector3, force_frd_m_s2: Vector3, t_s: float) -> None:
        self.calls.append(("imu", (rate_frd_rad_s, force_frd_m_s2, t_s)))
        super().imu(rate_frd_rad_s, force_frd_m_s2, t_s)

    def odometry(self, message: Odometry, t_s: float) -> None:
        self.calls.append(("odometry", (message, t_s)))
        super().odometry(message, t_s)

    def fix(self, message: PositionFix, t_s: float) -> None:
        self.calls.append(("fix", (message, t_s)))
        super().fix(message, t_s)

    def height(self, message: HeightAboveGround, t_s: float) -> None:
        self.calls.append(("height", (message, t_s)))
        super().height(message, t_s)

    def tick(self, now_s: float) -> None:
        self.calls.append(("tick", (now_s,)))
        super().tick(now_s)
