"""Physical model of a multirotor, without mass and contacts, which are in its JSBSim file."""

import msgspec


class MultirotorModel(msgspec.Struct, frozen=True, kw_only=True):
    """Rotors, drag and power of a quadrotor in X form.

    Motors, looking down: 0 front right and 1 rear left turn counter-clockwise, 2 front left and 3 rear right clockwise.
    The steady thrust of a rotor is `curve * u**2 + (1 - curve) * u` of its maximum at throttle u; its speed follows
    with a first-order lag. Rotor forces scale with the density of the air at the home.
    """

    aircraft: str
    """Name of the JSBSim model, which holds mass, inertia and contact points."""
    arm_m: float
    """Distance from the centre to each motor axis."""
    rotor_height_m: float
    """Height of the rotor discs over the centre of gravity."""
    foot_depth_m: float
    """Depth of the feet under the centre of gravity, as in the JSBSim file."""
    contact_spring_n_m: float
    """Stiffness of each foot, as in the JSBSim file."""
    thrust_max_n: float
    """Static thrust of one rotor at full throttle at sea level."""
    rotor_speed_max_rad_s: float
    """Speed of a rotor at full throttle."""
    throttle_curve: float
    """Share of the quadratic part in the thrust over throttle."""
    spin_up_s: float
    """Time constant of a rotor that speeds up."""
    spin_down_s: float
    """Time constant of a rotor that slows down."""
    torque_per_thrust_m: float
    """Reaction torque over thrust of a rotor."""
    rotor_inertia_kg_m2: float
    """Inertia of a rotor about its axis; the body turns against a rotor that speeds up."""
    rotor_drag_n_s2_m_rad: float
    """Force against sideways motion through the air, per rotor speed and air speed."""
    rotor_inflow_n_s2_m_rad: float
    """Loss of thrust in climb, per rotor speed and climb speed."""
    drag_area_side_m2: float
    """Drag coefficient times area of the airframe, for horizontal air flow."""
    drag_area_top_m2: float
    """Drag coefficient times area of the airframe and the rotor discs at rest, for vertical air flow."""
    drive_efficiency: float
    """Shaft power over battery power, of motor and speed controller together."""
    avionics_w: float
    """Battery power of everything but the motors."""
    cells: int
    """Cells of the lithium-polymer battery in series."""
    capacity_ah: float
    """Nominal charge of the battery."""
    battery_resistance_ohm: float
    """Internal resistance of the whole pack with its leads."""
