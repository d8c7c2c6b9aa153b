"""Commands that do not concern the flight: power, calibration, failures, outputs."""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Final

from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.mavlink.calibration import VEHICLE_POSITION, Subject
from gloc3_sitl.autopilot.mavlink.context import FrontContext
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.surroundings import FailureKind, FailureUnit, SupplyState
from gloc3_sitl.autopilot.vehicle_class import MULTIROTOR
from gloc3_sitl.autopilot.verdict import ACCEPTED, RequestVerdict

_UNSUPPORTED: Final = RequestVerdict(Result.UNSUPPORTED)
_MOTORS: Final = 4
_CHANNELS: Final = 16
_RELAYS: Final = 6
_RELATIVE_LENGTH, _WINCH_RATE = 1.0, 2.0
"""WINCH_ACTIONS."""
_TEST_S: Final = 3.0
"""Longest motor test of PX4."""
_TO_BOOTLOADER: Final = 3.0
_START_COMPASS, _CANCEL_COMPASS = 42424, 42426


def _power(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """Reboot and shutdown, on the ground only: PX4 does both, ArduPilot only the first."""
    wanted = request.params[0]
    if context.is_px4:
        if wanted == 0.0:
            return ACCEPTED
        if wanted not in (1.0, 2.0) or context.craft.is_armed:
            return RequestVerdict(Result.DENIED, "armed" if context.craft.is_armed else "not supported here")
        power = SupplyState(int(wanted))
    else:
        if context.craft.is_armed:
            return RequestVerdict(Result.FAILED, "armed")
        if wanted not in (1.0, _TO_BOOTLOADER):
            return _UNSUPPORTED
        power = SupplyState.REBOOT
    context.autopilot.surroundings.switch(power)
    return ACCEPTED


def _calibrate(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """PX4 accepts, reports progress as texts, and stops when all parameters are 0; ArduPilot answers when done."""
    calibration = context.autopilot.calibration
    if context.is_px4 and not any(request.params):
        calibration.cancel()
        context.commander.ignore_pilot(False)
        return ACCEPTED
    if context.craft.is_armed:
        return RequestVerdict(context.commander.style.refused, "armed")
    gyro, magnetometer, _, radio, accelerometer, _, escs = request.params
    if not context.is_px4:
        if accelerometer == 1.0:
            context.accelerometer.begin()
            return ACCEPTED
        if magnetometer:
            return RequestVerdict(Result.FAILED, "the simulated vehicle cannot be turned")
        context.begin_calibration()
        return RequestVerdict(Result.IN_PROGRESS)
    if calibration.is_busy:
        return RequestVerdict(Result.TEMPORARILY_REJECTED, "another calibration is in progress")
    if radio == 1.0:
        context.commander.ignore_pilot(True)
        return ACCEPTED
    if escs == 1.0:
        return ACCEPTED if calibration.begin_escs() else RequestVerdict(Result.DENIED)
    if gyro == 1.0:
        subject = Subject.GYRO
    elif magnetometer == 1.0:
        subject = Subject.MAGNETOMETER
    elif accelerometer == 1.0:
        subject = Subject.ACCELEROMETER
    elif accelerometer == 2.0:
        subject = Subject.LEVEL
    else:
        return _UNSUPPORTED
    calibration.begin(subject)
    return ACCEPTED


def _inject(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """PX4's failure injection, where SYS_FAILURE_EN allows it."""
    if not context.is_px4:
        return _UNSUPPORTED
    if not context.autopilot.parameters["SYS_FAILURE_EN"]:
        return RequestVerdict(Result.DENIED, "SYS_FAILURE_EN is 0")
    unit, failure = request.params[:2]
    if unit not in list(FailureUnit) or failure not in list(FailureKind):
        return RequestVerdict(Result.UNSUPPORTED, "this failure is not simulated")
    return context.autopilot.surroundings.inject(FailureUnit(int(unit)), FailureKind(int(failure)))


def _set_servo(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot moves a free output and refuses the motors'; PX4 has no such command."""
    if context.is_px4:
        return _UNSUPPORTED
    channel, pulse_us = request.params[:2]
    if not (_MOTORS < channel <= _CHANNELS and channel == int(channel) and 0.0 <= pulse_us < 2**16):
        return RequestVerdict(Result.FAILED, "this output drives a motor or does not exist")
    context.autopilot.servo_us[int(channel)] = int(pulse_us)
    return ACCEPTED


def _set_relay(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot sets a relay that a parameter has set up; PX4 has no such command."""
    if context.is_px4:
        return _UNSUPPORTED
    number, is_on = request.params[:2]
    if number not in range(_RELAYS) or not context.autopilot.parameters[f"RELAY{int(number) + 1}_FUNCTION"]:
        return RequestVerdict(Result.FAILED, "no such relay")
    context.autopilot.payload.relays[int(number)] = bool(is_on)
    return ACCEPTED


def _set_actuator(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """PX4 accepts any, and moves its first set; a value that is no number leaves one as it is. ArduPilot has none."""
    if not context.is_px4:
        return _UNSUPPORTED
    values, index = request.params[:6], request.params[6]
    if index == 0.0:
        moved = ((number, value) for number, value in enumerate(values, start=1) if isfinite(value))
        context.autopilot.payload.actuators.update((number, min(max(value, -1.0), 1.0)) for number, value in moved)
    return ACCEPTED


def _grip(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """A gripper grabs or releases, where a parameter enables it."""
    parameters = context.autopilot.parameters
    action = request.params[1]
    if not parameters["PD_GRIPPER_EN" if context.is_px4 else "GRIP_ENABLE"]:
        return _UNSUPPORTED if context.is_px4 else RequestVerdict(Result.FAILED, "no gripper")
    if action not in (0.0, 1.0):
        return RequestVerdict(Result.DENIED if context.is_px4 else Result.FAILED, "a gripper grabs (1) or releases (0)")
    context.autopilot.payload.grabs = action == 1.0
    context.craft.send_text(Severity.INFO, f"Gripper load {'grabbed' if action else 'released'}")
    return ACCEPTED


def _winch(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot's winch, where a parameter enables it: a length, or a rate, which is 0 to stop; PX4 has none."""
    if context.is_px4:
        return _UNSUPPORTED
    _, action, length_m, rate_m_s, *_ = request.params
    if not context.autopilot.parameters["WINCH_TYPE"]:
        return RequestVerdict(Result.FAILED, "no winch")
    if action == _RELATIVE_LENGTH and isfinite(length_m) and rate_m_s > 0.0:
        context.autopilot.payload.line_m += length_m
        return ACCEPTED
    if action == _WINCH_RATE and rate_m_s == 0.0:
        return ACCEPTED
    return RequestVerdict(Result.FAILED, "this motion of the winch is not simulated")


def _calibrate_compass(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot's own compass calibration commands; they end immediately, as the simulated vehicle cannot be turned."""
    if context.is_px4:
        return _UNSUPPORTED
    return (
        ACCEPTED
        if request.command == _CANCEL_COMPASS
        else RequestVerdict(Result.FAILED, "the simulated vehicle cannot be turned")
    )


def _confirm_position(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """The station confirms the position that ArduPilot's accelerometer calibration has requested."""
    if context.is_px4:
        return _UNSUPPORTED
    if not context.accelerometer.confirm(request.params[0]):
        return RequestVerdict(Result.FAILED, "this position is not requested")
    return ACCEPTED


def _test_actuator(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """PX4's ACTUATOR_TEST: one motor for at most 3 s; a time that is not positive stops it."""
    craft = context.craft
    if not context.is_px4 or context.autopilot.vehicle is not MULTIROTOR:
        return _UNSUPPORTED
    if craft.is_armed or not context.autopilot.parameters["COM_MOT_TEST_EN"]:
        return RequestVerdict(Result.DENIED, "armed, or COM_MOT_TEST_EN is 0")
    share, seconds, _, _, motor, *_ = request.params
    if motor not in range(1, _MOTORS + 1):
        return _UNSUPPORTED
    if not (isfinite(share) and seconds > 0.0):
        context.autopilot.motor_test.stop()
        return ACCEPTED
    context.autopilot.motor_test.begin(int(motor), min(max(share, 0.0), 1.0), craft.now_s + min(seconds, _TEST_S))
    return ACCEPTED


def _test_motor(context: FrontContext, request: MavCommandRequest) -> RequestVerdict:
    """ArduPilot's DO_MOTOR_TEST, by percent of throttle; a test without throttle stops it."""
    craft = context.craft
    if context.is_px4 or context.autopilot.vehicle is not MULTIROTOR:
        return _UNSUPPORTED
    if craft.is_armed or not craft.is_landed:
        return RequestVerdict(Result.FAILED, "armed, or not landed")
    motor, kind, percent, seconds, *_ = request.params
    if motor not in range(1, _MOTORS + 1) or kind != 0.0 or not 0.0 <= percent <= 100.0:
        return RequestVerdict(Result.FAILED, "this motor or throttle cannot be tested")
    context.autopilot.motor_test.begin(int(motor), percent / 100.0, craft.now_s + max(0.0, seconds))
    return ACCEPTED


SERVICE_HANDLERS: Final[Mapping[int, Callable[[FrontContext, MavCommandRequest], RequestVerdict]]] = {
    181: _set_relay,
    183: _set_servo,
    187: _set_actuator,
    209: _test_motor,
    211: _grip,
    241: _calibrate,
    246: _power,
    310: _test_actuator,
    420: _inject,
    _START_COMPASS: _calibrate_compass,
    _CANCEL_COMPASS: _calibrate_compass,
    42600: _winch,
    VEHICLE_POSITION: _confirm_position,
}
"""By MAV_CMD."""
