"""Messages that are neither commands nor a microservice: heartbeats, setpoints, sticks, vision, origin."""

from collections.abc import Callable, Mapping
from math import isfinite, sqrt
from typing import TYPE_CHECKING, Final

from gloc3.errors import Refused
from gloc3.frames import GeoPoint, Vector3, normalize, rotate, yaw_of
from gloc3.link.message import Address, MavlinkMessage
from gloc3_sitl.autopilot.commander import Author
from gloc3_sitl.autopilot.estimator.sources import ExternalOdometry
from gloc3_sitl.autopilot.mavlink.setpoints import attitude_setpoint, motion_setpoint
from gloc3_sitl.autopilot.modes import PILOTED, Behaviour

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.mavlink.front import Front

Listener = Callable[["Front", MavlinkMessage, Address], None]

_GROUND_STATION: Final = 6
_LOCAL_NED, _LOCAL_FRD, _BODY_FRD = 1, 20, 12
_ESTIMATORS: Final = (0, 1, 2, 3)
"""UNKNOWN, NAIVE, VISION and VIO; PX4 refuses the rest."""


def _heartbeat(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    # PX4 asks for the type of a ground station; ArduPilot for the one system id, whatever its type.
    if not front.is_px4 or message.type == _GROUND_STATION:
        front.station_heard(sender.system)


def _motion(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    del sender
    craft, style = front.craft, front.autopilot.style
    if style.takeoff_in_streamed and front.commander.mode.behaviour is not Behaviour.STREAMED:
        return  # ArduPilot ignores them outside Guided
    craft.stream.put(motion_setpoint(message, craft, style), craft.now_s)


def _attitude(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    del sender
    craft, style = front.craft, front.autopilot.style
    streamed = (Behaviour.STREAMED, Behaviour.STREAMED_ATTITUDE)
    if style.takeoff_in_streamed and front.commander.mode.behaviour not in streamed:
        return
    craft.stream.put(attitude_setpoint(message, craft.tuning.hover_thrust, style), craft.now_s)


def _set_mode(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """SET_MODE (old, still in use with ArduPilot); it has no answer but the heartbeat."""
    del sender
    if message.base_mode & 1:
        front.commander.set_mode(message.custom_mode, Author.COMMAND)


def _data_stream(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    if not front.is_px4:
        rate = float(message.req_message_rate) if message.start_stop else 0.0
        front.set_group(message.req_stream_id, rate, sender)


def _manual_control(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """A joystick at the ground station: the same as the pilot's sticks."""
    del sender
    pilot = front.craft.pilot
    if front.commander.mode.behaviour in PILOTED or pilot.is_on:
        pilot.sticks(
            roll=message.y / 1000.0,
            pitch=-message.x / 1000.0,
            yaw=message.r / 1000.0,
            throttle=message.z / 1000.0,
        )


def _origin(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    del sender
    front.set_origin(GeoPoint(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3))


def _odometry(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """ODOMETRY, in the frames and from the estimators that the style takes."""
    del sender
    frame, child = message.frame_id, message.child_frame_id
    if front.is_px4:
        if message.estimator_type not in _ESTIMATORS:
            raise Refused(f"estimator type {message.estimator_type} is not supported")
        if frame not in (_LOCAL_NED, _LOCAL_FRD):
            raise Refused(f"frame {frame} is not supported")
    elif frame != _LOCAL_FRD or child != _BODY_FRD:
        return
    if message.quality < 0:
        return
    rotation = normalize((message.q[0], message.q[1], message.q[2], message.q[3]))
    position = _finite((message.x, message.y, message.z))
    velocity = _finite((message.vx, message.vy, message.vz))
    if velocity is not None and child == _BODY_FRD:
        velocity = rotate(rotation, velocity)
    _take_external(
        front,
        message.time_usec,
        position,
        velocity,
        yaw_of(rotation) if all(isfinite(value) for value in message.q) else None,
        _deviation(message.pose_covariance, (0, 6), 0.1),
        _deviation(message.velocity_covariance, (0, 6), 0.1),
        message.reset_counter,
    )


def _vision_position(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """VISION_POSITION_ESTIMATE."""
    del sender
    position = _finite((message.x, message.y, message.z))
    deviation = _deviation(message.covariance, (0, 6), 0.1)
    _take_external(front, message.usec, position, None, message.yaw, deviation, 0.1, message.reset_counter)


def _vision_speed(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    """VISION_SPEED_ESTIMATE (ArduPilot)."""
    del sender
    if not front.is_px4:
        velocity = _finite((message.x, message.y, message.z))
        resets = front.autopilot.estimator.external_resets
        _take_external(front, message.usec, None, velocity, None, 0.1, 0.1, resets)


def _take_external(
    front: "Front",
    time_usec: int,
    position: Vector3 | None,
    velocity: Vector3 | None,
    yaw_rad: float | None,
    position_deviation_m: float,
    velocity_deviation_m_s: float,
    reset_counter: int,
) -> None:
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


def _deviation(covariance: tuple[float, ...], diagonal: tuple[int, int], default: float) -> float:
    """Root of the larger variance of x and y, or the default where none is given."""
    first = covariance[0] if covariance else float("nan")
    second = covariance[diagonal[1]] if len(covariance) > diagonal[1] else first
    variance = max(first, second)
    return sqrt(variance) if isfinite(variance) and variance > 0.0 else default


LISTENERS: Final[Mapping[str, Listener]] = {
    "HEARTBEAT": _heartbeat,
    "MANUAL_CONTROL": _manual_control,
    "ODOMETRY": _odometry,
    "REQUEST_DATA_STREAM": _data_stream,
    "SET_ATTITUDE_TARGET": _attitude,
    "SET_GPS_GLOBAL_ORIGIN": _origin,
    "SET_MODE": _set_mode,
    "SET_POSITION_TARGET_GLOBAL_INT": _motion,
    "SET_POSITION_TARGET_LOCAL_NED": _motion,
    "VISION_POSITION_ESTIMATE": _vision_position,
    "VISION_SPEED_ESTIMATE": _vision_speed,
}
"""By the name of the message."""
