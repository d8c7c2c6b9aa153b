"""The simulated Doppler velocity log: what it measures, and where its beams find no floor."""

from math import radians

import pytest

from gloc3.messages.frames import Quaternion, from_euler
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.dvl import FAR_M, NOISE_M_S, SCALE, DvlModel

LEVEL = from_euler(0.0, 0.0, 0.0)


def over(altitude_m: float, attitude: Quaternion = LEVEL) -> Truth:
    """Going north at 1 m/s, so far over the floor."""
    return Truth(
        t_s=0.0,
        position_ned_m=(0.0, 0.0, 0.0),
        velocity_ned_m_s=(1.0, 0.0, 0.0),
        attitude_wxyz=attitude,
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.8),
        latitude_deg=0.0,
        longitude_deg=0.0,
        altitude_m=0.0,
        height_above_ground_m=altitude_m,
        standing_height_m=0.0,
        is_on_ground=False,
        power_w=0.0,
        wind_ned_m_s=(0.0, 0.0, 0.0),
    )


def test_it_measures_in_the_axes_of_the_body_with_the_errors_that_it_claims() -> None:
    dvl = DvlModel(1)
    east = from_euler(0.0, 0.0, radians(90.0))
    measured = [dvl.measure(over(5.0, east)) for _ in range(400)]
    forward, right, down = (sum(one.velocity_frd_m_s[axis] for one in measured) / 400 for axis in range(3))
    assert (forward, down) == pytest.approx((0.0, 0.0), abs=0.012)
    assert right == pytest.approx(-1.0, abs=4.0 * SCALE + 4.0 * NOISE_M_S / 20.0)
    assert all((one.std_m_s, one.altitude_m, one.is_valid) == (NOISE_M_S, 5.0, True) for one in measured)


@pytest.mark.parametrize(
    ("altitude_m", "tilt_deg", "has_lock"),
    [
        (0.01, 0.0, False),
        (0.2, 0.0, True),
        (FAR_M - 1.0, 0.0, True),
        (FAR_M + 1.0, 0.0, False),
        (5.0, 30.0, True),
        (5.0, 40.0, False),
        (40.0, 30.0, False),
    ],
)
def test_there_is_bottom_lock_in_range_and_where_all_beams_reach_the_floor(
    altitude_m: float, tilt_deg: float, has_lock: bool
) -> None:
    bottom = DvlModel(1).measure(over(altitude_m, from_euler(radians(tilt_deg), 0.0, 0.0)))
    assert (bottom.is_valid, bottom.reason) == ((True, "") if has_lock else (False, "no bottom lock"))
