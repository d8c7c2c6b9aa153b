"""What other programs' estimators send: JSON lines and MAVLink ODOMETRY, decoded into one form; no I/O.

JSON: our own line, described in docs/sensors.md. MAVLink: common.xml, ODOMETRY (331). Axes: x forward, y left,
z up (*flu*, as ROS REP-103 and REP-105 have them) or x forward, y right, z down (*frd*, which *ned* fits as well).
"""

from collections.abc import Mapping, Sequence
from math import hypot, isfinite
from typing import Annotated, Any, Final, NamedTuple, Protocol

import msgspec

from gloc3.mavlink.codec import Parser
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.messages.perception import EstimatorPose

FLU, FRD = "flu", "frd"
COVARIANCE: Final = 36
_UPPER: Final = 21
"""Numbers of the upper triangle of a symmetric matrix of 6 by 6, rows first."""
_UNIT: Final = 1e-3
"""By so much the norm of a quaternion may differ from 1, squared; it is normalised then."""
_FRAMES: Final[Mapping[int, str]] = {1: FRD, 20: FRD, 21: FLU}
"""MAV_FRAME of the position: LOCAL_NED, LOCAL_FRD, LOCAL_FLU."""
_LOST: Final = -1
"""The quality that MAVLink's ODOMETRY has when the estimator has failed."""
_FAR_M: Final = 1e7
"""A position beyond this is no vehicle's."""
_LATE_S: Final = 1e10
"""A time beyond this, either way, is no clock's."""


class EstimatorReport(NamedTuple):
    """A pose, and the estimator's own time if it sends one."""

    stamp_s: float | None
    pose: EstimatorPose


class EstimatorDecoder(Protocol):
    """Decodes datagrams."""

    damaged: int
    """Datagrams and lines that could not be read."""

    def receive(self, data: bytes) -> Sequence[EstimatorReport]:
        """The poses of a datagram."""


class _Line(msgspec.Struct, kw_only=True):
    """A JSON line."""

    t_s: float | None = None
    position_m: tuple[float, float, float]
    attitude_wxyz: tuple[float, float, float, float]
    covariance: Annotated[list[float], msgspec.Meta(max_length=COVARIANCE)] = []
    reset_counter: Annotated[int, msgspec.Meta(ge=0, lt=2**32)] = 0
    quality: float = 1.0
    axes: str = FLU


class JsonDecoder:
    """One JSON object a line, one line or several a datagram."""

    def __init__(self) -> None:
        self.damaged = 0
        self._decoder = msgspec.json.Decoder(_Line)

    def receive(self, data: bytes) -> Sequence[EstimatorReport]:
        """The poses of a datagram; lines that are none are counted."""
        found = []
        for line in data.splitlines():
            try:
                found.append(self._report(self._decoder.decode(line)))
            except (msgspec.DecodeError, ValueError, RecursionError):
                self.damaged += 1
        return found

    def _report(self, line: _Line) -> EstimatorReport:
        if line.t_s is not None and not abs(line.t_s) <= _LATE_S:
            raise ValueError("its time is no clock's")
        return EstimatorReport(
            line.t_s,
            pose_of(
                line.position_m,
                line.attitude_wxyz,
                full(line.covariance),
                axes=line.axes,
                reset_counter=line.reset_counter,
                quality=line.quality,
            ),
        )


class OdometryDecoder:
    """MAVLink's ODOMETRY, from whatever system and component."""

    def __init__(self) -> None:
        self.damaged = 0
        self._parser = Parser(is_datagram=True)

    def receive(self, data: bytes) -> Sequence[EstimatorReport]:
        """The poses of a datagram; other messages are passed over."""
        found = []
        frames = self._parser.receive(data)
        self.damaged += not frames
        for frame in frames:
            message = frame.decode()
            if message is None or message.name != "ODOMETRY":
                continue
            try:
                found.append(_odometry_report(message))
            except ValueError:
                self.damaged += 1
        return found


def _odometry_report(message: Any) -> EstimatorReport:
    axes = _FRAMES.get(message.frame_id)
    if axes is None:
        raise ValueError(f"frame {message.frame_id} is none of LOCAL_NED, LOCAL_FRD, LOCAL_FLU")
    claimed = [float(number) for number in message.pose_covariance]
    quality = 1.0 if message.quality == 0 else message.quality / 100.0  # 0: the estimator does not say
    pose = pose_of(
        (message.x, message.y, message.z),
        tuple(message.q),
        full(claimed) if isfinite(claimed[0]) else [],
        axes=axes,
        reset_counter=message.reset_counter,
        quality=-1.0 if message.quality == _LOST else quality,
    )
    return EstimatorReport(message.time_usec * 1e-6 if message.time_usec else None, pose)


def full(numbers: Sequence[float]) -> list[float]:
    """A covariance of 6 by 6, from all its numbers, from its upper triangle, or from none.

    Raises:
        ValueError: their count fits neither.
    """
    if len(numbers) in (0, COVARIANCE):
        return list(numbers)
    if len(numbers) != _UPPER:
        raise ValueError(f"a covariance has {COVARIANCE} or {_UPPER} numbers")
    whole, given = [0.0] * COVARIANCE, iter(numbers)
    for row in range(6):
        for column in range(row, 6):
            whole[6 * row + column] = whole[6 * column + row] = next(given)
    return whole


def pose_of(
    position_m: Vector3,
    attitude_wxyz: Quaternion | tuple[float, ...],
    covariance: list[float],
    *,
    axes: str,
    reset_counter: int,
    quality: float,
) -> EstimatorPose:
    """The pose with z pointing down.

    Args:
        position_m: in the estimator's axes.
        attitude_wxyz: of its body in them.
        covariance: of both; empty where not claimed.
        axes: `flu` or `frd`, of the estimator's world and of its body.
        reset_counter: that of the estimator.
        quality: 0 to 1; negative where it has failed.

    Raises:
        ValueError: a number is not finite, the attitude is no rotation, or the axes are unknown.
    """
    if len(attitude_wxyz) != 4 or not all(map(isfinite, (*position_m, *attitude_wxyz, *covariance, quality))):
        raise ValueError("a number is not finite")
    norm = hypot(*attitude_wxyz)
    if abs(norm * norm - 1.0) > _UNIT:
        raise ValueError("the attitude is no rotation")
    if max(map(abs, position_m)) > _FAR_M:
        raise ValueError("the position is no vehicle's")
    if any(covariance[7 * index] < 0.0 for index in range(6) if covariance):
        raise ValueError("a variance is negative")
    (x, y, z), (w, i, j, k) = position_m, (part / norm for part in attitude_wxyz)
    if axes == FLU:
        y, z, j, k = -y, -z, -j, -k
        signs = (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
        covariance = [number * signs[at // 6] * signs[at % 6] for at, number in enumerate(covariance)]
    elif axes != FRD:
        raise ValueError(f"axes are {FLU} or {FRD}")
    is_valid = quality > 0.0
    return EstimatorPose(
        position_m=(x, y, z),
        world_from_body=(w, i, j, k),
        covariance=covariance,
        reset_counter=reset_counter,
        is_valid=is_valid,
        reason="" if is_valid else "the estimator has lost its way",
        quality=min(1.0, max(0.0, quality)),
    )
