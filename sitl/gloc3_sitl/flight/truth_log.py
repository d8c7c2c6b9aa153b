"""Logs a simulated vehicle's ground truth, separately from the processes that must not see it."""

import asyncio
from pathlib import Path
from typing import Final

from gloc3.clock import Clock
from gloc3.exchange import LocalExchange, Publisher
from gloc3.log.record import Recorder
from gloc3.messages.frames import TangentPlane
from gloc3.messages.topics import TopicTable
from gloc3_sitl.flight.messages import TOPICS, SimTruth
from gloc3_sitl.vehicles.scene import Scene

PERIOD_S: Final = 0.1


class TruthLog:
    """`truth.mcap` in a folder: `sim/truth` at 10 Hz, in NED at the origin of the world's frame, on the wall clock."""

    def __init__(self, scene: Scene, loop: asyncio.AbstractEventLoop, out: Path, platform: str) -> None:
        out.mkdir(parents=True, exist_ok=True)
        clock, exchange = Clock(loop), LocalExchange()
        self._scene, self._loop = scene, loop
        self._recorder = Recorder(out / "truth.mcap", clock, TopicTable(TOPICS), {"platform": platform})
        self._recorder.attach(exchange, loop)
        self._publisher = Publisher(exchange, platform, "simulator", 0)
        self._topic = f"{platform}/sim/truth"
        self._plane = TangentPlane(scene.world.frame.origin)
        self._timer: asyncio.TimerHandle | None = None
        self._tick()

    def close(self) -> None:
        """Finishes the log."""
        if self._timer is not None:
            self._timer.cancel()
        self._recorder.close()

    def _tick(self) -> None:
        truth = self._scene.truth()
        message = SimTruth(
            position_ned_m=self._plane.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m),
            velocity_ned_m_s=truth.velocity_ned_m_s,
            ned_from_frd=truth.attitude_wxyz,
            wind_ned_m_s=truth.wind_ned_m_s,
        )
        self._publisher.publish(self._topic, message, self._loop.time(), "ned")
        self._timer = self._loop.call_later(PERIOD_S, self._tick)
