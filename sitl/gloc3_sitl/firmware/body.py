"""A simulated vehicle without an autopilot: physics and sensors in a world, stepped by motor outputs."""

from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.errors import Misuse
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.ground import PERIOD_STEPS, raise_ground
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.sensors.battery import Battery
from gloc3_sitl.sensors.imu import SimulatedImu
from gloc3_sitl.sensors.range_finder import level_ground
from gloc3_sitl.sensors.readings import Reading
from gloc3_sitl.sensors.suite import SensorSuite
from gloc3_sitl.vehicles.table import vehicle_named
from gloc3_sitl.world import World
from gloc3_sitl.world.probe import WorldProbe


class BodySettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of the simulated body."""

    vehicle: str = "pelican"
    """What flies, by the name of a model."""
    seed: int = 0
    """Of turbulence and of all sensor noise."""
    wind: Wind = CALM
    """What the air does."""
    is_without_gps: bool = False
    """No fixes at all."""
    is_plain_gps: bool = False
    """Metre-level fixes in place of RTK-grade ones."""


class SensedBody:
    """One vehicle with its sensors in one world; the same outputs give the same flight, bit for bit.

    Args:
        world: scene of the flight.
        settings: vehicle and sensors.
        rate_hz: steps of the physics, and samples of the inertial unit, per second.
    """

    def __init__(self, world: World, settings: BodySettings, rate_hz: int) -> None:
        self.world: Final = world
        self.settings: Final = settings
        self.rate_hz: Final = rate_hz
        self._is_flat = world.is_flat
        self._make()

    def _make(self) -> None:
        settings, world = self.settings, self.world
        row = vehicle_named(settings.vehicle)
        self.vehicle_class, self._is_diving = row.vehicle_class, row.is_diving
        self._needed = len(row.vehicle_class.output_numbers)
        self.body = row.body(
            Situation(
                home=world.home,
                wind=settings.wind,
                water=world.water,
                seed=settings.seed,
                rate_hz=self.rate_hz,
                heading_deg=world.heading_deg,
            )
        )
        self.sensors = SensorSuite(
            settings.seed,
            world.home,
            imu=SimulatedImu(settings.seed, float(self.rate_hz), row.imu_bias_share),
            battery=Battery(settings.seed, row.pack),
            is_plain_gps=settings.is_plain_gps,
            probe=level_ground if self._is_flat else WorldProbe(world),
            more=row.sensors(settings.seed, world.home),
        )
        if settings.is_without_gps:
            self.sensors.fail("fix", "lost")

    def restart(self) -> None:
        """Restarts: at home, at rest, at time 0."""
        self._make()

    def step(self, outputs: Sequence[float]) -> list[Reading]:
        """Advances by one step.

        Args:
            outputs: as the body takes them (of a quadrotor: front right, rear left, front left, rear right, 0 to 1);
                more are ignored.

        Returns:
            The readings that arrive now.

        Raises:
            Misuse: there are fewer.
        """
        needed = self._needed
        if len(outputs) < needed:
            raise Misuse(f"{needed} outputs are needed, not {len(outputs)}")
        body = self.body
        body.step(tuple(outputs[:needed]))
        now_s = body.now_s
        if not self._is_flat and body.steps % PERIOD_STEPS == 0:
            raise_ground(body, self.world, now_s, is_diving=self._is_diving)
        return self.sensors.sample(body, now_s)

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self.body.now_s

    def truth(self) -> Truth:
        """What the vehicle really does now."""
        return self.body.truth()
