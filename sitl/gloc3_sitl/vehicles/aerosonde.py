"""The plane: an aircraft like the Aerosonde, with an electric motor and on wheels.

| figure | value | source |
| --- | --- | --- |
| mass, inertia, wing, aerodynamic coefficients, propeller and motor | see below | Aerosonde of R. Beard and T. McLain, "Small \
Unmanned Aircraft: Theory and Practice" (2012), appendix E, and the supplement to it (electric motor, propeller, and the \
parameters of 2018) |
| stall | 0.26 rad in place of 0.47 | our choice: the published one never stalls within the range of its elevator |
| deflection | 0.436 rad (25 deg) | our choice |
| lag of servos, of the motor | 0.05 s, 0.2 s | our choice |
| battery | 12 cells, 20 Ah | 12 cells in the supplement; our choice of charge |
| wheels | 0.57 m from nose to main wheels, track 0.8 m, rolling friction 0.10 (grass) | our choice; the original is launched from a car |
"""

from math import pi
from typing import Final

from gloc3_sitl.vehicles.fixed_wing_model import FixedWingModel

AEROSONDE: Final = FixedWingModel(
    aircraft="aerosonde",
    foot_depth_m=0.30,
    springs_n_m=6842.0,
    wing_m2=0.55,
    span_m=2.8956,
    chord_m=0.18994,
    lift_0=0.23,
    lift_alpha=5.61,
    lift_q=7.95,
    lift_elevator=0.13,
    stall_rad=0.26,
    stall_sharpness=50.0,
    drag_parasitic=0.043,
    oswald=0.9,
    drag_elevator=0.0135,
    pitch_0=0.0135,
    pitch_alpha=-2.74,
    pitch_q=-38.21,
    pitch_elevator=-0.99,
    side_beta=-0.83,
    side_aileron=0.075,
    side_rudder=0.19,
    roll_beta=-0.13,
    roll_p=-0.51,
    roll_r=0.25,
    roll_aileron=0.17,
    roll_rudder=0.0024,
    yaw_beta=0.073,
    yaw_p=-0.069,
    yaw_r=-0.095,
    yaw_aileron=-0.011,
    yaw_rudder=-0.069,
    deflection_max_rad=0.436,
    servo_s=0.05,
    propeller_m=20.0 * 0.0254,
    thrust_coefficients=(0.09357, -0.06044, -0.1079),
    torque_coefficients=(0.005230, 0.004970, -0.01664),
    motor_v_s_rad=60.0 / (2.0 * pi * 145.0),
    motor_ohm=0.042,
    motor_idle_a=1.5,
    motor_s=0.2,
    voltage_v=44.4,
    avionics_w=15.0,
    cells=12,
    capacity_ah=20.0,
    battery_resistance_ohm=0.03,
)
