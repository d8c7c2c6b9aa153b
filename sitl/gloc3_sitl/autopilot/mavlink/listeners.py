"""Messages that are neither commands nor a microservice: heartbeats, setpoints, sticks, origin, odometry."""

from collections.abc import Callable, Mapping
from math import inf
from typing import TYPE_CHECKING, Final

from gloc3.frames import GeoPoint
from gloc3.link.message import Address, MavlinkMessage
from gloc3_sitl.autopilot.mavlink.odometry import odometry, vision_position, vision_speed
from gloc3_sitl.autopilot.mavlink.setpoints import attitude_setpoint, motion_setpoint
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.mavlink.front import Front

Listener = Callable[["Front", MavlinkMessage, Address], None]

_GROUND_STATION: Final = 6
_JOYSTICK_S: Final = 0.5
"""A joystick that is silent for so long is gone."""


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
    """A joystick at the ground station: the same as the pilot's sticks, as long as it goes on."""
    if not front.takes_joystick(sender):
        return
    pilot = front.craft.pilot
    if pilot.is_on and pilot.held_until_s == inf:
        return  # a transmitter goes first
    roll, pitch, yaw = (value / 1000.0 for value in (message.y, -message.x, message.r))
    pilot.sticks(roll=roll, pitch=pitch, yaw=yaw, throttle=message.z / 1000.0)
    pilot.held_until_s = front.craft.now_s + _JOYSTICK_S


def _origin(front: "Front", message: MavlinkMessage, sender: Address) -> None:
    del sender
    front.set_origin(GeoPoint(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3))


LISTENERS: Final[Mapping[str, Listener]] = {
    "HEARTBEAT": _heartbeat,
    "MANUAL_CONTROL": _manual_control,
    "ODOMETRY": odometry,
    "REQUEST_DATA_STREAM": _data_stream,
    "SET_ATTITUDE_TARGET": _attitude,
    "SET_GPS_GLOBAL_ORIGIN": _origin,
    "SET_MODE": _set_mode,
    "SET_POSITION_TARGET_GLOBAL_INT": _motion,
    "SET_POSITION_TARGET_LOCAL_NED": _motion,
    "VISION_POSITION_ESTIMATE": vision_position,
    "VISION_SPEED_ESTIMATE": vision_speed,
}
"""By the name of the message."""
