"""Airframe data of the controller: thrust, thrust curve and default gains."""

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """A quadrotor in X, as a flight controller sees it: fractions of full thrust, no masses and no lengths."""

    name: str
    hover_thrust: float
    """Thrust that carries the weight in still air, as a fraction of the thrust of all rotors at full throttle."""
    thrust_curve: float
    """How much of the thrust goes with the square of the throttle: thrust = c u^2 + (1 - c) u."""
    rate_p: tuple[float, float, float]
    """Roll, pitch and yaw command per rad/s of rate error, in fractions of full thrust of each rotor."""
    rate_i: tuple[float, float, float]
    """The same per radian of integrated rate error."""
    rate_d: tuple[float, float, float]
    """The same per rad/s^2 of measured angular acceleration."""
    attitude_p: tuple[float, float, float]
    """Wanted rate per radian of attitude error about roll, pitch and yaw, in 1/s."""
    landing_gear_m: float
    """Height of the range finder above the ground when the vehicle stands, m."""
    integral_max: float = 0.08
    """Largest command of the integrals of the rates."""


PELICAN: Final = Airframe(
    name="pelican",
    hover_thrust=0.46,
    thrust_curve=0.3,
    rate_p=(0.03, 0.03, 0.25),
    rate_i=(0.06, 0.06, 0.15),
    rate_d=(0.0012, 0.0012, 0.0),
    attitude_p=(6.5, 6.5, 3.0),
    landing_gear_m=0.1,
)
"""The AscTec Pelican of the simulation."""
HUMMINGBIRD: Final = replace(PELICAN, name="hummingbird", hover_thrust=0.29, landing_gear_m=0.06)
"""The AscTec Hummingbird of the simulation: a command turns it as fast as the Pelican, to a tenth."""
QUADPLANE: Final = Airframe(
    name="quadplane",
    hover_thrust=0.51,
    thrust_curve=0.7,
    rate_p=(0.075, 0.09, 1.2),
    rate_i=(0.10, 0.12, 0.6),
    rate_d=(0.004, 0.005, 0.0),
    attitude_p=(4.5, 4.5, 1.6),
    landing_gear_m=0.3,
    integral_max=0.3,
)
"""The lift rotors of the quadplane of the simulation: slower, far apart, and with wings in the wind."""
