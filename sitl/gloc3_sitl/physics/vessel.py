"""A surface vessel: Fossen's manoeuvring model in the plane; heave, roll and pitch follow the waves."""

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Final, NamedTuple

from gloc3.messages.frames import GRAVITY_M_S2, IDENTITY, Quaternion, Vector3, wrap_pi
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.level_body import LevelBody, clipped
from gloc3_sitl.physics.sea import Sea
from gloc3_sitl.sensors.noise import Wander, normals
from gloc3_sitl.vehicles.surface_model import VesselModel

WATER_KG_M3: Final = 1025.0
AIR_KG_M3: Final = 1.225
_STRIPS: Final = 8
_SAMPLE_STEPS: Final = 4
"""Simulation steps between two samples of the sea surface; waves change slowly."""
_GUST_SHARE: Final = 0.2
"""Deviation of gusts near the surface over the wind speed at 20 ft, as in MIL-F-8785C."""
_GUST_S: Final = 5.0
_MEASURED_SHARE: Final = 0.35
"""Distance of the wave sample points from the centre, as a share of length and beam; shorter waves average out."""


class Hydrodynamics(NamedTuple):
    """Coefficients that follow from a vessel's drawing (Fossen 2021, chapters 4 and 6; about the point amidships)."""

    mass_kg: float
    centre_x_m: float
    surge_kg: float
    """Masses with added mass."""
    sway_kg: float
    yaw_kg_m2: float
    draught_m: float
    heave_rad_s: float
    """Natural frequencies."""
    roll_rad_s: float
    pitch_rad_s: float
    surge_damping: float
    """N s/m."""


def hydrodynamics(model: VesselModel) -> Hydrodynamics:
    """Masses, draught and natural frequencies of a vessel, as the Marine Systems Simulator works them out."""
    hull, load, length, breadth = model.hull_kg, model.payload_kg, model.length_m, model.pontoon_beam_m
    mass = hull + load
    x = (hull * model.hull_centre_m[0] + load * model.payload_centre_m[0]) / mass
    z = (hull * model.hull_centre_m[1] + load * model.payload_centre_m[1]) / mass
    volume = mass / WATER_KG_M3
    draught = volume / (2.0 * model.block_coefficient * breadth * length)
    # Moments of inertia about amidships: radii of gyration, and the hull and its load at their places.
    px, pz = model.payload_centre_m
    inertia_x = hull * (0.4 * model.beam_m) ** 2 + hull * z * z + load * pz * pz
    inertia_y = hull * (0.25 * length) ** 2 + hull * (x * x + z * z) + load * (px * px + pz * pz)
    inertia_z = hull * (0.25 * length) ** 2 + hull * x * x + load * px * px
    _, _, heave, roll, pitch, yaw = model.added_mass
    roll_inertia = inertia_x * (1.0 + roll) + mass * z * z
    pitch_inertia = inertia_y * (1.0 + pitch) + mass * (x * x + z * z)
    # Hydrostatics: water planes, and metacentric heights.
    plane = model.waterline_coefficient * length * breadth
    cw = model.waterline_coefficient
    across = 2.0 / 12.0 * length * breadth**3 * (6.0 * cw**3 / ((1.0 + cw) * (1.0 + 2.0 * cw)))
    across += 2.0 * plane * model.pontoon_arm_m**2
    along = 0.8 * 2.0 / 12.0 * breadth * length**3
    buoyancy_centre = (2.5 * draught - 0.5 * volume / (length * breadth)) / 3.0
    gravity_centre = draught - z
    stiffness = WATER_KG_M3 * GRAVITY_M_S2
    roll_stiffness = stiffness * volume * (buoyancy_centre + across / volume - gravity_centre)
    pitch_stiffness = stiffness * volume * (buoyancy_centre + along / volume - gravity_centre)
    return Hydrodynamics(
        mass_kg=mass,
        centre_x_m=x,
        surge_kg=mass + model.added_mass[0] * hull,
        sway_kg=mass + model.added_mass[1] * hull,
        yaw_kg_m2=inertia_z * (1.0 + yaw) + mass * x * x,
        draught_m=draught,
        heave_rad_s=sqrt(stiffness * 2.0 * plane / (mass + heave * hull)),
        roll_rad_s=sqrt(roll_stiffness / roll_inertia),
        pitch_rad_s=sqrt(pitch_stiffness / pitch_inertia),
        surge_damping=2.0 * model.thrust_ahead_n / model.speed_max_m_s,
    )


