"""Costs of the simulated world: pictures with distortion and noise, laser scans, the tracker; along a lap of the hold."""

import time
from collections.abc import Callable

import numpy as np

from gloc3.camera.opencv import load_opencv
from gloc3_sitl.cli.record import lap
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sequences.smooth_flight import SmoothFlight
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.laser import LaserScanner
from gloc3_sitl.world.probe import WorldProbe
from gloc3_sitl.world.tracker import TrackerCamera

FRAMES = 60


def each_ms(poll: Callable[[Truth], object], truths: list[Truth]) -> list[float]:
    """Processor time of this thread for each look, the first, which prepares, aside."""
    poll(truths[0])
    costs = []
    for truth in truths:
        begin_s = time.thread_time()
        poll(truth)
        costs.append(1e3 * (time.thread_time() - begin_s))
    return costs


def costs_ms(poll: Callable[[Truth], object], truths: list[Truth]) -> tuple[float, float]:
    """Mean and worst of them."""
    costs = each_ms(poll, truths)
    return float(np.mean(costs)), max(costs)


def remap_ms() -> float:
    """One remap of a picture of the same size, to compare machines and moments by."""
    cv2 = load_opencv()
    rows, columns = np.mgrid[0:480, 0:640].astype(np.float32)
    coarse, fine = cv2.convertMaps(columns * 0.98 + 3.0, rows * 0.97 + 4.0, cv2.CV_16SC2)
    picture = np.random.default_rng(1).integers(0, 255, (480, 640)).astype(np.uint8)
    best = float("inf")
    for _ in range(5):
        begin_s = time.thread_time()
        for _ in range(20):
            cv2.remap(picture, coarse, fine, cv2.INTER_LINEAR)
        best = min(best, 1e3 * (time.thread_time() - begin_s) / 20.0)
    return best


def lap_truths(world: World, count: int = FRAMES) -> list[Truth]:
    """Where the vehicle is at times spread over a lap at 0.6 m/s."""
    flight = SmoothFlight(world, lap(world, 1.5), 0.6)
    return [flight.truth(flight.duration_s * number / count) for number in range(count)]


def looks(world: World) -> dict[str, Callable[[Truth], object]]:
    """What is measured."""
    found: dict[str, Callable[[Truth], object]] = {
        f"a picture of {name}, {model.lens} lens": SimulatedCamera(world, model, imager).capture
        for name, (model, imager) in rig.CAMERAS.items()
    }
    if world.file.tracker is not None:
        found["a picture of the tracker"] = TrackerCamera(
            world, world.file.tracker, rig.TRACKER, rig.TRACKER_IMAGER
        ).capture
    found["a laser scan of 360 beams"] = LaserScanner(world, rig.LASER).scan
    probe = WorldProbe(world)
    found["a height"] = lambda truth: probe(truth, 0.0)
    return found


def run() -> list[str]:
    """The costs, and each as a multiple of one remap of a picture."""
    unit_ms = remap_ms()
    lines = [f"one remap of 640x480                           {unit_ms:7.2f} ms"]
    for name in ("hold", "hold_hard"):
        world = World.load(name)
        truths = lap_truths(world)
        for what, poll in looks(world).items():
            mean_ms, worst_ms = costs_ms(poll, truths)
            lines.append(
                f"{name + ': ' + what:46} {mean_ms:7.2f} ms mean, {worst_ms:6.2f} worst  ({mean_ms / unit_ms:5.1f} remaps)"
            )
    return lines
