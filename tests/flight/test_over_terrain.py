"""A mission with heights above the ground, over terrain tiles, from upload to landing."""

from pathlib import Path

from tests.terrain_tiles import ridge, write_tile

from gloc3.clock import run_virtual
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.terrain import Terrain
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

MISSION = """\
mission: over a slope
frame: geo
height_above: ground
on_low_battery: land
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 8}}
      way:
        after: [up]
        follow_waypoints: {waypoints: [[47.5, 8.5, 8], [47.5, 8.501, 8]], speed_m_s: 2}
      down: {land: {}, after: [way]}
"""


async def flown(folder: Path) -> list[tuple[float, float]]:
    """Metres east of home, and heights above it."""
    write_tile(folder / "tiles", "N47E008", ridge(400.0, 412.0, 8.5005, 0.0004), side=3601)
    (folder / "mission.yaml").write_text(MISSION)
    plan = FlightPlan(mission=str(folder / "mission.yaml"), seed=5, terrain=folder / "tiles")
    async with Flight(plan) as flight:
        end = await flight.await_end(await flight.upload_and_start(), within_s=200.0)
        samples = [sample.position_ned_m for sample in flight.truth.samples]
    assert (str(end.state), end.reason) == ("done", "")
    return [(east, -down) for _, east, down in samples]


def test_it_follows_the_ground_of_the_tiles_at_its_height_above_it(tmp_path: Path) -> None:
    samples = run_virtual(flown(tmp_path))
    terrain = Terrain(tmp_path / "tiles")
    plane = TangentPlane(GeoPoint(47.5, 8.5, 0.0))  # home is the first place of the mission
    foot_m = terrain.altitude_m(47.5, 8.5)
    heights = []
    for east, height_m in samples:
        if 3.0 < east < 72.0:
            place = plane.geo_from_ned((0.0, east, 0.0))
            heights.append(height_m - (terrain.altitude_m(47.5, place.longitude_deg) - foot_m))
    assert len(heights) > 50
    assert min(heights) > 5.5
    assert max(heights) < 10.5
    assert max(height_m for _, height_m in samples) > 17.0
