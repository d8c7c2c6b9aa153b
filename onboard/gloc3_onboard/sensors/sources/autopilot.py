"""The autopilot's sensors as devices of samplers; their messages are requested when opened."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from gloc3.errors import Refused, nearest
from gloc3_onboard.autopilot.sensors import IMU_HZ, SCAN_HZ, AutopilotSensors
from gloc3_onboard.sensors.devices import StampedImu, StampedScan, Unwatch
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import RATE

RANGES: Final = "distance_sensor"
OBSTACLES: Final = "obstacle_distance"


class AutopilotImu:
    """The inertial unit that the autopilot flies by."""

    def __init__(self, sensors: AutopilotSensors, rate_hz: float = IMU_HZ) -> None:
        self._sensors, self._rate_hz = sensors, rate_hz

    def open(self) -> None:
        """Asks for its samples."""
        self._sensors.want("imu", self._rate_hz)

    def close(self) -> None:
        """Ends the subscription; the sensor continues."""

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a sample has come."""
        return self._sensors.imu_bell.listen(ready)

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """What it felt after a time."""
        return self._sensors.samples(after_s)


class ObstacleDistance:
    """The range scanner behind the autopilot's OBSTACLE_DISTANCE."""

    def __init__(self, sensors: AutopilotSensors, rate_hz: float = SCAN_HZ) -> None:
        self._sensors, self._rate_hz = sensors, rate_hz

    def open(self) -> None:
        """Asks for its scans."""
        self._sensors.want("obstacles", self._rate_hz)

    def close(self) -> None:
        """Ends the subscription; the sensor continues."""

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a scan has come."""
        return self._sensors.obstacles_bell.listen(ready)

    def scan(self) -> StampedScan | None:
        """The latest."""
        return self._sensors.obstacles


class DistanceSensors:
    """Horizontal range finders from DISTANCE_SENSOR, as a scanner of eight beams."""

    def __init__(self, sensors: AutopilotSensors, rate_hz: float = 2.0 * SCAN_HZ) -> None:
        self._sensors, self._rate_hz = sensors, rate_hz

    def open(self) -> None:
        """Asks for them."""
        self._sensors.want("ranges", self._rate_hz)

    def close(self) -> None:
        """Ends the subscription; the sensor continues."""

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Calls `ready` when a range arrives."""
        return self._sensors.ranges_bell.listen(ready)

    def scan(self) -> StampedScan | None:
        """The latest of each."""
        return self._sensors.ranges


def _make(request: SourceRequest) -> Any:
    name, url, sensors = request.device, request.url, request.host.sensors
    if sensors is None:
        raise Refused(f"{name}: {url.text!r}: the autopilot's link is in the main process of the clock host alone")
    if request.sensor.name == "imu":
        return AutopilotImu(sensors, url.number("rate_hz", IMU_HZ))
    if request.sensor.name == "height":
        return request.host.height
    if url.part == RANGES:
        return DistanceSensors(sensors, url.number("rate_hz", 2.0 * SCAN_HZ))
    if url.part not in ("", OBSTACLES):
        raise Refused(f"{name}: {url.text!r}: {nearest(url.part, [RANGES, OBSTACLES])}")
    return ObstacleDistance(sensors, url.number("rate_hz", SCAN_HZ))


SOURCES: Final = (
    SourceKind(
        "autopilot",
        ("laser", "imu", "height"),
        "autopilot://",
        _make,
        RATE,
        takes_place=False,
        takes_part=True,
    ),
)
