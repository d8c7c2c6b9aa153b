"""A flight without pictures: a smooth inspection flight as truth, and sensors that are modelled by their errors."""

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import msgspec
import numpy as np

from gloc3.messages.frames import (
    Quaternion,
    Vector3,
    conjugate,
    from_rotation_vector,
    from_yaw,
    multiply,
    rotate,
    rotate_back,
    to_rotation_vector,
    yaw_of,
)
from gloc3.messages.perception import UNKNOWN_VARIANCE, Odometry, PositionFix
from gloc3.messages.vehicle import HeightAboveGround

IMU_HZ = 100
GRAVITY = 9.80665
WANDER_S = 1.1
OUTLIER_M = 1.0
"""Standard deviation of an outlier's displacement along each axis."""
RAMP_M_S = 0.05
"""Growth of an error that grows steadily: 6 % of the speed."""
Array = np.ndarray[Any, np.dtype[Any]]
M = TypeVar("M", Odometry, PositionFix)


@dataclass(frozen=True)
class Flight:
    """The truth, 100 times a second."""

    t_s: Array
    position: Array
    velocity: Array
    attitude: list[Quaternion]
    rate: Array
    force: Array

    def index(self, t_s: float) -> int:
        return min(max(round(t_s * IMU_HZ), 0), len(self.t_s) - 1)

    @property
    def distance_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())


@cache
def inspection(scale: float = 1.0, *, has_turns: bool = True, speed_m_s: float = 0.8) -> Flight:
    """Stands for 2 s, climbs to 1.5 m and sweeps a wall in three lines of 16 m, 60 m in all, with a gust's wobble."""
    corners = [
        (0, 0, 0),
        (0, 0, -1.5),
        (16, 0, -1.5),
        (16, 0, -3),
        (0, 0, -3),
        (0, 2, -3),
        (16, 2, -3),
        (16, 2, -2),
        (8, 2, -2),
    ]
    places = np.array(corners, dtype=float) * scale
    fine = 5
    dt = 1.0 / (IMU_HZ * fine)
    way: list[Array] = [np.repeat(places[:1], int(2.0 / dt), axis=0)]
    for begin, end in pairwise(places):
        steps = max(int(np.linalg.norm(end - begin) / speed_m_s / dt), 1)
        way.append(begin + (end - begin) * np.linspace(0.0, 1.0, steps, endpoint=False)[:, None])
        way.append(np.repeat(end[None], int(0.5 / dt), axis=0))
    path = np.concatenate(way)
    # Four first-order lags make it as smooth as a vehicle is.
    for _ in range(4):
        path = _lag(path, dt / 0.18)
    t = np.arange(len(path)) * dt
    part = np.clip((t - 2.5) / 3.0, 0.0, 1.0)[:, None]
    airborne = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    wobble = np.stack([np.sin(2 * np.pi * f * t + p) for f, p in ((0.41, 0.0), (0.53, 1.0), (0.29, 2.0))], axis=1)
    path = path + 0.015 * airborne * wobble
    yaw = 0.3 * airborne[:, 0] * np.sin(2 * np.pi * t / 25.0) if has_turns else np.zeros(len(t))
    velocity = np.gradient(path, dt, axis=0)
    acceleration = np.gradient(velocity, dt, axis=0)
    attitude = [_leaning(a, y) for a, y in zip(acceleration[::fine], yaw[::fine], strict=True)]
    # The mean rate and force of each period are what an integrating unit tells.
    force, rate = [], []
    for i in range(len(attitude)):
        a, b = attitude[max(i - 1, 0)], attitude[min(i + 1, len(attitude) - 1)]
        turn = to_rotation_vector(multiply(conjugate(a), b))
        rate.append(np.array(turn) * IMU_HZ / (min(i + 1, len(attitude) - 1) - max(i - 1, 0)))
        n, e, d = acceleration[i * fine]
        force.append(rotate_back(attitude[i], (n, e, d - GRAVITY)))
    return Flight(t[::fine], path[::fine], velocity[::fine], attitude, np.array(rate), np.array(force))


