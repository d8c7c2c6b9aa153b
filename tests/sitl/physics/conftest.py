"""A small pilot for physics tests: holds a place above the home, or only the attitude and the height."""

from collections.abc import Callable
from math import cos, sin

import pytest

from gloc3.messages.frames import GeoPoint, to_euler
from gloc3_sitl.physics.jsbsim_body import Quadrotor

Throttles = tuple[float, float, float, float]
Pilot = Callable[[Quadrotor], Throttles]

HOME = GeoPoint(39.5528, 2.6285, 2.0)


@pytest.fixture(name="home")
def _home() -> GeoPoint:
    return HOME


@pytest.fixture
def pilot() -> Callable[..., Pilot]:
    def make(height_m: float = 3.0, *, holds_place: bool = True) -> Pilot:
        def fly(vehicle: Quadrotor) -> Throttles:
            truth = vehicle.truth()
            roll, pitch, yaw = to_euler(truth.attitude_wxyz)
            p, q, r = truth.rate_frd_rad_s
            (north, east, down), (vn, ve, vd) = truth.position_ned_m, truth.velocity_ned_m_s
            roll_wanted = pitch_wanted = 0.0
            if holds_place:
                an, ae = -north - 1.5 * vn, -east - 1.5 * ve
                forward, right = cos(yaw) * an + sin(yaw) * ae, cos(yaw) * ae - sin(yaw) * an
                pitch_wanted, roll_wanted = max(-0.5, min(0.5, -forward / 9.8)), max(-0.5, min(0.5, right / 9.8))
            lift = 0.524 + 0.25 * (down + height_m) + 0.25 * vd
            about_x = 0.25 * (roll_wanted - roll) - 0.06 * p
            about_y = 0.25 * (pitch_wanted - pitch) - 0.06 * q
            about_z = -0.2 * yaw - 0.3 * r
            return (
                lift - about_x + about_y + about_z,
                lift + about_x - about_y + about_z,
                lift + about_x + about_y - about_z,
                lift - about_x - about_y - about_z,
            )

        return fly

    return make


@pytest.fixture
def fly() -> Callable[[Quadrotor, Pilot, float], None]:
    def run(vehicle: Quadrotor, pilot: Pilot, seconds: float) -> None:
        for _ in range(round(seconds * vehicle.rate_hz)):
            vehicle.step(pilot(vehicle))

    return run
