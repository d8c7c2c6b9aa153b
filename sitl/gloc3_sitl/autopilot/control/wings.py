"""Fixed-wing control: bank, pitch and throttle to ailerons, elevator, throttle and rudder, as in Plane."""

from math import cos, hypot, isnan, sin, tan
from typing import Final, NamedTuple

from gloc3.errors import Misuse
from gloc3.messages.frames import GRAVITY_M_S2, Quaternion, from_euler, to_euler, wrap_pi
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint, WingSetpoint
from gloc3_sitl.autopilot.control.wing_gains import WingGains
from gloc3_sitl.autopilot.craft import Craft, FlightDetector
from gloc3_sitl.autopilot.periods import OUTER_S, STEP_S

Rudders = tuple[float, float, float, float]
"""Ailerons, elevator, throttle, rudder: -1 to 1; right, nose up, full, right."""
_STOPPED: Final[Rudders] = (0.0, 0.0, -1.0, 0.0)
_STANDS_M_S: Final = 1.0
_STANDS_S: Final = 1.5
_FLIES_FROM: Final = 0.75
"""Share of the slowest air speed above which a plane may fly …"""
_ROLLS_M_S: Final = 5.0
"""… and speed over ground."""
_FIX_LOST_S: Final = 4.0
_STARTS: Final = 0.2
"""Throttle above which a plane on the ground counts as rolling."""


