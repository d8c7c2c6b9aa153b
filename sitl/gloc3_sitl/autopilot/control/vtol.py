"""VTOL control: a multirotor's loops, a plane's loops, and the transitions between them."""

from math import hypot, nan, radians
from typing import Final

from gloc3.errors import Misuse
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Quaternion, from_euler, to_euler
from gloc3_sitl.autopilot.airframe import QUADPLANE
from gloc3_sitl.autopilot.control.multirotor import MultirotorControl
from gloc3_sitl.autopilot.control.setpoint import LANDED, MotionSetpoint, Setpoint, WingSetpoint
from gloc3_sitl.autopilot.control.vtol_form import VtolForm, VtolGains, VtolState
from gloc3_sitl.autopilot.control.wings import WingControl
from gloc3_sitl.autopilot.craft import Craft

_STANDING: Final = (0.0, 0.0, 0.0, 0.0)
"""Lift rotors that stand."""
_STILL: Final = (0.0, 0.0, -1.0, 0.0)
"""Rudders in the middle, no throttle."""
_TAKE_OVER_S: Final = 1.5
"""Time in which rotors that stood take over."""
_BANK_RAD: Final = radians(20.0)
"""Largest bank in a transition …"""
_BANKS_FROM_M_S: Final = 6.0
"""… from twice this air speed on; below it, none."""
_NOSE_UP_RAD: Final = radians(10.0)
_CARRIES_RAD: Final = radians(7.0)
"""Nose up at which wings that have it carry."""
_BRAKES_FROM_M_S, _BRAKES_AT_M_S = 18.0, 6.0
_BRAKE_FAST_RAD, _BRAKE_SLOW_RAD = radians(2.0), radians(10.0)
"""Nose up in a transition to rotors, at and above the one speed, at and below the other: more would lift it."""


