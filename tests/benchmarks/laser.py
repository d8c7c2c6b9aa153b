"""What laser odometry and obstacles cost: processor time for one scan of 360 beams."""

import time
from math import pi

import numpy as np
from tests.benchmarks.parts import best_us, yardstick
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner, flight

from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.mapping.obstacle_field import Detour, ObstacleField
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserOdometer
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount
from gloc3_onboard.sensors.checks.obstacles import obstacles_of

LENGTH_M = 40.0
BAR_MS = 2.0


def odometer_ms() -> list[float]:
    """Each scan of a flight in the hold."""
    random, odometer, scanner = np.random.default_rng(1), LaserOdometer(), Scanner(HOLD)
    costs = []
    for t_s, pose, tilt in flight(LENGTH_M):
        scan = scanner.scan(pose, random, tilt)
        begin_s = time.thread_time()
        odometer.update(scan, t_s, tilt)
        costs.append(1e3 * (time.thread_time() - begin_s))
    return costs[5:]


def obstacles() -> int:
    """Scans turned into obstacles."""
    random, scanner = np.random.default_rng(1), Scanner(HOLD)
    routes = [(scanner.scan(pose, random, tilt), pose, tilt) for _, pose, tilt in flight(4.0)]
    for scan, pose, tilt in routes * 4:
        obstacles_of(scan, tilt, Mount(), pose, Planar(), 1.5)
    return 4 * len(routes)


def detours() -> int:
    """Ways around what stands ahead."""
    points = [(3.0 * np.cos(a), 3.0 * np.sin(a)) for a in np.linspace(-pi, pi, 180)]
    field, detour = ObstacleField(points, (0.0, 0.0, 0.0), 0.8), Detour()
    for _ in range(1000):
        detour.heading(field, (0.0, 0.0, 0.0), 0.0, 5.0, 0.0)
    return 1000


def run() -> list[str]:
    """The costs, and each as a multiple of a plain Python loop's step."""
    load_opencv()
    unit = best_us(yardstick)
    costs = np.array(odometer_ms())
    lines = [
        f"a step of a plain Python loop            {unit * 1000:8.1f} ns",
        f"laser odometry, mean (bar: {BAR_MS:g} ms)         {costs.mean():8.2f} ms   {1e3 * costs.mean() / unit:6.0f} steps",
        f"laser odometry, p99 (bar: 4 ms)          {np.percentile(costs, 99):8.2f} ms",
    ]
    for name, work in (("obstacles of a scan", obstacles), ("a way around obstacles", detours)):
        lines.append(f"{name:<40} {best_us(work):8.1f} us")
    return lines