class WingControl:
    """Three rudders and a throttle; a `Control`.

    Args:
        craft: what is known of the vehicle.
        lands: it looks for the ground; what lands on rotors does not.
    """

    stopped: Rudders = _STOPPED

    def __init__(self, craft: Craft, *, lands: bool = True) -> None:
        self.thrust = 0.0
        self._craft: Final = craft
        self._lands: Final = lands
        self._gains: Final[WingGains] = craft.tuning.wings
        self._energy: Final = EnergyControl(self._gains)
        self._setpoint = WingSetpoint(throttle=0.0, pitch_rad=0.0)
        self._pitch_rad = 0.0
        self._roll_sum = self._pitch_sum = 0.0
        self._stands_s = 0.0
        self._is_balancing = False
        self._flight: Final = FlightDetector()
        if lands:
            craft.flight = self._flight

    @property
    def wanted_attitude(self) -> Quaternion:
        """Bank and nose that are steered to, with the heading that there is."""
        return from_euler(self._setpoint.roll_rad, self._pitch_rad, self._craft.estimator.yaw_rad)

    @property
    def airspeed_m_s(self) -> float:
        """As measured; without a pitot tube, that over ground."""
        measured = self._craft.airspeed_m_s
        vn, ve, _ = self._craft.estimator.inertial.velocity_ned_m_s
        return hypot(vn, ve) if isnan(measured) else measured

    def follow(self, setpoint: Setpoint) -> None:
        """Works out nose and throttle, every 20 ms."""
        craft = self._craft
        if setpoint is LANDED or not craft.is_armed:
            self._setpoint = WingSetpoint(throttle=0.0, pitch_rad=0.0)
            self._roll_sum = self._pitch_sum = self.thrust = self._pitch_rad = 0.0
            self._is_balancing = False
            self._mind_ground(0.0)
            return
        if not isinstance(setpoint, WingSetpoint):
            raise Misuse(f"a plane does not accept {type(setpoint).__name__}")
        self._setpoint = setpoint
        if not setpoint.is_direct:
            self._balance(setpoint)
        else:
            self.thrust, self._is_balancing = setpoint.throttle, False
        self._mind_ground(self.thrust)

    def _balance(self, setpoint: WingSetpoint) -> None:
        inertial, gains = self._craft.estimator.inertial, self._gains
        if not isnan(setpoint.pitch_rad) and not isnan(setpoint.throttle):
            self._pitch_rad, self.thrust, self._is_balancing = setpoint.pitch_rad, setpoint.throttle, False
            return
        airspeed = self.airspeed_m_s
        if not self._is_balancing:
            self._energy.reset(airspeed, to_euler(inertial.ned_from_frd)[1])
            self._is_balancing = True
        has_height = not isnan(setpoint.down_m)
        wanted = EnergyDemand(
            inertial.position_ned_m[2] - setpoint.down_m if has_height else 0.0,
            setpoint.climb_m_s,
            gains.cruise_m_s if isnan(setpoint.airspeed_m_s) else setpoint.airspeed_m_s,
            None if isnan(setpoint.throttle) else setpoint.throttle,
        )
        load = 1.0 / max(0.5, cos(setpoint.roll_rad))
        pitch, self.thrust = self._energy.update(wanted, -inertial.velocity_ned_m_s[2], airspeed, load)
        self._pitch_rad = pitch if isnan(setpoint.pitch_rad) else setpoint.pitch_rad

    def lean(self, pitch_rad: float) -> None:
        """Puts another nose in place of the one that `follow` has worked out."""
        self._pitch_rad = pitch_rad

    def _mind_ground(self, throttle: float) -> None:
        """Detects ground and air: landed at standstill with the motor off."""
        craft = self._craft
        touchdown = craft.touchdown
        if not self._lands:
            return
        self._mind_flight()
        if not craft.is_armed:
            if not touchdown.is_landed:
                touchdown.landed_s = craft.now_s
            touchdown.is_landed = True
            return
        if throttle > _STARTS:
            touchdown.is_landed, self._stands_s = False, craft.now_s
            return
        moves = hypot(*craft.estimator.inertial.velocity_ned_m_s) > _STANDS_M_S
        if moves or throttle > 0.0:
            self._stands_s = craft.now_s
        elif not touchdown.is_landed and craft.now_s - self._stands_s > _STANDS_S:
            touchdown.is_landed, touchdown.landed_s = True, craft.now_s

    def _mind_flight(self) -> None:
        craft, fix = self._craft, self._craft.estimator.fix
        has_fix = fix is not None and fix.fix_type >= 3 and craft.now_s - fix.t_s < _FIX_LOST_S
        self._flight.update(
            is_armed=craft.is_armed,
            moves_in_air=craft.airspeed_m_s >= _FLIES_FROM * self._gains.slowest_m_s,
            moves_over_ground=fix is not None and has_fix and hypot(*fix.velocity_ned_m_s[:2]) >= _ROLLS_M_S,
        )

    def outputs(self) -> Rudders:
        """The outputs for the next 5 ms."""
        wanted, gains, inertial = self._setpoint, self._gains, self._craft.estimator.inertial
        throttle = 2.0 * self.thrust - 1.0
        if wanted.is_direct:
            return (wanted.aileron, wanted.elevator, throttle, wanted.rudder)
        if self._craft.is_landed:
            return _STOPPED
        p, q, r = inertial.rate_frd_rad_s
        roll, pitch, yaw = to_euler(inertial.ned_from_frd)
        airspeed = max(0.5 * gains.scaling_m_s, self.airspeed_m_s)
        scale = min(2.0, gains.scaling_m_s / airspeed)
        rate = max(-1.5, min(1.5, (wanted.roll_rad - roll) / gains.roll_s))
        error = rate - p
        self._roll_sum = max(-0.5, min(0.5, self._roll_sum + gains.roll_i * error * STEP_S))
        aileron = gains.roll_ff * rate * scale + (gains.roll_p * error + self._roll_sum) * scale * scale
        bank = max(-1.2, min(1.2, roll))
        turn = GRAVITY_M_S2 / airspeed * tan(bank)
        rate = max(-0.8, min(0.8, (self._pitch_rad - pitch) / gains.pitch_s)) + turn * sin(bank)
        error = rate - q
        step = gains.pitch_i * error * STEP_S
        elevator = gains.pitch_ff * rate * scale + (gains.pitch_p * error + self._pitch_sum) * scale * scale
        if abs(elevator) < 1.0 or elevator * error < 0.0:
            self._pitch_sum = max(-1.0, min(1.0, self._pitch_sum + step))
        if isnan(wanted.heading_rad):
            rudder = -gains.yaw_damping * (r - turn * cos(bank)) * scale
        else:
            rudder = gains.steering_p * wrap_pi(wanted.heading_rad - yaw) - gains.yaw_damping * r
        return (_clip(aileron), _clip(elevator), throttle, _clip(rudder))


def _clip(value: float) -> float:
    return max(-1.0, min(1.0, value))


