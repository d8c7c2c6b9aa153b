"""Physical model of a vessel with two pontoons and a propeller behind each."""

import msgspec


class VesselModel(msgspec.Struct, frozen=True, kw_only=True):
    """A catamaran, with its hydrodynamics about the point amidships in the waterline."""

    hull_kg: float
    payload_kg: float
    hull_centre_m: tuple[float, float]
    """Centre of gravity of the hull: forward of amidships, and down."""
    payload_centre_m: tuple[float, float]
    length_m: float
    beam_m: float
    pontoon_beam_m: float
    pontoon_arm_m: float
    """From the middle line to a pontoon and its propeller."""
    waterline_coefficient: float
    block_coefficient: float
    added_mass: tuple[float, float, float, float, float, float]
    """Shares: of the hull's mass in surge, sway and heave, of the moments of inertia in roll, pitch and yaw."""
    speed_max_m_s: float
    """At full thrust, ahead."""
    sway_s: float
    """Time constants of sway and yaw, which set their linear damping."""
    yaw_s: float
    yaw_quadratic: float
    """Damping of yaw at 1 rad/s beyond the linear, as a multiple of it."""
    damping_ratios: tuple[float, float, float]
    """Of heave, roll and pitch."""
    cross_flow: float
    """Drag coefficient of a pontoon's section, across."""
    thrust_ahead_n: float
    """Largest of one propeller at rest."""
    thrust_astern_n: float
    shaft_s: float
    """Time constant of a propeller's speed."""
    area_front_m2: float
    """Windage."""
    area_side_m2: float
    wind_coefficients: tuple[float, float, float]
    """Of surge, sway and yaw (Fossen 2021, section 10.1)."""
    thrust_per_w: float
    """Newtons of both propellers at full thrust for a watt of battery power."""
    avionics_w: float
    cells: int
    capacity_ah: float
    battery_resistance_ohm: float
