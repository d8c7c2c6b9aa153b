"""AD: the autopilot driver: streams the owner's setpoints, commands manoeuvres, and gives way to the human pilot."""

import math
from collections.abc import Sequence
from typing import Any

from gloc3.component import ActuatorDriver
from gloc3.errors import Refused
from gloc3.frames import Vector3
from gloc3.messages import Envelope
from gloc3.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.vehicle import (
    AutopilotPose,
    AutopilotState,
    DriverState,
    FlightMode,
    LandedState,
    Manoeuvre,
    MotionGrant,
    MotionLimits,
    Pose,
    Setpoint,
    TakeOver,
)
from gloc3_onboard.devices import AutopilotControl
from gloc3_onboard.drivers.manoeuvres import Arm, Climb, DriverSettings, ManoeuvreMachine, SetMode, Write
from gloc3_onboard.motion_limits import SetpointLimiter, is_finite
from gloc3_onboard.pilot_watch import PilotWatch

SETPOINT_AGE_S = 0.25
"""An older setpoint is dropped (DESIGN §7)."""
EXPIRY_S = 0.5
"""Without a valid setpoint for so long the stream stops and the autopilot's hold is commanded (DESIGN §7)."""
STATE_PERIOD_S = 0.2


class Send(Setpoint, frozen=True):
    """One setpoint to write, in the autopilot's own frame."""


