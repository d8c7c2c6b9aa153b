"""DESIGN §5: the same seed gives the same log, byte for byte, in any process, with any hash seed and output folder."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec

from gloc3.log.reader import LogReader

RUN = "import sys; from gloc3.cli import main; sys.exit(main())"
FAULTS = ("link_loss=0.2@5..9", "sensor:fix=noisy/0.1@6..8", "crash:limiter@8", "restart@9.5..11")


def fly(out: Path, style: str, *, seed: int, hash_seed: int) -> Path:
    """Flies the shortest mission in a process of its own, with faults in wind; returns the folder that it left."""
    options = ["--autopilot", style, "--wind", "6", "--quiet", "--seed", str(seed), "--out", str(out)]
    for fault in FAULTS:
        options += ["--fault", fault]
    environment = {"PYTHONHASHSEED": str(hash_seed), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", RUN, "fly", "hop", *options]
    told = subprocess.run(command, check=False, env=environment, capture_output=True, text=True, timeout=120)
    assert (out / "log.mcap").is_file(), told.stderr
    return out


def report(folder: Path) -> dict[str, object]:
    """What the flight reported, but for what it cost."""
    told: dict[str, object] = msgspec.json.decode((folder / "report.json").read_bytes())
    return {key: value for key, value in told.items() if key != "wall"}


def truth(folder: Path) -> list[object]:
    """Where the vehicle truly was."""
    with LogReader(folder / "log.mcap") as log:
        return [entry.envelope.payload for entry in log.entries("sim/truth")]


def test_one_seed_gives_one_log_in_any_process_and_another_seed_another_flight(style: str, tmp_path: Path) -> None:
    one = fly(tmp_path / "one", style, seed=3, hash_seed=1)
    same = fly(tmp_path / "another" / "folder", style, seed=3, hash_seed=2)
    assert (one / "log.mcap").read_bytes() == (same / "log.mcap").read_bytes()
    assert report(one) == report(same)
    assert (one / "path.svg").read_bytes() == (same / "path.svg").read_bytes()
    other = fly(tmp_path / "other", style, seed=4, hash_seed=1)
    assert truth(one)
    assert truth(one) != truth(other)
