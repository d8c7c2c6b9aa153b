"""The ground odometer over the floor of the hold: the bars in a reduced form, and `gloc3 odometry ground` on a folder."""

from itertools import islice
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.evidence.ground import Run, controls
from tests.evidence.ground_flight import fly, motion, write_folder

from gloc3.cli.program import _call
from gloc3.errors import InputError
from gloc3_onboard.cli.odometry import app
from gloc3_sitl.world.model import Box
from gloc3_sitl.world.world import World

pytestmark = pytest.mark.thorough

LEG = ((3.0, 0.2, 1.8), (3.0, 0.2, 2.2), (3.0, 1.0, 2.2), (7.5, 1.0, 2.2))


def over_boxes() -> World:
    """The hold with cargo below the leg: the range finder hits it, and half of the picture shows it."""
    file = World.load("hold").file
    low = Box(min_m=(4.0, 0.4, 0.0), max_m=(5.0, 1.6, 0.8), texture="crate")
    high = Box(min_m=(6.0, 0.8, 0.0), max_m=(6.8, 2.0, 1.2), texture="crate")
    return World(msgspec.structs.replace(file, boxes={"low": low, "high": high}))


def drifts(world: World, seed: int = 2) -> tuple[Run, Run]:
    plain, biased = Run(), Run(1.01)
    for step in fly(seed, world, motion(seed, LEG)):
        plain.take(step)
        biased.take(step)
    return plain, biased


def test_a_leg_over_the_floor_keeps_the_bars_and_an_honest_covariance() -> None:
    plain, biased = drifts(World.load("hold"))
    assert plain.reasons == ["restarts: the first picture"]
    assert plain.drift() < 0.8
    assert biased.drift() < 1.3
    assert 0.1 < np.mean([position for position, _ in plain.errors]) < 2.0
    assert min(controls(motion(2, LEG))) > 10.0


def test_boxes_below_are_not_taken_for_motion() -> None:
    plain, _ = drifts(over_boxes())
    assert plain.drift() < 1.0
    assert len(plain.reasons) < 4


def test_the_command_runs_on_a_folder_and_tells_errors_and_reasons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(islice(fly(1, World.load("hold"), motion(1, LEG)), 40, 100), tmp_path / "set")
    folder = tmp_path / "set"
    torn = sorted((folder / "ground" / "data").glob("*.png"))[20]
    torn.write_bytes(torn.read_bytes()[:2000])
    out, truth = tmp_path / "out.txt", folder / "truth.txt"
    assert (
        _call(app, ["ground", str(folder), "--slant", "--truth", str(truth), "--trajectory", str(out), "--json"]) == 0
    )
    found = msgspec.json.decode(capsys.readouterr().out)
    assert found["run"]["inputs"] == 60
    assert found["run"]["valid"] >= 57
    assert found["errors"]["absolute_m"]["rms"] < 0.03
    rows = [line.split() for line in out.read_text().splitlines()]
    assert (len(rows), len(rows[0])) == (found["poses"], 8)
    begin_ns = int((folder / "ground" / "data.csv").read_text().splitlines()[1].split(",")[0])
    assert float(rows[0][0]) == pytest.approx(begin_ns * 1e-9, abs=1e-9), "the data set's own time"
    (folder / "height.csv").write_text("1,2\nx,2\n")
    with pytest.raises(InputError, match=r"height\.csv:2"):
        _call(app, ["ground", str(folder)])
