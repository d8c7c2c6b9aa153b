"""AD: autopilot driver: streams the owner's setpoints, commands manoeuvres, and yields to the human pilot."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.errors import Misuse, Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S
from gloc3.messages.vehicle import (
    AutopilotPose,
    AutopilotState,
    DriverState,
    EmergencyDisarm,
    FlightMode,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    MotionGrant,
    MotionLimits,
    Pose,
    Setpoint,
    TakeOver,
)
from gloc3_onboard.algorithms.paths.setpoint_gate import SETPOINT_AGE_S
from gloc3_onboard.components.drivers.manoeuvres import (
    Arm,
    AutopilotCommand,
    Climb,
    Disarm,
    DriverSettings,
    ManoeuvreMachine,
    RestMeter,
    SetMode,
    StartMission,
)
from gloc3_onboard.components.drivers.pilot_watch import PilotWatch
from gloc3_onboard.components.drivers.setpoint_stream import SetpointStream
from gloc3_onboard.sensors.devices import AutopilotControl, AutopilotSetpoint

STATE_PERIOD_S: Final = 0.2
NOT_ARMED_IN: Final = (FlightMode.GUIDED, FlightMode.LAND)
"""Modes in which PX4 cannot be armed, or not without a stream; left on the ground."""
UNANSWERED_S: Final = 30.0
"""Longest wait for the answer to a command whose effect is ours, s; the command protocol gives up before."""
SURRENDER_S: Final = 10.0
"""Time after which a refused stop that is not repeated is dropped, s."""
LOW_M: Final = 1.0
"""Height above or below home at which the autopilot may have landed, m."""


class ManoeuvreStep(NamedTuple):
    """Write: the command of a manoeuvre's step."""

    command: AutopilotCommand


class Abandon(NamedTuple):
    """Write: stop repeating our commands."""


class ForcedDisarm(NamedTuple):
    """Write: disarm now, in flight too."""


