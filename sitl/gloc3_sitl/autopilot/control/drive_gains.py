"""Gains and limits of driven vehicles."""

from dataclasses import dataclass


@dataclass(slots=True, kw_only=True)
class DriveGains:
    """Gains and limits; written by the parameters of Rover."""

    cruise_speed_m_s: float = 1.5
    cruise_throttle: float = 0.75
    """Share of full at that speed."""
    speed_p: float = 0.2
    speed_i: float = 0.2
    speed_ff: float = 0.0
    acceleration_m_s2: float = 1.0
    rate_p: float = 0.2
    rate_i: float = 0.2
    rate_ff: float = 0.2
    heading_p: float = 2.0
    rate_max_rad_s: float = 2.0
    rate_change_rad_s2: float = 2.0
    turn_acceleration_m_s2: float = 5.9
    """Largest towards the inside of a turn."""
    thrust_curve: float = 0.0
    """1 where thrust goes with the square of the output, 0 where it is proportional."""
    astern: float = 1.0
    """Thrust ahead over thrust astern."""
    steering_share: float = 0.5
    """Of full output that steering gets in any case."""
    position_p: float = 0.5
    """Lateral speed per metre of lateral error, 1/s."""
    integral: float = 0.0
    """Of the line of sight, where there is drift."""
    pivot_angle_rad: float = 1.05
    """Corners sharper than this are turned on the spot, rad; 0 for none."""
    pivot_rate_rad_s: float = 1.05
    loiters: bool = False
    """Whether it drifts where it stops, and goes back."""
    loiter_radius_m: float = 2.0
    loiter_gain: float = 0.5
    return_speed_m_s: float = 0.0
