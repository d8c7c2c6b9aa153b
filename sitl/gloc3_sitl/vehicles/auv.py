"""The example AUV: a REMUS 100, with the cross-body thrusters that let it hover.

| figure | value | source |
| --- | --- | --- |
| mass, buoyancy, centres, inertia | 299 N, 306 N, 1.96 cm apart, 0.177, 3.45 and 3.45 kg m^2 | Prestero, "Verification of a Six-Degree \
of Freedom Simulation Model for the REMUS Autonomous Underwater Vehicle", MIT/WHOI 2001 |
| added mass, drag, lift of hull and fins | see below | the same, tables of the non-linear coefficients, as adjusted there to the \
trials at sea; what the added mass gives by itself (Munk's moment) is taken off the lift |
| thrust in trim | 3.86 N and 0.543 N m at 1.54 m/s | the same |
| largest speed | 2.6 m/s (5 knots) | REMUS 100 data sheet; it asks for 10.8 N |
| fins | 9.64 kg/(m rad), 0.638 m behind the origin, 13.6 degrees | Prestero 2001 |
| cross-body thrusters | a pair of horizontal and a pair of vertical tunnels, fore and aft | Doherty, "Cross-body thruster control \
and modeling of a body of revolution autonomous underwater vehicle", Naval Postgraduate School 2011; their thrust of 9 N and their \
places are our estimate, and the weight that they add is left out |
| power | 1 kWh lithium-ion, 8 h at 4.5 knots | REMUS 100 data sheet |

Two figures of the thesis are not taken as printed: the drag across (Y_v|v|) stands there ten times larger than Z_w|w| and than its own
formula gives, so 131 kg/m serves for both; trim at 7 N of buoyancy is kept by fins or thrusters, as on the real one.
"""

from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.vehicles.underwater import CrossFlow, Fins, Lift, Thruster, UnderwaterModel

_PROPELLER_N: Final = 10.8


def _tunnel(x_m: float, direction_frd: Vector3) -> Thruster:
    return Thruster(position_frd_m=(x_m, 0.0, 0.0), direction_frd=direction_frd, forward_n=9.0, backward_n=9.0)


AUV: Final = UnderwaterModel(
    name="auv",
    mass_kg=299.0 / GRAVITY_M_S2,
    buoyancy_n=306.0,
    inertia_kg_m2=(0.177, 3.45, 3.45),
    center_of_gravity_frd_m=(0.0, 0.0, 0.0196),
    center_of_buoyancy_frd_m=(0.0, 0.0, 0.0),
    added_mass=(0.93, 35.5, 35.5, 0.0704, 4.88, 4.88),
    added_sway_yaw_kg_m=-1.93,
    linear_drag=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    quadratic_drag=(1.62, 131.0, 131.0, 0.130, 188.0, 94.0),
    cross_flow=CrossFlow(sway_rr=0.632, yaw_vv=-3.18),
    lift=Lift(sway_uv=-28.6, sway_ur=6.15, yaw_uv=10.57, yaw_ur=-3.93),
    thrusters=(
        Thruster(
            position_frd_m=(-0.65, 0.0, 0.0),
            direction_frd=(1.0, 0.0, 0.0),
            forward_n=_PROPELLER_N,
            backward_n=0.6 * _PROPELLER_N,
            torque_m=-0.543 / 3.86,
        ),
        _tunnel(0.42, (0.0, 1.0, 0.0)),
        _tunnel(-0.42, (0.0, 1.0, 0.0)),
        _tunnel(0.34, (0.0, 0.0, 1.0)),
        _tunnel(-0.34, (0.0, 0.0, 1.0)),
    ),
    thrust_curve=1.0,
    dead_band=0.03,
    thruster_lag_s=0.2,
    fins=Fins(force_n_s2_m2_rad=9.64, arm_m=0.638, deflection_rad=0.2374, lag_s=0.1),
    length_m=1.33,
    height_m=0.191,
    power_w_n=2.8,
    avionics_w=30.0,
    cells=7,
    capacity_ah=38.0,
    battery_resistance_ohm=0.05,
)
