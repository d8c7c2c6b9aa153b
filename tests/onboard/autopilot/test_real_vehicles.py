"""ArduPilot's own programs with their built-in models, and nothing of ours changed but the address of the link.

A mission with parallel actions is flown, driven, dived; its station goes away and another one takes over, pauses and
resumes it; it ends on the ground, standing, or at the surface, disarmed.
"""

import shutil
from pathlib import Path

import pytest
from tests.onboard.real_journey import lead
from tests.onboard.real_vehicle import COPTER, ROVER, SUB, Vehicle

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough]


@pytest.mark.timeout(400)
@pytest.mark.parametrize("vehicle", [COPTER, ROVER, SUB], ids=lambda one: one.binary)
async def test_a_mission_survives_its_station_is_paused_and_resumed_and_ends_disarmed(
    vehicle: Vehicle, tmp_path: Path
) -> None:
    if shutil.which(vehicle.binary) is None:
        pytest.skip(f"{vehicle.binary} is not on PATH: see docs/firmware.md")
    exchange = await lead(vehicle, tmp_path)
    near_m = vehicle.near_m
    assert exchange.pictures >= 3
    assert max(exchange.misses_m) < near_m + 0.5
    assert exchange.most_m < near_m
    assert (
        (exchange.highest_m > vehicle.height_m - 0.5)
        if vehicle.height_m >= 0.0
        else (exchange.lowest_m < vehicle.height_m + 0.5)
    )
    assert not exchange.had_pilot
    assert exchange.fence == "confirmed"
    assert exchange.inside_m > 0.0
