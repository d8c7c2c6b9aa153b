"""A smaller quadrotor like the AscTec Hummingbird, at its full take-off weight: 0.43 of the Pelican's.

| figure | value | source |
| --- | --- | --- |
| mass, arm, inertia | 0.716 kg, 0.17 m, 0.007 and 0.012 kg m^2 | RotorS Hummingbird model (Furrer et al. 2016) |
| thrust, largest rotor speed | 8.55e-6 N s^2/rad^2, 838 rad/s: 6.0 N | RotorS Hummingbird model |
| torque over thrust, rotor drag | 0.016 m, 8.06e-5 | RotorS Hummingbird model |
| rotor inertia | 1.7e-5 kg m^2 | a bar of 5 g and 0.2 m, as in RotorS |
| loss of thrust in climb | 3.1e-4 N s^2/(m rad) | the Pelican's, by the cube of the radius: 8-inch rotors in place of 10-inch ones |
| rotor lag | 0.03 and 0.05 s | our choice: between RotorS (0.0125 and 0.025 s) and the Pelican's larger rotors |
| drag areas | 0.015 and 0.04 m^2 | our estimate: the Pelican's, by the area of a frame of 0.34 m in place of 0.42 m |
| battery | 2.1 Ah, 11.1 V | AscTec Hummingbird data sheet |
| drive efficiency | 0.65 | our choice, as for the Pelican |
"""

from msgspec.structs import replace

from gloc3_sitl.vehicles.pelican import PELICAN

HUMMINGBIRD = replace(
    PELICAN,
    aircraft="hummingbird",
    arm_m=0.17,
    rotor_height_m=0.03,
    foot_depth_m=0.06,
    contact_spring_n_m=650.0,
    thrust_max_n=6.0,
    rotor_speed_max_rad_s=838.0,
    spin_up_s=0.03,
    spin_down_s=0.05,
    rotor_inertia_kg_m2=1.7e-5,
    rotor_inflow_n_s2_m_rad=3.1e-4,
    drag_area_side_m2=0.015,
    drag_area_top_m2=0.04,
    capacity_ah=2.1,
    battery_resistance_ohm=0.06,
)
