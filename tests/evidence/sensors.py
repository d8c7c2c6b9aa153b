"""Samplers: bad data, calibrations, sources, and what it costs to look at what comes."""

import asyncio
from collections.abc import Callable
from functools import partial
from random import Random
from time import process_time
from typing import Any

import numpy as np
from tests.data_folders import PICTURES
from tests.direct_link import wire
from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite

from gloc3.clock import Clock, VirtualLoop
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import Image
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.sensors.checks.frame_check import FrameCheck
from gloc3_onboard.sensors.checks.scan_check import checked_scan
from gloc3_onboard.sensors.sources.autopilot import AutopilotImu
from gloc3_onboard.sensors.sources.euroc import stereo_records
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.world import World

TESTS = (
    "tests/onboard/components/samplers/test_bad_input_of_samplers.py",
    "tests/onboard/sensors/test_own_sensor_checks.py",
    "tests/onboard/autopilot/test_autopilot_sensors.py",
    "tests/onboard/sensors/test_source_urls.py",
    "tests/onboard/sensors/test_replays_of_logs.py",
    "tests/onboard/sensors/test_video_cameras.py",
    "tests/onboard/sensors/test_laser_scanners.py",
    "tests/onboard/sensors/test_v4l2_controls.py",
    "tests/onboard/sensors/test_rangers.py",
    "tests/onboard/sensors/test_realsense.py",
    "tests/onboard/sensors/test_velodyne.py",
    "tests/onboard/sensors/test_time_shifts.py",
    "tests/sitl/world/test_depth_camera.py",
    "tests/sitl/world/test_lidar.py",
    "tests/flight/test_seen_in_depth.py",
    "tests/onboard/process/test_onboard_on_logs.py",
    "tests/onboard/calibration",
)
REST = PICTURES / "euroc_rest"
ROUNDS = 400


def cost_ms(work: Callable[[int], object]) -> float:
    """Processor time of one call, in milliseconds."""
    for number in range(20):
        work(number)
    begin_s = process_time()
    for number in range(ROUNDS):
        work(number)
    return (process_time() - begin_s) / ROUNDS * 1e3


def frame_cost_ms() -> float:
    """Of looking at a picture of 640 x 480."""
    random, check = np.random.default_rng(1), FrameCheck()
    pictures = [
        Image(camera="a", width=640, height=480, data=random.integers(40, 200, 640 * 480, np.uint8).tobytes())
        for _ in range(8)
    ]
    return cost_ms(lambda number: check.problem(pictures[number % 8]))


def scan_cost_ms() -> float:
    """Of looking at a scan of 360 beams."""
    ranges = np.full(360, 5.0, "<f4")
    ranges[::7] = np.nan
    scan = LaserScan(
        scanner="a",
        angle_min_rad=0.0,
        angle_step_rad=0.01,
        range_min_m=0.1,
        range_max_m=30.0,
        ranges_m=ranges.tobytes(),
    )
    return cost_ms(lambda _: checked_scan(scan))


def imu_stamps(style: str) -> dict[str, Any]:
    """Rate of an autopilot's inertial unit and how its clock is mapped to ours, 20 s of a link with 5 ms of jitter."""
    loop = VirtualLoop()
    simulator = Simulator(World.load("hold"), SimulatorSettings(style=style, seed=2))
    cable = MemoryLink(loop, Random(5), Conditions(latency_s=0.002, jitter_s=0.005))
    cable.a.on_data = simulator.attach(cable.a.send, LinkKind.COMPANION)
    link = AutopilotLink(loop, Clock(loop))
    wire(link, cable.b, loop)
    simulator.start(loop)
    imu = AutopilotImu(link.sensors)
    imu.open()
    samples: list[float] = []
    offsets_s: list[float] = []
    last_s = float("-inf")
    for _ in range(220):
        loop.run_until_complete(asyncio.sleep(0.1))
        new = imu.samples(last_s)
        last_s = new[-1].t_s if new else last_s
        if loop.time() > 2.0:
            samples += [stamped.t_s for stamped in new]
            offsets_s.append(link.telemetry.t_s_of_boot(0.0) or 0.0)
    simulator.stop()
    link.close()
    loop.close()
    return {"rate_hz": len(samples) / 20.0, "spread_ms": float(np.ptp(offsets_s)) * 1e3}


def sensors(progress: Progress) -> list[Figure]:
    """Bars 2 and 6, as far as samplers go."""
    frame_ms = progress.part("frame", frame_cost_ms)
    scan_ms = progress.part("scan", scan_cost_ms)
    figures = [
        Figure("looking at a picture of 640 x 480, ms", f"{frame_ms:.3f}", "<= 0.3", frame_ms <= 0.3),
        Figure("looking at a scan of 360 beams, ms", f"{scan_ms:.3f}", "<= 0.1", scan_ms <= 0.1),
    ]
    for style in ("px4", "ardupilot"):
        found = progress.part(style, partial(imu_stamps, style))
        rate_hz, spread_ms = found["rate_hz"], found["spread_ms"]
        figures += [
            Figure(f"inertial unit of {style} over MAVLink, Hz", f"{rate_hz:.1f}", "95 to 105", 95 <= rate_hz <= 105),
            Figure(f"its clock is mapped to ours within, ms ({style})", f"{spread_ms:.2f}", "<= 1", spread_ms <= 1.0),
        ]
    if REST.is_dir():
        count = progress.part("euroc", _valid_pairs)
        figures.append(Figure("pairs of EuRoC V1_01 that are valid, of 40", str(count), "40", count == 40))
    return [*figures, *suite("sensors", TESTS)(progress)]


def _valid_pairs() -> int:
    checks = (FrameCheck(), FrameCheck())
    pairs = [record.load() for record in stereo_records(REST, ("left", "right"))]
    return sum(not checks[0].problem(left) and not checks[1].problem(right) for left, right in pairs)


BARS = (
    Bar(
        "sensors",
        "Samplers read sensors by configuration, and mark unusable data with a reason",
        "Samplers get their data from hardware, other processes and logs by configuration. Calibrations that do not "
        "fit and data that cannot be used are reported with a reason, and samplers recover on their own.",
        sensors,
        "hypothesis chooses, anew in every run",
    ),
)
