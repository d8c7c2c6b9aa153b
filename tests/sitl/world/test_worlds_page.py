"""The page of the docs about worlds: its example is a world file, and its table names the worlds that there are."""

import re
from pathlib import Path

import pytest

from gloc3_sitl.faults.faults import read_fault
from gloc3_sitl.flight.sim_rig import SIM_DEVICES
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough

PAGE = (Path(__file__).parents[3] / "docs" / "worlds.md").read_text(encoding="utf-8")


def test_the_example_can_be_flown_in(tmp_path: Path) -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    file = tmp_path / "yard.yaml"
    file.write_text(text)
    world = World.load(str(file))
    assert world.height_at(3.5, 1.5) == 1.2
    assert world.geometry.clearance_m((2.0, 1.5, 0.5), 0.0) == pytest.approx(0.5)
    assert (world.file.tracker is not None, len(world.file.lights), len(world.file.lighting.lamps)) == (True, 1, 1)
    assert world.file.fields["co2"].value_at((2.0, 4.0, 1.0)) == pytest.approx(4420.0)


def test_its_tables_name_every_world_and_device() -> None:
    table = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert sorted(table) == sorted([*World.names(), *SIM_DEVICES])


def test_its_faults_can_be_written() -> None:
    for text in re.findall(r"--fault (\S+?)`", PAGE):
        assert read_fault(text).kind == "device"
