"""A truth that stands still, for sensor tests."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from gloc3.messages.frames import IDENTITY, GeoPoint
from gloc3_sitl.physics.truth import Truth

HOME = GeoPoint(39.5528, 2.6285, 2.0)


@pytest.fixture(name="home")
def _home() -> GeoPoint:
    return HOME


@pytest.fixture
def still() -> Callable[..., Truth]:
    base = Truth(
        t_s=0.0,
        position_ned_m=(0.0, 0.0, -3.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        attitude_wxyz=IDENTITY,
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.8),
        latitude_deg=HOME.latitude_deg,
        longitude_deg=HOME.longitude_deg,
        altitude_m=HOME.altitude_m + 3.0,
        height_above_ground_m=3.0,
        standing_height_m=0.0973,
        is_on_ground=False,
        power_w=250.0,
        wind_ned_m_s=(0.0, 0.0, 0.0),
    )

    def make(**changes: Any) -> Truth:
        return msgspec.structs.replace(base, **changes)

    return make
