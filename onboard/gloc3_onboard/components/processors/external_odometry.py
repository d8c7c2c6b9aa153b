"""DP: odometry by an estimator that is not ours: its poses made into motions of the body, which are judged as others are."""

from collections.abc import Sequence
from math import dist, hypot, radians
from typing import Annotated

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import (
    Quaternion,
    Vector3,
    conjugate,
    from_euler,
    multiply,
    rotate,
    rotate_back,
)
from gloc3.messages.perception import EstimatorPose, Odometry, no_motion


class ExternalOdometrySettings(Settings, frozen=True):
    """Settings of the odometry: where the estimator's body is, and what its motions are trusted with."""

    source: str = "external"
    """Its name in the fusion, in logs and on screens."""
    mount_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Origin of the estimator's body (its camera or inertial unit) in the vehicle's, in metres."""
    mount_euler_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of that body in the vehicle's, in degrees."""
    std_m: Annotated[float, Bounds(1e-4, 10.0)] = 0.01
    """Standard deviation of a motion, in metres, however short it is."""
    share: Annotated[float, Bounds(0.0, 1.0)] = 0.01
    """The same that grows with the distance, as a share of it."""
    std_deg: Annotated[float, Bounds(1e-3, 90.0)] = 0.2
    """Standard deviation of a turn, in degrees, however short it is."""
    deg_per_m: Annotated[float, Bounds(0.0, 90.0)] = 0.05
    """The same that grows with the distance, in degrees per metre."""
    key_m: Annotated[float, Bounds(0.01, 100.0)] = 1.0
    """Distance from the reference of the motions after which they get a new one, in metres."""
    key_s: Annotated[float, Bounds(0.05, 60.0)] = 1.0
    """Time after which they get one, in seconds."""
    max_m_s: Annotated[float, Bounds(0.1, 300.0)] = 20.0
    """A motion that is faster cannot be the vehicle's: the estimator has jumped without saying so."""


class _Key:
    """A pose of the vehicle in the estimator's axes.

    Args:
        t_s: when.
        pose: as it came.
        settings: the mount.
    """

    __slots__ = ("attitude", "position_m", "reset_counter", "t_s", "variances")

    def __init__(self, t_s: float, pose: EstimatorPose, settings: ExternalOdometrySettings) -> None:
        roll, pitch, yaw = map(radians, settings.mount_euler_deg)
        self.t_s, self.reset_counter = t_s, pose.reset_counter
        self.attitude: Quaternion = multiply(pose.world_from_body, conjugate(from_euler(roll, pitch, yaw)))
        x, y, z = rotate(self.attitude, settings.mount_frd_m)
        self.position_m: Vector3 = (pose.position_m[0] - x, pose.position_m[1] - y, pose.position_m[2] - z)
        self.variances = [pose.covariance[7 * index] for index in range(6)] if pose.covariance else [0.0] * 6


class ExternalOdometryProcessor(DataProcessor[ExternalOdometrySettings]):
    """One motion for each pose of the estimator, relative to a key pose of it.

    Where the estimator restarts, jumps or loses its way there is no motion, and the next pose is a new key. What it claims
    of its own uncertainty counts as far as that grows from the key on; the settings are the least that is assumed.
    """

    loggable = ("travelled_m", "resets", "reason")

    estimator_pose = Input(EstimatorPose, Keep.ALL)
    odometry = Output(Odometry)

    def __init__(self) -> None:
        self.travelled_m = 0.0
        self.resets = 0
        """Times that the estimator has restarted, or jumped."""
        self.reason = ""
        self._key: _Key | None = None
        self._last: _Key | None = None

    def initialize(self, settings: ExternalOdometrySettings) -> None:
        """Adopts the settings."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins with the next pose."""
        self._key = self._last = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes the poses in the order of time."""
        reports = [self._report(pose.payload, pose.t_s) for pose in inbox.new(self.estimator_pose)]
        return [self.odometry.report(report, t_s=t_s) for report, t_s in reports]

    def _report(self, pose: EstimatorPose, t_s: float) -> tuple[Odometry, float]:
        settings = self.settings
        if not pose.is_valid:
            return self._lost(pose.reason, None, t_s)
        now = _Key(t_s, pose, settings)
        key, last = self._key, self._last
        if key is None or last is None:
            return self._lost("it begins", now, t_s)
        if now.reset_counter != last.reset_counter:
            self.resets += 1
            return self._lost("the estimator has restarted", now, t_s)
        moved_m = dist(now.position_m, last.position_m)
        if t_s <= last.t_s or moved_m > settings.max_m_s * (t_s - last.t_s) + settings.std_m:
            self.resets += 1
            return self._lost(f"it has jumped by {moved_m:.2f} m", now, t_s)
        if t_s - key.t_s > settings.key_s or dist(key.position_m, last.position_m) > settings.key_m:
            key = self._key = last
        self._last = now
        self.travelled_m += moved_m
        self.reason = pose.reason
        return self._motion(key, now, pose.quality), t_s

    def _lost(self, reason: str, begin: _Key | None, t_s: float) -> tuple[Odometry, float]:
        self._key = self._last = begin
        self.reason = reason
        return no_motion(self.settings.source, t_s, reason), t_s

    def _motion(self, key: _Key, now: _Key, quality: float) -> Odometry:
        settings = self.settings
        x, y, z = (b - a for a, b in zip(key.position_m, now.position_m, strict=True))
        length_m = hypot(x, y, z)
        grown = [max(0.0, after - before) for before, after in zip(key.variances, now.variances, strict=True)]
        place = settings.std_m**2 + (settings.share * length_m) ** 2 + max(grown[:3])
        turn = radians(settings.std_deg) ** 2 + radians(settings.deg_per_m * length_m) ** 2 + max(grown[3:])
        variances = (place,) * 3 + (turn,) * 3
        return Odometry(
            source=settings.source,
            reference_t_s=key.t_s,
            position_m=rotate_back(key.attitude, (x, y, z)),
            reference_from_frd=multiply(conjugate(key.attitude), now.attitude),
            covariance=[variances[index // 7] if index % 7 == 0 else 0.0 for index in range(36)],
            quality=quality,
            shared=0.5,
        )
