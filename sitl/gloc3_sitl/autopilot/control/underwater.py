"""Underwater control: position to velocity to force, attitude to moment, both to thrusters and fins."""

from collections.abc import Sequence
from math import asin, atan2, cos, hypot, nan, sqrt
from typing import Final

import numpy as np

from gloc3.errors import Misuse
from gloc3.messages.frames import IDENTITY, Quaternion, Vector3, from_euler, rotate, rotate_back, to_euler, wrap_pi
from gloc3_sitl.autopilot.control.setpoint import AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.periods import OUTER_S
from gloc3_sitl.vehicles.underwater import Six, Thruster, UnderwaterModel, steady_thrust_n

_ANGLE_GAIN: Final = (2.0, 2.0, 1.2)
"""Wanted turn rate per radian of error, in 1/s: roll, pitch, yaw."""
_RATE_GAIN: Final = 0.5
"""Angular acceleration per rad/s of rate error, times the lag of a thruster."""
_RATE_INTEGRAL: Final = 0.1
"""The same per radian of integrated rate error, times the square of that gain."""
_RATE_MAX_RAD_S: Final = (0.8, 0.5, 0.6)
_PITCH_MAX_RAD: Final = 0.5
_CRUISE_AT_M_S, _CRUISE_AT_M = 0.25, 3.0
"""Speed and distance above which a vehicle that steers by its heading turns along its path…"""
_HOVER_AT_M_S, _HOVER_AT_M = 0.15, 2.0
"""…and hovers again when it is slower, and nearer."""
_STREAM_SPEED_M_S: Final = 0.5
_STREAM_TURN_RAD_S: Final = 0.05
_STREAM_S: Final = 6.0
_STREAM_MAX_M_S: Final = 1.2
"""Largest estimate of the current; it is learned on straight legs above this speed, with this time constant."""
_FIN_SPEED_M_S: Final = 0.4
"""Fins are used above this speed."""
_TURN_SHARE: Final = 0.7
"""So much of a thruster's force may be used to keep level and heading."""
_COMMANDED_AGAIN_RAD: Final = 0.02
_TRIM_MAX_M_S2: Final = 0.6


