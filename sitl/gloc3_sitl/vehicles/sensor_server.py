"""TCP server of the simulated cameras, the depth camera and the laser scanner, for companion processes on the same machine."""

import asyncio
import errno
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, Self

from gloc3.camera.frame_stream import (
    COLOUR,
    MOST_REQUEST_BYTES,
    CameraFrame,
    DepthFrame,
    ScanFrame,
    encode,
    encode_depth,
    encode_scan,
    read_stream_request,
)
from gloc3.errors import Refused
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.gimbal import SimulatedGimbal
from gloc3_sitl.vehicles.scene import Scene
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.depth_camera import SimulatedDepthCamera
from gloc3_sitl.world.laser import LaserScanner
from gloc3_sitl.world.tracker import TrackerCamera

MOST_CLIENTS: Final = 8
_POLL_PERIOD_S: Final = 0.01


class Feed(NamedTuple):
    """One sensor."""

    rate_hz: float
    take: Callable[[Truth], bytes]
    """Looks at the world; a record of the stream."""


class SensorServer:
    """Sends each client its requested sensors at their rates; slow clients miss data.

    Sensors without a client cost nothing. Sensors with equal rates sample the same instant.
    """

    def __init__(
        self, scene: Scene, loop: asyncio.AbstractEventLoop, seed: int, gimbal: SimulatedGimbal | None = None
    ) -> None:
        self._scene, self._loop = scene, loop
        self.feeds: Final[Mapping[str, Feed]] = _feeds(scene.world, seed, gimbal)
        """By name."""
        self._slots = dict.fromkeys(self.feeds, -1)
        self._clients: dict[asyncio.StreamWriter, frozenset[str]] = {}
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def port(self) -> int:
        """The port in use."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def open(self, port: int) -> Self:
        """Listens on loopback.

        Raises:
            Refused: the port is in use.
        """
        try:
            self._server = await asyncio.start_server(self._connected, "127.0.0.1", port, limit=MOST_REQUEST_BYTES)
        except OSError as error:
            reason = "it is in use by another program" if error.errno == errno.EADDRINUSE else error.strerror
            raise Refused(f"sensor port {port}: {reason}") from error
        self.feeds["ground"].take(self._scene.truth())  # to paint takes long, and time does not run yet
        self._tick()
        return self

    async def close(self) -> None:
        """Stops serving."""
        if self._timer is not None:
            self._timer.cancel()
        for client in self._clients:
            client.close()
        if self._server is not None:
            self._server.close()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Accepts a client that requests existing sensors; rejects others."""
        try:
            wanted = read_stream_request(await reader.readline())
        except (ValueError, ConnectionError):
            wanted = frozenset()
        if not wanted or not wanted <= self.feeds.keys() or len(self._clients) >= MOST_CLIENTS:
            writer.close()
        else:
            self._clients[writer] = wanted

    def _tick(self) -> None:
        self._timer = self._loop.call_later(_POLL_PERIOD_S, self._tick)
        self._clients = {client: wanted for client, wanted in self._clients.items() if not client.is_closing()}
        wanted = frozenset[str]().union(*self._clients.values())
        due = [name for name in self.feeds if name in wanted and self._is_due(name)]
        if not due:
            return
        truth = self._scene.truth()
        records = {name: self.feeds[name].take(truth) for name in due}
        for client, wish in self._clients.items():
            data = b"".join(record for name, record in records.items() if name in wish)
            if data and client.transport.get_write_buffer_size() < len(data):
                client.write(data)

    def _is_due(self, name: str) -> bool:
        slot = int(self._scene.now_s * self.feeds[name].rate_hz + 1e-6)
        is_new = slot != self._slots[name]
        self._slots[name] = slot
        return is_new


def _feeds(world: World, seed: int, gimbal: SimulatedGimbal | None) -> dict[str, Feed]:
    cameras: dict[str, SimulatedCamera | TrackerCamera] = {
        name: SimulatedCamera(world, model, imager, seed) for name, (model, imager) in rig.CAMERAS.items()
    }
    if world.file.tracker is not None:
        tracker = TrackerCamera(world, world.file.tracker, rig.TRACKER, rig.TRACKER_IMAGER, seed)
        cameras[rig.TRACKER_IMAGER.name] = tracker
    feeds = {name: Feed(camera.imager.rate_hz, _picture_of(camera)) for name, camera in cameras.items()}
    for name, camera in cameras.items():
        feeds[name + COLOUR] = Feed(camera.imager.rate_hz, _picture_of(camera, is_coloured=True))
    if gimbal is not None:
        on_gimbal, name = SimulatedCamera(world, rig.GIMBAL, rig.GIMBAL_IMAGER, seed), rig.GIMBAL_IMAGER.name
        for ending in ("", COLOUR):
            take = _picture_of(on_gimbal, is_coloured=bool(ending))
            feeds[name + ending] = Feed(rig.GIMBAL_IMAGER.rate_hz, _carried(take, gimbal))
    depth = SimulatedDepthCamera(world, rig.DEPTH, rig.DEPTH_IMAGER, seed)
    feeds[rig.DEPTH_IMAGER.name] = Feed(rig.DEPTH_IMAGER.rate_hz, _depth_of(depth))
    feeds[rig.LASER.name] = Feed(rig.LASER.rate_hz, _scan_of(LaserScanner(world, rig.LASER, seed)))
    return feeds


def _picture_of(camera: SimulatedCamera | TrackerCamera, *, is_coloured: bool = False) -> Callable[[Truth], bytes]:
    """Takes pictures; those of the tracker are grey in any case."""

    def handle(truth: Truth) -> bytes:
        if isinstance(camera, SimulatedCamera):
            camera.is_coloured = is_coloured
        photo = camera.capture(truth)
        height, width = photo.pixels.shape
        bgr = b"" if photo.bgr is None else photo.bgr.tobytes()
        return encode(
            CameraFrame(round(truth.t_s * 1e6), camera.imager.name, width, height, photo.pixels.tobytes(), bgr)
        )

    return handle


def _carried(take: Callable[[Truth], bytes], gimbal: SimulatedGimbal) -> Callable[[Truth], bytes]:
    """Looks from the gimbal."""
    return lambda truth: take(gimbal.carrying(truth))


def _depth_of(camera: SimulatedDepthCamera) -> Callable[[Truth], bytes]:
    def handle(truth: Truth) -> bytes:
        depth = camera.capture(truth)
        return encode_depth(
            DepthFrame(
                round(truth.t_s * 1e6),
                depth.camera,
                depth.width,
                depth.height,
                depth.scale_m,
                depth.range_min_m,
                depth.range_max_m,
                depth.data,
            )
        )

    return handle


def _scan_of(scanner: LaserScanner) -> Callable[[Truth], bytes]:
    def handle(truth: Truth) -> bytes:
        scan = scanner.scan(truth)
        return encode_scan(
            ScanFrame(
                round(truth.t_s * 1e6),
                scan.scanner,
                scan.angle_min_rad,
                scan.angle_step_rad,
                scan.range_min_m,
                scan.range_max_m,
                scan.duration_s,
                scan.ranges_m,
            )
        )

    return handle