class AutopilotDriver(ActuatorDriver[DriverSettings]):
    """The only component that moves the vehicle."""

    settings_type = DriverSettings
    loggable = ("foreign", "stale", "not_finite", "clamped", "expired")

    setpoint = Input(Setpoint, Keep.ALL)
    manoeuvre = Input(Manoeuvre, Keep.ALL)
    grant = Input(MotionGrant)
    limits = Input(MotionLimits)
    autopilot = Input(AutopilotState, Keep.ALL)
    autopilot_pose = Input(AutopilotPose)
    pose = Input(Pose)
    take_over = Input(TakeOver, Keep.ALL)
    driver = Output(DriverState)

    def __init__(self, device: AutopilotControl) -> None:
        self.foreign = self.stale = self.not_finite = self.clamped = self.expired = 0
        self._control = device
        self._settings = DriverSettings()
        self._watch = PilotWatch()
        self._reset()

    def _reset(self) -> None:
        self._autopilot: AutopilotState | None = None
        self._machine = ManoeuvreMachine(self._settings)
        self._limiter: SetpointLimiter | None = None
        self._now_s = 0.0
        self._owner = ""
        self._offset_ned_m: Vector3 | None = None
        self._valid_s = -math.inf
        self._streaming_since_s: float | None = None
        self._hold_wanted = False
        self._mode_command: tuple[FlightMode, float] | None = None
        self._is_surrendered = False
        self._reported: DriverState | None = None
        self._reported_s = -math.inf

    # --- the local command interface ---

    def initialize(self, settings: DriverSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def start(self) -> None:
        """Looks afresh at the autopilot; moves nothing until it is granted motion."""
        self._watch.restart()
        self._reset()

    def resume(self) -> None:
        """After quiet: looks afresh at the autopilot."""
        self.start()

    def stop(self) -> None:
        """Refused in flight unless the autopilot has confirmed a mode of its own."""
        state = self._autopilot
        if state is None or not state.is_armed or state.landed is LandedState.ON_GROUND:
            return
        if state.mode is FlightMode.GUIDED:
            raise Refused("the vehicle flies on our setpoints; hold has been commanded, ask again when it is confirmed")

    def make_safe(self) -> None:
        """Stops the stream and commands the autopilot's hold, if the vehicle flies on our setpoints."""
        self._is_surrendered = True
        state = self._autopilot
        is_ours = state is not None and state.mode is FlightMode.GUIDED and not self._watch.has_control
        if self._streaming_since_s is not None or (is_ours and state is not None and state.is_armed):
            self._streaming_since_s = None
            self._watch.command(FlightMode.HOLD, self._now_s)
            self._control.command_mode(FlightMode.HOLD)

    def actuate(self, write: Any) -> None:
        """Writes to the autopilot."""
        match write:
            case Send():
                self._control.send_setpoint(write.position_ned_m, write.velocity_ned_m_s, write.yaw_rad)
            case SetMode(mode=mode):
                self._machine.ticket = self._control.command_mode(mode)
            case Arm():
                self._machine.ticket = self._control.command_arm()
            case Climb(height_m=height_m):
                self._machine.ticket = self._control.command_take_off(height_m)

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Obeys the owner of motion."""
        self._now_s = now_s
        self._observe(now_s, inbox)
        writes: list[Write] = []
        if self._watch.has_control or self._is_surrendered:
            self._let_go()
            for envelope in inbox.new(self.setpoint):
                self._check(envelope, now_s)
        else:
            writes += self._manoeuvre(now_s, inbox)
            writes += self._stream(now_s, inbox)
        for write in writes:
            if isinstance(write, SetMode):
                self._watch.command(write.mode, now_s)
            elif isinstance(write, Arm):
                self._watch.command_arm()
            elif isinstance(write, Climb):
                self._watch.command(FlightMode.TAKE_OFF, now_s)
        return [*(Actuation(write) for write in writes), *self._report(now_s)]

    def _observe(self, now_s: float, inbox: Inbox) -> None:
        for state in inbox.new(self.autopilot):
            self._watch.see(state.payload, now_s)
            self._autopilot = state.payload
        for take_over in inbox.new(self.take_over):
            if take_over.payload.is_resumed:
                self._watch.yield_back()
        for limits in inbox.new(self.limits):
            if self._limiter is None:
                self._limiter = SetpointLimiter(limits.payload)
            self._limiter.limits = limits.payload
        pose, own = inbox.latest(self.pose), inbox.latest(self.autopilot_pose)
        if pose is not None and own is not None and pose.payload.is_valid and abs(pose.t_s - own.t_s) < 1e-3:
            a, b = pose.payload.position_ned_m, own.payload.position_ned_m
            self._offset_ned_m = (a[0] - b[0], a[1] - b[1], a[2] - b[2])
        grant = inbox.latest(self.grant)
        owner = grant.payload.action_id if grant is not None else ""
        if owner != self._owner:
            self._owner = owner
            if self._limiter is not None and pose is not None:
                self._limiter.restart(pose.payload.position_ned_m, pose.payload.velocity_ned_m_s, pose.t_s)

    def _let_go(self) -> None:
        self._streaming_since_s = None
        self._hold_wanted = False
        self._machine.abandon(self._watch.reason or "the driver has been told to stop")

    def _manoeuvre(self, now_s: float, inbox: Inbox) -> list[Write]:
        for envelope in inbox.new(self.manoeuvre):
            if envelope.payload.action_id != self._owner:
                self.foreign += 1
                continue
            self._streaming_since_s = None
            self._hold_wanted = False
            self._machine.begin(envelope.payload, self._control.arm_in_mode, now_s)
        if self._machine.action_id and self._machine.action_id != self._owner:
            self._machine.abandon("motion was given to somebody else")
        answer = self._control.answer(self._machine.ticket) if self._machine.ticket else None
        return list(self._machine.advance(now_s, self._autopilot, answer))

    # --- setpoints ---

    def _check(self, envelope: Envelope[Setpoint], now_s: float) -> bool:
        """Whether a setpoint may be obeyed; counts what is wrong."""
        setpoint = envelope.payload
        if not self._owner or setpoint.action_id != self._owner:
            self.foreign += 1
        elif not is_finite(setpoint):
            self.not_finite += 1
        elif now_s - envelope.t_s > SETPOINT_AGE_S:
            self.stale += 1
        else:
            return True
        return False

    def _stream(self, now_s: float, inbox: Inbox) -> list[Write]:
        valid = None
        for envelope in inbox.new(self.setpoint):
            if self._check(envelope, now_s):
                valid = envelope.payload
        writes: list[Write] = []
        if valid is not None and self._may_fly():
            self._valid_s = now_s
            self._hold_wanted = False
            if self._streaming_since_s is None:
                self._streaming_since_s = now_s
            send = self._convert(valid, now_s)
            if send is not None:
                writes.append(send)
        elif self._streaming_since_s is not None and now_s - self._valid_s > EXPIRY_S:
            self._streaming_since_s = None
            self._hold_wanted = True
            self.expired += 1
        return [*writes, *self._mode(now_s)]

    def _may_fly(self) -> bool:
        state = self._autopilot
        if state is None or not state.is_connected or not state.is_armed or self._limiter is None:
            return False
        if self._machine.is_under_way:  # the owner has asked for a manoeuvre; its setpoints come before or after it
            return False
        return state.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)

    def _convert(self, setpoint: Setpoint, now_s: float) -> Send | None:
        assert self._limiter is not None
        limited = self._limiter.limit(setpoint, now_s)
        self.clamped += limited.is_clamped
        position = limited.setpoint.position_ned_m
        if position is not None:
            if self._offset_ned_m is None:
                return None
            offset = self._offset_ned_m
            position = (position[0] - offset[0], position[1] - offset[1], position[2] - offset[2])
        return Send(
            action_id=setpoint.action_id,
            position_ned_m=position,
            velocity_ned_m_s=limited.setpoint.velocity_ned_m_s,
            yaw_rad=setpoint.yaw_rad,
        )

    def _mode(self, now_s: float) -> list[Write]:
        """Commands guided for a stream, hold after one has run dry; repeats until the autopilot has it."""
        state = self._autopilot
        wanted = None
        if self._streaming_since_s is not None:
            if now_s - self._streaming_since_s >= self._control.stream_before_guided_s:
                wanted = FlightMode.GUIDED
        elif self._hold_wanted:
            wanted = FlightMode.HOLD
        if wanted is None or state is None or state.mode is wanted:
            self._mode_command = None
            if wanted is FlightMode.HOLD:
                self._hold_wanted = False
            return []
        if self._mode_command is not None:
            mode, asked_s = self._mode_command
            if mode is wanted and now_s - asked_s < self._settings.repeat_s:
                return []
        self._mode_command = (wanted, now_s)
        return [SetMode(wanted)]

    # --- report ---

    def _report(self, now_s: float) -> list[DriverState]:
        machine = self._machine
        state = DriverState(
            action_id=self._owner,
            is_streaming=self._streaming_since_s is not None,
            has_pilot_control=self._watch.has_control,
            pilot_reason=self._watch.reason,
            manoeuvre_id=machine.action_id,
            manoeuvre=machine.kind,
            manoeuvre_state=machine.state,
            manoeuvre_reason=machine.reason,
            foreign=self.foreign,
            stale=self.stale,
            not_finite=self.not_finite,
            clamped=self.clamped,
            expired=self.expired,
        )
        if state == self._reported and now_s - self._reported_s < STATE_PERIOD_S - 1e-9:
            return []
        self._reported, self._reported_s = state, now_s
        return [state]
