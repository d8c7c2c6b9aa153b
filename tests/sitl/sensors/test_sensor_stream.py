"""Simulated sensors over TCP: their data reaches the onboard process's devices, across breaks, and damage does not."""

import asyncio
import socket
from collections.abc import Callable

import pytest

from gloc3.camera.frame_stream import CameraFrame, encode
from gloc3.errors import Refused
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.sources.stream import StreamCamera, StreamDepthCamera, StreamLaser, StreamStereoCamera
from gloc3_sitl.vehicles.sensor_server import SensorServer
from gloc3_sitl.vehicles.simulator import Simulator
from gloc3_sitl.world import World

pytestmark = pytest.mark.sockets

OFFSET_S = 1000.0
WITHIN_S = 20.0


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(WITHIN_S):
        while not is_so():
            await asyncio.sleep(0.02)


async def frame_after(camera: StreamCamera, t_s: float) -> StampedImage:
    def has_come() -> bool:
        frame = camera.frame()
        return frame is not None and frame.t_s > t_s

    await until(has_come)
    frame = camera.frame()
    assert frame is not None
    return frame


async def test_pictures_of_the_simulator_arrive_with_the_time_of_their_exposure() -> None:
    simulator, loop = Simulator(World.load("hold")), asyncio.get_running_loop()
    server = await SensorServer(simulator, loop, 0).open(0)
    camera = StreamCamera("belly", ("127.0.0.1", server.port), lambda boot_s: boot_s + OFFSET_S, "ground")
    camera.open()
    simulator.start(loop)
    try:
        first = await frame_after(camera, 0.0)
        second = await frame_after(camera, first.t_s)
    finally:
        simulator.stop()
        camera.close()
        await server.close()
    assert OFFSET_S <= first.t_s < second.t_s < OFFSET_S + WITHIN_S
    image = second.image
    assert image.camera == "belly"
    assert len(image.data) == image.width * image.height
    assert len(set(image.data)) > 10, "it shows something"
    assert len(image.bgr) == 3 * len(image.data)


async def test_pairs_scans_and_the_tracker_arrive_beside_each_other_and_nothing_else_is_looked_at() -> None:
    simulator, loop = Simulator(World.load("hold")), asyncio.get_running_loop()
    server = await SensorServer(simulator, loop, 0).open(0)
    address = ("127.0.0.1", server.port)
    stereo = StreamStereoCamera(("front_left", "front_right"), address, lambda boot_s: boot_s)
    laser = StreamLaser("laser", address, lambda boot_s: boot_s)
    tracker = StreamCamera("tracker", address, lambda boot_s: boot_s)
    depth = StreamDepthCamera("nose_depth", address, lambda boot_s: boot_s, "depth")
    grey = StreamCamera("ground", address, lambda boot_s: boot_s, pixels="")
    stranger = StreamCamera("nose", address, lambda boot_s: boot_s)
    devices = (stereo, laser, tracker, depth, grey, stranger)
    for device in devices:
        device.open()
    simulator.start(loop)
    try:
        await until(lambda: None not in (stereo.pair(), laser.scan(), tracker.frame(), depth.depth(), grey.frame()))
        pair, turn, frame = stereo.pair(), laser.scan(), tracker.frame()
        await until(lambda: stereo.pair() is not pair)
    finally:
        simulator.stop()
        for device in devices:
            device.close()
        await server.close()
    assert pair is not None
    assert turn is not None
    assert frame is not None
    assert pair.left.data != pair.right.data
    assert (pair.left.camera, pair.right.camera) == ("front_left", "front_right")
    assert turn.scan.range_max_m == pytest.approx(30.0)
    assert len(turn.scan.ranges_m) == 4 * 360
    stamped = depth.depth()
    assert stamped is not None
    assert stamped.depth.camera == "nose_depth"
    assert (stamped.depth.width, stamped.depth.height, len(stamped.depth.data)) == (160, 90, 28_800)
    assert (stamped.depth.scale_m, stamped.depth.range_max_m) == pytest.approx((0.001, 10.0))
    assert any(stamped.depth.data)
    assert max(frame.image.data) > 200, "the light of the vehicle"
    assert len(pair.right.bgr) == 3 * len(pair.right.data)
    assert frame.image.bgr == b"", "the tracker sees lights only"
    ground = grey.frame()
    assert ground is not None
    assert ground.image.bgr == b""
    assert stranger.frame() is None, "there is no such camera"


async def test_a_stream_that_breaks_or_is_damaged_is_opened_anew() -> None:
    served = 0

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal served
        served += 1
        whole = encode(CameraFrame(served * 1_000_000, "x", 4, 2, bytes(8)))
        writer.write({1: b"no frame at all, but something else", 2: whole[:-3]}.get(served, whole))
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    camera = StreamCamera("belly", ("127.0.0.1", port), lambda boot_s: boot_s)
    camera.open()
    try:
        frame = await frame_after(camera, 0.0)
    finally:
        camera.close()
        server.close()
    assert frame.t_s >= 3.0


async def test_a_picture_whose_time_is_not_known_yet_is_dropped() -> None:
    requested: list[float] = []

    def unknown(boot_s: float) -> None:
        requested.append(boot_s)

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(encode(CameraFrame(5_000_000, "x", 4, 2, bytes(8))))
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    camera = StreamCamera("belly", ("127.0.0.1", server.sockets[0].getsockname()[1]), unknown)
    camera.open()
    try:
        await until(lambda: bool(requested))
    finally:
        camera.close()
        server.close()
    assert camera.frame() is None


async def test_a_camera_port_that_is_taken_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as used:
        server = SensorServer(Simulator(World.load("hold")), asyncio.get_running_loop(), 0)
        with pytest.raises(Refused, match="in use by another program"):
            await server.open(used.getsockname()[1])
