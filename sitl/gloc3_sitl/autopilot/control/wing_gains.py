"""Gains and limits of planes."""

from dataclasses import dataclass
from math import radians


@dataclass(slots=True, kw_only=True)
class WingGains:
    """Gains and limits; written by the parameters of Plane."""

    cruise_m_s: float = 23.0
    slowest_m_s: float = 18.0
    fastest_m_s: float = 32.0
    scaling_m_s: float = 22.0
    """Air speed at which the gains of the rudders hold."""
    roll_max_rad: float = radians(45.0)
    pitch_max_rad: float = radians(20.0)
    pitch_min_rad: float = radians(-15.0)
    roll_s: float = 0.5
    """Time in which an error of roll is turned away."""
    roll_p: float = 0.2
    roll_i: float = 0.3
    roll_ff: float = 0.45
    pitch_s: float = 0.4
    pitch_p: float = 0.8
    pitch_i: float = 1.5
    pitch_ff: float = 1.0
    yaw_damping: float = 0.5
    steering_p: float = 2.0
    """Rudder per radian of heading on the ground."""
    throttle_trim: float = 0.66
    throttle_max: float = 1.0
    climb_max_m_s: float = 5.0
    sink_min_m_s: float = 1.2
    """With the motor off at cruise speed."""
    sink_max_m_s: float = 4.0
    energy_s: float = 5.0
    """Time in which errors of height and speed are flown away."""
    energy_integral: float = 0.1
    throttle_damping: float = 0.5
    pitch_damping: float = 0.3
    throttle_in_turns_m_s: float = 1.0
    """Climb that the throttle of a turn is worth, per (load factor squared - 1)."""
    guidance_s: float = 12.0
    guidance_damping: float = 0.75
    circle_m: float = 80.0
    """Radius; negative is to the left."""
    return_circle_m: float = 0.0
    return_height_m: float = 60.0
    """Negative keeps the height."""
    takeoff_height_m: float = 50.0
    takeoff_level_m: float = 10.0
    """Below this height it climbs straight ahead."""
    takeoff_pitch_rad: float = radians(12.0)
    takeoff_rotate_m_s: float = 20.0
    takeoff_ahead_m: float = 200.0
    approach_m_s: float = 20.0
    approach_height_m: float = 25.0
    approach_m: float = 400.0
    """Way of the final approach."""
    flare_m: float = 3.0
    flare_sink_m_s: float = 0.4
