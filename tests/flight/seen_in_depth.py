"""Flights of the Pelican with a depth camera in place of a scanner, among boxes that stand in the way."""

from pathlib import Path
from typing import Final

from tests.flight.among_obstacles import Course, box, way, world

PAGE: Final = Path(__file__).parents[2] / "docs" / "sensors.md"


def behind_a_box() -> Course:
    """Straight ahead, to a place behind a box, whose side is wider than the vehicle."""
    return Course(world([box("crate", 4.0, 0.1, (0.8, 1.2))], "hold"), way([(8.0, 0.0, 1.5)], 1.0))


def before_a_wall() -> Course:
    """The same where no way leads round: a beam from side to side, in which the vehicle would end."""
    return Course(world([box("bar", 4.0, 5.0, (0.5, 15.98), 2.4, low_m=1.25)], "hold"), way([(8.0, 0.0, 1.6)], 1.0))


def depth_platform() -> str:
    """The Pelican that flies by satellites, with a depth camera, as the page of sensors has it."""
    return _platform("## Depth cameras")


def lidar_platform() -> str:
    """The same with a 3D scanner."""
    return _platform("### 3D scanners")


def _platform(heading: str) -> str:
    section = PAGE.read_text(encoding="utf-8").partition(heading)[2]
    return section.partition("```yaml\n")[2].partition("```")[0]
