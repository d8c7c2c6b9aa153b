"""What the pose fusion costs with everything that comes from a pelican's sensors, in processor time."""

import time
from typing import Any

from tests.onboard.algorithms.fusion.flown import inspection, sensors_of
from tests.onboard.algorithms.fusion.fly import Recorder

from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

BAR_MS = 0.1
REPEATS = 5


def cost_ms(until_s: float = 1e9) -> tuple[float, float]:
    """Milliseconds for each step of the inertial unit: with all measurements that come in between, and without."""
    calls = Recorder.of(inspection(), sensors_of("pelican", 0), until_s)
    steps = [call for call in calls if call[0] == "imu"]
    return _best_ms(calls, len(steps)), _best_ms(steps, len(steps))


def _best_ms(calls: list[tuple[str, Any]], steps: int) -> float:
    best = float("inf")
    for _ in range(REPEATS):
        fusion = PoseFusion(Recorder.SETTINGS)
        bound = [(getattr(fusion, name), arguments) for name, arguments in calls]
        begin_s = time.thread_time()
        for method, arguments in bound:
            method(*arguments)
        best = min(best, time.thread_time() - begin_s)
    return best / steps * 1e3


def run() -> list[str]:
    """The costs."""
    whole, alone = cost_ms()
    return [
        f"fusion, an inertial step at 100 Hz         {alone:6.3f} ms",
        f"the same with its share of 70 measurements {whole:6.3f} ms   bar {BAR_MS:g} ms",
    ]
