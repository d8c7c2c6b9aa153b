"""The example ROV: a BlueROV2 in the Heavy configuration, with eight thrusters.

| figure | value | source |
| --- | --- | --- |
| mass, buoyancy, centres, inertia | 13.5 kg, 0.0134 m^3, 1 cm apart, 0.26, 0.23 and 0.37 kg m^2 | von Benzon, Sørensen, Uth, Jouffroy, Liniger \
and Pedersen, "An Open-Source Benchmark Simulator: Control of a BlueROV2 Underwater Robot", J. Mar. Sci. Eng. 2022, 10(12), 1898 |
| added mass, linear and quadratic drag | see below | the same, identified in a tank |
| places of the thrusters | 0.156, 0.111 and 0.085 m; 0.120 and 0.218 m | the same, and Wu, "6-DoF Modelling and Control of a \
Remotely Operated Vehicle", Flinders University 2018 |
| largest thrust | 5.25 and 4.1 kgf at 16 V | Blue Robotics T200 data sheet; 1.75 kgf at half of the range gives the curve |
| dead band | 1472 to 1528 us | the same |
| lag | 0.085 s | slowest pole, 11.8 rad/s, of the thruster's transfer function in von Benzon et al. |
| power | 390 W at 51.5 N | T200 data sheet at 16 V |
| battery | 4 cells, 18 Ah | Blue Robotics data sheet |

The paper prints the centre of buoyancy 1 cm above that of gravity, and a vehicle 1 N heavier than the water; real ones are
ballasted to float, so the buoyancy here is 2 N more than the weight.
"""

from math import sqrt
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.vehicles.underwater import Thruster, UnderwaterModel

_MASS_KG: Final = 13.5
_HALF: Final = sqrt(0.5)


def _thruster(position_frd_m: Vector3, direction_frd: Vector3) -> Thruster:
    return Thruster(
        position_frd_m=position_frd_m,
        direction_frd=direction_frd,
        forward_n=5.25 * GRAVITY_M_S2,
        backward_n=4.1 * GRAVITY_M_S2,
    )


ROV: Final = UnderwaterModel(
    name="rov",
    mass_kg=_MASS_KG,
    buoyancy_n=_MASS_KG * GRAVITY_M_S2 + 2.0,
    inertia_kg_m2=(0.26, 0.23, 0.37),
    center_of_gravity_frd_m=(0.0, 0.0, 0.0),
    center_of_buoyancy_frd_m=(0.0, 0.0, -0.01),
    added_mass=(6.36, 7.12, 18.68, 0.189, 0.135, 0.222),
    linear_drag=(13.7, 0.0, 33.0, 0.0, 0.8, 0.0),
    quadratic_drag=(141.0, 217.0, 190.0, 1.19, 0.47, 1.5),
    # In ArduSub's order of the vectored frame with six degrees of freedom; positive commands as its mixer gives them.
    thrusters=(
        _thruster((0.156, 0.111, 0.085), (-_HALF, _HALF, 0.0)),
        _thruster((0.156, -0.111, 0.085), (-_HALF, -_HALF, 0.0)),
        _thruster((-0.156, 0.111, 0.085), (_HALF, _HALF, 0.0)),
        _thruster((-0.156, -0.111, 0.085), (_HALF, -_HALF, 0.0)),
        _thruster((0.120, 0.218, 0.0), (0.0, 0.0, 1.0)),
        _thruster((0.120, -0.218, 0.0), (0.0, 0.0, 1.0)),
        _thruster((-0.120, 0.218, 0.0), (0.0, 0.0, 1.0)),
        _thruster((-0.120, -0.218, 0.0), (0.0, 0.0, 1.0)),
    ),
    thrust_curve=0.53,
    dead_band=0.07,
    thruster_lag_s=0.085,
    length_m=0.457,
    height_m=0.254,
    power_w_n=390.0 / 51.5**1.5,
    avionics_w=25.0,
    cells=4,
    capacity_ah=18.0,
    battery_resistance_ohm=0.02,
)
