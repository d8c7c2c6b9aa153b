"""Physical model of a fixed-wing aircraft, without mass and contacts, which are in its JSBSim file."""

import msgspec


class FixedWingModel(msgspec.Struct, frozen=True, kw_only=True):
    """A fixed-wing aircraft: wing, tail, control surfaces, and a propeller on an electric motor.

    Coefficients are those of R. Beard and T. McLain, "Small Unmanned Aircraft" (2012), chapter 4: for forces along the
    stability axes and moments about the body's axes, per radian; turn rates as `b p / 2 V`, `c q / 2 V`, `b r / 2 V`.
    Deflections: ailerons positive turn right, the elevator positive nose down, the rudder positive nose left.
    """

    aircraft: str
    """Name of the JSBSim model, which holds mass, inertia and contact points."""
    foot_depth_m: float
    """Depth of the wheels under the centre of gravity, as in the JSBSim file."""
    springs_n_m: float
    """Stiffness of all wheels together, as in the JSBSim file."""
    wing_m2: float
    span_m: float
    chord_m: float
    lift_0: float
    lift_alpha: float
    lift_q: float
    lift_elevator: float
    stall_rad: float
    """Angle of attack in the middle of the change from attached flow to a flat plate's."""
    stall_sharpness: float
    drag_parasitic: float
    oswald: float
    """Efficiency of the wing: induced drag is lift squared over pi, this, and the aspect ratio."""
    drag_elevator: float
    pitch_0: float
    pitch_alpha: float
    pitch_q: float
    pitch_elevator: float
    side_beta: float
    side_aileron: float
    side_rudder: float
    roll_beta: float
    roll_p: float
    roll_r: float
    roll_aileron: float
    roll_rudder: float
    yaw_beta: float
    yaw_p: float
    yaw_r: float
    yaw_aileron: float
    yaw_rudder: float
    deflection_max_rad: float
    """Of each control surface at full output."""
    servo_s: float
    """Time constant of a control surface."""
    propeller_m: float
    """Diameter."""
    thrust_coefficients: tuple[float, float, float]
    """Thrust over density, n squared and diameter to the fourth, as a polynomial of the advance ratio, constant first."""
    torque_coefficients: tuple[float, float, float]
    """Torque over density, n squared and diameter to the fifth, likewise."""
    motor_v_s_rad: float
    """Volts per rad/s, which is newton metres per ampere, too."""
    motor_ohm: float
    motor_idle_a: float
    """Current without load."""
    motor_s: float
    """Time constant of the motor voltage, s."""
    voltage_v: float
    """At full throttle."""
    moment_angle_max_rad: float = 3.2
    """Angles of the flow beyond this give no more moment and side force: what hovers has air from all sides."""
    avionics_w: float
    """Battery power of everything but the motor."""
    cells: int
    capacity_ah: float
    battery_resistance_ohm: float
