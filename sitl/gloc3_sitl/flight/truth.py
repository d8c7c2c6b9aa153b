"""Ground truth of a flight in virtual time, for its log and its tests."""

import asyncio
from collections.abc import Callable
from math import isfinite
from typing import Final

from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.vehicle import Pose
from gloc3_sitl.flight.messages import SimFault, SimTruth
from gloc3_sitl.flight.path_error import TruthSample
from gloc3_sitl.physics.truth import Truth

TRUTH_PERIOD_S: Final = 0.1


class FlightTruth:
    """Publishes the truth at 10 Hz, in the frame of the vehicle's pose, stamped with the time of the physics' last step.

    Args:
        exchange: of the flight.
        platform: the platform's name.
        loop: the virtual time.
        boot: a random number.
        truth: reads the state of the simulated vehicle.
        sank: receives the depth below the frame's origin, m.
        surface_m: altitude of the water's surface, from which what dives counts its depth, whatever altitude its receiver
            has given the frame's origin; None for other vehicles.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: str,
        loop: asyncio.AbstractEventLoop,
        boot: int,
        truth: Callable[[], Truth],
        sank: Callable[[float], None],
        surface_m: float | None = None,
    ) -> None:
        self.samples: Final[list[TruthSample]] = []
        """True positions, in the frame of the pose."""
        self.frame: TangentPlane | None = None
        """Frame of the pose; None until its origin is known."""
        self._platform, self._loop, self._truth, self._sank = platform, loop, truth, sank
        self._surface_m = surface_m
        self._publisher = Publisher(exchange, platform, "simulator", boot)
        self._timer: asyncio.TimerHandle | None = None
        exchange.subscribe(f"{platform}/pose", self._receive_pose)

    def begin(self) -> None:
        """Begins to publish it."""
        if self.frame is not None:
            truth = self._truth()
            position = self.frame.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
            self.samples.append(TruthSample(truth.t_s, position))
            self._sank(position[2])
            message = SimTruth(
                position_ned_m=position,
                velocity_ned_m_s=truth.velocity_ned_m_s,
                ned_from_frd=truth.attitude_wxyz,
                wind_ned_m_s=truth.wind_ned_m_s,
            )
            self._publisher.publish(f"{self._platform}/sim/truth", message, truth.t_s, "ned")
        self._timer = self._loop.call_later(TRUTH_PERIOD_S, self.begin)

    def publish_fault(self, fault: SimFault) -> None:
        """Publishes the begin or end of a fault."""
        self._publisher.publish(f"{self._platform}/sim/fault", fault, self._loop.time())

    def close(self) -> None:
        """Stops publishing."""
        if self._timer is not None:
            self._timer.cancel()

    def _receive_pose(self, envelope: Envelope[Pose]) -> None:
        origin = envelope.payload.origin_geo
        if self.frame is None and origin is not None and all(map(isfinite, origin)):
            latitude_deg, longitude_deg, altitude_m = origin
            if self._surface_m is not None:
                altitude_m = self._surface_m
            self.frame = TangentPlane(GeoPoint(latitude_deg, longitude_deg, altitude_m))
