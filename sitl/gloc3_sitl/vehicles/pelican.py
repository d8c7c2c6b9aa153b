"""The example vehicle: a quadrotor like the AscTec Pelican, at its full take-off weight.

| figure | value | source |
| --- | --- | --- |
| take-off weight, arm, thrust | 1.65 kg, 0.21 m, 36 N | AscTec Pelican data sheet (2013) |
| largest rotor speed | 8600 rpm | AscTec motor controllers: `rpm = (25 + command * 175 / 200) * 43`, command 0 to 200 |
| battery, hover time at full load | 6250 mAh, 11.1 V; 16 min | AscTec Pelican data sheet |
| torque over thrust, rotor drag, inertia without load | 0.016 m, 8.06e-5, 0.01 and 0.02 kg m^2 | RotorS Pelican model (Furrer et al. 2016) |
| rotor inertia | 5.5e-5 kg m^2 | a bar of 10 g and 0.256 m, as in RotorS |
| loss of thrust in climb | 6e-4 N s^2/(m rad) | blade element and momentum theory (Leishman, section 3.3) gives 6e-4 to 8e-4 for a \
10 x 4.5 inch rotor; 6e-4 meets the data sheet's 8 m/s of climb |
| rotor lag | 0.04 and 0.06 s | our choice, slower than RotorS (0.0125 and 0.025 s): 10-inch rotors are reported with 0.03 to 0.08 s |
| inertia | 0.0123 and 0.0216 kg m^2 | RotorS, and 0.65 kg of load as a box of 0.12 x 0.12 x 0.10 m, 4 cm off centre |
| drag areas | 0.025 and 0.06 m^2 | our estimate: bluff body (coefficient 1.1) of 0.02 m^2 in side view, and discs at rest |
| drive efficiency | 0.65 | our choice, so that the hover time comes out as in the data sheet |
"""

from gloc3_sitl.vehicles.model import MultirotorModel

PELICAN = MultirotorModel(
    aircraft="pelican",
    arm_m=0.21,
    rotor_height_m=0.05,
    foot_depth_m=0.10,
    contact_spring_n_m=1500.0,
    thrust_max_n=9.0,
    rotor_speed_max_rad_s=900.6,
    throttle_curve=0.3,
    spin_up_s=0.04,
    spin_down_s=0.06,
    torque_per_thrust_m=0.016,
    rotor_inertia_kg_m2=5.5e-5,
    rotor_drag_n_s2_m_rad=8.06e-5,
    rotor_inflow_n_s2_m_rad=6e-4,
    drag_area_side_m2=0.025,
    drag_area_top_m2=0.06,
    drive_efficiency=0.65,
    avionics_w=10.0,
    cells=3,
    capacity_ah=6.25,
    battery_resistance_ohm=0.03,
)
