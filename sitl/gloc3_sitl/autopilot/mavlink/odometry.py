"""Odometry from outside (vision, laser, motion capture): which messages and frames each style takes."""

from math import isfinite, sqrt
from typing import TYPE_CHECKING, Final

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.frames import Vector3, from_yaw, normalize, rotate, wrap_pi, yaw_of
from gloc3_sitl.autopilot.estimator.sources import ExternalOdometry, Source

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.mavlink.front import Front

_LOCAL_NED, _LOCAL_FRD, _BODY_FRD = 1, 20, 12
_ESTIMATORS: Final = (0, 1, 2, 3)
"""UNKNOWN, NAIVE, VISION and VIO; PX4 refuses the rest."""
_X, _Y = 0, 6
"""Places of the first two variances in a row-major upper triangle of a 6x6 covariance."""
_USUAL_DEVIATION: Final = 0.1
_ALIGNING_SHARE: Final = 0.01


class HeadingOffset:
    """The heading of an odometer's own frame, whose x axis points wherever it was switched on."""

    __slots__ = ("_offset_rad", "_resets")

    def __init__(self) -> None:
        self._offset_rad: float | None = None
        self._resets = -1

    def update(self, own_yaw_rad: float, odometer_yaw_rad: float, reset_counter: int) -> float:
        """Heading of the odometer's x axis, from the two headings of the vehicle; it changes slowly."""
        seen = wrap_pi(own_yaw_rad - odometer_yaw_rad)
        if self._offset_rad is None or reset_counter != self._resets:
            self._offset_rad = seen
        else:
            self._offset_rad = wrap_pi(self._offset_rad + _ALIGNING_SHARE * wrap_pi(seen - self._offset_rad))
        self._resets = reset_counter
        return self._offset_rad


def odometry(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """ODOMETRY, in the frames and from the estimators that the style takes.

    Raises:
        Refused: PX4 does not take this frame or estimator; ArduPilot ignores such messages.
    """
    del sender
    frame, child = message.frame_id, message.child_frame_id
    if front.is_px4:
        if message.estimator_type not in _ESTIMATORS:
            raise Refused(f"estimator type {message.estimator_type} is not supported")
        if frame not in (_LOCAL_NED, _LOCAL_FRD):
            raise Refused(f"frame {frame} is not supported")
        least = front.autopilot.parameters["EKF2_EV_QMIN"]
    elif frame != _LOCAL_FRD or child != _BODY_FRD or not front.autopilot.parameters["VISO_TYPE"]:
        return
    else:
        least = front.autopilot.parameters["VISO_QUAL_MIN"]
    if message.quality < 0 or 0 < message.quality < least:
        return
    has_attitude = all(isfinite(value) for value in message.q)
    rotation = normalize((message.q[0], message.q[1], message.q[2], message.q[3]))
    position = _finite((message.x, message.y, message.z))
    velocity = _finite((message.vx, message.vy, message.vz))
    if velocity is not None and child == _BODY_FRD:
        velocity = rotate(rotation, velocity)
    yaw = yaw_of(rotation) if has_attitude else None
    estimator = front.autopilot.estimator
    if frame == _LOCAL_FRD and yaw is not None and not estimator.sources & Source.EXTERNAL_YAW:
        turn = from_yaw(front.heading_offset.update(estimator.yaw_rad, yaw, message.reset_counter))
        position = None if position is None else rotate(turn, position)
        velocity = None if velocity is None else rotate(turn, velocity)
    _take(
        front,
        message.time_usec,
        position,
        velocity,
        yaw,
        _deviation(message.pose_covariance),
        _deviation(message.velocity_covariance),
        message.reset_counter,
    )


def vision_position(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """VISION_POSITION_ESTIMATE."""
    del sender
    position = _finite((message.x, message.y, message.z))
    deviation = _deviation(message.covariance)
    _take(front, message.usec, position, None, message.yaw, deviation, _USUAL_DEVIATION, message.reset_counter)


def vision_speed(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """VISION_SPEED_ESTIMATE, which only ArduPilot takes."""
    del sender
    if not front.is_px4:
        velocity = _finite((message.x, message.y, message.z))
        resets = front.autopilot.estimator.external_resets
        _take(front, message.usec, None, velocity, None, _USUAL_DEVIATION, _USUAL_DEVIATION, resets)


def mocap(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """ATT_POS_MOCAP: ArduPilot takes it; what PX4 makes of it its estimator does not use."""
    del sender
    if front.is_px4 or not front.autopilot.parameters["VISO_TYPE"]:
        return
    w, x, y, z = message.q
    yaw = yaw_of(normalize((w, x, y, z))) if all(isfinite(value) for value in message.q) else None
    position = _finite((message.x, message.y, message.z))
    resets = front.autopilot.estimator.external_resets
    _take(front, message.time_usec, position, None, yaw, _USUAL_DEVIATION, _USUAL_DEVIATION, resets)


def _take(
    front: "Front",
    time_usec: int,
    position: Vector3 | None,
    velocity: Vector3 | None,
    yaw_rad: float | None,
    position_deviation_m: float,
    velocity_deviation_m_s: float,
    reset_counter: int,
) -> None:
    if not front.autopilot.takes_odometry:
        return
    now_s = front.craft.now_s
    t_s = time_usec * 1e-6
    if not now_s - 1.0 < t_s <= now_s:
        t_s = now_s  # another clock, or none: taken as new
    front.autopilot.estimator.take_external(
        ExternalOdometry(
            t_s=t_s,
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            yaw_rad=yaw_rad,
            position_deviation_m=position_deviation_m,
            velocity_deviation_m_s=velocity_deviation_m_s,
            reset_counter=reset_counter,
        ),
        now_s,
    )


def _finite(vector: Vector3) -> Vector3 | None:
    return vector if all(isfinite(value) for value in vector) else None


def _deviation(covariance: tuple[float, ...]) -> float:
    """Root of the larger variance of x and y, or the usual one where none is given."""
    variance = max(covariance[_X], covariance[_Y])
    return sqrt(variance) if isfinite(variance) and variance > 0.0 else _USUAL_DEVIATION
