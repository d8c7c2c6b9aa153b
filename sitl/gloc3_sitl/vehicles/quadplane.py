"""The VTOL: the Aerosonde of this simulation with four lift rotors on booms under its wing, as a quadplane.

| figure | value | source |
| --- | --- | --- |
| wing, tail, propeller, motor, battery | those of the Aerosonde | `aerosonde.py` |
| mass | 13.5 kg | 11 kg, and our estimate of what lifts it: 4 x (0.35 kg of motor, 0.1 kg of controller and rotor), booms of 0.7 kg |
| inertia | 1.50, 1.83, 3.13 kg m^2 | those of the Aerosonde, the four motors as points at 0.6 m fore, aft and aside, and the booms |
| arms | 0.85 m | our choice: 0.6 m ahead or behind, 0.6 m aside, so that discs of 0.56 m clear wing and fuselage |
| thrust | 66 N a rotor | our choice: twice the weight, as is usual for multirotors |
| largest rotor speed | 5000 rpm | thrust coefficient 0.080 (of density, turns squared, diameter to the fourth), in the range of the \
UIUC propeller data base (Brandt and Selig 2011) for slow propellers at rest, at a diameter of 22 inches |
| torque over thrust | 0.031 m | momentum theory (Leishman, section 2.8) with a figure of merit of 0.65 at the thrust of hover |
| drag of a rotor, loss of thrust in climb | 8.6e-4, 6.4e-3 | those of the Pelican, scaled by area and radius of the disc |
| rotor inertia | 1.5e-3 kg m^2 | a bar of 60 g and 0.56 m |
| rotor lag | 0.06 and 0.09 s | our choice, slower than the Pelican's for larger rotors |
| drag area | 0.016 m^2 | our estimate: booms and rotors that stand, two thirds of the clean aircraft's |
| moments by the angle of the flow | grow up to 0.35 rad | our choice: farther on fin and tail are stalled, as in hover in a cross wind |
| drive efficiency | 0.80 | our choice |

Left out: what the rotors' wake does to wing and tail, and that a rotor in a flow from ahead lifts its nose.
"""

from typing import Final

from msgspec.structs import replace

from gloc3_sitl.vehicles.aerosonde import AEROSONDE
from gloc3_sitl.vehicles.fixed_wing_model import FixedWingModel
from gloc3_sitl.vehicles.lift_rotor_model import LiftRotorModel

QUADPLANE: Final[FixedWingModel] = replace(
    AEROSONDE, aircraft="quadplane", springs_n_m=24_000.0, moment_angle_max_rad=0.35
)
"""What flies on."""
LIFT_ROTORS: Final = LiftRotorModel(
    arm_m=0.85,
    height_m=0.05,
    thrust_max_n=66.0,
    speed_max_rad_s=523.6,
    throttle_curve=0.7,
    spin_up_s=0.06,
    spin_down_s=0.09,
    torque_per_thrust_m=0.031,
    inertia_kg_m2=1.5e-3,
    drag_n_s2_m_rad=8.6e-4,
    inflow_n_s2_m_rad=6.4e-3,
    drag_area_m2=0.016,
    drive_efficiency=0.80,
)
"""What hovers."""
