"""MAVSDK at the other end of a UDP link that loses datagrams: an independent judge of our services."""

import asyncio
import random
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

from mavsdk import log_subscribe
from mavsdk.asyncio import Configuration, ForwardingOption, Mavsdk
from tests.node_runner import NodeRunner

from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.version import ProtocolCapability, Version, VersionServer
from gloc3.mavlink.transport.endpoints import open_endpoint

log_subscribe(lambda level, text, file, line: True)  # else it writes to stdout

VEHICLE = Address(1, 1)
QUADROTOR, PX4, STATION = 2, 12, 6


async def until(is_so: Callable[[], bool], within_s: float = 60.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.01)


@asynccontextmanager
async def lossy_proxy(port: int, loss: float, seed: int) -> AsyncIterator[int]:
    """Passes datagrams to a port of this computer and back, and loses some; gives the port to send to."""
    loop, chance = asyncio.get_running_loop(), random.Random(seed)

    def pass_on(send: Callable[[bytes], None]) -> Callable[[bytes], None]:
        return lambda data: None if chance.random() < loss else send(data)

    def to_front(data: bytes) -> None:
        pass_on(front.send)(data)

    back = await open_endpoint(f"udpout://127.0.0.1:{port}", loop, to_front)
    front = await open_endpoint("udpin://127.0.0.1:0", loop, pass_on(back.send))
    assert front.local_port
    try:
        yield front.local_port
    finally:
        await front.close()
        await back.close()


@asynccontextmanager
async def running(
    services: Sequence[Microservice[Any]],
    mavsdk: Configuration,
    *,
    own: Address = VEHICLE,
    loss: float = 0.0,
    seed: int = 1,
    after: Callable[[float], None] | None = None,
) -> AsyncIterator[tuple[NodeRunner, Mavsdk]]:
    """Our services as one component on one side, MAVSDK on the other."""
    loop = asyncio.get_running_loop()
    is_vehicle = own.component == 1
    heartbeat = Heartbeat(own, vehicle_type=QUADROTOR if is_vehicle else STATION, autopilot=PX4 if is_vehicle else 8)
    commands = MavCommandServer(own, is_autopilot=is_vehicle)
    version = VersionServer(
        own, Version(capabilities=ProtocolCapability.MISSION_INT | ProtocolCapability.MAVLINK2 | ProtocolCapability.FTP)
    )

    def answer(now_s: float) -> None:
        for request in commands.events():
            commands.answer(request, version.command(request) or CommandResult.UNSUPPORTED, now_s=now_s)
        if after is not None:
            after(now_s)

    def on_data(data: bytes) -> None:
        runner.on_data(data)

    endpoint = await open_endpoint("udpin://127.0.0.1:0", loop, on_data)
    runner = NodeRunner(
        MavlinkComponent(own, [heartbeat, commands, version, *services]), loop, endpoint.send, after=answer
    )
    assert endpoint.local_port
    try:
        async with lossy_proxy(endpoint.local_port, loss, seed) as port, Mavsdk(mavsdk) as peer:
            await peer.add_any_connection(f"udpout://127.0.0.1:{port}", ForwardingOption.OFF)
            runner.settle()
            yield runner, peer
    finally:
        runner.stop()
        await endpoint.close()
