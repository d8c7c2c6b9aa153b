"""A fixed-wing aircraft on JSBSim: wing, tail, rudders, and a propeller on an electric motor."""

from collections.abc import Sequence
from math import atan2, cos, exp, pi, sin, sqrt, tau
from typing import Final

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.jsbsim_body import FOOT_M, PER_POUND, PER_POUND_FOOT, JsbsimBody
from gloc3_sitl.physics.level_body import clipped
from gloc3_sitl.vehicles.fixed_wing_model import FixedWingModel

_LEAST_AIR_M_S: Final = 1.0
"""In slower air angles of the flow mean nothing, and its force is less than the weight of a gram."""
Wrench = tuple[float, float, float, float, float, float]
"""A force in N and a moment in N m, both FRD: x, y, z, roll, pitch, yaw."""
AILERON, ELEVATOR, THROTTLE, RUDDER = range(4)
"""Outputs: -1 to 1; positive turn right, nose up, full throttle (-1 is none) and nose right."""


class FixedWing(JsbsimBody):
    """A simulated aircraft that starts at rest on its wheels.

    Formulas: R. Beard and T. McLain, "Small Unmanned Aircraft" (2012), chapter 4, and its supplement for motor and
    propeller
    in steady state. As there, a motor without throttle brakes a windmilling propeller, without charging the battery.

    Args:
        model: the aircraft.
        situation: initial state, wind and gusts.
    """

    near_ground_m = 3.0

    def __init__(self, model: FixedWingModel, situation: Situation) -> None:
        self.model: Final = model
        super().__init__(model.aircraft, model.foot_depth_m, model.springs_n_m, situation)
        self._servo_lag: Final = 1.0 - exp(-1.0 / (self.rate_hz * model.servo_s))
        self._motor_lag: Final = 1.0 - exp(-1.0 / (self.rate_hz * model.motor_s))

    def _stop_motors(self) -> None:
        self._surfaces = (0.0, 0.0, 0.0)
        self._motor_v = self._motor_w = 0.0

    def _power_w(self) -> float:
        return self.model.avionics_w + self._motor_w

    @property
    def surfaces_rad(self) -> tuple[float, float, float]:
        """Deflection of ailerons, elevator and rudder, with the signs of the model."""
        return self._surfaces

    def step(self, outputs: Sequence[float], /) -> None:
        """Advance by one period with ailerons, elevator, throttle and rudder, each -1 to 1."""
        self._put(self._force_and_moment(outputs))
        self._advance()

    def _put(self, wrench: Wrench) -> None:
        """Puts a force and a moment on the body for the next period."""
        x, y, z, roll, pitch, yaw = wrench
        put_x, put_y, put_z, put_l, put_m, put_n = self._forces
        put_x(x * PER_POUND)
        put_y(y * PER_POUND)
        put_z(z * PER_POUND)
        put_l(roll * PER_POUND_FOOT)
        put_m(pitch * PER_POUND_FOOT)
        put_n(yaw * PER_POUND_FOOT)

    def _force_and_moment(self, outputs: Sequence[float]) -> Wrench:
        """Force and moment of air and propeller, after rudders and motor have moved on by one period."""
        model = self.model
        most, lag = model.deflection_max_rad, self._servo_lag
        aileron, elevator, rudder = self._surfaces
        aileron += lag * (most * clipped(outputs[AILERON]) - aileron)
        elevator += lag * (-most * clipped(outputs[ELEVATOR]) - elevator)
        rudder += lag * (-most * clipped(outputs[RUDDER]) - rudder)
        self._surfaces = (aileron, elevator, rudder)
        wanted_v = model.voltage_v * 0.5 * (1.0 + clipped(outputs[THROTTLE]))
        self._motor_v += self._motor_lag * (wanted_v - self._motor_v)

        get_u, get_v, get_w, get_p, get_q, get_r = self._motion
        u, v, w = velocity = get_u() * FOOT_M, get_v() * FOOT_M, get_w() * FOOT_M
        air = sqrt(u * u + v * v + w * w)
        thrust_n, torque_n_m = self._propel(u)
        if air > _LEAST_AIR_M_S:
            return self._fly(air, velocity, (get_p(), get_q(), get_r()), thrust_n, torque_n_m)
        return thrust_n, 0.0, 0.0, -torque_n_m, 0.0, 0.0

    def _fly(self, air: float, velocity: Vector3, rates: Vector3, thrust_n: float, torque_n_m: float) -> Wrench:
        """Force and moment of air and propeller, FRD."""
        m = self.model
        (u, v, w), (p, q, r) = velocity, rates
        aileron, elevator, rudder = self._surfaces
        alpha, beta = atan2(w, u), atan2(v, sqrt(u * u + w * w))
        pressure_n = 0.5 * self._density * air * air * m.wing_m2
        ahead_n = 0.5 * self._density * (u * u + w * w) * m.wing_m2  # what blows along the wing does not lift it
        half = 0.5 / air
        p, q, r = p * m.span_m * half, q * m.chord_m * half, r * m.span_m * half
        cosine, sine = cos(alpha), sin(alpha)
        attached = m.lift_0 + m.lift_alpha * alpha
        stalled = _stalled(alpha, m.stall_rad, m.stall_sharpness)
        lift = (1.0 - stalled) * attached + stalled * 2.0 * (sine if sine >= 0.0 else -sine) * sine * cosine
        drag = m.drag_parasitic + stalled * 2.0 * sine * sine
        drag += (1.0 - stalled) * attached * attached * m.wing_m2 / (pi * m.oswald * m.span_m * m.span_m)
        lift += m.lift_q * q + m.lift_elevator * elevator
        drag += m.drag_elevator * abs(elevator)
        most = m.moment_angle_max_rad
        alpha, beta = max(-most, min(most, alpha)), max(-most, min(most, beta))
        side = m.side_beta * beta + m.side_aileron * aileron + m.side_rudder * rudder
        roll = m.roll_beta * beta + m.roll_p * p + m.roll_r * r + m.roll_aileron * aileron + m.roll_rudder * rudder
        pitch = m.pitch_0 + m.pitch_alpha * alpha + m.pitch_q * q + m.pitch_elevator * elevator
        yaw = m.yaw_beta * beta + m.yaw_p * p + m.yaw_r * r + m.yaw_aileron * aileron + m.yaw_rudder * rudder
        return (
            ahead_n * (lift * sine - drag * cosine) + thrust_n,
            pressure_n * side,
            -ahead_n * (lift * cosine + drag * sine),
            pressure_n * m.span_m * roll - torque_n_m,
            ahead_n * m.chord_m * pitch,
            pressure_n * m.span_m * yaw,
        )

    def _propel(self, ahead_m_s: float) -> tuple[float, float]:
        """Thrust and torque of the propeller where motor and propeller torque balance."""
        m, volts = self.model, self._motor_v
        speed, size, rho = max(0.0, ahead_m_s), m.propeller_m, self._density
        q0, q1, q2 = m.torque_coefficients
        a = rho * size**5 / tau**2 * q0
        b = rho * size**4 / tau * q1 * speed + m.motor_v_s_rad**2 / m.motor_ohm
        c = rho * size**3 * q2 * speed * speed - m.motor_v_s_rad * (volts / m.motor_ohm - m.motor_idle_a)
        if c >= 0.0:  # not even its own friction is overcome: the propeller stands
            self._motor_w = 0.0
            return 0.0, 0.0
        spin = (-b + sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
        t0, t1, t2 = m.thrust_coefficients
        turns = spin / tau
        thrust = rho * size**2 * (t0 * (size * turns) ** 2 + t1 * size * turns * speed + t2 * speed * speed)
        current = (volts - m.motor_v_s_rad * spin) / m.motor_ohm
        self._motor_w = max(0.0, volts * current)
        return thrust, m.motor_v_s_rad * (current - m.motor_idle_a)


def _stalled(alpha: float, stall_rad: float, sharpness: float) -> float:
    """Share of the flow that has left the wing, 0 to 1."""
    above = exp(-min(50.0, max(-50.0, sharpness * (alpha - stall_rad))))
    below = exp(min(50.0, max(-50.0, sharpness * (alpha + stall_rad))))
    return (1.0 + above + below) / ((1.0 + above) * (1.0 + below))
