"""Setpoints from MAVLink: type masks and frames, as each style takes them."""

from math import cos, isfinite, nan, sin
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.frames import Vector3, normalize
from gloc3_sitl.autopilot.control.setpoint import FREE, AttitudeSetpoint, MotionSetpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import StyleTables

_POSITION, _VELOCITY, _ACCELERATION = 0o7, 0o70, 0o700
_FORCE, _YAW, _YAW_RATE = 512, 1024, 2048

_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET = 1, 7, 8, 9
_PX4_FRAMES: Final = (_LOCAL, _BODY)
_ARDUPILOT_FRAMES: Final = (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET)
_ABSOLUTE: Final = (0, 5)
_RELATIVE: Final = (3, 6)
_TERRAIN: Final = (10, 11)

_ATTITUDE_IGNORED, _THRUST_IGNORED, _RATES_IGNORED = 128, 64, 7


def motion_setpoint(message: MavlinkMessage, craft: Craft, style: StyleTables) -> MotionSetpoint:
    """Reads SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.

    Raises:
        Refused: the style does not take this mask or frame, or a number is not finite; the text says which.
    """
    mask = message.type_mask
    if mask & _FORCE:
        raise Refused("forces are not supported")
    whole = not style.streamed_needs_stream  # ArduPilot wants all three axes of each, or none
    for bits, word in ((_POSITION, "position"), (_VELOCITY, "velocity"), (_ACCELERATION, "acceleration")):
        if whole and mask & bits not in (0, bits):
            raise Refused(f"all three axes of the {word} are needed")
    velocity = _axes(mask >> 3, (message.vx, message.vy, message.vz), "velocity")
    acceleration = _axes(mask >> 6, (message.afx, message.afy, message.afz), "acceleration")
    yaw = nan if mask & _YAW else _number(message.yaw, "yaw")
    yaw_rate = 0.0 if mask & _YAW_RATE else _number(message.yaw_rate, "yaw rate")
    if message.name == "SET_POSITION_TARGET_GLOBAL_INT":
        position = _global_position(message, craft, mask)
    else:
        frame = message.coordinate_frame
        if frame not in (_PX4_FRAMES if style.streamed_needs_stream else _ARDUPILOT_FRAMES):
            raise Refused(f"frame {frame} is not supported")
        position = _axes(mask, (message.x, message.y, message.z), "position")
        here = craft.estimator.inertial.position_ned_m
        heading = craft.estimator.yaw_rad
        if frame in (_BODY, _BODY_OFFSET):
            velocity, acceleration = _turn(velocity, heading), _turn(acceleration, heading)
            if position != FREE and any(isfinite(value) for value in position):
                if style.streamed_needs_stream:
                    raise Refused("positions in the body frame are not supported")
                position = _add(here, _turn(position, heading))
            if isfinite(yaw) and not style.streamed_needs_stream:
                yaw += heading
        elif frame == _LOCAL_OFFSET:
            position = _add(here, position)
    if mask & 0o777 == 0o777:
        if style.streamed_needs_stream:
            raise Refused("the type mask selects no axis")
        position = here_if_free(craft)
    an, ae, ad = acceleration
    return MotionSetpoint(
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        acceleration_ned_m_s2=(an if an == an else 0.0, ae if ae == ae else 0.0, ad if ad == ad else 0.0),
        yaw_rad=yaw,
        yaw_rate_rad_s=yaw_rate,
    )


def attitude_setpoint(message: MavlinkMessage, hover_thrust: float, style: StyleTables) -> AttitudeSetpoint:
    """Reads SET_ATTITUDE_TARGET.

    Raises:
        Refused: a number is not finite, or all fields are ignored.
    """
    mask = message.type_mask
    rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    if mask & _THRUST_IGNORED or not isfinite(message.thrust):
        raise Refused("thrust is required")
    if not style.streamed_needs_stream:
        # ArduPilot reads 0.5 as "hold the height"; the nearest here is the thrust of hover.
        share = max(0.0, min(1.0, message.thrust))
        thrust = 2.0 * share * hover_thrust if share < 0.5 else hover_thrust + (share - 0.5) * 2.0 * (1 - hover_thrust)
    else:
        thrust = max(0.0, min(1.0, message.thrust))
    wanted = tuple(0.0 if mask & 1 << index or not isfinite(rate) else rate for index, rate in enumerate(rates))
    rate_frd: Vector3 = (wanted[0], wanted[1], wanted[2])
    if mask & _ATTITUDE_IGNORED:
        if mask & _RATES_IGNORED == _RATES_IGNORED:
            raise Refused("the type mask selects neither attitude nor rates")
        return AttitudeSetpoint(rate_frd_rad_s=rate_frd, thrust=thrust)
    w, x, y, z = message.q
    size = w * w + x * x + y * y + z * z
    if not 0.5 < size < 2.0:
        raise Refused("the attitude is not a unit quaternion")
    return AttitudeSetpoint(ned_from_frd=normalize((w, x, y, z)), rate_frd_rad_s=rate_frd, thrust=thrust)


def here_if_free(craft: Craft) -> Vector3:
    """Where the vehicle is, for setpoints that ask for a heading alone."""
    return craft.estimator.inertial.position_ned_m


def _axes(mask: int, values: Vector3, word: str) -> Vector3:
    x, y, z = values
    return (
        nan if mask & 1 else _number(x, word),
        nan if mask & 2 else _number(y, word),
        nan if mask & 4 else _number(z, word),
    )


def _number(value: float, word: str) -> float:
    if not isfinite(value):
        raise Refused(f"{word} is not a number")
    return value


def _turn(vector: Vector3, heading_rad: float) -> Vector3:
    x, y, z = vector
    cosine, sine = cos(heading_rad), sin(heading_rad)
    return (x * cosine - y * sine, x * sine + y * cosine, z)


def _add(left: Vector3, right: Vector3) -> Vector3:
    return (left[0] + right[0], left[1] + right[1], left[2] + right[2])


def _global_position(message: MavlinkMessage, craft: Craft, mask: int) -> Vector3:
    if mask & _POSITION == _POSITION:
        return FREE
    origin = craft.estimator.origin
    if origin is None:
        raise Refused("no global origin")
    latitude, longitude = message.lat_int * 1e-7, message.lon_int * 1e-7
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise Refused("the position is not on Earth")
    n, e, _ = origin.ned_from_geo(latitude, longitude, origin.origin.altitude_m)
    height = _number(message.alt, "altitude")
    base = 0.0 if craft.home is None else craft.home.position_ned_m[2]
    if message.coordinate_frame in _ABSOLUTE:
        down = origin.origin.altitude_m - height
    elif message.coordinate_frame in _RELATIVE:
        down = base - height
    elif message.coordinate_frame in _TERRAIN:
        down = craft.estimator.ground_down_m - height
    else:
        raise Refused(f"frame {message.coordinate_frame} is not supported")
    return _axes(mask, (n, e, down), "position")
