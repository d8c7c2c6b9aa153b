"""Position to velocity to acceleration: the outer loops, 50 times a second."""

from dataclasses import dataclass
from math import hypot, sqrt, tan

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint


@dataclass(slots=True, kw_only=True)
class PositionGains:
    """Gains and limits; written by the parameters of each style."""

    position_xy: float = 1.3
    """Velocity per metre of error, in 1/s."""
    position_z: float = 1.4
    velocity_p_xy: float = 2.6
    """Acceleration per m/s of error, in 1/s."""
    velocity_p_z: float = 5.0
    velocity_i_xy: float = 1.2
    """Acceleration per metre of integrated velocity error, in 1/s^2."""
    velocity_i_z: float = 2.0
    velocity_d_xy: float = 0.25
    """Acceleration taken off per m/s^2 of measured acceleration, no unit."""
    speed_xy_m_s: float = 8.0
    speed_up_m_s: float = 3.0
    speed_down_m_s: float = 1.5
    tilt_rad: float = 0.6
    """Largest lean."""
    thrust_min: float = 0.12
    """Least collective thrust in flight, as a fraction."""
    thrust_max: float = 1.0


class PositionController:
    """Cascade of P on position and PID on velocity; returns a specific force setpoint in NED."""

    __slots__ = ("_integral", "_velocity_wanted", "gains")

    def __init__(self, gains: PositionGains) -> None:
        self.gains = gains
        self._integral: Vector3 = (0.0, 0.0, 0.0)
        self._velocity_wanted: Vector3 = (0.0, 0.0, 0.0)

    @property
    def velocity_wanted_ned_m_s(self) -> Vector3:
        """Velocity setpoint of the last update."""
        return self._velocity_wanted

    def reset(self) -> None:
        """Resets the integrators; called on the ground."""
        self._integral = (0.0, 0.0, 0.0)

    def update(
        self,
        wanted: MotionSetpoint,
        position: Vector3,
        velocity: Vector3,
        acceleration: Vector3,
        hover_thrust: float,
        dt_s: float,
    ) -> Vector3:
        """Specific force setpoint (rotor thrust per mass, about -9.8 down in hover), NED, in m/s^2."""
        gains = self.gains
        pn, pe, pd = wanted.position_ned_m
        vn, ve, vd = wanted.velocity_ned_m_s
        an, ae, ad = wanted.acceleration_ned_m_s2
        n, e, d = position
        gain = gains.position_xy
        # Velocity wanted: NaN propagates where there is neither position nor velocity.
        if pn == pn and pe == pe:
            to_n, to_e = (pn - n) * gain, (pe - e) * gain
            speed = hypot(to_n, to_e)
            if speed > gains.speed_xy_m_s:
                to_n *= gains.speed_xy_m_s / speed
                to_e *= gains.speed_xy_m_s / speed
            vn = to_n + vn if vn == vn else to_n
            ve = to_e + ve if ve == ve else to_e
        if pd == pd:
            to_d = (pd - d) * gains.position_z
            vd = to_d + vd if vd == vd else to_d
        in_n, in_e, in_d = self._integral
        real_n, real_e, real_d = velocity
        has_xy = vn == vn and ve == ve
        has_z = vd == vd
        error_n = error_e = error_d = 0.0
        if has_xy:
            speed = hypot(vn, ve)
            if speed > gains.speed_xy_m_s:
                vn *= gains.speed_xy_m_s / speed
                ve *= gains.speed_xy_m_s / speed
            error_n, error_e = vn - real_n, ve - real_e
        if has_z:
            up, down = -gains.speed_up_m_s, gains.speed_down_m_s
            vd = up if vd < up else min(vd, down)
            error_d = vd - real_d
        self._velocity_wanted = (vn, ve, vd)
        damp = gains.velocity_d_xy
        fn = gains.velocity_p_xy * error_n + in_n + (an if an == an else 0.0) - damp * acceleration[0]
        fe = gains.velocity_p_xy * error_e + in_e + (ae if ae == ae else 0.0) - damp * acceleration[1]
        fd = gains.velocity_p_z * error_d + in_d + (ad if ad == ad else 0.0) - GRAVITY_M_S2
        # Limits: thrust first for height, then what lean and thrust are left for the horizontal.
        scale = GRAVITY_M_S2 / hover_thrust
        least, most = -gains.thrust_min * scale, -gains.thrust_max * scale
        is_limited_z = False
        if fd > least:
            fd, is_limited_z = least, error_d > 0.0
        elif fd < 0.9 * most:
            fd, is_limited_z = 0.9 * most, error_d < 0.0
        room = min(-fd * tan(gains.tilt_rad), sqrt(most * most - fd * fd))
        across = hypot(fn, fe)
        is_limited_xy = across > room
        if is_limited_xy:
            fn *= room / across
            fe *= room / across
        if has_z and not is_limited_z:
            in_d += gains.velocity_i_z * error_d * dt_s
        if has_xy:
            step = gains.velocity_i_xy * dt_s
            if not is_limited_xy or in_n * error_n < 0.0:
                in_n += step * error_n
            if not is_limited_xy or in_e * error_e < 0.0:
                in_e += step * error_e
        self._integral = (_clamp(in_n, 5.0), _clamp(in_e, 5.0), _clamp(in_d, 7.0))
        return (fn, fe, fd)


def _clamp(value: float, limit: float) -> float:
    return limit if value > limit else max(value, -limit)
