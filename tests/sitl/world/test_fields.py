"""Fields of a world: their values, what a probe makes of them, and what is wrong in a file."""

from pathlib import Path
from statistics import fmean, stdev

import pytest

from gloc3.errors import InputError
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World
from gloc3_sitl.world.field_probe import FieldProbe, field_lines

LEAKY = """
world: leaky
based_on: hold
fields:
  co2:
    unit: ppm
    background: 420
    noise: 8
    sources:
      leak: {position_m: [10, 4, 1], peak: 4000, radius_m: 3, height_m: 2}
      pipe: {position_m: [-20, 4, 3], peak: -100, radius_m: 1}
  temperature: {unit: °C, background: 18.5}
"""


def load(tmp_path: Path, text: str = LEAKY) -> World:
    path = tmp_path / "leaky.yaml"
    path.write_text(text, encoding="utf-8")
    return World.load(str(path))


def test_half_of_a_source_is_left_at_its_radius_and_at_its_height(tmp_path: Path) -> None:
    field = load(tmp_path).file.fields["co2"]
    values = [field.value_at(place) for place in ((10, 4, 1), (13, 4, 1), (10, 1, 1), (10, 4, 3), (10, 10, 1))]
    assert values == pytest.approx([4420.0, 2420.0, 2420.0, 2420.0, 670.0], abs=0.5)
    lowered = [field.value_at(place) for place in ((-20, 4, 3), (-20, 4, 4), (-20, 5, 3))]
    assert lowered == pytest.approx([320.0, 370.0, 370.0], abs=0.1), "where no height is given, it is the radius"
    assert field.value_at((10, 4, 90)) == 420.0


def test_a_probe_measures_at_the_vehicle_with_the_fields_noise_by_the_seed(tmp_path: Path) -> None:
    world = load(tmp_path)
    truth = Simulator(world, SimulatorSettings(seed=1)).truth()
    true = world.file.fields["co2"].value_at((0.0, 0.0, 0.2))
    probes = [FieldProbe(world, "co2", seed) for seed in (1, 1, 2)]
    first, same, other = ([probe.measure(truth) for _ in range(400)] for probe in probes)
    assert first == same
    assert first != other
    assert fmean(first) == pytest.approx(true, abs=3.0)
    assert stdev(first) == pytest.approx(8.0, rel=0.15)
    assert FieldProbe(world, "temperature", 1).measure(truth) == 18.5
    (co2, temperature) = field_lines(world, 1)(truth).decode().splitlines()
    assert co2 == f"co2 {first[0]:.6g} ppm"
    assert temperature == "temperature 18.5 °C"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("unit: ppm", "unit: parts per million", r"leaky.yaml:6:\d+: .*unit"),
        ("    unit: ppm\n", "", r"leaky.yaml:6:\d+: .*unit"),
        ("radius_m: 3", "radius_m: 0", r"leaky.yaml:10:\d+: .*radius_m"),
        ("peak: 4000", "peek: 4000", r"leaky.yaml:10:\d+: .*peek.*peak"),
        ("peak: 4000", "peak: .inf", r"leaky.yaml:10:\d+: "),
        ("  co2:", "  CO2:", r"leaky.yaml:5:\d+: .*CO2"),
        ("fields:", "field:", r"leaky.yaml:4:\d+: .*field.*fields"),
    ],
)
def test_mistakes_are_found_with_their_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in LEAKY
    with pytest.raises(InputError, match=says):
        load(tmp_path, LEAKY.replace(old, new, 1))
