"""Makes the devices of a platform from their URLs."""

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from gloc3.errors import Refused, nearest
from gloc3.messages.perception import BottomVelocity, ImuSample, LaserScan
from gloc3.messages.vehicle import HeightAboveGround, Image
from gloc3_onboard.autopilot.sensor_devices import AutopilotImu, DistanceSensors, ObstacleDistance
from gloc3_onboard.autopilot.sensors import IMU_HZ, SCAN_HZ, AutopilotSensors
from gloc3_onboard.sensors.devices import HeightSensor
from gloc3_onboard.sources import carmen, euroc, kitti, mcap
from gloc3_onboard.sources.dvl import DvlSource
from gloc3_onboard.sources.hokuyo import HokuyoLaser
from gloc3_onboard.sources.none import NoSource
from gloc3_onboard.sources.pairs import PairedCameras, SideBySide
from gloc3_onboard.sources.replay import (
    LogTime,
    ReplayCamera,
    ReplayDvl,
    ReplayHeight,
    ReplayImu,
    ReplayLaser,
    ReplayStereoCamera,
)
from gloc3_onboard.sources.rplidar import RpLidar
from gloc3_onboard.sources.stream import StreamCamera, StreamLaser, StreamStereoCamera
from gloc3_onboard.sources.url import Sensor, SourceUrl, address_of, parse_source, sensor_of
from gloc3_onboard.sources.video import VideoCamera

WITHIN_S = 0.005
"""How far apart in time the frames of a pair may be, unless the URL says so."""
RANGES = "distance_sensor"
OBSTACLES = "obstacle_distance"


class SourceHost(NamedTuple):
    """What sources are made with."""

    loop: asyncio.AbstractEventLoop
    folder: Path
    """To which files are relative."""
    t_s_of_boot: Callable[[float], float | None]
    """Maps the vehicle's time since boot to ours."""
    sensors: AutopilotSensors | None = None
    height: HeightSensor | None = None
    """The autopilot's own; None in a process without its link."""


def camera_name(device: str) -> str:
    """What the pictures of a camera are called: `ground_camera` takes those of *ground*."""
    return device.removesuffix("camera").rstrip("_") or "camera"


def pair_names(device: str) -> tuple[str, str]:
    """What the pictures of a stereo camera are called: those of `stereo_camera` are *front_left* and *front_right*."""
    name = device.removesuffix(Sensor.STEREO).rstrip("_") or "front"
    return f"{name}_left", f"{name}_right"


def make_sources(urls: Mapping[str, str], host: SourceHost) -> dict[str, Any]:
    """The devices by name.

    Args:
        urls: their sources, by device; all that a platform has.
        host: what they are made with.

    Raises:
        Refused: a source is wrong.
    """
    parsed = {name: parse_source(name, text) for name, text in sorted(urls.items())}
    maker = _Maker(host, parsed)
    return {name: maker.make(name) for name in parsed}


