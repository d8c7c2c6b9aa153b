"""Messages that are neither commands nor a microservice: heartbeats, setpoints, sticks, origin, odometry."""

from collections.abc import Callable, Mapping
from math import isfinite, nan
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.heartbeat import GROUND_STATION
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.craft import FollowTarget
from gloc3_sitl.autopilot.mavlink.context import FrontContext
from gloc3_sitl.autopilot.mavlink.odometry import mocap, odometry, vision_position, vision_speed
from gloc3_sitl.autopilot.mavlink.setpoints import attitude_setpoint, motion_setpoint
from gloc3_sitl.autopilot.modes import Behaviour, Result
from gloc3_sitl.autopilot.verdict import Author, RequestVerdict

Listener = Callable[[FrontContext, MavlinkMessage, Address], None]

_POLE_DEG: Final = 90.0
_GO_NOW: Final = 2
_OVER_SEA: Final = (0, 5)
_LEAVE: Final = 65535
_OVERRIDE_S: Final = 3.0
"""RC_OVERRIDE_TIME of ArduPilot, which holds for a joystick too, s."""
_NO_AXIS: Final = 32767
"""An axis of MANUAL_CONTROL that is not given."""
_FULL: Final = 1000.0


def _heartbeat(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    # PX4 asks for the type of a ground station; ArduPilot for the one system id, whatever its type.
    if not context.is_px4 or message.type == GROUND_STATION:
        context.station_contact(sender.system)


def _motion(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    del sender
    craft, style = context.craft, context.autopilot.style
    if style.takeoff_in_streamed and context.commander.mode.behaviour is not Behaviour.STREAMED:
        return  # ArduPilot ignores them outside Guided
    craft.stream.put(motion_setpoint(message, craft, style), craft.now_s)


def _attitude(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    del sender
    craft, style = context.craft, context.autopilot.style
    streamed = (Behaviour.STREAMED, Behaviour.STREAMED_ATTITUDE)
    if style.takeoff_in_streamed and context.commander.mode.behaviour not in streamed:
        return
    craft.stream.put(attitude_setpoint(message, craft.tuning.hover_thrust, style), craft.now_s)


def _set_mode(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """SET_MODE (deprecated, still in use with ArduPilot); the heartbeat is the only answer."""
    del sender
    if message.base_mode & 1:
        context.commander.set_mode(message.custom_mode, Author.COMMAND)


def _data_stream(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    if not context.is_px4:
        rate = float(message.req_message_rate) if message.start_stop else 0.0
        context.set_group(message.req_stream_id, rate, sender)


def _manual_control(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """MANUAL_CONTROL: a joystick at the ground station acts as the pilot's sticks until its time-out."""
    own, style = context.own.system, context.autopilot.style
    if not context.accepts_joystick(sender) or message.target not in ((0, own) if context.is_px4 else (own,)):
        return
    pilot, low = context.craft.pilot, style.joystick_throttle_low
    if not context.is_px4:
        context.station_contact(sender.system)
    if pilot.has_transmitter or message.z < low:
        return  # a transmitter goes first; and there is no thrust backwards
    before = (pilot.roll, -pilot.pitch, pilot.yaw)
    roll, ahead, yaw = (
        stick if value == _NO_AXIS else value / _FULL
        for value, stick in zip((message.y, message.x, message.r), before, strict=True)
    )
    throttle = pilot.throttle if message.z == _NO_AXIS else (message.z - low) / (_FULL - low)
    pilot.sticks(roll=roll, pitch=-ahead, yaw=yaw, throttle=throttle)
    now_s = context.craft.now_s
    pilot.last_seen_s = now_s
    pilot.held_until_s = now_s + (context.craft.tuning.pilot_timeout_s if context.is_px4 else _OVERRIDE_S)


def _target(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """Position of a target to follow, PX4's way; ArduPilot's is not implemented."""
    del sender
    origin = context.craft.estimator.origin
    latitude, longitude = message.lat * 1e-7, message.lon * 1e-7
    if not context.is_px4 or origin is None or abs(latitude) > _POLE_DEG or not isfinite(message.alt):
        return
    n, e, _ = origin.ned_from_geo(latitude, longitude, origin.origin.altitude_m)
    velocity = (message.vel[0], message.vel[1], message.vel[2])
    context.craft.target = FollowTarget(
        context.craft.now_s,
        (n, e, origin.origin.altitude_m - message.alt),
        velocity if all(map(isfinite, velocity)) else (0.0, 0.0, 0.0),
    )


def _guided_item(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """ArduPilot's legacy guided item: a mission item marked as a position to go to now."""
    if context.is_px4 or message.current != _GO_NOW:
        return
    craft, origin = context.craft, context.craft.estimator.origin
    verdict = RequestVerdict(Result.FAILED, "not in GUIDED")
    if origin is not None and context.commander.mode.behaviour is Behaviour.STREAMED:
        per_unit = 1e-7 if message.name == "MISSION_ITEM_INT" else 1.0
        n, e, _ = origin.ned_from_geo(message.x * per_unit, message.y * per_unit, origin.origin.altitude_m)
        base = 0.0 if craft.home is None else craft.home.position_ned_m[2]
        over_sea = message.frame in _OVER_SEA
        down = origin.origin.altitude_m - message.z if over_sea else base - message.z
        if all(map(isfinite, (n, e, down))):
            verdict = context.commander.go_to((n, e, down), nan, nan)
    link = context.link_of(sender)
    if link is not None:
        fields = {"target_system": sender.system, "target_component": sender.component}
        ack = codec.message("MISSION_ACK", type=0 if verdict.is_accepted else 1, **fields)
        link.send(link.encoder.encode(ack))


def _override(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """RC_CHANNELS_OVERRIDE for the first four channels; 0 releases one, the largest value ignores it."""
    if not context.accepts_joystick(sender):
        return
    pilot = context.craft.pilot
    if pilot.has_transmitter:
        return  # it goes first
    pulses = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
    before = (pilot.roll, pilot.pitch, 2.0 * pilot.throttle - 1.0, pilot.yaw)
    roll, pitch, throttle, yaw = (
        0.0 if pulse == 0 else stick if pulse == _LEAVE else (pulse - 1500) / 500.0
        for pulse, stick in zip(pulses, before, strict=True)
    )
    if not any(pulses):
        pilot.switch_off()
        return
    pilot.sticks(roll=roll, pitch=pitch, yaw=yaw, throttle=(throttle + 1.0) / 2.0)
    pilot.last_seen_s = context.craft.now_s
    pilot.held_until_s = context.craft.now_s + _OVERRIDE_S


def _origin(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    del sender
    context.set_origin(GeoPoint(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3))


def _corrections(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """GPS_RTCM_DATA: the receiver gets whole frames alone."""
    del sender
    whole = context.corrections.receive(message)
    if whole:
        context.autopilot.surroundings.correct(whole)


def _operator(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    """OPEN_DRONE_ID_SYSTEM: where the operator is."""
    del sender
    context.craft.has_operator_place = (message.operator_latitude, message.operator_longitude) != (0, 0)


def _signing(context: FrontContext, message: MavlinkMessage, sender: Address) -> None:
    del sender
    problem = context.signing.set_up(message, is_armed=context.craft.is_armed)
    if problem:
        context.craft.send_text(Severity.WARNING, problem)


LISTENERS: Final[Mapping[str, Listener]] = {
    "ATT_POS_MOCAP": mocap,
    "FOLLOW_TARGET": _target,
    "GPS_RTCM_DATA": _corrections,
    "HEARTBEAT": _heartbeat,
    "MANUAL_CONTROL": _manual_control,
    "MISSION_ITEM": _guided_item,
    "MISSION_ITEM_INT": _guided_item,
    "ODOMETRY": odometry,
    "OPEN_DRONE_ID_SYSTEM": _operator,
    "RC_CHANNELS_OVERRIDE": _override,
    "REQUEST_DATA_STREAM": _data_stream,
    "SETUP_SIGNING": _signing,
    "SET_ATTITUDE_TARGET": _attitude,
    "SET_GPS_GLOBAL_ORIGIN": _origin,
    "SET_MODE": _set_mode,
    "SET_POSITION_TARGET_GLOBAL_INT": _motion,
    "SET_POSITION_TARGET_LOCAL_NED": _motion,
    "VISION_POSITION_ESTIMATE": vision_position,
    "VISION_SPEED_ESTIMATE": vision_speed,
}
"""By the name of the message."""