class VtolControl:
    """Ailerons, elevator, throttle, rudder and four lift rotors; a `Control`.

    On rotors it takes a multirotor's setpoints, on wings and in transitions a plane's.
    """

    stopped = (*_STILL, *_STANDING)

    def __init__(self, craft: Craft) -> None:
        self._craft: Final = craft
        self._gains: Final[VtolGains] = craft.tuning.vtol
        self._rotors: Final = MultirotorControl(craft, QUADPLANE)
        self._wings: Final = WingControl(craft, lands=False)
        self._state: Final = VtolState()
        craft.vtol = self._state
        self._share = 1.0
        """Share of the rotors."""

    @property
    def thrust(self) -> float:
        """Of what carries it."""
        return self._wings.thrust if self._state.form is VtolForm.WINGS else self._rotors.thrust

    @property
    def wanted_attitude(self) -> Quaternion:
        """Of what carries it."""
        is_on_wings = self._state.form is VtolForm.WINGS
        return self._wings.wanted_attitude if is_on_wings else self._rotors.wanted_attitude

    def follow(self, setpoint: Setpoint) -> None:
        """Flies the setpoint in the present form, then looks whether the form changes."""
        state, craft = self._state, self._craft
        if setpoint is LANDED or not craft.is_armed:
            self._stand()
            return
        match state.form:
            case VtolForm.ROTORS:
                self._share = 1.0
                self._rotors.follow(setpoint)
            case VtolForm.WINGS:
                self._share = 0.0
                self._wings.follow(setpoint)
            case _ if not isinstance(setpoint, WingSetpoint):
                raise Misuse(f"a transition does not accept {type(setpoint).__name__}")
            case VtolForm.TO_WINGS:
                self._speed_up(setpoint)
            case VtolForm.TO_ROTORS:
                self._slow_down(setpoint)
        self._change_form()

    def _stand(self) -> None:
        """On the ground it stands on its rotors."""
        state = self._state
        state.wants_wings = False
        if state.form is not VtolForm.ROTORS:
            state.begin(VtolForm.ROTORS, self._craft.now_s)
        if not self._craft.is_armed:
            state.problem = ""
        self._wings.follow(LANDED)
        self._rotors.follow(LANDED)
        self._share = 1.0

    def _speed_up(self, setpoint: WingSetpoint) -> None:
        gains, speed = self._gains, self._wings.airspeed_m_s
        since_s = self._craft.now_s - self._state.since_s
        self._share = 1.0
        if since_s > gains.wings_least_s:
            self._share = min(1.0, max(0.0, (gains.wings_m_s - speed) / max(1.0, gains.wings_m_s - gains.blend_m_s)))
        throttle = min(1.0, gains.pusher_per_s * since_s)
        self._blend(setpoint, throttle, nan, (1.0 - self._share) * _CARRIES_RAD, _NOSE_UP_RAD)

    def _slow_down(self, setpoint: WingSetpoint) -> None:
        self._share = min(1.0, (self._craft.now_s - self._state.since_s) / _TAKE_OVER_S)
        speed = self._wings.airspeed_m_s
        slow = min(1.0, max(0.0, (_BRAKES_FROM_M_S - speed) / (_BRAKES_FROM_M_S - _BRAKES_AT_M_S)))
        pitch = _BRAKE_FAST_RAD + slow * (_BRAKE_SLOW_RAD - _BRAKE_FAST_RAD)
        self._blend(setpoint, 0.0, pitch, pitch, pitch)

    def _blend(self, setpoint: WingSetpoint, throttle: float, pitch: float, least: float, most: float) -> None:
        """The wings steer as at all speeds; the rotors keep the height, and the same attitude."""
        bank = _BANK_RAD * min(1.0, max(0.0, self._wings.airspeed_m_s / _BANKS_FROM_M_S - 1.0))
        self._wings.follow(
            WingSetpoint(
                roll_rad=max(-bank, min(bank, setpoint.roll_rad)),
                down_m=setpoint.down_m,
                climb_m_s=setpoint.climb_m_s,
                pitch_rad=pitch,
                throttle=throttle,
            )
        )
        yaw = self._craft.estimator.yaw_rad
        self._rotors.steer(
            MotionSetpoint(
                position_ned_m=(nan, nan, setpoint.down_m),
                velocity_ned_m_s=(nan, nan, -setpoint.climb_m_s),
                yaw_rad=yaw,
            )
        )
        roll, nose, _ = to_euler(self._wings.wanted_attitude)
        nose = max(least, min(most, nose))
        self._rotors.wanted_attitude = from_euler(roll, nose, yaw)
        self._wings.lean(nose)

    def _change_form(self) -> None:
        craft, gains, state = self._craft, self._gains, self._state
        now_s, speed = craft.now_s, self._wings.airspeed_m_s
        since_s = now_s - state.since_s
        match state.form:
            case VtolForm.ROTORS if state.wants_wings and not craft.is_landed:
                state.begin(VtolForm.TO_WINGS, now_s)
            case VtolForm.TO_WINGS if not state.wants_wings:
                state.begin(VtolForm.ROTORS if speed < gains.blend_m_s else VtolForm.TO_ROTORS, now_s)
            case VtolForm.TO_WINGS if speed >= gains.wings_m_s and since_s > gains.wings_least_s:
                state.problem = ""
                state.begin(VtolForm.WINGS, now_s)
            case VtolForm.TO_WINGS if 0.0 < gains.wings_most_s < since_s:
                self._fail(
                    f"transition failed: {speed:.1f} m/s of {gains.wings_m_s:g} m/s after {since_s:.0f} s",
                    gives_up=gains.gives_up,
                )
            case VtolForm.WINGS if not state.wants_wings:
                state.begin(VtolForm.TO_ROTORS, now_s)
            case VtolForm.WINGS if craft.height_over_home_m < gains.wings_height_m:
                self._fail(f"too low for wings: {craft.height_over_home_m:.0f} m of {gains.wings_height_m:g} m")
            case VtolForm.TO_ROTORS if state.wants_wings:
                state.begin(VtolForm.TO_WINGS, now_s)
            case VtolForm.TO_ROTORS:
                vn, ve, _ = craft.estimator.inertial.velocity_ned_m_s
                if hypot(vn, ve) < gains.rotors_m_s or since_s > gains.rotors_most_s:
                    state.begin(VtolForm.ROTORS, now_s)
            case _:
                pass

    def _fail(self, problem: str, *, gives_up: bool = True) -> None:
        state, craft = self._state, self._craft
        if not gives_up and state.problem:
            return
        if gives_up:
            state.fail(problem, craft.now_s)
        state.problem = problem
        craft.send_text(Severity.CRITICAL, f"Quad-chute: {problem}" if gives_up else problem.capitalize())

    def outputs(self) -> tuple[float, ...]:
        """The outputs for the next 5 ms."""
        share = self._share
        if share == 0.0:
            return (*self._wings.outputs(), *_STANDING)
        rotors = self._rotors.outputs()
        if self._state.form is VtolForm.ROTORS:
            return (*_STILL, *rotors)
        return (*self._wings.outputs(), *(share * rotor for rotor in rotors))