def _lag(path: Array, share: float) -> Array:
    out = np.empty_like(path)
    at = path[0]
    for i, wanted in enumerate(path):
        at = at + share * (wanted - at)
        out[i] = at
    return out


def _leaning(acceleration: Array, yaw: float) -> Quaternion:
    """Thrust along the body's z axis, heading as told."""
    force = np.array((acceleration[0], acceleration[1], acceleration[2] - GRAVITY))
    down = -force / np.linalg.norm(force)
    axis = np.cross((0.0, 0.0, 1.0), down)
    size = float(np.linalg.norm(axis))
    tilt = from_rotation_vector(tuple(axis * (np.arcsin(min(size, 1.0)) / size)) if size > 1e-12 else (0.0, 0.0, 0.0))
    return multiply(tilt, from_yaw(yaw))


# --- sensors ---


@dataclass
class Sensor:
    """Reports at a rate, some time after the moment that it tells of; `fault` changes what it says."""

    name: str
    rate_hz: float
    latency_s: float
    fault: str = ""
    fault_s: tuple[float, float] = (1e9, 1e9)
    wrong_share: float = 0.0
    """Of the fault `outliers`: how many of the reports are displaced, 0 to 1; of `bursts`: how many begin one."""
    rng: Any = None
    fault_rng: Any = None
    _held: Any = None
    _next_s: float = 0.3
    _shift: Array = field(default_factory=lambda: np.zeros(3))
    _burst: Vector3 = (0.0, 0.0, 0.0)
    _burst_left: int = 0

    def reports(self, flight: Flight, t_s: float) -> list[tuple[float, float, Any]]:
        """What is said of this moment: when it arrives, its time of validity, and the message."""
        if t_s < self._next_s - 1e-9:
            return []
        self._next_s += 1.0 / self.rate_hz
        message = self.measure(flight, t_s)
        arrives_s = t_s + self.latency_s
        is_faulty = self.fault_s[0] <= t_s < self.fault_s[1]
        if not is_faulty:
            self._held = message
            return [(arrives_s, t_s, message)]
        match self.fault:
            case "removed":
                return []
            case "frozen":
                return [(arrives_s, t_s, self._held)]
            case "late":
                return [(arrives_s + 0.2, t_s, message)]
            case "old":
                index = flight.index(t_s - 0.2)
                return [(arrives_s, t_s, self.measure(flight, float(flight.t_s[index])))]
            case "garbage":
                return [(arrives_s, t_s, self.garbage(message))]
            case "scale" | "step":
                return [(arrives_s, t_s, self.biased(message))]
            case "ramp":
                return [(arrives_s, t_s, self.displaced(message, (RAMP_M_S * self._ramped_s(message, t_s), 0.0, 0.0)))]
            case "outliers":
                displacement = tuple((self.fault_rng.normal(size=3) * OUTLIER_M).tolist())
                is_wrong = self.fault_rng.random() < self.wrong_share
                return [(arrives_s, t_s, self.displaced(message, displacement) if is_wrong else message)]
            case "bursts":
                return [(arrives_s, t_s, self.displaced(message, self._burst_m()))]
        return [(arrives_s, t_s, message)]

    def _burst_m(self) -> Vector3:
        """Error of a report: now and then two to four in a row have the same one."""
        if self._burst_left:
            self._burst_left -= 1
        elif self.fault_rng.random() < self.wrong_share:
            self._burst = tuple((self.fault_rng.normal(size=3) * OUTLIER_M).tolist())
            self._burst_left = int(self.fault_rng.integers(1, 4))
        else:
            return (0.0, 0.0, 0.0)
        return self._burst

    def measure(self, flight: Flight, t_s: float) -> Any:
        raise NotImplementedError

    def garbage(self, message: Any) -> Any:
        raise NotImplementedError

    def biased(self, message: Any) -> Any:
        raise NotImplementedError

    def displaced(self, message: Any, by_m: Vector3) -> Any:
        """The message with its position off by a vector."""
        raise NotImplementedError

    def _ramped_s(self, message: Any, t_s: float) -> float:
        """For how long an error has grown that is in this message: an odometer's since its reference."""
        begin_s = self.fault_s[0]
        return t_s - (max(message.reference_t_s, begin_s) if isinstance(message, Odometry) else begin_s)


