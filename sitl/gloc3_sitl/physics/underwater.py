"""The physics of underwater vehicles: Fossen's equations of motion in six degrees of freedom."""

from collections.abc import Sequence
from math import exp, pi
from typing import Final

import numpy as np

from gloc3.errors import Misuse
from gloc3.messages.frames import (
    GRAVITY_M_S2,
    IDENTITY,
    GeoPoint,
    Quaternion,
    TangentPlane,
    Vector3,
    from_yaw,
    normalize,
    rotate,
    rotate_back,
)
from gloc3_sitl.physics.sea import Sea
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.water import STILL, Water
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.vehicles.underwater import Six, UnderwaterModel, clipped, steady_thrust_n

_FLOOR_SPRING_N_M: Final = 4000.0
_FLOOR_DAMPING_N_S_M: Final = 400.0
_FLOOR_FRICTION: Final = 0.5
_SLIDING_M_S: Final = 0.02
"""Below this speed friction with the floor fades, so that a vehicle at rest does not shake."""
_SECTIONS: Final = (-1.0 / 3.0, 0.0, 1.0 / 3.0)
"""Middles of the three parts of the hull that carry the buoyancy near the surface, as shares of its length."""


class UnderwaterVehicle:
    """One vehicle in water: added mass, Coriolis forces, drag, lift, restoring forces, current, surface and floor.

    The state is the velocity relative to the water `v_r`, in which the equations of motion keep the form that they have in
    still water as long as the current is free of rotation (Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control,
    2021, section 10.3): `M dv_r/dt + C(v_r) v_r + D(v_r) v_r + g = tau`. Orbital motion of waves counts as current, and
    carries a body of neutral buoyancy with it as it should. One step is semi-implicit: velocities first, by the forces at the
    state before, then the pose by the new velocities. The same arguments and commands give the same trajectory bit for bit.

    Args:
        model: the vehicle.
        home: the surface of the water at the place of departure, and the origin of NED.
        water: floor, current and waves; heights count from the home.
        wind: kept for the sensors; it does not move a vehicle under water.
        seed: of the waves.
        rate_hz: steps per second.
        heading_deg: heading at the start, clockwise from north.
    """

    def __init__(
        self,
        model: UnderwaterModel,
        home: GeoPoint,
        water: Water = STILL,
        wind: Wind = CALM,
        seed: int = 0,
        rate_hz: int = 200,
        heading_deg: float = 0.0,
    ) -> None:
        if rate_hz < 100:
            raise Misuse(f"the floor needs at least 100 steps per second, not {rate_hz}")
        self.model: Final = model
        self.home: Final = GeoPoint(*home)
        self.rate_hz: Final = rate_hz
        self.steps = 0
        """Steps done since the start."""
        self.mass_kg: Final = model.mass_kg
        self.standing_height_m: Final = 0.0
        """The truth's standing point is the body's origin."""
        self.wind = wind
        self.water: Final = water
        self.sea: Final = Sea(water.waves, seed)
        self.current_ned_m_s: Vector3 = water.current_ned_m_s
        """Steady velocity of the water; may be set at any time."""
        self.is_flooded = False
        """Whether a leak has taken the buoyancy beyond the weight away."""
        self._plane = TangentPlane(self.home)
        self._surface_down_m = -water.surface_m
        self._floor_down_m = -water.floor_m
        self._dt_s = 1.0 / rate_hz
        self._mass_matrix: Final = mass_matrix(model)
        self._inverse: Final = [tuple(row) for row in np.linalg.inv(np.array(self._mass_matrix)).tolist()]
        self._columns: Final = [
            _column(thruster.position_frd_m, thruster.direction_frd, thruster.torque_m) for thruster in model.thrusters
        ]
        self._keep = 1.0 - exp(-self._dt_s / model.thruster_lag_s)
        self._fin_keep = 1.0 - exp(-self._dt_s / model.fins.lag_s) if model.fins is not None else 0.0
        self.place((0.0, 0.0, self._surface_down_m + self.float_depth_m()), from_yaw(heading_deg * pi / 180.0))

    @property
    def now_s(self) -> float:
        """Seconds of simulated time since the start."""
        return self.steps / self.rate_hz

    @property
    def thrusts_n(self) -> tuple[float, ...]:
        """Force of each thruster now."""
        return tuple(self._thrusts)

    @property
    def water_velocity_frd_m_s(self) -> Vector3:
        """Velocity relative to the water, along the body's axes."""
        return self._v

    def float_depth_m(self) -> float:
        """Depth of the origin where a vehicle floats at rest on a calm surface."""
        model = self.model
        share = min(1.0, model.mass_kg * GRAVITY_M_S2 / model.buoyancy_n)
        return (share - 0.5) * model.height_m

    def set_ground(self, altitude_m: float) -> None:
        """Raise or lower the floor under the vehicle to this altitude above mean sea level."""
        self._floor_down_m = self.home.altitude_m - altitude_m

    def place(
        self,
        position_ned_m: Vector3,
        attitude_wxyz: Quaternion = IDENTITY,
        velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Places the vehicle with its thrusters stopped and without turn rate; its time continues."""
        self._position = position_ned_m
        self._attitude = normalize(attitude_wxyz)
        water = self._water_velocity()
        relative = tuple(own - its for own, its in zip(velocity_ned_m_s, water, strict=True))
        self._v: Vector3 = rotate_back(self._attitude, (relative[0], relative[1], relative[2]))
        self._w: Vector3 = (0.0, 0.0, 0.0)
        self._velocity_ned = velocity_ned_m_s
        self._thrusts = [0.0] * len(self.model.thrusters)
        self._fins = (0.0, 0.0)
        self._force: Vector3 = rotate_back(self._attitude, (0.0, 0.0, -GRAVITY_M_S2))
        self._touches = False
        self._truth: Truth | None = None

    def _water_velocity(self) -> Vector3:
        n, e, d = self._position
        cn, ce, cd = self.current_ned_m_s
        if self.sea.is_flat:
            return (cn, ce, cd)
        wn, we, wd = self.sea.velocity_ned_m_s(n, e, d - self._surface_down_m, self.now_s)
        return (cn + wn, ce + we, cd + wd)

    def step(self, outputs: Sequence[float]) -> None:
        """Advance by one period with the commands -1 to 1 of the thrusters, then of rudder and stern planes (where there are).

        A positive rudder turns right, positive stern planes raise the nose. What is out of range or not a number is clipped.
        """
        dt = self._dt_s
        u, v, w = self._v
        p, q, r = self._w
        self._actuate(outputs)
        fx, fy, fz, mx, my, mz = self._forces(u, v, w, p, q, r)
        i0, i1, i2, i3, i4, i5 = self._inverse
        u += dt * (i0[0] * fx + i0[1] * fy + i0[2] * fz + i0[3] * mx + i0[4] * my + i0[5] * mz)
        v += dt * (i1[0] * fx + i1[1] * fy + i1[2] * fz + i1[3] * mx + i1[4] * my + i1[5] * mz)
        w += dt * (i2[0] * fx + i2[1] * fy + i2[2] * fz + i2[3] * mx + i2[4] * my + i2[5] * mz)
        p += dt * (i3[0] * fx + i3[1] * fy + i3[2] * fz + i3[3] * mx + i3[4] * my + i3[5] * mz)
        q += dt * (i4[0] * fx + i4[1] * fy + i4[2] * fz + i4[3] * mx + i4[4] * my + i4[5] * mz)
        r += dt * (i5[0] * fx + i5[1] * fy + i5[2] * fz + i5[3] * mx + i5[4] * my + i5[5] * mz)
        self._v, self._w = (u, v, w), (p, q, r)
        self.steps += 1
        self._turn(p, q, r, dt)
        wn, we, wd = self._water_velocity()
        n, e, d = rotate(self._attitude, (u, v, w))
        north, east, down = n + wn, e + we, d + wd
        was_n, was_e, was_d = self._velocity_ned
        self._velocity_ned = (north, east, down)
        x, y, z = self._position
        self._position = (x + north * dt, y + east * dt, z + down * dt)
        self._force = rotate_back(
            self._attitude,
            ((north - was_n) / dt, (east - was_e) / dt, (down - was_d) / dt - GRAVITY_M_S2),
        )
        self._truth = None

    def _turn(self, p: float, q: float, r: float, dt: float) -> None:
        """Turn the attitude by the body's rates for one step (first order, then normalised: the step is small)."""
        qw, qx, qy, qz = self._attitude
        half = 0.5 * dt
        self._attitude = normalize(
            (
                qw - half * (qx * p + qy * q + qz * r),
                qx + half * (qw * p + qy * r - qz * q),
                qy + half * (qw * q + qz * p - qx * r),
                qz + half * (qw * r + qx * q - qy * p),
            )
        )

    def _actuate(self, outputs: Sequence[float]) -> None:
        """Thrusters and fins follow their commands."""
        model, keep, thrusts = self.model, self._keep, self._thrusts
        if len(outputs) < len(thrusts):
            outputs = (*outputs, *(0.0,) * (len(thrusts) - len(outputs)))
        for i, thruster in enumerate(model.thrusters):
            thrusts[i] += keep * (
                steady_thrust_n(model, thruster.forward_n, thruster.backward_n, outputs[i]) - thrusts[i]
            )
        if model.fins is not None:
            rudder, stern = (
                (outputs[len(thrusts)], outputs[len(thrusts) + 1]) if len(outputs) > len(thrusts) + 1 else (0.0, 0.0)
            )
            most, now, share = model.fins.deflection_rad, self._fins, self._fin_keep
            self._fins = (
                now[0] + share * (most * clipped(rudder) - now[0]),
                now[1] + share * (most * clipped(stern) - now[1]),
            )

    def _forces(self, u: float, v: float, w: float, p: float, q: float, r: float) -> Six:
        """All forces and moments except inertia, on the body, about its origin, along its axes."""
        model = self.model
        m = self._mass_matrix
        # Momentum of body and added mass; -C(v) v follows from it by cross products (Fossen 2021, theorem 3.2).
        m0, m1, m2, m3, m4, m5 = m
        ax = m0[0] * u + m0[4] * q
        ay = m1[1] * v + m1[3] * p + m1[5] * r
        az = m2[2] * w + m2[4] * q
        bx = m3[1] * v + m3[3] * p
        by = m4[0] * u + m4[2] * w + m4[4] * q
        bz = m5[1] * v + m5[5] * r
        fx = ay * r - az * q
        fy = az * p - ax * r
        fz = ax * q - ay * p
        mx = ay * w - az * v + by * r - bz * q
        my = az * u - ax * w + bz * p - bx * r
        mz = ax * v - ay * u + bx * q - by * p

        lx, ly, lz, lp, lq, lr = model.linear_drag
        qx, qy, qz, qp, qq, qr = model.quadratic_drag
        fx -= (lx + qx * abs(u)) * u
        fy -= (ly + qy * abs(v)) * v
        fz -= (lz + qz * abs(w)) * w
        mx -= (lp + qp * abs(p)) * p
        my -= (lq + qq * abs(q)) * q
        mz -= (lr + qr * abs(r)) * r
        cross = model.cross_flow
        if cross is not None:
            fy += cross.sway_rr * abs(r) * r
            fz -= cross.sway_rr * abs(q) * q
            mz += cross.yaw_vv * abs(v) * v
            my -= cross.yaw_vv * abs(w) * w
        lift = model.lift
        if lift is not None:
            fy += u * (lift.sway_uv * v + lift.sway_ur * r)
            fz += u * (lift.sway_uv * w - lift.sway_ur * q)
            my += u * (-lift.yaw_uv * w + lift.yaw_ur * q)
            mz += u * (lift.yaw_uv * v + lift.yaw_ur * r)
        fins = model.fins
        if fins is not None:
            rudder, stern = self._fins
            side = fins.force_n_s2_m2_rad * u * abs(u) * rudder
            lifting = fins.force_n_s2_m2_rad * u * abs(u) * stern
            # A rudder that turns the nose right pushes the tail left; stern planes that raise the nose push it down.
            fy -= side
            fz += lifting
            my += fins.arm_m * lifting
            mz += fins.arm_m * side
        wet = 1.0
        qw, i, j, k = self._attitude
        # Down, along the body's axes.
        dx, dy, dz = 2.0 * (i * k - qw * j), 2.0 * (j * k + qw * i), 1.0 - 2.0 * (i * i + j * j)
        weight = model.mass_kg * GRAVITY_M_S2
        gx, gy, gz = model.center_of_gravity_frd_m
        fx += weight * dx
        fy += weight * dy
        fz += weight * dz
        mx += weight * (gy * dz - gz * dy)
        my += weight * (gz * dx - gx * dz)
        mz += weight * (gx * dy - gy * dx)
        buoyancy = weight - 5.0 if self.is_flooded else model.buoyancy_n
        depth = self._position[2] - self._surface_down_m
        reach = 0.5 * (model.length_m + model.height_m) + self.sea.height_m
        bx, by, bz = model.center_of_buoyancy_frd_m
        if depth < reach:
            wet = 0.0
            for section in _SECTIONS:
                x = bx + section * model.length_m
                share = self._wet_share(x, dx, dz, depth)
                wet += share / 3.0
                up = buoyancy / 3.0 * share
                fx -= up * dx
                fy -= up * dy
                fz -= up * dz
                mx -= up * (by * dz - bz * dy)
                my -= up * (bz * dx - x * dz)
                mz -= up * (x * dy - by * dx)
        else:
            fx -= buoyancy * dx
            fy -= buoyancy * dy
            fz -= buoyancy * dz
            mx -= buoyancy * (by * dz - bz * dy)
            my -= buoyancy * (bz * dx - bx * dz)
            mz -= buoyancy * (bx * dy - by * dx)
        drive = 1.0 if wet > 0.5 else 2.0 * wet
        for thrust, (cx, cy, cz, kx, ky, kz) in zip(self._thrusts, self._columns, strict=True):
            if thrust:
                force = thrust * drive
                fx += cx * force
                fy += cy * force
                fz += cz * force
                mx += kx * force
                my += ky * force
                mz += kz * force
        self._touches = False
        if self._position[2] + 0.5 * (model.length_m + model.height_m) > self._floor_down_m:
            return self._on_floor((fx, fy, fz, mx, my, mz), (dx, dy, dz))
        return fx, fy, fz, mx, my, mz

    def _wet_share(self, x_m: float, dx: float, dz: float, depth_m: float) -> float:
        """How much of a section of the hull at so far ahead of the origin is under water, 0 to 1."""
        height = self.model.height_m
        section = depth_m + x_m * dx
        if not self.sea.is_flat:
            n, e, _ = self._position
            section += self.sea.elevation_m(n, e, self.now_s)
        share = 0.5 + section / (height * max(0.2, abs(dz)))
        return 0.0 if share < 0.0 else min(share, 1.0)

    def _on_floor(self, forces: Six, down: Vector3) -> Six:
        """Adds the contact forces of the floor at bow and stern: a stiff damped spring and friction."""
        fx, fy, fz, mx, my, mz = forces
        model = self.model
        _, q, r = self._w
        half_n = 0.5 * model.height_m
        for x in (0.4 * model.length_m, -0.4 * model.length_m):
            low_m = self._position[2] + x * down[0] + half_n * max(0.2, abs(down[2]))
            sunk_m = low_m - self._floor_down_m
            if sunk_m <= 0.0:
                continue
            self._touches = True
            own = rotate_back(self._attitude, self._velocity_ned)
            point = (own[0], own[1] + r * x, own[2] - q * x)
            sinking = point[0] * down[0] + point[1] * down[1] + point[2] * down[2]
            push = max(0.0, _FLOOR_SPRING_N_M * sunk_m + _FLOOR_DAMPING_N_S_M * sinking)
            slide = (point[0] - sinking * down[0], point[1] - sinking * down[1], point[2] - sinking * down[2])
            speed = (slide[0] ** 2 + slide[1] ** 2 + slide[2] ** 2) ** 0.5
            grip = _FLOOR_FRICTION * push / max(speed, _SLIDING_M_S)
            gx, gy, gz = (-push * d - grip * s for d, s in zip(down, slide, strict=True))
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            my -= x * gz
            mz += x * gy
        return fx, fy, fz, mx, my, mz

    def imu(self) -> tuple[Vector3, Vector3]:
        """Specific force in m/s^2 at the body's origin and turn rate in rad/s, both FRD; the force is the mean over the last step."""
        return self._force, self._w

    def truth(self) -> Truth:
        """What the vehicle does now."""
        if self._truth is not None:
            return self._truth
        model = self.model
        place = self._plane.geo_from_ned(self._position)
        self._truth = Truth(
            t_s=self.now_s,
            position_ned_m=self._position,
            velocity_ned_m_s=self._velocity_ned,
            attitude_wxyz=self._attitude,
            rate_frd_rad_s=self._w,
            specific_force_frd_m_s2=self._force,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m,
            height_above_ground_m=self._floor_down_m - self._position[2],
            standing_height_m=0.0,
            is_on_ground=self._touches,
            power_w=model.avionics_w + model.power_w_n * sum(abs(thrust) ** 1.5 for thrust in self._thrusts),
            wind_ned_m_s=self.wind.velocity_ned_m_s,
        )
        return self._truth


def mass_matrix(model: UnderwaterModel) -> list[list[float]]:
    """Rigid body and added mass about the body's origin, 6 by 6 and symmetric (Fossen 2021, equations 3.37 and 6.41)."""
    matrix = np.diag(np.array(model.added_mass) + np.array([model.mass_kg] * 3 + list(model.inertia_kg_m2)))
    matrix[1, 5] = matrix[5, 1] = model.added_sway_yaw_kg_m
    matrix[2, 4] = matrix[4, 2] = -model.added_sway_yaw_kg_m
    x, y, z = (model.mass_kg * part for part in model.center_of_gravity_frd_m)
    if x or y:
        raise Misuse("the centre of gravity must lie under the body's origin")
    matrix[0, 4] += z
    matrix[4, 0] += z
    matrix[1, 3] -= z
    matrix[3, 1] -= z
    rows: list[list[float]] = matrix.tolist()
    return rows


def _column(position: Vector3, direction: Vector3, torque_m: float) -> Six:
    """Force and moment about the body's origin of a thrust of 1 N."""
    x, y, z = position
    dx, dy, dz = direction
    return (
        dx,
        dy,
        dz,
        y * dz - z * dy + torque_m * dx,
        z * dx - x * dz + torque_m * dy,
        x * dy - y * dx + torque_m * dz,
    )


__all__ = ["UnderwaterVehicle", "mass_matrix"]
