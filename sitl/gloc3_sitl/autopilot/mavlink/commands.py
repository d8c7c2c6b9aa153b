"""MAVLink commands: one handler and one result for each MAV_CMD."""

from collections.abc import Callable, Mapping
from math import isfinite, nan, radians
from typing import Final

from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, Vector3, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import Mover
from gloc3_sitl.autopilot.behaviours.orbit import Facing, circle
from gloc3_sitl.autopilot.mavlink.context import MOST_HEIGHT_M, FrontContext
from gloc3_sitl.autopilot.mavlink.service_commands import SERVICE_HANDLERS
from gloc3_sitl.autopilot.modes import Behaviour, Result
from gloc3_sitl.autopilot.verdict import ACCEPTED, OUT_OF_RANGE, Author, RequestVerdict

Handler = Callable[[FrontContext, MavCommandRequest], RequestVerdict]

ARM: Final = 400
_FORCE: Final = 21196.0
_MAGIC_FORCE: Final = 2989.0
"""ArduPilot's force-arming number."""
_UNSUPPORTED: Final = RequestVerdict(Result.UNSUPPORTED)
_RELATIVE: Final = (3, 6)
_CUSTOM_FLAG: Final = 1
_NO_REGION_OF_INTEREST: Final = 197
_TO_ROTORS, _TO_WINGS = 3.0, 4.0
"""MAV_VTOL_STATE."""
_NO_TRANSITION: Final = (Behaviour.TAKE_OFF, Behaviour.LAND, Behaviour.RETURN)
_WHOLE_TURN_DEG: Final = 360.0


