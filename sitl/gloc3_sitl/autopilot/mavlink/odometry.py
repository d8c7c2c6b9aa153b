"""External odometry (vision, laser, motion capture): the messages and frames that each style accepts."""

from math import isfinite, sqrt
from typing import Final

from msgspec.structs import replace

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.frames import Vector3, from_yaw, normalize, rotate, yaw_of
from gloc3_sitl.autopilot.estimator.sources import USUAL_DEVIATION, AidingSource, ExternalOdometry
from gloc3_sitl.autopilot.mavlink.context import FrontContext

_LOCAL_NED, _LOCAL_FRD, _BODY_FRD = 1, 20, 12
_ESTIMATORS: Final = (0, 1, 2, 3)
"""UNKNOWN, NAIVE, VISION and VIO; PX4 refuses the rest."""
_X, _Y = 0, 6
"""Places of the first two variances in a row-major upper triangle of a 6x6 covariance."""
OLD_S: Final = 1.0
"""Age up to which a measurement is placed in the past."""
OTHER_CLOCK_S: Final = 60.0
"""Age from which its time is one by another clock."""


def odometry(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """ODOMETRY, in the frames and from the estimators that the style takes.

    Raises:
        Refused: PX4 does not take this frame or estimator; ArduPilot ignores such messages.
    """
    del sender
    frame, child = message.frame_id, message.child_frame_id
    if context.is_px4:
        if message.estimator_type not in _ESTIMATORS:
            raise Refused(f"estimator type {message.estimator_type} is not supported")
        if frame not in (_LOCAL_NED, _LOCAL_FRD):
            raise Refused(f"frame {frame} is not supported")
        least = context.autopilot.parameters["EKF2_EV_QMIN"]
    elif frame != _LOCAL_FRD or child != _BODY_FRD or not context.autopilot.parameters["VISO_TYPE"]:
        return
    else:
        least = context.autopilot.parameters["VISO_QUAL_MIN"]
    if message.quality < 0 or 0 < message.quality < least:
        return
    has_attitude = all(isfinite(value) for value in message.q)
    rotation = normalize((message.q[0], message.q[1], message.q[2], message.q[3]))
    position = _finite((message.x, message.y, message.z))
    velocity = _finite((message.vx, message.vy, message.vz))
    if velocity is not None and child == _BODY_FRD:
        velocity = rotate(rotation, velocity)
    yaw = yaw_of(rotation) if has_attitude else None
    estimator = context.autopilot.estimator
    if frame == _LOCAL_FRD and yaw is not None and not estimator.sources & AidingSource.EXTERNAL_YAW:
        turn = from_yaw(context.heading_offset.update(estimator.yaw_rad, yaw, message.reset_counter))
        position = None if position is None else rotate(turn, position)
        velocity = None if velocity is None else rotate(turn, velocity)
    odometer = ExternalOdometry(
        t_s=message.time_usec * 1e-6,
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        yaw_rad=yaw,
        yaw_is_from_north=frame == _LOCAL_NED or not context.is_px4,
        position_deviation_m=_deviation(message.pose_covariance),
        velocity_deviation_m_s=_deviation(message.velocity_covariance),
        reset_counter=message.reset_counter,
    )
    _estimate(context, odometer)


def vision_position(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """VISION_POSITION_ESTIMATE."""
    del sender
    odometer = ExternalOdometry(
        t_s=message.usec * 1e-6,
        position_ned_m=_finite((message.x, message.y, message.z)),
        yaw_rad=message.yaw,
        position_deviation_m=_deviation(message.covariance),
        reset_counter=message.reset_counter,
    )
    _estimate(context, odometer)


def vision_speed(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """VISION_SPEED_ESTIMATE, which only ArduPilot takes."""
    del sender
    if not context.is_px4:
        odometer = ExternalOdometry(
            t_s=message.usec * 1e-6,
            velocity_ned_m_s=_finite((message.x, message.y, message.z)),
            reset_counter=context.autopilot.estimator.external_resets,
        )
        _estimate(context, odometer)


def mocap(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """ATT_POS_MOCAP: used by ArduPilot; PX4's estimator ignores it."""
    del sender
    if context.is_px4 or not context.autopilot.parameters["VISO_TYPE"]:
        return
    w, x, y, z = message.q
    odometer = ExternalOdometry(
        t_s=message.time_usec * 1e-6,
        position_ned_m=_finite((message.x, message.y, message.z)),
        yaw_rad=yaw_of(normalize((w, x, y, z))) if all(isfinite(value) for value in message.q) else None,
        reset_counter=context.autopilot.estimator.external_resets,
    )
    _estimate(context, odometer)


def _estimate(context: FrontContext, odometer: ExternalOdometry) -> None:
    """Hands odometry to the estimator; a time by another clock, or none, is taken as now.

    PX4's estimator drops what has been too long on its way; ArduPilot takes its lag for half a second at most.
    """
    if not context.autopilot.accepts_odometry:
        return
    now_s = context.craft.now_s
    age_s = now_s - odometer.t_s
    if context.is_px4 and OLD_S <= age_s < OTHER_CLOCK_S and odometer.t_s > 0.0:
        return
    if not 0.0 <= age_s < OLD_S:
        odometer = replace(odometer, t_s=now_s)
    context.autopilot.estimator.use_external(odometer, now_s)


def _finite(vector: Vector3) -> Vector3 | None:
    return vector if all(isfinite(value) for value in vector) else None


def _deviation(covariance: tuple[float, ...]) -> float:
    """Root of the larger variance of x and y, or the default without one."""
    variance = max(covariance[_X], covariance[_Y])
    return sqrt(variance) if isfinite(variance) and variance > 0.0 else USUAL_DEVIATION