class UnderwaterControl:
    """Control loops of a vehicle that hovers in all directions; a `Control`.

    A slender vehicle (with fins) also steers by its heading: it turns its nose along its path through the water, with a
    crab angle against the current, and dives nose down.

    Args:
        craft: the vehicle's state.
        model: masses, drag and actuators to which the autopilot is tuned.
    """

    def __init__(self, craft: Craft, model: UnderwaterModel) -> None:
        self.thrust = 0.0
        self.wanted_attitude: Quaternion = IDENTITY
        self._craft: Final = craft
        self._estimator: Final = craft.estimator
        self._model: Final = model
        fins = 2 if model.fins is not None else 0
        self.stopped: Sequence[float] = (0.0,) * (len(model.thrusters) + fins)
        matrix = np.array([_effect(thruster) for thruster in model.thrusters]).T
        used = [axis for axis in range(6) if np.abs(matrix[axis]).max() > 1e-9 and axis != (3 if fins else -1)]
        inverse = np.zeros((len(model.thrusters), 6))
        inverse[:, used] = np.linalg.pinv(matrix[used])
        self._inverse: Final[list[list[float]]] = inverse.tolist()
        self._inertia: Final = tuple(
            own + added for own, added in zip((model.mass_kg,) * 3 + model.inertia_kg_m2, model.added_mass, strict=True)
        )
        self._most: Final = [min(thruster.forward_n, thruster.backward_n) for thruster in model.thrusters]
        self._turn_most: Final = [
            _TURN_SHARE * float(np.abs(matrix[3 + axis]) @ np.array(self._most)) / self._inertia[3 + axis]
            for axis in range(3)
        ]
        self._rate_gain: Final = _RATE_GAIN / model.thruster_lag_s
        self._outputs: Sequence[float] = self.stopped
        self._reset()

    def _reset(self) -> None:
        self._trim: Vector3 = (0.0, 0.0, 0.0)
        self._turn_trim = [0.0, 0.0, 0.0]
        self._stream: tuple[float, float] = (0.0, 0.0)
        self._push_n = self._ahead_m_s = 0.0
        self._pitch_trim_rad = 0.0
        self._yaw_rad = self._reported_yaw_rad = self._estimator.yaw_rad
        self._is_cruising = False
        self._was_armed = False

    def outputs(self) -> Sequence[float]:
        """The commands for the next 5 ms."""
        return self._outputs

    def follow(self, setpoint: Setpoint) -> None:
        """Turns a setpoint into commands. An armed vehicle under water is never landed."""
        craft = self._craft
        craft.touchdown.is_landed = False
        if not craft.is_armed:
            self._reset()
            self._outputs = self.stopped
            self.thrust = 0.0
            return
        if not self._was_armed:
            self._was_armed = True
            self._yaw_rad = self._estimator.yaw_rad
        if isinstance(setpoint, AttitudeSetpoint):
            self._follow_attitude(setpoint)
        elif isinstance(setpoint, MotionSetpoint):
            self._follow_motion(setpoint)
        else:
            raise Misuse("a submarine does not accept drive setpoints")

    def _follow_attitude(self, setpoint: AttitudeSetpoint) -> None:
        """An attitude with a thrust upwards, 0.5 for none, as ArduSub takes SET_ATTITUDE_TARGET."""
        attitude = setpoint.ned_from_frd
        if attitude is None:
            self._yaw_rad = wrap_pi(self._yaw_rad + setpoint.rate_frd_rad_s[2] * OUTER_S)
            roll, pitch = 0.0, 0.0
        else:
            roll, pitch, self._yaw_rad = to_euler(attitude)
        self._drive(
            (0.0, 0.0, (1.0 - 2.0 * setpoint.thrust) * self._inertia[2]), roll, pitch, setpoint.rate_frd_rad_s[2]
        )

    def _follow_motion(self, wanted: MotionSetpoint) -> None:
        inertial, gains = self._estimator.inertial, self._craft.tuning.gains
        commanded_rad = wanted.yaw_rad
        if commanded_rad == commanded_rad:
            # What is told anew counts; a slender vehicle that has turned into its way does not turn back at its end.
            if self._model.fins is None or abs(wrap_pi(commanded_rad - self._reported_yaw_rad)) > _COMMANDED_AGAIN_RAD:
                self._yaw_rad = self._reported_yaw_rad = commanded_rad
        elif wanted.yaw_rate_rad_s:
            self._yaw_rad = wrap_pi(self._yaw_rad + wanted.yaw_rate_rad_s * OUTER_S)
        velocity = inertial.velocity_ned_m_s
        goal = self._wanted_velocity(wanted, inertial.position_ned_m)
        vn, ve, vd = goal
        errors = [want - have if want == want else 0.0 for want, have in zip(goal, velocity, strict=True)]
        tn, te, td = self._trim
        gain = gains.velocity_i_xy * OUTER_S
        if self._is_cruising:
            tn = te = 0.0  # the current is met by crab angle then
        else:
            tn, te = _clamp(tn + gain * errors[0], _TRIM_MAX_M_S2), _clamp(te + gain * errors[1], _TRIM_MAX_M_S2)
        td = _clamp(td + gains.velocity_i_z * OUTER_S * errors[2], _TRIM_MAX_M_S2)
        self._trim = (tn, te, td)
        an, ae, ad = (feed if feed == feed else 0.0 for feed in wanted.acceleration_ned_m_s2)
        p_xy, p_z = gains.velocity_p_xy, gains.velocity_p_z
        acceleration = (
            an + p_xy * errors[0] + (tn if vn == vn else 0.0),
            ae + p_xy * errors[1] + (te if ve == ve else 0.0),
            ad + p_z * errors[2] + (td if vd == vd else 0.0),
        )
        attitude = inertial.ned_from_frd
        along, across, down = rotate_back(attitude, acceleration)
        flow = rotate_back(attitude, tuple(value if value == value else 0.0 for value in goal))  # type: ignore[arg-type]
        model, inertia = self._model, self._inertia
        force = (
            inertia[0] * along + (model.linear_drag[0] + model.quadratic_drag[0] * abs(flow[0])) * flow[0],
            inertia[1] * across + (model.linear_drag[1] + model.quadratic_drag[1] * abs(flow[1])) * flow[1],
            inertia[2] * down + (model.linear_drag[2] + model.quadratic_drag[2] * abs(flow[2])) * flow[2],
        )
        pitch = 0.0
        yaw, rate = self._yaw_rad, wanted.yaw_rate_rad_s
        if model.fins is not None:
            self._learn_stream()
            cruise = self._cruise(wanted, goal, errors)
            if cruise is not None:
                yaw, pitch, through_m_s = cruise
                self._yaw_rad = self._estimator.yaw_rad
                if commanded_rad == commanded_rad:
                    self._reported_yaw_rad = commanded_rad
                rate = 0.0
                # It turns on the spot first: a way that begins to its side would lead it round in a circle.
                speed = through_m_s * max(0.0, cos(wrap_pi(yaw - self._estimator.yaw_rad))) ** 3
                ahead = rotate_back(attitude, velocity)[0] - rotate_back(attitude, (*self._stream, 0.0))[0]
                push = inertia[0] * p_xy * (speed - ahead)
                force = (push + model.quadratic_drag[0] * speed * speed, 0.0, force[2])
        self._drive(force, 0.0, pitch, rate, yaw)

    def _wanted_velocity(self, wanted: MotionSetpoint, position: Vector3) -> Vector3:
        """Position errors and velocity setpoints as one velocity in NED within the limits; NaN on free axes."""
        gains = self._craft.tuning.gains
        pn, pe, pd = wanted.position_ned_m
        vn, ve, vd = wanted.velocity_ned_m_s
        n, e, d = position
        if pn == pn and pe == pe:
            off_n, off_e = (pn - n) * gains.position_xy, (pe - e) * gains.position_xy
            vn, ve = (off_n + vn if vn == vn else off_n), (off_e + ve if ve == ve else off_e)
        if pd == pd:
            off_d = (pd - d) * gains.position_z
            vd = off_d + vd if vd == vd else off_d
        if vn == vn and ve == ve:
            speed = hypot(vn, ve)
            if speed > gains.speed_xy_m_s:
                vn, ve = vn * gains.speed_xy_m_s / speed, ve * gains.speed_xy_m_s / speed
        else:
            vn = ve = nan
        if vd == vd:
            vd = max(-gains.speed_up_m_s, min(gains.speed_down_m_s, vd))
        return vn, ve, vd

    def _learn_stream(self) -> None:
        """Estimates the current: velocity over ground minus the velocity through water derived from thrust and drag."""
        model, inertial = self._model, self._estimator.inertial
        push = sum(
            steady_thrust_n(model, thruster.forward_n, thruster.backward_n, command) * thruster.direction_frd[0]
            for thruster, command in zip(model.thrusters, self._outputs, strict=False)
        )
        self._push_n += (push - self._push_n) * OUTER_S / (OUTER_S + model.thruster_lag_s)
        drag = (model.linear_drag[0] + model.quadratic_drag[0] * abs(self._ahead_m_s)) * self._ahead_m_s
        self._ahead_m_s += OUTER_S * (self._push_n - drag) / self._inertia[0]
        if self._ahead_m_s < _STREAM_SPEED_M_S or abs(inertial.rate_frd_rad_s[2]) > _STREAM_TURN_RAD_S:
            return
        along = rotate(inertial.ned_from_frd, (self._ahead_m_s, 0.0, 0.0))
        share = OUTER_S / _STREAM_S
        north, east = self._stream
        vn, ve, _ = inertial.velocity_ned_m_s
        self._stream = (
            _clamp(north + share * (vn - along[0] - north), _STREAM_MAX_M_S),
            _clamp(east + share * (ve - along[1] - east), _STREAM_MAX_M_S),
        )

    def _cruise(
        self, wanted: MotionSetpoint, goal: Vector3, errors: Sequence[float]
    ) -> tuple[float, float, float] | None:
        """Heading, pitch and speed through the water for a path long enough to turn along; None to hover."""
        vn, ve, vd = goal
        pn, pe, _ = wanted.position_ned_m
        on_n, on_e, _ = wanted.velocity_ned_m_s
        n, e, _ = self._estimator.inertial.position_ned_m
        speed = hypot(on_n, on_e) if on_n == on_n and on_e == on_e else 0.0
        away = hypot(pn - n, pe - e) if pn == pn and pe == pe else 0.0
        if self._is_cruising:
            self._is_cruising = vn == vn and (speed > _HOVER_AT_M_S or away > _HOVER_AT_M)
        else:
            self._is_cruising = vn == vn and (speed > _CRUISE_AT_M_S or away > _CRUISE_AT_M)
        if not self._is_cruising:
            return None
        north, east = vn - self._stream[0], ve - self._stream[1]
        through = hypot(north, east)
        down = vd if vd == vd else 0.0
        self._pitch_trim_rad = _clamp(self._pitch_trim_rad - 0.05 * OUTER_S * errors[2], 0.2)
        pitch = _clamp(-asin(_clamp(down / max(through, 0.5), 0.5)) + self._pitch_trim_rad, _PITCH_MAX_RAD)
        return atan2(east, north), pitch, through

    def _drive(
        self,
        force_frd_n: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rate_rad_s: float,
        yaw_rad: float | None = None,
    ) -> None:
        """Adds the moments that keep an attitude, and shares everything out among the actuators."""
        estimator, model = self._estimator, self._model
        inertial = estimator.inertial
        yaw = self._yaw_rad if yaw_rad is None else yaw_rad
        self.wanted_attitude = from_euler(roll_rad, pitch_rad, yaw)
        roll, pitch, heading = to_euler(inertial.ned_from_frd)
        p, q, r = inertial.rate_frd_rad_s
        tuning = self._craft.tuning
        yaw_max = min(_RATE_MAX_RAD_S[2], tuning.yaw_rate_rad_s)
        rates = (
            _clamp(_ANGLE_GAIN[0] * (roll_rad - roll), _RATE_MAX_RAD_S[0]),
            _clamp(_ANGLE_GAIN[1] * (pitch_rad - pitch), _RATE_MAX_RAD_S[1]),
            _clamp(_ANGLE_GAIN[2] * wrap_pi(yaw - heading) + yaw_rate_rad_s, yaw_max),
        )
        gain, trims = self._rate_gain, self._turn_trim
        vn, ve, vd = inertial.velocity_ned_m_s
        u, v, w = rotate_back(inertial.ned_from_frd, (vn - self._stream[0], ve - self._stream[1], vd))
        mu, mv, mw = self._inertia[:3]
        # Munk's moment, which turns a body across its way, is taken off before it turns it.
        moment = [(mw - mv) * v * w, (mu - mw) * u * w, (mv - mu) * u * v]
        for axis, (rate, wanted, inertia) in enumerate(zip((p, q, r), rates, self._inertia[3:], strict=True)):
            error = wanted - rate
            most = 0.5 * self._turn_most[axis]
            if abs(gain * error + trims[axis]) < most or error * trims[axis] < 0.0:
                trims[axis] = _clamp(trims[axis] + _RATE_INTEGRAL * gain * gain * error * OUTER_S, most)
            drag = model.quadratic_drag[3 + axis] * abs(wanted) * wanted
            moment[axis] += inertia * (gain * error + trims[axis]) + drag
        fins: tuple[float, ...] = ()
        if model.fins is not None:
            fins = self._fins(moment)
        fx, fy, fz = force_frd_n
        turns = self._shared((0.0, 0.0, 0.0, *moment))
        turns = [_clamp(own, _TURN_SHARE * most) for own, most in zip(turns, self._most, strict=True)]
        # Level and heading first, then the depth: what they leave is for the way.
        room = [most - abs(own) for own, most in zip(turns, self._most, strict=True)]
        heave = _scaled(self._shared((0.0, 0.0, fz, 0.0, 0.0, 0.0)), room)
        room = [left - 0.8 * abs(own) for own, left in zip(heave, room, strict=True)]
        level = _scaled(self._shared((fx, fy, 0.0, 0.0, 0.0, 0.0)), room)
        commands = [
            _command(model, thruster, turn + up + on)
            for thruster, turn, up, on in zip(model.thrusters, turns, heave, level, strict=True)
        ]
        largest = max(map(abs, commands))
        self.thrust = largest
        self._outputs = (*commands, *fins)

    def _shared(self, wanted: Sequence[float]) -> list[float]:
        """Thrusts that give force and moment together, with the least effort."""
        return [sum(a * b for a, b in zip(row, wanted, strict=True)) for row in self._inverse]

    def _fins(self, moment: list[float]) -> tuple[float, float]:
        """Rudder and stern planes: as much of the moments as they can give now, which is taken off them."""
        fins, ahead = self._model.fins, self._ahead_m_s
        assert fins is not None
        if ahead < _FIN_SPEED_M_S:
            return 0.0, 0.0
        most = fins.force_n_s2_m2_rad * fins.arm_m * ahead * ahead * fins.deflection_rad
        rudder, stern = _clamp(moment[2] / most, 1.0), _clamp(moment[1] / most, 1.0)
        moment[2] -= rudder * most
        moment[1] -= stern * most
        return rudder, stern


