"""Physical model of an underwater vehicle: Fossen's model in SNAME's coefficients, and its actuators."""

import msgspec

from gloc3.messages.frames import Vector3

Six = tuple[float, float, float, float, float, float]
"""Surge, sway, heave, roll, pitch, yaw."""


class Thruster(msgspec.Struct, frozen=True, kw_only=True):
    """One thruster: position, direction and thrust."""

    position_frd_m: Vector3
    """From the body's origin."""
    direction_frd: Vector3
    """Unit vector of its force at a positive command."""
    forward_n: float
    """Thrust at full positive command."""
    backward_n: float
    """Size of the thrust at full negative command."""
    torque_m: float = 0.0
    """Reaction torque about `direction_frd` over thrust."""


class Fins(msgspec.Struct, frozen=True, kw_only=True):
    """A cruciform tail: rudders and stern planes of the same kind."""

    force_n_s2_m2_rad: float
    """Force of the rudder (or of the stern planes) per speed squared and radian."""
    arm_m: float
    """Distance behind the body's origin."""
    deflection_rad: float
    """Largest deflection either way, at a command of 1 or -1."""
    lag_s: float
    """Time constant of the servo."""


class Lift(msgspec.Struct, frozen=True, kw_only=True):
    """Forces of hull and fins that grow with the forward speed times another velocity; without the added mass's."""

    sway_uv: float
    """Sway force per surge and sway speed, kg/m; heave per surge and heave speed is the same."""
    sway_ur: float
    """Sway force per surge speed and yaw rate, kg/rad; heave per surge and pitch rate has the other sign."""
    yaw_uv: float
    """Yaw moment per surge and sway speed, kg; pitch per surge and heave speed has the other sign."""
    yaw_ur: float
    """Yaw moment per surge speed and yaw rate, kg m/rad; pitch per surge and pitch rate is the same."""


class CrossFlow(msgspec.Struct, frozen=True, kw_only=True):
    """Quadratic drag that couples sway with yaw, and heave with pitch the other way."""

    sway_rr: float
    """Sway force per yaw rate squared, kg m/rad^2."""
    yaw_vv: float
    """Yaw moment per sway speed squared, kg."""


class UnderwaterModel(msgspec.Struct, frozen=True, kw_only=True):
    """A rigid body in water. Coefficients of drag and added mass are given as positive numbers.

    The origin is that of the source; SNAME's X_u|u| = -1.62 kg/m is written here as 1.62.
    """

    name: str
    """What it is called."""
    mass_kg: float
    """In air."""
    buoyancy_n: float
    """Weight of the displaced water when all of it is under water."""
    inertia_kg_m2: Vector3
    """About the body's origin, along the body's axes."""
    center_of_gravity_frd_m: Vector3
    center_of_buoyancy_frd_m: Vector3
    added_mass: Six
    """Diagonal of the added mass: kg, and kg m^2."""
    added_sway_yaw_kg_m: float = 0.0
    """Added mass that couples sway and yaw (-Y of the yaw acceleration); heave and pitch have the other sign."""
    linear_drag: Six
    """N s/m, and N m s/rad."""
    quadratic_drag: Six
    """N s^2/m^2, and N m s^2/rad^2."""
    cross_flow: CrossFlow | None = None
    lift: Lift | None = None
    thrusters: tuple[Thruster, ...]
    thrust_curve: float
    """Share of the quadratic part in the thrust over the command."""
    dead_band: float
    """Commands smaller than this turn nothing."""
    thruster_lag_s: float
    """Time constant of a thruster's force."""
    fins: Fins | None = None
    length_m: float
    """Of the hull."""
    height_m: float
    """Of the hull: how far it sticks out when the origin is at the surface follows from half of it."""
    power_w_n: float
    """Electrical power of a thruster over thrust to the power of 1.5."""
    avionics_w: float
    """Electrical power of everything else."""
    cells: int
    """Of its lithium battery, in series."""
    capacity_ah: float
    battery_resistance_ohm: float


def steady_thrust_n(model: UnderwaterModel, forward_n: float, backward_n: float, command: float) -> float:
    """Force that a thruster settles at, for a command -1 to 1."""
    command = clipped(command)
    size = abs(command)
    if size <= model.dead_band:
        return 0.0
    share = (size - model.dead_band) / (1.0 - model.dead_band)
    share *= model.thrust_curve * share + 1.0 - model.thrust_curve
    return forward_n * share if command > 0.0 else -backward_n * share


def clipped(command: float) -> float:
    """Clips to -1..1; not-a-number becomes 0."""
    if not -1.0 <= command <= 1.0:
        return 1.0 if command > 1.0 else -1.0 if command < -1.0 else 0.0
    return command
