"""Multirotor control: position to attitude to rates to four throttles, and touchdown detection."""

from math import hypot, nan, radians, sqrt
from typing import Final

from gloc3.errors import Misuse
from gloc3.messages.frames import GRAVITY_M_S2
from gloc3_sitl.autopilot.airframe import PELICAN, Airframe
from gloc3_sitl.autopilot.control.position import PositionController
from gloc3_sitl.autopilot.control.rates import AttitudeController, RateController, attitude_for
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft, TouchdownSigns
from gloc3_sitl.autopilot.periods import OUTER_S, OUTER_STEPS, STEP_S

Throttles = tuple[float, float, float, float]
"""Front right, rear left, front left, rear right; each 0..1."""

IDLE: Throttles = (0.0, 0.0, 0.0, 0.0)
"""Motors stopped."""
_IDLE_THRUST: Final = 0.03
"""Collective thrust of motors that idle."""
_IDLES: Final = 0.1
"""Up to this share of the way from the least thrust to that of hovering, a landing vehicle idles, as in PX4 …"""
_TURNS_RAD_S: Final = radians(20.0)
"""… while it rolls and pitches slower than this (LNDMC_ROT_MAX)."""
_THRUST_RISE_PER_S: Final = 1.2
"""Largest rise of the collective thrust after standing on the ground, 1/s."""


class Mixer:
    """Quadrotor in X from above: 0 front right, 1 rear left counter-clockwise; 2 front left, 3 rear right clockwise.

    At a limit, yaw is reduced first, then collective thrust; roll and pitch are scaled only beyond a rotor's whole
    range: an upright vehicle that turns or climbs wrongly can be flown, a toppled one cannot.
    """

    __slots__ = ("_half_linear", "_inverse_curve", "_is_linear", "idle_thrust", "is_saturated")

    def __init__(self, thrust_curve: float, idle_thrust: float = 0.02) -> None:
        self.idle_thrust = idle_thrust
        """Least thrust of a rotor while armed, as a fraction, so that none stops in flight."""
        self.is_saturated = False
        """Whether the last mix was limited; integrators then stop."""
        self._is_linear = thrust_curve < 1e-6
        self._inverse_curve = 0.0 if self._is_linear else 1.0 / thrust_curve
        self._half_linear = 0.0 if self._is_linear else (1.0 - thrust_curve) / (2.0 * thrust_curve)

    def mix(self, thrust: float, roll: float, pitch: float, yaw: float) -> Throttles:
        """Throttles for a collective thrust 0..1 and torques, all as fractions of full thrust of each rotor."""
        low, high = self.idle_thrust, 1.0
        tilt = abs(roll) + abs(pitch)
        saturated = False
        if tilt > 0.5 * (high - low):
            scale = 0.5 * (high - low) / tilt
            roll *= scale
            pitch *= scale
            tilt = 0.5 * (high - low)
            saturated = True
        # Collective moves just as far as roll and pitch need, and yaw takes what is left on the nearer side.
        if thrust - tilt < low:
            thrust = low + tilt
            saturated = True
        elif thrust + tilt > high:
            thrust = high - tilt
            saturated = True
        below, above = thrust - tilt - low, high - thrust - tilt
        room = min(below, above)
        # A little yaw authority is always kept, at the cost of lift at the upper limit.
        if room < 0.04 and thrust + tilt + 0.04 > high:
            thrust = max(high - tilt - 0.04, low + tilt)
            room = min(thrust - tilt - low, high - thrust - tilt)
        if yaw > room:
            yaw = room
            saturated = True
        elif yaw < -room:
            yaw = -room
            saturated = True
        self.is_saturated = saturated
        front_right = thrust - roll + pitch + yaw
        rear_left = thrust + roll - pitch + yaw
        front_left = thrust + roll + pitch - yaw
        rear_right = thrust - roll - pitch - yaw
        if self._is_linear:
            return (front_right, rear_left, front_left, rear_right)
        half, inverse = self._half_linear, self._inverse_curve
        square = half * half
        return (
            sqrt(square + front_right * inverse) - half if front_right > 0.0 else 0.0,
            sqrt(square + rear_left * inverse) - half if rear_left > 0.0 else 0.0,
            sqrt(square + front_left * inverse) - half if front_left > 0.0 else 0.0,
            sqrt(square + rear_right * inverse) - half if rear_right > 0.0 else 0.0,
        )


