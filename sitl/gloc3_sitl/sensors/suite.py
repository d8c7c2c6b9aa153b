"""All sensors of a vehicle, sampled together, with faults injected by name."""

from collections.abc import Sequence
from typing import Any, Final

from gloc3.errors import Misuse
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.barometer import Barometer
from gloc3_sitl.sensors.battery import Battery
from gloc3_sitl.sensors.fix import PLAIN_GPS, RTK, FixSensor
from gloc3_sitl.sensors.imu import SimulatedImu
from gloc3_sitl.sensors.magnetometer import Magnetometer
from gloc3_sitl.sensors.range_finder import HeightSensor, Probe, level_ground
from gloc3_sitl.sensors.readings import Reading
from gloc3_sitl.sensors.sensor import FaultMode, SimulatedSensor
from gloc3_sitl.vehicles import PELICAN


class SensorSuite:
    """The sensors of a vehicle; each has its own noise, derived from one seed.

    Args:
        seed: Seed of all noise and biases.
        home: Start of the flight; location of the magnetic field.
        imu: The vehicle's inertial unit; None for a multirotor's.
        battery: Its battery; None for the Pelican's.
        is_plain_gps: Metre-level fixes in place of RTK-grade ones.
        probe: What the height sensor measures.
        more: Further sensors; one replaces a sensor of the same name.
    """

    def __init__(
        self,
        seed: int,
        home: GeoPoint,
        *,
        imu: SimulatedImu | None = None,
        battery: Battery | None = None,
        is_plain_gps: bool = False,
        probe: Probe = level_ground,
        more: Sequence[SimulatedSensor[Any]] = (),
    ) -> None:
        self.imu: Final = imu or SimulatedImu(seed)
        self.barometer: Final = Barometer(seed)
        self.magnetometer: Final = Magnetometer(seed, home)
        self.height: Final = HeightSensor(seed, probe=probe)
        self.fix: Final = FixSensor(seed, home, PLAIN_GPS if is_plain_gps else RTK)
        self.battery: Final = battery or Battery(seed, PELICAN)
        usual: tuple[SimulatedSensor[Any], ...] = (
            self.barometer,
            self.magnetometer,
            self.height,
            self.fix,
            self.battery,
        )
        slow = {sensor.name: sensor for sensor in (*usual, *more)}
        self._slow: tuple[SimulatedSensor[Any], ...] = tuple(slow.values())
        self._sensors = {sensor.name: sensor for sensor in (self.imu, *self._slow)}
        self._due_s = 0.0

    @property
    def names(self) -> list[str]:
        """Of those that can be made to fail."""
        return list(self._sensors)

    def sample(self, motion: TrueMotion, now_s: float) -> list[Reading]:
        """Readings that arrive now; call at least at the rate of the IMU.

        Args:
            motion: The simulated vehicle, whose truth is computed only when a sensor needs it, or one `Truth`.
            now_s: Time on the simulation's clock, not less than in the previous call.
        """
        out: list[Reading] = []
        self.imu.poll(motion, now_s, out)
        if now_s >= self._due_s - 1e-6:
            for sensor in self._slow:
                if now_s >= sensor.due_s - 1e-6:
                    sensor.poll(motion, now_s, out)
            self._due_s = min(sensor.due_s for sensor in self._slow)
        return out

    def fail(self, name: str, mode: str, size: float | None = None, direction: Vector3 = (1.0, 0.0, 0.0)) -> None:
        """Injects a fault.

        Args:
            name: `imu`, `barometer`, `magnetometer`, `height`, `fix` or `battery`.
            mode: One of `FaultMode`: lost, stuck, biased, noisy, late, old, scaled.
            size: Bias or noise deviation in the sensor's fault unit, or seconds of lateness, share; each sensor has a
                default.
            direction: Axes that a bias acts on.
        """
        if mode not in list(FaultMode):
            raise Misuse(f"unknown fault mode {mode!r}; known: {', '.join(FaultMode)}")
        self._named(name).fail(FaultMode(mode), size, direction)

    def correct(self, corrections: bytes, now_s: float) -> None:
        """Gives the satellite receiver corrections of a base, as RTCM 3."""
        receiver = self._named(self.fix.name)
        if isinstance(receiver, FixSensor):
            receiver.correct(corrections, now_s)

    def repair(self, name: str) -> None:
        """End a sensor's fault."""
        self._named(name).fault = None

    def _named(self, name: str) -> SimulatedSensor[Any]:
        if name not in self._sensors:
            raise Misuse(f"unknown sensor {name!r}; known: {', '.join(self._sensors)}")
        return self._sensors[name]