@dataclass
class Odometer(Sensor):
    """Key-framed; the errors of one key frame's reports have a share in common, which wanders slowly."""

    std_m: float = 0.003
    std_rad: float = 3e-4
    share: float = 0.9
    key_m: float = 0.6
    key_s: float = 4.0
    is_level: bool = False
    blind: tuple[int, ...] = ()
    scale: float = 0.0
    _key: tuple[float, int] = (-1.0, 0)
    _common: Array = field(default_factory=lambda: np.zeros(6))
    _stepped: bool = False

    def measure(self, flight: Flight, t_s: float) -> Odometry:
        now = flight.index(t_s)
        key_s, key = self._key
        if (
            key_s < 0.0
            or t_s - key_s > self.key_s
            or np.linalg.norm(flight.position[now] - flight.position[key]) > self.key_m
        ):
            if key_s >= 0.0:
                self._new_key(t_s - 1.0 / self.rate_hz, flight)
            else:
                self._new_key(t_s, flight)
        key_s, key = self._key
        then = flight.attitude[key]
        axes = from_yaw(yaw_of(then)) if self.is_level else then
        n, e, d = flight.position[now] - flight.position[key]
        kept = np.exp(-1.0 / (self.rate_hz * WANDER_S))
        self._common = kept * self._common + np.sqrt((1.0 - kept**2) * self.share) * self._draw()
        noise = self._common + np.sqrt(1.0 - self.share) * self._draw()
        scale = 1.0 + self.scale
        x, y, z = rotate_back(axes, (n * scale, e * scale, d * scale))
        turned = multiply(multiply(conjugate(axes), flight.attitude[now]), from_rotation_vector(tuple(noise[3:])))
        covariance = np.diag([self.std_m**2] * 3 + [self.std_rad**2] * 3)
        for axis in self.blind:
            covariance[axis, axis] = UNKNOWN_VARIANCE
        return Odometry(
            source=self.name,
            reference_t_s=key_s,
            position_m=(x + noise[0], y + noise[1], z + noise[2]),
            reference_from_frd=turned,
            covariance=covariance.ravel().tolist(),
            is_level=self.is_level,
            shared=self.share,
        )

    def _new_key(self, t_s: float, flight: Flight) -> None:
        index = flight.index(t_s)
        self._key = (float(flight.t_s[index]), index)
        self._common = np.sqrt(self.share) * self._draw()
        self._stepped = False

    def _draw(self) -> Array:
        draw: Array = self.rng.normal(size=6) * ([self.std_m] * 3 + [self.std_rad] * 3)
        return draw

    def garbage(self, message: Odometry) -> Odometry:
        x, y, z = self.rng.normal(size=3) * 2.0
        return _changed(
            message, position_m=(x, y, z), reference_from_frd=from_rotation_vector(tuple(self.rng.normal(size=3)))
        )

    def biased(self, message: Odometry) -> Odometry:
        x, y, z = message.position_m
        if self.fault == "scale":
            return _changed(message, position_m=(x * 1.05, y * 1.05, z * 1.05))
        return _changed(message, position_m=(x + 0.2, y, z))

    def displaced(self, message: Odometry, by_m: Vector3) -> Odometry:
        x, y, z = (value + more for value, more in zip(message.position_m, by_m, strict=True))
        return _changed(message, position_m=(x, y, z))


