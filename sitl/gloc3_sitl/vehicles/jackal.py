"""The rover: a Clearpath Jackal, skid-steered on four wheels.

| figure | value | source |
| --- | --- | --- |
| mass | 18.4 kg | chassis 16.523 kg and four wheels of 0.477 kg: `jackal.urdf.xacro` of Clearpath's `jackal_description` |
| inertia about the vertical | 0.55 kg m^2 | 0.4485 of the chassis there, and the wheels at their places |
| track, wheelbase, wheel radius | 0.37559 m, 0.262 m, 0.098 m | the same |
| largest speed | 2.0 m/s | data sheet of the Jackal UGV, and `control.yaml` of `jackal_control` |
| friction of the tyres | 0.5 | `mu1`, `mu2` of the wheels in `jackal.urdf.xacro` |
| turning | the wheels turn it by about 1/1.5 of what rolling would give | `wheel_separation_multiplier` 1.5 of `control.yaml`; \
friction that is the same in all directions gives 1 + (wheelbase / track)^2 = 1.49 by itself |
| battery | 270 Wh lithium, 7 cells | data sheet |
| encoder | 78,000 ticks a metre | our choice: that of Clearpath's larger Husky A200, by its manual |
| time constant and acceleration of the wheels, slip speed, rolling resistance, efficiency | 0.10 s, 4 m/s^2, 0.1 m/s, 0.02, \
0.6 | our choice |
"""

from typing import Final

from gloc3_sitl.vehicles.ground_model import RoverModel

JACKAL: Final = RoverModel(
    mass_kg=18.4,
    inertia_z_kg_m2=0.55,
    track_m=0.37559,
    wheelbase_m=0.262,
    centre_height_m=0.13,
    speed_max_m_s=2.0,
    drive_s=0.10,
    acceleration_max_m_s2=4.0,
    friction=0.5,
    slip_m_s=0.10,
    rolling=0.02,
    drive_efficiency=0.6,
    avionics_w=25.0,
    cells=7,
    capacity_ah=10.4,
    battery_resistance_ohm=0.06,
    ticks_per_m=78_000.0,
)
