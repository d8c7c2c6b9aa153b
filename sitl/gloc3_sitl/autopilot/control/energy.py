"""Height and air speed by total energy: the throttle gives the sum, the nose shares it out (A. A. Lambregts 1983)."""

from typing import Final, NamedTuple

from gloc3.messages.frames import GRAVITY_M_S2
from gloc3_sitl.autopilot.control.wing_gains import WingGains
from gloc3_sitl.autopilot.periods import OUTER_S

_PITCH_SUM_MAX_RAD: Final = 0.35
_FILTER_S: Final = 0.5
"""Of the measured change of air speed."""


class Wish(NamedTuple):
    """What is to be had of height and speed."""

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

    def update(self, wish: Wish, climb_m_s: float, airspeed_m_s: float, load_factor: float) -> tuple[float, float]:
        """Pitch in radians and throttle, 0 to 1.

        Args:
            wish: what is wanted.
            climb_m_s: estimated.
            airspeed_m_s: measured.
            load_factor: lift over weight that the bank asks for.
        """
        g = self._gains
        speed = max(5.0, airspeed_m_s)
        change = (speed - self._speed_m_s) / OUTER_S if self._speed_m_s > 0.0 else 0.0
        self._speed_m_s = speed
        self._speed_change_m_s2 += OUTER_S / _FILTER_S * (max(-10.0, min(10.0, change)) - self._speed_change_m_s2)
        wanted_m_s = max(g.slowest_m_s, min(g.fastest_m_s, wish.airspeed_m_s))
        climb = wish.height_error_m / g.energy_s + wish.climb_m_s
        climb = max(-g.sink_max_m_s, min(g.climb_max_m_s, climb))
        faster = max(-1.5, min(1.5, (wanted_m_s - speed) / g.energy_s))
        # As rates of climb: what all the energy gained would be worth.
        sum_wanted = climb + speed * faster / GRAVITY_M_S2
        sum_now = climb_m_s + speed * self._speed_change_m_s2 / GRAVITY_M_S2
        throttle = wish.throttle
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
