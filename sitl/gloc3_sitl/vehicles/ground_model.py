"""Physical model of a skid-steered rover."""

import msgspec


class RoverModel(msgspec.Struct, frozen=True, kw_only=True):
    """Four wheels, two sides that are driven at a speed each."""

    mass_kg: float
    inertia_z_kg_m2: float
    """About the vertical axis through the centre of gravity, wheels included."""
    track_m: float
    """Between the middles of left and right wheels."""
    wheelbase_m: float
    """Between front and rear axles."""
    centre_height_m: float
    """Of the centre of gravity over the ground."""
    speed_max_m_s: float
    """Of a wheel's rim at full output."""
    drive_s: float
    """Time constant with which the wheels' own controllers reach a speed."""
    acceleration_max_m_s2: float
    """Of a rim, as the motors can give it."""
    friction: float
    """Friction coefficient of a tyre on the ground, in every direction."""
    slip_m_s: float
    """Speed of the contact patch over the ground at which friction is at 76 % of its largest."""
    rolling: float
    """Resistance of rolling, as a share of the weight."""
    drive_efficiency: float
    avionics_w: float
    """Battery power of everything but the motors."""
    cells: int
    capacity_ah: float
    battery_resistance_ohm: float
    ticks_per_m: float
    """Of the wheel encoders."""
