"""Truths at places of a world, for world and camera tests."""

from collections.abc import Callable

import pytest

from gloc3.messages.frames import Vector3, from_euler
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World

STANDING_HEIGHT_M = 0.0973


def truth_of(world: World, position_m: Vector3, euler_rad: Vector3 = (0.0, 0.0, 0.0), t_s: float = 1.5) -> Truth:
    """A vehicle that stands still at a place of a world."""
    place = world.frame.to_geo(position_m)
    return Truth(
        t_s=t_s,
        position_ned_m=(0.0, 0.0, 0.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        attitude_wxyz=from_euler(*euler_rad),
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.8),
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        altitude_m=place.altitude_m,
        height_above_ground_m=position_m[2],
        standing_height_m=STANDING_HEIGHT_M,
        is_on_ground=False,
        power_w=250.0,
        wind_ned_m_s=(0.0, 0.0, 0.0),
    )


@pytest.fixture
def truth_at() -> Callable[..., Truth]:
    return truth_of