_PITCH_SUM_MAX_RAD: Final = 0.35
_FILTER_S: Final = 0.5
"""Of the measured change of air speed."""


class EnergyDemand(NamedTuple):
    """Demanded height and speed."""

    height_error_m: float
    """Metres that it is too low; 0 where the climb alone is wanted."""
    climb_m_s: float
    """How fast the height that is wanted changes."""
    airspeed_m_s: float
    throttle: float | None
    """Given, in place of one of the energy's: then the nose keeps the path, whatever the speed."""


class EnergyControl:
    """Pitch and throttle, 50 times a second."""

    def __init__(self, gains: WingGains) -> None:
        self._gains: Final = gains
        self._speed_m_s = -1.0
        self._speed_change_m_s2 = 0.0
        self._throttle_sum = self._pitch_sum = 0.0

    def reset(self, airspeed_m_s: float, pitch_rad: float) -> None:
        """Begins with the nose where it is."""
        self._speed_m_s, self._speed_change_m_s2 = airspeed_m_s, 0.0
        self._throttle_sum, self._pitch_sum = 0.0, max(-0.1, min(_PITCH_SUM_MAX_RAD, pitch_rad))

    def update(
        self, wanted: EnergyDemand, climb_m_s: float, airspeed_m_s: float, load_factor: float
    ) -> tuple[float, float]:
        """Pitch in radians and throttle, 0 to 1.

        Args:
            wanted: the setpoint.
            climb_m_s: estimated climb rate.
            airspeed_m_s: measured airspeed.
            load_factor: lift over weight required by the bank.
        """
        g = self._gains
        speed = max(5.0, airspeed_m_s)
        change = (speed - self._speed_m_s) / OUTER_S if self._speed_m_s > 0.0 else 0.0
        self._speed_m_s = speed
        self._speed_change_m_s2 += OUTER_S / _FILTER_S * (max(-10.0, min(10.0, change)) - self._speed_change_m_s2)
        wanted_m_s = max(g.slowest_m_s, min(g.fastest_m_s, wanted.airspeed_m_s))
        climb = wanted.height_error_m / g.energy_s + wanted.climb_m_s
        climb = max(-g.sink_max_m_s, min(g.climb_max_m_s, climb))
        faster = max(-1.5, min(1.5, (wanted_m_s - speed) / g.energy_s))
        # As rates of climb: what all the energy gained would be worth.
        sum_wanted = climb + speed * faster / GRAVITY_M_S2
        sum_now = climb_m_s + speed * self._speed_change_m_s2 / GRAVITY_M_S2
        throttle = wanted.throttle
        if throttle is None:
            throttle = self._throttle(sum_wanted, sum_now, load_factor)
            path = climb - speed * faster / GRAVITY_M_S2
            error = (path - climb_m_s + speed * self._speed_change_m_s2 / GRAVITY_M_S2) / speed
        else:
            path = climb
            error = (path - climb_m_s) / speed
        pitch = path / speed + g.pitch_damping * error + self._pitch_sum
        if g.pitch_min_rad < pitch < g.pitch_max_rad or pitch * error < 0.0:
            self._pitch_sum += error * OUTER_S / max(1.0, 0.4 * g.energy_s)
            self._pitch_sum = max(-_PITCH_SUM_MAX_RAD, min(_PITCH_SUM_MAX_RAD, self._pitch_sum))
        return max(g.pitch_min_rad, min(g.pitch_max_rad, pitch)), throttle

    def _throttle(self, wanted: float, now: float, load_factor: float) -> float:
        g = self._gains
        wanted += g.throttle_in_turns_m_s * (load_factor * load_factor - 1.0)
        up, down = (g.throttle_max - g.throttle_trim) / g.climb_max_m_s, g.throttle_trim / max(0.3, g.sink_min_m_s)
        share = up if wanted > 0.0 else down
        error = wanted - now
        trim = g.throttle_trim + share * wanted
        throttle = trim + g.throttle_damping * 0.1 * error + self._throttle_sum
        if 0.0 < throttle < g.throttle_max or throttle * error < 0.0:
            self._throttle_sum += g.energy_integral * 0.5 * error * OUTER_S
            self._throttle_sum = max(-0.4, min(0.4, self._throttle_sum))
        return max(0.0, min(g.throttle_max, throttle))
