"""Physical model of the rotors that lift an aircraft while its wings do not."""

import msgspec


class LiftRotorModel(msgspec.Struct, frozen=True, kw_only=True):
    """Four rotors in X form, numbered as those of a multirotor.

    Looking down: 0 front right and 1 rear left turn counter-clockwise, 2 front left and 3 rear right clockwise. The steady
    thrust of a rotor is `curve * u**2 + (1 - curve) * u` of its maximum at throttle u; its speed follows with a first-order
    lag. Rotor forces scale with the density of the air at the home.
    """

    arm_m: float
    """Distance from the centre to each motor axis."""
    height_m: float
    """Height of the rotor discs over the centre of gravity."""
    thrust_max_n: float
    """Static thrust of one rotor at full throttle at sea level."""
    speed_max_rad_s: float
    """Speed of a rotor at full throttle."""
    throttle_curve: float
    """Share of the quadratic part in the thrust over throttle."""
    spin_up_s: float
    """Time constant of a rotor that speeds up."""
    spin_down_s: float
    """Time constant of a rotor that slows down."""
    torque_per_thrust_m: float
    """Reaction torque over thrust of a rotor."""
    inertia_kg_m2: float
    """Inertia of a rotor about its axis; the body turns against a rotor that speeds up."""
    drag_n_s2_m_rad: float
    """Force against sideways motion through the air, per rotor speed and air speed."""
    inflow_n_s2_m_rad: float
    """Loss of thrust in climb, per rotor speed and climb speed."""
    drag_area_m2: float
    """Drag coefficient times area of booms, motors and rotors at rest, for air flow from ahead or aside."""
    drive_efficiency: float
    """Shaft power over battery power, of motor and speed controller together."""