def handle(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """Runs a command; unknown ones are unsupported."""
    handler = None if request.command in context.autopilot.style.unsupported else HANDLERS.get(request.command)
    return _UNSUPPORTED if handler is None else handler(context, request)


# -- arming and modes -------------------------------------------------------------------------------------------------


def _arm(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    wanted, force = request.params[0], request.params[1]
    is_forced = force in (_FORCE, _MAGIC_FORCE)
    if wanted == 1.0:
        return context.commander.arm(Author.COMMAND, is_forced=is_forced)
    if wanted == 0.0:
        return context.commander.disarm(Author.COMMAND, is_forced=is_forced)
    return RequestVerdict(Result.UNSUPPORTED if context.is_px4 else Result.FAILED, "param1 must be 0 or 1")


def _set_mode(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    base, main, sub = request.params[:3]
    if not (isfinite(base) and isfinite(main) and isfinite(sub)) or not int(base) & _CUSTOM_FLAG:
        return OUT_OF_RANGE
    if not 0 <= main < 2**16 or not 0 <= sub < 256:
        return OUT_OF_RANGE
    custom = int(main) << 16 | int(sub) << 24 if context.is_px4 else int(main)
    return context.commander.set_mode(custom, Author.COMMAND)


def _take_off(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    height = request.params[6]
    craft = context.craft
    if not isfinite(height):
        return context.commander.take_off(nan)
    if context.is_px4 and (not request.is_int or request.frame not in _RELATIVE):
        origin = craft.estimator.origin
        return context.commander.take_off(nan if origin is None else origin.origin.altitude_m - height)
    base = 0.0 if craft.home is None else craft.home.position_ned_m[2]
    if height < 0.1:
        return RequestVerdict(context.commander.style.refused, "take-off height must be above the ground")
    return context.commander.take_off(base - height)


def _land(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    del request
    return context.commander.set_mode(context.commander.style.land_mode, Author.COMMAND)


def _return(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    del request
    return context.commander.set_mode(context.commander.style.return_mode, Author.COMMAND)


def _loiter(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    del request
    style = context.commander.style
    return context.commander.set_mode(
        style.position_mode if style.takeoff_in_streamed else style.hold_mode, Author.COMMAND
    )


def _terminate(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if not request.params[0] > 0.5:
        return ACCEPTED
    context.commander.terminate()
    return ACCEPTED


def _transition(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """DO_VTOL_TRANSITION: PX4 takes it in modes that stay in the air, ArduPilot in Auto only, where missions command it."""
    commander, vtol = context.commander, context.craft.vtol
    wanted = request.params[0]
    if vtol is None:
        return _UNSUPPORTED
    if wanted not in (_TO_ROTORS, _TO_WINGS):
        return OUT_OF_RANGE
    if not context.is_px4 and commander.mode.behaviour is not Behaviour.MISSION:
        return RequestVerdict(Result.FAILED, "VTOL transition only in AUTO")
    if context.craft.is_landed or (wanted == _TO_WINGS and commander.mode.behaviour in _NO_TRANSITION):
        return RequestVerdict(commander.style.refused, f"no transition in {commander.mode.name} or on the ground")
    vtol.want(wings=wanted == _TO_WINGS)
    return ACCEPTED


# -- places -----------------------------------------------------------------------------------------------------------


def _place(context: FrontContext, request: MavCommandRequest, *, is_absolute: bool = False) -> Vector3 | RequestVerdict:
    """The NED position of parameters 5 to 7; NaN means here.

    The height counts from home where a COMMAND_INT says so, unless it `is_absolute` whatever the frame.
    """
    craft = context.craft
    origin = craft.estimator.origin
    latitude, longitude, height = request.params[4:]
    n, e, d = craft.estimator.inertial.position_ned_m
    if origin is None:
        return RequestVerdict(context.commander.style.refused, "no global origin")
    if isfinite(latitude) and isfinite(longitude):
        if abs(latitude) > 90.0 or abs(longitude) > 180.0:
            return OUT_OF_RANGE
        n, e, _ = origin.ned_from_geo(latitude, longitude, origin.origin.altitude_m)
    if isfinite(height):
        if abs(height) > MOST_HEIGHT_M:
            return OUT_OF_RANGE
        base = 0.0 if craft.home is None else craft.home.position_ned_m[2]
        is_relative = request.is_int and request.frame in _RELATIVE and not is_absolute
        d = base - height if is_relative else origin.origin.altitude_m - height
    return (n, e, d)


def _reposition(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    place = _place(context, request)
    if isinstance(place, RequestVerdict):
        return place
    style, commander = context.commander.style, context.commander
    if (
        style.takeoff_in_streamed
        and commander.mode.behaviour is not Behaviour.STREAMED
        and not (isfinite(request.params[1]) and int(request.params[1]) & 1)
    ):
        return RequestVerdict(Result.DENIED, "not in GUIDED")
    yaw = request.params[3]
    if not context.is_px4:
        yaw = radians(yaw) if isfinite(yaw) and yaw != 0.0 else nan
    return commander.go_to(place, yaw, request.params[0])


def _orbit(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if context.commander.style.orbit_mode is None:
        return _UNSUPPORTED
    place = _place(context, request, is_absolute=True)
    if isinstance(place, RequestVerdict):
        return place
    radius, speed, facing = request.params[:3]
    known = Facing(int(facing)) if facing in list(Facing) else Facing.CENTRE
    return context.commander.orbit(circle(place, radius, speed, known, context.craft.tuning.orbit_radius_m))


def _set_home(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if request.params[0] == 1.0:
        return context.commander.set_home()
    place = _place(context, request, is_absolute=context.is_px4)  # PX4 does not look at the frame
    return place if isinstance(place, RequestVerdict) else context.commander.set_home(place)


def _set_origin(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    return context.set_origin(GeoPoint(*request.params[4:]))


# -- mission ----------------------------------------------------------------------------------------------------------


def _mission_start(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    commander, craft = context.commander, context.craft
    first = int(request.params[0]) if isfinite(request.params[0]) else 0
    if commander.style.takeoff_in_streamed:
        # ArduPilot: the mode must be AUTO already, or the vehicle stand.
        if not craft.is_armed:
            return RequestVerdict(Result.FAILED, "not armed")
    elif first > 0 and first < len(craft.plans.mission):
        context.set_current(first)
    return commander.set_mode(commander.style.mission_mode, Author.COMMAND)


def _pause_continue(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    commander = context.commander
    is_continue = request.params[0] == 1.0
    if context.is_px4:
        style = commander.style
        return commander.set_mode(style.mission_mode if is_continue else style.hold_mode, Author.COMMAND)
    flight = context.mission_flight
    if flight is None:
        return RequestVerdict(Result.FAILED, "not in AUTO")
    if is_continue:
        flight.go_on()
    else:
        flight.pause()
    return ACCEPTED


def _set_current(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    index = request.params[0]
    if not isfinite(index) or not context.set_current(int(index)):
        return RequestVerdict(Result.FAILED if not context.is_px4 else Result.DENIED, "no such item")
    return ACCEPTED


def _change_speed(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    speed = request.params[1]
    if not speed > 0.0:
        return ACCEPTED if speed == -1.0 else OUT_OF_RANGE
    context.craft.tuning.limits.speed_xy_m_s = min(speed, context.craft.tuning.gains.speed_xy_m_s)
    return ACCEPTED


# -- messages and services --------------------------------------------------------------------------------------------


def _request_message(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if not isfinite(request.params[0]):
        return OUT_OF_RANGE
    return context.request_message(int(request.params[0]), request)


def _stream(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    return context.stream_command(request)


def _capabilities(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    return context.request_message(148, request)


def _run_checks(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    del request
    commander = context.commander
    if context.health is not None:
        context.health.send(context.craft.now_s)
        return ACCEPTED
    if context.craft.is_armed:
        return RequestVerdict(Result.TEMPORARILY_REJECTED, "armed")
    for problem in commander.problems():
        context.craft.send_text(Severity.CRITICAL, f"{commander.style.arming_prefix}{problem}")
    return ACCEPTED


def _storage(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if request.params[0] == 2.0:
        context.autopilot.parameters.reset()
    return ACCEPTED


def _turn_nose(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """CONDITION_YAW outside a mission, as in ArduPilot: turns the vehicle in modes that control its heading."""
    if context.is_px4:
        return _UNSUPPORTED
    angle, _, direction, relative = request.params[:4]
    if not 0.0 <= angle <= _WHOLE_TURN_DEG or relative not in (0.0, 1.0):
        return RequestVerdict(Result.FAILED, "angle or reference out of range")
    craft, activity = context.craft, context.commander.activity
    craft.is_facing = None
    if isinstance(activity, Mover):
        turn = radians(angle)
        activity.yaw_wanted_rad = wrap_pi(
            activity.yaw_rad + (turn if direction >= 0.0 else -turn) if relative else turn
        )
    return ACCEPTED


def _source_set(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    if context.is_px4:
        return _UNSUPPORTED
    index = request.params[0]
    if index not in (1.0, 2.0, 3.0):
        return OUT_OF_RANGE
    return context.use_source_set(int(index))


def _fence_enable(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """Enables or disables ArduPilot's fence until the next boot or change of FENCE_ENABLE; PX4 refuses."""
    if context.is_px4:
        return _UNSUPPORTED
    wanted = request.params[0]
    if wanted not in (0.0, 1.0):
        return OUT_OF_RANGE
    if wanted == 1.0 and not context.commander.fence.is_present(context.craft):
        return RequestVerdict(Result.FAILED, "no fence")
    context.craft.tuning.fence_is_on = wanted == 1.0
    return ACCEPTED


def _set_region_of_interest(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot turns the vehicle towards a place, until the mode changes; PX4 turns a gimbal, and there is none."""
    if context.is_px4:
        return ACCEPTED
    if request.command == _NO_REGION_OF_INTEREST or not any(request.params[4:6]):
        context.craft.is_facing = None
        return ACCEPTED
    place = _place(context, request)
    if isinstance(place, RequestVerdict):
        return place
    context.craft.is_facing = place
    return ACCEPTED


HANDLERS: Final[Mapping[int, Handler]] = {
    **SERVICE_HANDLERS,
    17: _loiter,
    20: _return,
    21: _land,
    22: _take_off,
    34: _orbit,
    115: _turn_nose,
    176: _set_mode,
    178: _change_speed,
    179: _set_home,
    185: _terminate,
    192: _reposition,
    193: _pause_continue,
    195: _set_region_of_interest,
    197: _set_region_of_interest,
    201: _set_region_of_interest,
    207: _fence_enable,
    224: _set_current,
    245: _storage,
    300: _mission_start,
    ARM: _arm,
    401: _run_checks,
    510: _stream,
    511: _stream,
    512: _request_message,
    519: _capabilities,
    520: _capabilities,
    611: _set_origin,
    3000: _transition,
    42007: _source_set,
}
"""By MAV_CMD."""