class MultirotorControl:
    """Control loops of a quadrotor; a `Control`.

    Args:
        craft: the vehicle's state.
        airframe: the vehicle's properties.
    """

    stopped: Throttles = IDLE

    def __init__(self, craft: Craft, airframe: Airframe = PELICAN) -> None:
        self.thrust = 0.0
        self.wanted_attitude = craft.estimator.inertial.ned_from_frd
        self._craft: Final = craft
        self._estimator: Final = craft.estimator
        self._tuning: Final = craft.tuning
        self._mixer = Mixer(airframe.thrust_curve)
        self._rates = RateController(airframe, STEP_S, limit=airframe.integral_max)
        self._attitude = AttitudeController(airframe.attitude_p)
        self._position = PositionController(craft.tuning.gains)
        self._wanted_rate = (0.0, 0.0, 0.0)
        self._yaw_rate = 0.0
        self._flies_rates = False
        self._is_idle = True
        self._ceiling = 0.0
        self._hold_yaw_rad = 0.0

    def outputs(self) -> Throttles:
        """The throttles for the next 5 ms."""
        mixer = self._mixer
        inertial = self._estimator.inertial
        if self._is_idle:
            self._rates.reset()
            return mixer.mix(_IDLE_THRUST, 0.0, 0.0, 0.0)
        if self._flies_rates:
            wanted = self._wanted_rate
        else:
            wanted = self._attitude.update(inertial.ned_from_frd, self.wanted_attitude, self._yaw_rate)
        roll, pitch, yaw = self._rates.update(wanted, inertial.rate_frd_rad_s, mixer.is_saturated)
        return mixer.mix(self.thrust, roll, pitch, yaw)

    def follow(self, setpoint: Setpoint) -> None:
        """Looks for the ground, and steers."""
        if not isinstance(setpoint, MotionSetpoint | AttitudeSetpoint):
            raise Misuse(f"a multirotor does not accept {type(setpoint).__name__}")
        self._detect_touchdown(setpoint)
        self.steer(setpoint)
        craft = self._craft
        steers_attitude = craft.is_armed and not craft.is_landed and not self._flies_rates
        craft.crash.update(craft.now_s, craft.estimator, self.wanted_attitude, is_flying=steers_attitude)

    def steer(self, setpoint: MotionSetpoint | AttitudeSetpoint) -> None:
        """Turns a setpoint into an attitude (or rates) and a thrust."""
        tuning = self._tuning
        self._attitude.gain = (tuning.attitude_p_roll, tuning.attitude_p_pitch, tuning.attitude_p_yaw)
        inertial = self._estimator.inertial
        if setpoint is LANDED:
            self._is_idle = True
            self._ceiling = _IDLE_THRUST
            self.thrust = _IDLE_THRUST if self._craft.is_armed else 0.0
            self._position.reset()
            self.wanted_attitude = inertial.ned_from_frd
            self._hold_yaw_rad = self._estimator.yaw_rad
            return
        self._is_idle = False
        if self._ceiling < 1.0:
            self._ceiling += _THRUST_RISE_PER_S * STEP_S * OUTER_STEPS
        if isinstance(setpoint, AttitudeSetpoint):
            self.thrust = min(setpoint.thrust, self._ceiling)
            self._flies_rates = setpoint.ned_from_frd is None
            if setpoint.ned_from_frd is None:
                self._wanted_rate = setpoint.rate_frd_rad_s
            else:
                self.wanted_attitude = setpoint.ned_from_frd
                self._yaw_rate = setpoint.rate_frd_rad_s[2]
            self._hold_yaw_rad = self._estimator.yaw_rad
            return
        self._flies_rates = False
        self._follow_motion(setpoint)

    def _follow_motion(self, setpoint: MotionSetpoint) -> None:
        inertial, tuning = self._estimator.inertial, self._tuning
        if setpoint.yaw_rad == setpoint.yaw_rad:
            self._hold_yaw_rad = setpoint.yaw_rad
        elif setpoint.yaw_rate_rad_s:
            self._hold_yaw_rad += setpoint.yaw_rate_rad_s * STEP_S * OUTER_STEPS
        self._yaw_rate = setpoint.yaw_rate_rad_s
        force = self._position.update(
            setpoint,
            inertial.position_ned_m,
            inertial.velocity_ned_m_s,
            inertial.acceleration_ned_m_s2,
            tuning.hover_thrust,
            OUTER_S,
        )
        self.wanted_attitude = attitude_for(force, self._hold_yaw_rad)
        # Only the part of the force along the body's own axis can be given before the vehicle has turned.
        w, x, y, z = inertial.ned_from_frd
        along = (
            force[0] * 2.0 * (x * z + w * y)
            + force[1] * 2.0 * (y * z - w * x)
            + force[2] * (1.0 - 2.0 * (x * x + y * y))
        )
        thrust = -along / GRAVITY_M_S2 * tuning.hover_thrust
        thrust = max(thrust, tuning.gains.thrust_min)
        self.thrust = min(thrust, self._ceiling)

    def _detect_touchdown(self, setpoint: MotionSetpoint | AttitudeSetpoint) -> None:
        craft, inertial = self._craft, self._estimator.inertial
        now_s = craft.now_s
        if isinstance(setpoint, AttitudeSetpoint):
            wants_up = setpoint.thrust > self._tuning.hover_thrust
            wants_down = setpoint.thrust < 0.5 * self._tuning.hover_thrust
        else:
            wanted_down, wanted_speed = setpoint.position_ned_m[2], setpoint.velocity_ned_m_s[2]
            off = wanted_down - inertial.position_ned_m[2] if wanted_down == wanted_down else 0.0
            speed = wanted_speed if wanted_speed == wanted_speed else 0.0
            wants_up = off < -0.05 or speed < -0.05
            wants_down = setpoint is LANDED or off > 0.05 or speed > 0.1
        is_range_fresh = now_s - self._estimator.range_t_s < 0.3
        least = self._tuning.gains.thrust_min
        p, q, _ = inertial.rate_frd_rad_s
        signs = TouchdownSigns(
            wants_down=wants_down,
            wants_up=wants_up,
            thrust_share=self.thrust / self._tuning.hover_thrust,
            is_idle=self.thrust <= least + _IDLES * (self._tuning.hover_thrust - least) and hypot(p, q) < _TURNS_RAD_S,
            speed_down_m_s=inertial.velocity_ned_m_s[2],
            is_climb_known=self._estimator.is_climb_good(now_s),
            height_m=self._estimator.height_above_ground_m - craft.range_mount_m if is_range_fresh else nan,
        )
        craft.touchdown.update(now_s, signs, is_armed=craft.is_armed)
