"""An aircraft that lift rotors carry until its wings do: a quadplane on JSBSim."""

from collections.abc import Sequence
from math import exp, sqrt
from typing import Final

from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.fixed_wing import FixedWing, Wrench
from gloc3_sitl.physics.jsbsim_body import FOOT_M, SEA_LEVEL_KG_M3
from gloc3_sitl.vehicles.fixed_wing_model import FixedWingModel
from gloc3_sitl.vehicles.lift_rotor_model import LiftRotorModel

FIRST_ROTOR: Final = 4
"""Outputs before it are those of the aircraft."""
Rotors = tuple[float, float, float, float]
_SIDES: Final = ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0))
"""Of each rotor: ahead or behind, right or left, and the sense of its reaction on the body about down."""


class Quadplane(FixedWing):
    """One simulated aircraft with four lift rotors that rests on its feet to begin with.

    Its outputs are ailerons, elevator, throttle and rudder, each -1 to 1, then the throttles of four rotors, 0 to 1.

    Args:
        model: the aircraft.
        rotors: what lifts it.
        situation: where it begins; its wind and its gusts too.
    """

    def __init__(self, model: FixedWingModel, rotors: LiftRotorModel, situation: Situation) -> None:
        self.rotors: Final = rotors
        self._speeds: Rotors = (0.0, 0.0, 0.0, 0.0)
        super().__init__(model, situation)
        self._up: Final = 1.0 - exp(-1.0 / (self.rate_hz * rotors.spin_up_s))
        self._down: Final = 1.0 - exp(-1.0 / (self.rate_hz * rotors.spin_down_s))
        self._density_ratio: Final = self._density / SEA_LEVEL_KG_M3

    def _stop_motors(self) -> None:
        super()._stop_motors()
        self._speeds = (0.0, 0.0, 0.0, 0.0)

    def _power_w(self) -> float:
        rotors = self.rotors
        lift = rotors.thrust_max_n / rotors.speed_max_rad_s**2 * self._density / SEA_LEVEL_KG_M3
        shaft_w = lift * rotors.torque_per_thrust_m * sum(speed**3 for speed in self._speeds)
        return super()._power_w() + shaft_w / rotors.drive_efficiency

    @property
    def rotor_speeds_rad_s(self) -> Rotors:
        """How fast each lift rotor turns."""
        return self._speeds

    def step(self, outputs: Sequence[float], /) -> None:
        """Advance by one period with the outputs of the aircraft and the throttles of the rotors."""
        on_wings = self._force_and_moment(outputs)
        on_rotors = self._lift(outputs[FIRST_ROTOR : FIRST_ROTOR + 4])
        x, y, z, roll, pitch, yaw = (one + other for one, other in zip(on_wings, on_rotors, strict=True))
        self._put((x, y, z, roll, pitch, yaw))
        self._advance()

    def _lift(self, throttles: Sequence[float]) -> Wrench:
        """Force and moment of rotors and booms, FRD, after the rotors have spun up or down for one period."""
        model = self.rotors
        get_u, get_v, get_w, get_p, get_q, get_r = self._motion
        u, v, w = get_u() * FOOT_M, get_v() * FOOT_M, get_w() * FOOT_M
        p, q, r = get_p(), get_q(), get_r()
        arm, hub, inertia = model.arm_m / sqrt(2.0), -model.height_m, model.inertia_kg_m2 * self.rate_hz
        lift, inflow = model.thrust_max_n / model.speed_max_rad_s**2, model.inflow_n_s2_m_rad
        thrust = roll = pitch = yaw = 0.0
        speeds = []
        for (ahead, right, sense), was, wanted in zip(_SIDES, self._speeds, throttles, strict=True):
            gain = self._wanted_speed(wanted) - was
            gain *= self._up if gain > 0.0 else self._down
            speed = was + gain
            speeds.append(speed)
            sinks = w + arm * (right * p - ahead * q)
            own = self._density_ratio * speed * max(0.0, lift * speed + inflow * sinks)
            thrust += own
            roll -= arm * right * own
            pitch += arm * ahead * own
            yaw += sense * (model.torque_per_thrust_m * own + inertia * gain)
        self._speeds = (speeds[0], speeds[1], speeds[2], speeds[3])
        sideways = model.drag_n_s2_m_rad * self._density_ratio * sum(speeds)
        yaw -= sideways * arm * arm * 2.0 * r
        hub_x, hub_y = -sideways * (u + q * hub), -sideways * (v - p * hub)
        drag = 0.5 * self._density * sqrt(u * u + v * v + w * w) * model.drag_area_m2
        return hub_x - drag * u, hub_y - drag * v, -thrust, roll - hub * hub_y, pitch + hub * hub_x, yaw

    def _wanted_speed(self, throttle: float) -> float:
        share = 0.0 if not throttle > 0.0 else min(throttle, 1.0)
        curve = self.rotors.throttle_curve
        return self.rotors.speed_max_rad_s * sqrt((curve * share + 1.0 - curve) * share)
