"""The inspection report: the coverage that it tells, against what the cameras of the same flight have truly seen."""

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from tests.evidence.coverage import Coverage
from tests.evidence.page import ROOT, Bar, Figure, Progress

from gloc3.log.reader import LogReader
from gloc3.messages.frames import interpolate, multiply, slerp
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import ImageRecorded
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.vehicles import PELICAN
from gloc3_sitl.world.placing import Placing, WorldPlacement
from gloc3_sitl.world.rig import CAMERAS
from gloc3_sitl.world.world import World

GLOC3 = str(Path(sys.executable).with_name("gloc3"))
SEEDS = range(3)
SURFACE = "floor"
"""The camera that records looks down."""
CELL_M, FARTHEST_M, OBLIQUE_DEG = 0.1, 6.0, 68.0
BAR = 0.05
FOV_SHARE = 0.8


def flight(seed: int) -> dict[str, Any]:
    """Flies, reports, and works out the truth."""
    hold = ROOT / "sitl/gloc3_sitl/world/worlds/hold.yaml"
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "run"
        fly = [GLOC3, "fly", "inspection", "--seed", str(seed), "--out", str(out), "--quiet"]
        subprocess.run(fly, check=True, capture_output=True)
        limits = ["--cell", str(CELL_M), "--farthest", str(FARTHEST_M), "--oblique", str(OBLIQUE_DEG)]
        limits += ["--lift", str(PELICAN.foot_depth_m)]
        report = [GLOC3, "log", "report", str(out), "--wall", f"{hold}#{SURFACE}", *limits]
        subprocess.run(report, check=True, capture_output=True)
        reported = msgspec.json.decode((out / "report/report.json").read_bytes())
        true, narrow = seen(out / "log.mcap", 1.0), seen(out / "log.mcap", FOV_SHARE)
        size = (out / "report/report.html").stat().st_size
    return {
        "told": reported["coverage"],
        "true": true,
        "narrow": narrow,
        "pictures": reported["pictures"],
        "bytes": size,
    }


def seen(log: Path, fov_share: float, surface: str = SURFACE, world_name: str = "hold") -> float:
    """Share of the surface that was truly in a picture, what hides it included; of cameras with a part of the view."""
    world = World.load(world_name)
    coverage = Coverage(
        world, surface, cell_m=CELL_M, range_max_m=FARTHEST_M, incidence_max_rad=float(np.radians(OBLIQUE_DEG))
    )
    placing = Placing(world)
    truths: list[tuple[float, SimTruth]] = []
    used: list[tuple[float, str]] = []
    with LogReader(log, TopicTable.installed().types) as reader:
        for entry in reader.entries("sim/truth", "image_recorded"):
            payload = entry.envelope.payload
            if isinstance(payload, ImageRecorded):
                used.append((entry.envelope.t_s, payload.camera))
            else:
                truths.append((entry.envelope.t_s, payload))
    times = [t_s for t_s, _ in truths]
    for t_s, camera in used:
        after = min(max(1, int(np.searchsorted(times, t_s))), len(times) - 1)
        (a_s, a), (b_s, b) = truths[after - 1], truths[after]
        share = (t_s - a_s) / (b_s - a_s)
        x, y, height = world.frame.from_ned(interpolate(a.position_ned_m, b.position_ned_m, share))
        turned = multiply(placing.local_from_ned, slerp(a.ned_from_frd, b.ned_from_frd, share))
        model = CAMERAS[camera][0]
        focal = (model.focal_px[0] / fov_share, model.focal_px[1] / fov_share)
        body = WorldPlacement(turned, (x, y, height + PELICAN.foot_depth_m))
        coverage.poll(
            msgspec.structs.replace(model, focal_px=focal), body.mounted(model.position_frd_m, model.frd_from_rdf), t_s
        )
    return coverage.share


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    figures = []
    for seed in SEEDS:
        progress.report(f"seed {seed}")
        found = progress.part(f"floor {seed}", partial(flight, seed))
        error, control = (found["told"] / found[key] - 1.0 for key in ("true", "narrow"))
        figures += [
            Figure(
                f"seed {seed}: coverage told and true, {found['pictures']} pictures",
                f"{found['told']:.2%} and {found['true']:.2%}",
            ),
            Figure("… apart by, of the true one", f"{error:+.1%}", f"within {BAR:.0%}", abs(error) <= BAR),
            Figure(
                f"… control: cameras that see {FOV_SHARE:.0%} as far out", f"{control:+.1%}", "red", abs(control) > BAR
            ),
        ]
    return figures


BARS = (
    Bar(
        "inspection-report",
        "The inspection report states the coverage of a surface within 5 %",
        "`gloc3 log report` computes the coverage of a surface from recorded poses and camera models. The result is "
        "within 5 % of what the pictures show.",
        run,
        seeds="0 to 2",
    ),
)
