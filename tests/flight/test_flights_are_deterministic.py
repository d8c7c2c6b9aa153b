"""DESIGN §5: the same seed gives the same log, byte for byte, in any process, with any hash seed and output folder."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec
from tests.flight.missions import PHOTOGRAPHED

from gloc3.log.reader import LogReader
from gloc3.mission.examples import example_missions

RUN = "import sys; from gloc3.cli.program import main; sys.exit(main())"
STUMBLES = ("link_loss=0.2@5..9", "sensor:fix=noisy/0.1@6..8", "crash:limiter@8", "restart@9.5..11")


def fly(out: Path, *options: str, mission: str, seed: int = 3, hash_seed: int) -> Path:
    """Flies a mission in a process of its own; returns the folder that it left."""
    environment = {"PYTHONHASHSEED": str(hash_seed), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    options = (mission, *options, "--quiet", "--seed", str(seed), "--out", str(out))
    command = [sys.executable, "-c", RUN, "fly", *options]
    reported = subprocess.run(command, check=False, env=environment, capture_output=True, text=True, timeout=900)
    assert (out / "log.mcap").is_file(), reported.stderr
    return out


def faults(*texts: str) -> list[str]:
    """Options of the command."""
    return [word for text in texts for word in ("--fault", text)]


def report(folder: Path) -> dict[str, object]:
    """What the flight reported, but for what it cost."""
    reported: dict[str, object] = msgspec.json.decode((folder / "report.json").read_bytes())
    return {key: value for key, value in reported.items() if key != "wall"}


def truth(folder: Path) -> list[object]:
    """Where the vehicle truly was."""
    with LogReader(folder / "log.mcap") as log:
        return [entry.envelope.payload for entry in log.entries("sim/truth")]


HOP = example_missions()["hop"].read_text().replace("on_pose_lost: land", "on_pose_lost: land\non_restart: continue")
"""Where nobody would act, it would else hold for a minute after its restart."""


def test_one_seed_gives_one_log_in_any_process_and_another_seed_another_flight(style: str, tmp_path: Path) -> None:
    (tmp_path / "hop.yaml").write_text(HOP)
    mission = str(tmp_path / "hop.yaml")
    options = ("--autopilot", style, "--wind", "6", *faults(*STUMBLES))
    one = fly(tmp_path / "one", *options, mission=mission, hash_seed=1)
    same = fly(tmp_path / "another" / "folder", *options, mission=mission, hash_seed=2)
    assert (one / "log.mcap").read_bytes() == (same / "log.mcap").read_bytes()
    assert report(one) == report(same)
    assert (one / "path.svg").read_bytes() == (same / "path.svg").read_bytes()
    other = fly(tmp_path / "other", *options, mission=mission, seed=4, hash_seed=1)
    assert truth(one)
    assert report(one)["mission_state"] == "done"
    assert truth(one) != truth(other)


def test_what_cameras_and_scanner_see_and_all_that_is_made_of_it_is_the_same_in_any_process(tmp_path: Path) -> None:
    (tmp_path / "up.yaml").write_text(PHOTOGRAPHED)
    options = ("--platform", "pelican", *faults("device:stereo_camera=garbage@5..6", "crash:pose@7"))
    one, same = (
        fly(tmp_path / name, *options, mission=str(tmp_path / "up.yaml"), hash_seed=seed)
        for seed, name in ((1, "one"), (2, "another/folder"))
    )
    assert (one / "log.mcap").read_bytes() == (same / "log.mcap").read_bytes()
    pictures = sorted(file.name for file in (one / "images").glob("*.jpg"))
    assert len(pictures) > 3
    for name in pictures:
        assert (one / "images" / name).read_bytes() == (same / "images" / name).read_bytes()
    with LogReader(one / "log.mcap") as log:
        for topic in ("odometry/stereo", "odometry/ground", "odometry/laser", "position_fix/tracker", "pose"):
            assert any(entry.envelope.payload.is_valid for entry in log.entries(topic)), topic