@dataclass
class Tracker(Sensor):
    """Sees a lamp on the body from outside."""

    std_m: Vector3 = (0.008, 0.02, 0.008)
    lever: Vector3 = (0.1, 0.0, -0.08)
    lasting_s: float = 0.0
    """Time after which 0.37 of an error is left; 0: it is another one with each report."""
    _error_m: Array = field(default_factory=lambda: np.zeros(3))

    def measure(self, flight: Flight, t_s: float) -> PositionFix:
        now = flight.index(t_s)
        lamp = rotate(flight.attitude[now], self.lever)
        share = np.exp(-1.0 / (self.rate_hz * self.lasting_s)) if self.lasting_s else 0.0
        self._error_m = share * self._error_m + np.sqrt(1.0 - share**2) * self.rng.normal(size=3) * self.std_m
        place = flight.position[now] + lamp + self._error_m
        return PositionFix(
            source=self.name,
            position_ned_m=tuple(place.tolist()),
            covariance=np.diag(np.square(self.std_m)).ravel().tolist(),
            lever_frd_m=self.lever,
        )

    def garbage(self, message: PositionFix) -> PositionFix:
        return _changed(message, position_ned_m=tuple((self.rng.normal(size=3) * 5.0).tolist()))

    def biased(self, message: PositionFix) -> PositionFix:
        n, e, d = message.position_ned_m
        return _changed(
            message, position_ned_m=(n * 1.05, e * 1.05, d * 1.05) if self.fault == "scale" else (n + 0.2, e, d)
        )

    def displaced(self, message: PositionFix, by_m: Vector3) -> PositionFix:
        n, e, d = (value + more for value, more in zip(message.position_ned_m, by_m, strict=True))
        return _changed(message, position_ned_m=(n, e, d))


@dataclass
class Height(Sensor):
    """A range finder that is fixed to the body, over a floor at zero."""

    boxes_s: tuple[tuple[float, float], ...] = ()
    """When it is over a box of 0.6 m."""

    def measure(self, flight: Flight, t_s: float) -> HeightAboveGround:
        now = flight.index(t_s)
        cosine = rotate(flight.attitude[now], (0.0, 0.0, 1.0))[2]
        floor_m = -0.6 if any(begin_s < t_s < end_s for begin_s, end_s in self.boxes_s) else 0.0
        range_m = (0.1 + floor_m - flight.position[now][2]) / cosine + self.rng.normal() * 0.01
        return HeightAboveGround(height_m=float(range_m), is_valid=True)

    def garbage(self, message: HeightAboveGround) -> HeightAboveGround:
        return HeightAboveGround(height_m=float(self.rng.uniform(0.0, 20.0)), is_valid=True)

    def biased(self, message: HeightAboveGround) -> HeightAboveGround:
        more = 0.05 * message.height_m if self.fault == "scale" else 0.2
        return HeightAboveGround(height_m=message.height_m + more, is_valid=True)

    def displaced(self, message: HeightAboveGround, by_m: Vector3) -> HeightAboveGround:
        return HeightAboveGround(height_m=max(message.height_m + by_m[0], 0.0), is_valid=True)


def _changed(message: M, **fields: Any) -> M:
    return msgspec.structs.replace(message, **fields)


def sensors_of(platform: str, seed: int) -> list[Sensor]:
    """The pelican's sensors, or the hummingbird's: without the laser."""
    make = [
        Odometer("stereo", 15.0, 0.06, std_m=0.002, std_rad=2e-4),
        Odometer("ground", 15.0, 0.05, std_m=0.004, std_rad=5e-4, key_m=0.4, is_level=True, blind=(3, 4)),
        Tracker("tracker", 10.0, 0.08),
        Height("height", 20.0, 0.02),
    ]
    if platform == "pelican":
        make.insert(
            2,
            Odometer(
                "laser", 10.0, 0.06, std_m=0.004, std_rad=4e-4, key_m=2.0, key_s=6.0, is_level=True, blind=(2, 3, 4)
            ),
        )
    for number, sensor in enumerate(make):
        sensor.rng = np.random.default_rng((seed, number))
        sensor.fault_rng = np.random.default_rng((seed, number, 1))
    return make
