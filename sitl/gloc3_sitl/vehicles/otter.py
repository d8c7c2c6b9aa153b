"""The boat: a Maritime Robotics Otter, a catamaran of 2 m with a propeller behind each pontoon.

| figure | value | source |
| --- | --- | --- |
| length, beam, hull, payload, pontoons, coefficients | 2.0 m, 1.08 m, 55 kg, 25 kg, 0.25 m at ±0.395 m, 0.75 and 0.4 | \
`otter.m` of the Marine Systems Simulator (T. I. Fossen and T. Perez), identified with Maritime Robotics' vehicle |
| added mass, time constants of sway and yaw, damping ratios | 0.1, 1.5, 1.0, 0.2, 0.8, 1.7; 1 s; 0.3, 0.2, 0.4 | the same |
| largest speed; thrust ahead and astern, bollard pull | 6 knots; 119.7 N and 66.7 N a propeller | the same, experimental |
| quadratic damping of yaw | 10 times the linear | the same |
| time constant of a propeller | 0.1 s | the same |
| cross-flow drag | 1.0 | Hoerner's curve at beam over draught 1.28, as there |
| windage | 0.3 and 0.6 m^2; 0.5, 0.7, 0.05 | our estimate from its drawings; Fossen 2021, section 10.1, for such vessels |
| battery, endurance | four of 915 Wh; 20 h at 2 knots | data sheet of the Otter |
| power | 0.12 N for a watt at full thrust | our choice, near the data sheet's endurance |
"""

from typing import Final

from gloc3_sitl.vehicles.surface_model import VesselModel

OTTER: Final = VesselModel(
    hull_kg=55.0,
    payload_kg=25.0,
    hull_centre_m=(0.2, -0.2),
    payload_centre_m=(0.05, -0.35),
    length_m=2.0,
    beam_m=1.08,
    pontoon_beam_m=0.25,
    pontoon_arm_m=0.395,
    waterline_coefficient=0.75,
    block_coefficient=0.4,
    added_mass=(0.1, 1.5, 1.0, 0.2, 0.8, 1.7),
    speed_max_m_s=6.0 * 0.5144,
    sway_s=1.0,
    yaw_s=1.0,
    yaw_quadratic=10.0,
    damping_ratios=(0.3, 0.2, 0.4),
    cross_flow=1.0,
    thrust_ahead_n=0.5 * 24.4 * 9.81,
    thrust_astern_n=0.5 * 13.6 * 9.81,
    shaft_s=0.1,
    area_front_m2=0.3,
    area_side_m2=0.6,
    wind_coefficients=(0.5, 0.7, 0.05),
    thrust_per_w=0.12,
    avionics_w=30.0,
    cells=7,
    capacity_ah=141.0,
    battery_resistance_ohm=0.01,
)