class AutopilotDriver(ActuatorDriver[DriverSettings]):
    """The only component that moves the vehicle.

    A quiet driver does everything except writing, and is ready to take over. Its `primary` is then bound to the topic
    `driver` of the working one, which reports who has control.
    """

    loggable = ("foreign", "stale", "not_finite", "clamped", "expired")

    setpoint = Input(Setpoint, Keep.ALL)
    manoeuvre = Input(Manoeuvre, Keep.ALL)
    direct_landing = Input(Manoeuvre, Keep.ALL)
    grant = Input(MotionGrant)
    limits = Input(MotionLimits)
    autopilot = Input(AutopilotState, Keep.ALL)
    autopilot_pose = Input(AutopilotPose)
    pose = Input(Pose)
    take_over = Input(TakeOver, Keep.ALL)
    emergency = Input(EmergencyDisarm, Keep.ALL)
    primary = Input(DriverState, Keep.ALL)
    driver = Output(DriverState)

    def __init__(self, device: AutopilotControl) -> None:
        self.foreign = self.stale = self.not_finite = self.clamped = self.expired = 0
        self._control = device
        self._watch = PilotWatch()
        self._stream = SetpointStream()
        self._now_s = 0.0
        self._reset()

    def _reset(self) -> None:
        self._autopilot: AutopilotState | None = None
        self._is_autopilot_known = False
        """Whether that state is recent enough to tell whether the autopilot obeys."""
        self._machine = ManoeuvreMachine(self.settings)
        self._stream.stop()
        self._is_quiet = False
        self._owner = ""
        self._requested: tuple[FlightMode, float] | None = None
        """The mode that was commanded for the stream, and when."""
        self._ticket = 0
        self._unanswered: dict[int, tuple[AutopilotCommand, float]] = {}
        """Our commands whose answers have not come, by ticket, with the time of each."""
        self._refusal = ""
        self._climbs_from_down_m: float | None = None
        self._surrendered_s = -math.inf
        self._rest = RestMeter(self.settings)
        self._own: Envelope[AutopilotPose] | None = None
        self._had_control = True
        self._reported: DriverState | None = None
        self._reported_s = -math.inf

    # --- the local command interface ---

    def start(self) -> None:
        """Looks afresh at the autopilot; moves nothing until it is granted motion."""
        self._watch.begin()
        self._reset()

    def goquiet(self) -> None:
        """Continues as the shadow of the active driver."""
        self._is_quiet = True
        self._surrendered_s = -math.inf

    def resume(self) -> None:
        """Steps in: what its primary has commanded is ours, and so is the hold that it may have left behind."""
        self._is_quiet = False
        self._watch.step_in(self._now_s)
        self._machine.repeat(self._now_s)
        self._requested = None

    def stop(self) -> None:
        """Stops; refused in flight unless the autopilot has confirmed a mode of its own."""
        state = self._autopilot
        if state is not None and self._is_airborne and state.mode is FlightMode.GUIDED and not self._watch.has_control:
            raise Refused("the vehicle flies on our setpoints; hold has been commanded, ask again when it is confirmed")

    def make_safe(self) -> None:
        """Stops the stream and commands the autopilot's hold, if the vehicle flies on our setpoints."""
        self._surrendered_s = self._now_s
        is_guided = self._autopilot is not None and self._autopilot.mode is FlightMode.GUIDED
        is_ours = self._stream.since_s is not None or (is_guided and self._is_airborne)
        self._stream.stop()
        if is_ours and not self._watch.has_control:
            self._watch.command(FlightMode.HOLD, self._now_s)
            self._command(SetMode(FlightMode.HOLD))

    def actuate(self, write: Any) -> None:
        """Writes to the autopilot."""
        match write:
            case AutopilotSetpoint():
                self._control.send_setpoint(write)
            case ManoeuvreStep(command=command):
                self._machine.ticket = self._command(command)
            case SetMode():
                self._ticket = self._command(write)
            case ForcedDisarm():
                self._control.command_disarm(is_forced=True)
            case Abandon():
                self._control.abandon_commands()
            case _:
                raise Misuse(f"{type(write).__name__} cannot be written to an autopilot")

    def _command(self, command: AutopilotCommand) -> int:
        match command:
            case SetMode(mode=mode):
                ticket = self._control.command_mode(mode)
            case Arm():
                ticket = self._control.command_arm()
            case Disarm():
                ticket = self._control.command_disarm()
            case StartMission():
                ticket = self._control.command_mission_start()
            case Climb(height_m=height_m):
                ticket = self._control.command_take_off(height_m)
        self._unanswered[ticket] = command, self._now_s
        return ticket

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Obeys the owner of motion."""
        self._now_s = now_s
        self._observe(now_s, inbox)
        is_idle = self._watch.has_control or now_s - self._surrendered_s < SURRENDER_S
        writes: list[Any] = self._release_control() if is_idle else [*self._manoeuvre(now_s, inbox)]
        send = self._stream.next_setpoint(
            inbox.new(self.setpoint),
            self._owner,
            now_s,
            may_fly=not is_idle and self._may_fly,
            is_guided=self._is_guided,
        )
        if send is not None:
            self._machine.finish()
        elif self._machine.is_taking_over and self._is_guided and self._is_airborne:
            send = self._stream.brake(now_s)
        if send is not None:
            writes.append(send)
        if not is_idle:
            writes += self._mode(now_s)
        if inbox.new(self.emergency):
            writes = [*self._release_control(), ForcedDisarm()]
        for write in writes:
            self._note(write.command if isinstance(write, ManoeuvreStep) else write, now_s)
        return [*(Actuation(write) for write in writes), *self._report(now_s)]

    def _observe(self, now_s: float, inbox: Inbox) -> None:
        if self._is_quiet:
            for primary in inbox.new(self.primary):
                if primary.payload.has_pilot_control:
                    self._watch.lose(primary.payload.pilot_reason, is_failsafe=primary.payload.is_failsafe)
        if self._is_guided and not self._is_quiet and self._stream.is_interrupted(now_s):
            self._watch.interrupt(now_s)
        for limits in inbox.new(self.limits):
            self._stream.adopt(limits.payload)
        self._own = inbox.latest(self.autopilot_pose)
        self._watch.received(self._own, now_s)
        self._await_answers(now_s)
        for state in self._states(now_s, inbox):
            pose = self._stream.pose
            may_settle = self._machine.may_settle(self._climbed_m, pose.position_ned_m if pose is not None else None)
            behaviour = self._control.behaviour
            self._watch.lands_into = behaviour.lands_into
            self._watch.restores_guided = behaviour.stream_before_guided_s > 0.0
            self._watch.update(
                state,
                now_s,
                is_shadow=self._is_quiet,
                may_settle=may_settle,
                comes_down=self._machine.comes_down,
                is_low=self._height_m is not None and abs(self._height_m) <= LOW_M,
                may_return=self._stream.since_s is not None and behaviour.stream_before_guided_s > 0.0,
            )
            self._autopilot = state
        for take_over in inbox.new(self.take_over):
            if take_over.payload.is_resumed:
                self._watch.yield_back()
        grant = inbox.latest(self.grant)
        self._owner = grant.payload.action_id if grant is not None else ""
        self._stream.set_vehicle(inbox.latest(self.pose), self._own, is_guided=self._is_guided)

    def _states(self, now_s: float, inbox: Inbox) -> list[AutopilotState]:
        """The autopilot's new states; without its sampler, what the device itself knows."""
        states = [state.payload for state in inbox.new(self.autopilot)]
        is_sampled = inbox.is_fresh(self.autopilot, now_s, AUTOPILOT_SILENT_S)
        state = None if is_sampled else self._control.state()
        self._is_autopilot_known = is_sampled or (state is not None and state.is_connected)
        return states if state is None or not state.is_connected else [*states, state]

    def _await_answers(self, now_s: float) -> None:
        """What a busy autopilot, or a process that stood still, carries out or confirms late is ours all the same."""
        for ticket, (command, sent_s) in list(self._unanswered.items()):
            match command:
                case SetMode(mode=mode):
                    self._watch.extend(mode, now_s)
                case Climb():
                    self._watch.extend(FlightMode.TAKE_OFF, now_s)
                case StartMission():
                    self._watch.extend(FlightMode.MISSION, now_s)
                case Arm():
                    self._watch.command_arm(now_s)
                case Disarm():
                    self._watch.command_disarm(now_s)
            if self._control.answer(ticket) is not None or now_s - sent_s > UNANSWERED_S:
                del self._unanswered[ticket]

    def _note(self, write: Any, now_s: float) -> None:
        """Notifies the pilot watch of our commands."""
        match write:
            case SetMode(mode=mode):
                self._watch.command(mode, now_s)
            case StartMission():
                self._watch.command(FlightMode.MISSION, now_s)
            case Arm():
                self._watch.command_arm(now_s)
            case Disarm() | ForcedDisarm():
                self._watch.command_disarm(now_s)
            case Climb():
                self._watch.command(FlightMode.TAKE_OFF, now_s)
                pose = self._stream.pose
                self._climbs_from_down_m = None if pose is None else pose.position_ned_m[2]

    def _known_velocity(self, now_s: float) -> Vector3 | None:
        """By our own pose, or else by the autopilot's, where that is young."""
        pose = self._stream.young_pose(now_s)
        if pose is not None:
            return pose.velocity_ned_m_s
        own = self._own
        is_young = own is not None and now_s - own.t_s <= SETPOINT_AGE_S
        return own.payload.velocity_ned_m_s if own is not None and is_young else None

    @property
    def _climbed_m(self) -> float | None:
        """How far a take-off has come; None where nobody knows, as without a pose."""
        pose, begin = self._stream.young_pose(self._now_s), self._climbs_from_down_m
        return None if pose is None or begin is None else begin - pose.position_ned_m[2]

    @property
    def _height_m(self) -> float | None:
        """Height above home; None where one of them is not known."""
        pose, home = self._stream.pose, self._stream.home_ned_m
        return None if pose is None or home is None else home[2] - pose.position_ned_m[2]

    @property
    def _away_m(self) -> float | None:
        """Distance from home over ground; None where that, or the place of the vehicle, is not known."""
        pose, home = self._stream.pose, self._stream.home_ned_m
        return None if pose is None or home is None else math.dist(pose.position_ned_m[:2], home[:2])

    @property
    def _is_airborne(self) -> bool:
        state = self._autopilot
        return state is not None and state.is_armed and state.landed is not LandedState.ON_GROUND

    @property
    def _is_guided(self) -> bool:
        return self._autopilot is not None and self._autopilot.mode is FlightMode.GUIDED

    def _release_control(self) -> list[Any]:
        self._stream.stop()
        self._requested = None
        self._machine.abandon(self._watch.reason or "the driver was stopped")
        had_control, self._had_control = self._had_control, not self._watch.has_control
        return [Abandon()] if had_control and self._watch.has_control else []

    def _manoeuvre(self, now_s: float, inbox: Inbox) -> list[ManoeuvreStep]:
        self._had_control = True
        asked = [one for one in inbox.new(self.manoeuvre) if not self._would_break_landing_off(one.payload)]
        for envelope in (*asked, *inbox.new(self.direct_landing)):
            if not self._owner or envelope.payload.action_id != self._owner:
                self._stream.gate.foreign += 1
                continue
            self._stream.stop()
            self._requested = None
            self._machine.begin(envelope.payload, now_s, self._control.behaviour, self._away_m)
            if self._control.behaviour.floats:
                self._rest.begin_to_rise()
        if self._machine.action_id != self._owner:
            self._machine.abandon("motion was granted to another owner")
        answer = self._control.answer(self._machine.ticket) if self._machine.ticket else None
        state = self._autopilot if self._is_autopilot_known else None
        rested_s = self._rest.update(self._known_velocity(now_s), now_s, floats=self._control.behaviour.floats)
        self._machine.away_m = self._away_m
        return [ManoeuvreStep(command) for command in self._machine.advance(now_s, state, answer, rested_s)]

    def _would_break_landing_off(self, manoeuvre: Manoeuvre) -> bool:
        """Whether it is a hold that is asked for again and again, and a landing was asked for over the asker's head."""
        return manoeuvre.kind is ManoeuvreKind.HOLD and self._machine.lands_for(manoeuvre.action_id)

    # --- setpoints ---

    @property
    def _may_fly(self) -> bool:
        """Only in the air; while the autopilot flies a manoeuvre for the owner, only to end a climb."""
        state = self._autopilot
        if state is None or not state.is_connected or not state.is_armed:
            return False
        if self._machine.is_running and not self._machine.is_climbing:
            return False
        return state.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)

    def _mode(self, now_s: float) -> list[SetMode]:
        """Commands guided for a stream, hold where there is none; repeats until the autopilot has it."""
        wanted, state = self._wanted_mode(now_s), self._autopilot
        if wanted is None or state is None or state.mode is wanted:
            self._requested, self._refusal = None, ""
            return []
        answer = self._control.answer(self._ticket) if self._ticket else None
        self._refusal = "" if answer is None or answer.is_accepted else answer.reason
        if self._requested is not None:
            mode, requested_s = self._requested
            is_obeyed = not self._is_autopilot_known and answer is not None and answer.is_accepted
            if mode is wanted and (is_obeyed or now_s - requested_s < self.settings.repeat_s):
                return []  # unseen, a pilot may have chosen another mode since: what was obeyed is not repeated
        self._requested = (wanted, now_s)
        return [SetMode(wanted)]

    def _wanted_mode(self, now_s: float) -> FlightMode | None:
        state, since_s = self._autopilot, self._stream.since_s
        if state is None or not state.is_connected or self._machine.is_running:
            return None
        if since_s is not None:
            is_ready = now_s - since_s >= self._control.behaviour.stream_before_guided_s
            return FlightMode.GUIDED if is_ready and (self._is_guided or self._stream.is_steady) else None
        behaviour = self._control.behaviour
        if state.mode in NOT_ARMED_IN and not state.is_armed and behaviour.stream_before_guided_s > 0.0:
            return behaviour.arm_in_mode
        is_guided_by_us = state.mode in (FlightMode.GUIDED, FlightMode.MISSION)
        return FlightMode.HOLD if is_guided_by_us and self._is_airborne else None

    # --- report ---

    def _report(self, now_s: float) -> list[DriverState]:
        machine, stream, gate = self._machine, self._stream, self._stream.gate
        self.foreign, self.stale, self.not_finite = gate.foreign, gate.stale, gate.not_finite
        self.clamped, self.expired = stream.clamped, stream.expired
        state = DriverState(
            action_id=self._owner,
            is_streaming=stream.since_s is not None,
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
            is_guided=stream.since_s is not None and self._is_guided,
            refusal=self._refusal,
            is_failsafe=self._watch.is_failsafe,
            held_after_gap_s=self._watch.held_after_gap_s,
            steady_s=stream.steady_s,
            is_after_landing=self._autopilot is not None
            and self._autopilot.mode_name in self._control.behaviour.lands_into,
        )
        if state == self._reported and now_s - self._reported_s < STATE_PERIOD_S - 1e-9:
            return []
        self._reported, self._reported_s = state, now_s
        return [state]
