"""Figures of whole programs, and of what others need for the same, as JSON: of the sources that PYTHONPATH leads to.

Arguments are the names of the benches; see `tests.evidence.speed`.
"""

import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import quantiles
from typing import Any, Final

import foxglove
import msgspec
import numpy as np
from foxglove.channels import PoseInFrameChannel
from foxglove.messages import Pose, PoseInFrame, Quaternion, Vector3
from pymavlink.dialects.v20 import common
from tests.benchmarks import footprint, fusion, network, stereo, turnaround
from tests.benchmarks.parts import best_us
from tests.evidence.cost import one_core
from tests.onboard.algorithms.vision.flights import fly, inspection

from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.jsbsim_body import Quadrotor

ALONE_S: Final = 60.0
"""Simulated time of the physics alone."""
HOVER: Final = (0.524, 0.524, 0.524, 0.524)
"""Throttles at which it neither climbs nor sinks, about."""


def patrol() -> dict[str, float]:
    """Simulated seconds for each second of one core, start-up and log included."""
    with one_core():
        simulated_s, processor_s, _ = _fly("patrol", "--seed", "1")
    return {"times": simulated_s / processor_s}


def inspected() -> dict[str, float]:
    """Simulated seconds for each second on the wall, on all cores."""
    simulated_s, _, wall_s = _fly("inspection", "--platform", "pelican", "--seed", "1")
    return {"times": simulated_s / wall_s}


def _fly(*arguments: str) -> tuple[float, float, float]:
    """What a flight takes as a program of its own: simulated, in the processor, and on the wall, s."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gloc3", "fly", *arguments, "--out", folder, "--quiet"]
        begin_s, before = time.perf_counter(), os.times()
        subprocess.run(command, check=True, capture_output=True)
        wall_s, after = time.perf_counter() - begin_s, os.times()
        report = msgspec.json.decode((Path(folder) / "report.json").read_bytes())
    processor_s = after.children_user + after.children_system - before.children_user - before.children_system
    return report["wall"]["simulated_s"], processor_s, wall_s


def physics() -> dict[str, float]:
    """Simulated seconds of the Pelican's physics, JSBSim and rotors, for each second of a core, and nothing else."""
    vehicle = Quadrotor("pelican", GeoPoint(39.5528, 2.6285, 2.0))
    vehicle.place((0.0, 0.0, -10_000.0))
    begin_s = time.process_time()
    for _ in range(round(ALONE_S * vehicle.rate_hz)):
        vehicle.step(HOVER)
    return {"times": ALONE_S / (time.process_time() - begin_s)}


def fused() -> dict[str, float]:
    """A step of the pose fusion with its share of measurements, ms."""
    return {"ms": fusion.cost_ms()[0]}


def paired() -> dict[str, float]:
    """Features and motion of a stereo pair, ms."""
    pairs = list(fly(inspection(1).select(slice(200, 200 + stereo.COUNT)), "hold", 1))
    return {"ms": float(np.mean(np.add(*stereo.costs_ms(pairs))))}


def turned() -> dict[str, float]:
    """From a pose's bytes to a setpoint's bytes, ms."""
    cuts = quantiles(asyncio.run(turnaround.fly()), n=100)
    return {"p50": 1e3 * cuts[49], "p99": 1e3 * cuts[98]}


def delayed() -> dict[str, float]:
    """A pose's delay as a multiple of that of Zenoh in its own thread."""
    found = network.measure()
    return {"ratio": network.ratio(found, lambda one: one.delay_us, network.OURS, network.RAW)}


def hosted() -> dict[str, float]:
    """The onboard process of a vehicle without cameras, in flight."""
    memory_mb, share = footprint.watch("patrol", "--platform", "pelican_rtk")["onboard"]
    return {"MB": memory_mb, "%": 100.0 * share}


def logged_by_foxglove() -> dict[str, float]:
    """A pose in the log by foxglove-sdk, µs."""

    def work() -> int:
        pose = PoseInFrame(
            frame_id="ned",
            pose=Pose(position=Vector3(x=1.0, y=2.0, z=-3.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        )
        with tempfile.TemporaryDirectory() as folder, foxglove.open_mcap(f"{folder}/log.mcap"):
            channel = PoseInFrameChannel("/pose")
            for number in range(20_000):
                channel.log(pose, log_time=number)
            channel.close()
        return 20_000

    return {"µs": best_us(work)}


def coded_by_pymavlink() -> dict[str, float]:
    """A MAVLink message encoded, found and decoded by pymavlink, µs."""

    def work() -> int:
        encoder, parser = common.MAVLink(None, 1, 1), common.MAVLink(None)
        for number in range(20_000):
            message = common.MAVLink_attitude_quaternion_message(number, 1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0)
            parser.parse_buffer(message.pack(encoder))
        return 20_000

    return {"µs": best_us(work)}


BENCHES: Final[Mapping[str, Callable[[], dict[str, float]]]] = {
    "patrol": patrol,
    "physics": physics,
    "inspection": inspected,
    "fusion": fused,
    "stereo": paired,
    "onboard": hosted,
    "zenoh": delayed,
    "turnaround": turned,
    "foxglove-sdk": logged_by_foxglove,
    "pymavlink": coded_by_pymavlink,
}


if __name__ == "__main__":
    found: dict[str, Any] = {
        f"{name} {unit}": value for name in sys.argv[1:] for unit, value in BENCHES[name]().items()
    }
    sys.stdout.buffer.write(msgspec.json.encode(found))