def _effect(thruster: Thruster) -> Six:
    """Force and moment about the body's origin of a thrust of 1 N."""
    x, y, z = thruster.position_frd_m
    dx, dy, dz = thruster.direction_frd
    return dx, dy, dz, y * dz - z * dy, z * dx - x * dz, x * dy - y * dx


def _command(model: UnderwaterModel, thruster: Thruster, force_n: float) -> float:
    """The command (-1 to 1) at which a thruster produces a force."""
    share = abs(force_n) / (thruster.forward_n if force_n > 0.0 else thruster.backward_n)
    if share < 0.002:
        return 0.0
    curve = model.thrust_curve
    root = share if curve < 1e-6 else (sqrt((1.0 - curve) ** 2 + 4.0 * curve * share) - (1.0 - curve)) / (2.0 * curve)
    command = model.dead_band + min(root, 1.0) * (1.0 - model.dead_band)
    return command if force_n > 0.0 else -command


def _scaled(thrusts: list[float], room: list[float]) -> list[float]:
    """The same thrusts, all made smaller by as much as the one with the least room needs."""
    share = min((max(left, 0.0) / abs(own) for own, left in zip(thrusts, room, strict=True) if own), default=1.0)
    return [own * share for own in thrusts] if share < 1.0 else thrusts


def _clamp(value: float, limit: float) -> float:
    return limit if value > limit else max(value, -limit)