class _Maker:
    def __init__(self, host: SourceHost, urls: Mapping[str, SourceUrl]) -> None:
        self._host, self._urls = host, urls
        self._times: dict[tuple[str, str], LogTime] = {}

    def make(self, name: str) -> Any:
        url, sensor = self._urls[name], sensor_of(name)
        now_s = self._host.loop.time
        match url.scheme:
            case "none":
                return NoSource()
            case "pair":
                return self._pair(name, url)
            case "rplidar":
                return RpLidar(name, url, now_s)
            case "hokuyo":
                return HokuyoLaser(name, url, now_s)
            case "a50" | "pd6":
                return DvlSource(name, url, now_s)
            case "autopilot":
                return self._autopilot(name, url, sensor)
            case "tcp":
                return self._stream(name, url, sensor)
            case "euroc" | "kitti" | "carmen" | "mcap":
                return self._replay(name, url, sensor)
        camera = VideoCamera(camera_name(name), url, self._host.folder, now_s)
        return SideBySide(camera, pair_names(name)) if sensor is Sensor.STEREO else camera

    def _pair(self, name: str, url: SourceUrl) -> PairedCameras:
        sides = url.place.split(",")
        known = [device for device in self._urls if sensor_of(device) is Sensor.CAMERA]
        if len(sides) != 2:
            raise Refused(f"{name}: {url.text!r}: name two cameras, as in pair://left_camera,right_camera")
        for side in sides:
            if side not in known:
                raise Refused(f"{name}: there is no camera {side!r}; {nearest(side, known)}")
        left, right = (self.make(side) for side in sides)
        return PairedCameras(left, right, url.number("within_s", WITHIN_S))

    def _autopilot(self, name: str, url: SourceUrl, sensor: Sensor | None) -> Any:
        sensors = self._host.sensors
        if sensors is None:
            raise Refused(f"{name}: {url.text!r}: the autopilot's link is in the main process of the clock host alone")
        if sensor is Sensor.IMU:
            return AutopilotImu(sensors, url.number("rate_hz", IMU_HZ))
        if sensor is Sensor.HEIGHT:
            return self._host.height
        if url.part == RANGES:
            return DistanceSensors(sensors, url.number("rate_hz", 2.0 * SCAN_HZ))
        if url.part not in ("", OBSTACLES):
            raise Refused(f"{name}: {url.text!r}: {nearest(url.part, [RANGES, OBSTACLES])}")
        return ObstacleDistance(sensors, url.number("rate_hz", SCAN_HZ))

    def _stream(self, name: str, url: SourceUrl, sensor: Sensor | None) -> Any:
        address, t_s_of = address_of(name, url), self._host.t_s_of_boot
        if sensor is Sensor.STEREO:
            return StreamStereoCamera(pair_names(name), address, t_s_of)
        if sensor is Sensor.LASER:
            return StreamLaser(name, address, t_s_of, url.part)
        return StreamCamera(camera_name(name), address, t_s_of, url.part)

    def _replay(self, name: str, url: SourceUrl, sensor: Sensor | None) -> Any:
        path = url.path(self._host.folder)
        loop = self._host.loop
        time = self._times.setdefault((url.scheme, str(path)), LogTime(url.number("skip_s", 0.0)))
        index = _index(name, url, sensor, path)
        match sensor:
            case Sensor.STEREO:
                return ReplayStereoCamera(loop, time, index)
            case Sensor.LASER:
                return ReplayLaser(loop, time, index)
            case Sensor.IMU:
                return ReplayImu(loop, time, index)
            case Sensor.HEIGHT:
                return ReplayHeight(loop, time, index)
            case Sensor.DVL:
                return ReplayDvl(loop, time, index)
        return ReplayCamera(loop, time, index)


def _index(name: str, url: SourceUrl, sensor: Sensor | None, path: Path) -> Callable[[], Any]:
    """What reads the log when the device is opened."""
    pair, rate_hz = pair_names(name), url.number("rate_hz", kitti.RATE_HZ)
    match url.scheme, sensor:
        case "carmen", _:
            return partial(carmen.scan_records, path, name, url.number("max_m", 0.0) or None)
        case "euroc", Sensor.STEREO:
            return partial(euroc.stereo_records, path, pair)
        case "euroc", Sensor.IMU:
            return partial(euroc.imu_records, path, url.part or "imu0")
        case "euroc", _:
            return partial(euroc.camera_records, path, url.part or "cam0", camera_name(name))
        case "kitti", Sensor.STEREO:
            return partial(kitti.stereo_records, path, url.part, pair, rate_hz)
        case "kitti", _:
            return partial(kitti.camera_records, path, url.part, camera_name(name), rate_hz)
        case _, Sensor.STEREO:
            left, _, right = url.part.partition(",")
            return partial(mcap.stereo_records, path, (left or f"camera/{pair[0]}", right or f"camera/{pair[1]}"))
        case _, Sensor.CAMERA if url.part == mcap.RECORDED:
            return partial(mcap.recorded_pictures, path, camera_name(name))
        case _, Sensor.LASER:
            return partial(mcap.topic_records, path, url.part or "laser", LaserScan)
        case _, Sensor.IMU:
            return partial(mcap.topic_records, path, url.part or "imu", ImuSample)
        case _, Sensor.DVL:
            return partial(mcap.topic_records, path, url.part or "dvl", BottomVelocity)
        case _, Sensor.HEIGHT:
            return partial(mcap.topic_records, path, url.part or "height", HeightAboveGround)
    return partial(mcap.topic_records, path, url.part or f"camera/{camera_name(name)}", Image)