class _Oscillator:
    """A damped second-order response to a target: heave, roll or pitch."""

    __slots__ = ("_damping", "_stiffness", "acceleration", "at", "speed")

    def __init__(self, natural_rad_s: float, ratio: float) -> None:
        self._stiffness, self._damping = natural_rad_s**2, 2.0 * ratio * natural_rad_s
        self.at = self.speed = self.acceleration = 0.0

    def step(self, pulled_to: float, dt_s: float) -> None:
        self.acceleration = self._stiffness * (pulled_to - self.at) - self._damping * self.speed
        self.speed += self.acceleration * dt_s
        self.at += self.speed * dt_s


class Vessel(LevelBody):
    """A catamaran driven and steered by two propellers.

    In the plane: surge, sway and yaw with added mass, Coriolis forces, linear and cross-flow damping, relative to the
    water moved by current and waves (Fossen 2021, chapters 6 and 8); wind on the parts above it (section 10.1); and
    gravity along the slope of a wave. Heave, roll and pitch follow the surface under the hull as damped oscillators.
    Second-order drift by waves is not modelled. The reference point is amidships in the waterline.

    Args:
        model: the vessel.
        situation: initial state.
    """

    def __init__(self, model: VesselModel, situation: Situation) -> None:
        snapshot = hydrodynamics(model)
        self.hydrodynamics: Final = snapshot
        super().__init__(situation, snapshot.mass_kg, 0.0)
        self.model: Final = model
        self.sea: Final = Sea(situation.water.waves, situation.seed)
        self.current_ned_m_s: Vector3 = situation.water.current_ned_m_s
        """Velocity of the water; may be set at any time."""
        self._shafts = (0.0, 0.0)
        """Of the left and the right propeller, as shares of the fastest."""
        self._oscillators: Final = tuple(
            _Oscillator(natural, ratio)
            for natural, ratio in zip(
                (snapshot.heave_rad_s, snapshot.roll_rad_s, snapshot.pitch_rad_s), model.damping_ratios, strict=True
            )
        )
        self._slopes = (0.0, 0.0)
        """Of the surface along the hull and to its right: upwards positive."""
        self._surface_m = 0.0
        self._water_ne_m_s = (0.0, 0.0)
        determinant = snapshot.sway_kg * snapshot.yaw_kg_m2 - (snapshot.mass_kg * snapshot.centre_x_m) ** 2
        coupling = snapshot.mass_kg * snapshot.centre_x_m
        self._inverse: Final = (
            snapshot.yaw_kg_m2 / determinant,
            -coupling / determinant,
            snapshot.sway_kg / determinant,
        )
        width = model.length_m / _STRIPS
        self._strips: Final = tuple((i + 0.5) * width - 0.5 * model.length_m for i in range(_STRIPS))
        self._strip_drag: Final = 0.5 * WATER_KG_M3 * snapshot.draught_m * model.cross_flow * width
        draw = normals(situation.seed, "gusts")
        self._gusts: Final = tuple(Wander(draw, 1.0, _GUST_S, _SAMPLE_STEPS * self._dt_s) for _ in range(2))
        self._gust_ne = (0.0, 0.0)
        self._lag: Final = self._dt_s / (model.shaft_s + self._dt_s)
        self._yaw_rad = wrap_pi(situation.heading_deg * pi / 180.0)
        self._measure_forces(0.0, 0.0, 0.0)
        self._sample_surroundings()

    def place(
        self,
        position_ned_m: Vector3,
        attitude_wxyz: Quaternion = IDENTITY,
        velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Places the vessel on the water with its propellers stopped."""
        super().place(position_ned_m, attitude_wxyz, velocity_ned_m_s)
        self._shafts = (0.0, 0.0)
        self._sample_surroundings()

    def _air_m_s(self) -> Vector3:
        n, e, d = self.wind.velocity_ned_m_s
        return (n + self._gust_ne[0], e + self._gust_ne[1], d)

    def _sample_surroundings(self) -> None:
        """What water and air do here, now."""
        n, e, _ = self.current_ned_m_s
        if not self.sea.is_flat:
            t_s, cosine, sine = self.now_s, cos(self._yaw_rad), sin(self._yaw_rad)
            north, east = self._north_m, self._east_m
            ahead, aside = _MEASURED_SHARE * self.model.length_m, _MEASURED_SHARE * self.model.beam_m
            height = self.sea.elevation_m
            bow = height(north + ahead * cosine, east + ahead * sine, t_s)
            stern = height(north - ahead * cosine, east - ahead * sine, t_s)
            right = height(north - aside * sine, east + aside * cosine, t_s)
            left = height(north + aside * sine, east - aside * cosine, t_s)
            self._slopes = ((bow - stern) / (2.0 * ahead), (right - left) / (2.0 * aside))
            self._surface_m = 0.25 * (bow + stern + right + left)
            wn, we, _ = self.sea.velocity_ned_m_s(north, east, 0.5 * self.hydrodynamics.draught_m, t_s)
            n, e = n + wn, e + we
        self._water_ne_m_s = (n, e)
        if self.wind.gust_m_s > 0.0:
            size = _GUST_SHARE * self.wind.gust_m_s
            self._gust_ne = (size * self._gusts[0].step(), size * self._gusts[1].step())

    def step(self, outputs: Sequence[float], /) -> None:
        """Advances by one period with the outputs of the left and the right propeller, -1 to 1."""
        if self.steps % _SAMPLE_STEPS == 0:
            self._sample_surroundings()
        model, snapshot, dt = self.model, self.hydrodynamics, self._dt_s
        left, right = self._shafts
        left += self._lag * (clipped(outputs[0]) - left)
        right += self._lag * (clipped(outputs[1]) - right)
        self._shafts = (left, right)
        thrust_left, thrust_right = self._thrust_n(left), self._thrust_n(right)
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        u, v, r = self._surge_m_s, self._sway_m_s, self._rates[2]
        cn, ce = self._water_ne_m_s
        uc, vc = cn * cosine + ce * sine, ce * cosine - cn * sine
        ur, vr = u - uc, v - vc
        mass, xg = snapshot.mass_kg, snapshot.centre_x_m
        m11, m22 = snapshot.surge_kg, snapshot.sway_kg
        # Cross-flow drag, strip by strip.
        drag_y = drag_n = 0.0
        for x in self._strips:
            flow = vr + x * r
            drag = self._strip_drag * abs(flow) * flow
            drag_y += drag
            drag_n += x * drag
        wind_x, wind_y, wind_n = self._wind_n(cosine, sine, u, v)
        along, across = self._slopes
        yaw_linear = snapshot.yaw_kg_m2 / model.yaw_s
        force_x = (
            thrust_left + thrust_right + wind_x
            - snapshot.surge_damping * ur
            + m22 * vr * r + mass * xg * r * r
            - mass * GRAVITY_M_S2 * along
        )  # fmt: skip
        force_y = wind_y - m22 / model.sway_s * vr - drag_y - m11 * ur * r - mass * GRAVITY_M_S2 * across
        moment = (
            model.pontoon_arm_m * (thrust_left - thrust_right) + wind_n
            - yaw_linear * (1.0 + model.yaw_quadratic * abs(r)) * r - drag_n
            - (m22 - m11) * ur * vr - mass * xg * ur * r
        )  # fmt: skip
        a, b, c = self._inverse
        du = force_x / m11
        dv, dr = a * force_y + b * moment, b * force_y + c * moment
        # The equations hold relative to the water, which turns as the vessel turns over it.
        u_dot, v_dot = du + r * vc, dv - r * uc
        u, v, r = u + u_dot * dt, v + v_dot * dt, r + dr * dt
        self._surge_m_s, self._sway_m_s = u, v
        self._yaw_rad = wrap_pi(self._yaw_rad + r * dt)
        self._north_m += (u * cosine - v * sine) * dt
        self._east_m += (u * sine + v * cosine) * dt
        heave, roll, pitch = self._oscillators
        heave.step(self._surface_m + self._ground_m, dt)
        roll.step(-across, dt)
        pitch.step(along, dt)
        self._height_m, self._climb_m_s = heave.at, heave.speed
        self._roll_rad, self._pitch_rad = roll.at, pitch.at
        self._rates = (roll.speed, pitch.speed, r)
        self._measure_forces(u_dot - r * v, v_dot + r * u, heave.acceleration)
        drive_w = (abs(thrust_left) * abs(left) + abs(thrust_right) * abs(right)) / model.thrust_per_w
        self._power_w = model.avionics_w + drive_w
        self._moved()

    def _thrust_n(self, shaft: float) -> float:
        """Of one propeller; it goes with the square of its speed."""
        most = self.model.thrust_ahead_n if shaft > 0.0 else self.model.thrust_astern_n
        return most * abs(shaft) * shaft

    def _wind_n(self, cosine: float, sine: float, u: float, v: float) -> Vector3:
        """Forces and moment of the wind."""
        wn, we, _ = self._air_m_s()
        ahead, right = wn * cosine + we * sine - u, we * cosine - wn * sine - v
        speed = hypot(ahead, right)
        if speed < 1e-6:
            return (0.0, 0.0, 0.0)
        model = self.model
        pressure = 0.5 * AIR_KG_M3 * speed * speed
        from_bow = -atan2(-right, -ahead)
        cx, cy, cn = model.wind_coefficients
        return (
            -cx * cos(from_bow) * pressure * model.area_front_m2,
            cy * sin(from_bow) * pressure * model.area_side_m2,
            cn * sin(2.0 * from_bow) * pressure * model.area_side_m2 * model.length_m,
        )
