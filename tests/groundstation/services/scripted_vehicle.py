"""A vehicle made of the servers of our own link, at the other end of a memory link in virtual time, and its services."""

import asyncio
import random
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from tests.node_runner import NodeRunner

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.mavlink.codec import Frame, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3.mavlink.services.files.log_server import LogEntry, LogServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import StreamScheduler
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType, parameter
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.mavlink.services.version import ProtocolCapability, Version, VersionServer, version_number
from gloc3.mavlink.transport.memory import PERFECT, Conditions, MemoryLink
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.services.vehicle import VehicleServices

T = TypeVar("T")
VEHICLE, STATION = Address(1, 1), Address(255, 190)
PX4, ARDUPILOT = 12, 3
TOPICS = TopicTable.installed()
QUADROTOR = 2
Answer = Callable[[MavCommandRequest], CommandResult | None]


class Logs:
    """Logs in memory."""

    def __init__(self, *contents: bytes) -> None:
        self.contents = dict(enumerate(contents, start=1))
        self.bytes_read = 0

    def entries(self) -> list[LogEntry]:
        return [LogEntry(number, len(content), 1_700_000_000) for number, content in self.contents.items()]

    def read(self, number: int, offset: int, size: int) -> bytes:
        self.bytes_read += size
        return self.contents[number][offset : offset + size]

    def erase(self) -> None:
        self.contents.clear()


class ScriptedVehicle:
    """Answers what the services ask; `answer` has the first word on commands."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        link: MemoryLink,
        *,
        autopilot: int,
        parameters: Iterable[Parameter],
        logs: Logs,
        folder: Path | None,
    ) -> None:
        is_px4 = autopilot == PX4
        encoding = ParameterEncoding.BYTEWISE if is_px4 else ParameterEncoding.CAST
        says = ProtocolCapability.PARAM_ENCODE_BYTEWISE if is_px4 else ProtocolCapability.PARAM_ENCODE_C_CAST
        capabilities = (
            says | ProtocolCapability.MISSION_FENCE | ProtocolCapability.MISSION_RALLY | ProtocolCapability.FTP
        )
        version = version_number(1, 15, 4) if is_px4 else version_number(4, 6, 0)
        self.heartbeat = Heartbeat(VEHICLE, vehicle_type=QUADROTOR, autopilot=autopilot)
        self.parameters = ParameterServer(VEHICLE, parameters, encoding=encoding)
        self.mission = MissionServer(VEHICLE)
        self.texts = StatusTextSender(VEHICLE)
        self.streams = StreamScheduler(VEHICLE, {"ATTITUDE": 4.0, "VFR_HUD": 0.0})
        self.answer: Answer = lambda request: None
        self.requested: list[MavCommandRequest] = []
        self.received: list[Frame] = []
        self._commands = MavCommandServer(VEHICLE, is_autopilot=True)
        self._version = VersionServer(VEHICLE, Version(capabilities=capabilities, flight_software=version))
        services: list[Microservice[Any]] = [
            self.heartbeat,
            self._commands,
            self._version,
            self.parameters,
            self.mission,
        ]
        services += [self.texts, self.streams, LogServer(VEHICLE, logs)]
        if folder is not None:
            services.append(FtpServer(VEHICLE, FolderFiles(folder)))
        self._send = link.b.send
        self.runner = NodeRunner(MavlinkComponent(VEHICLE, services), loop, link.b.send, after=self._after)
        link.b.on_data = self._take
        self.runner.settle()

    def report(self, *texts: str) -> None:
        """Sends status texts."""
        for text in texts:
            self.texts.send(6, text)
        self.runner.settle()

    def send(self, name: str, **fields: Any) -> None:
        """Sends one message."""
        self._send(self.runner.encoder.encode(message(name, **fields)))

    def _take(self, data: bytes) -> None:
        from gloc3.mavlink.codec import Parser

        self.received += Parser(is_datagram=True).receive(data)
        self.runner.on_data(data)

    def _after(self, now_s: float) -> None:
        for number in self.streams.due(now_s):
            self.send({30: "ATTITUDE", 74: "VFR_HUD"}[number])
        for request in self._commands.events():
            self.requested.append(request)
            result = self.answer(request)
            if result is None:
                result = self._version.command(request)
            if result is None:
                result = self.streams.command(request, now_s)
            result = CommandResult.UNSUPPORTED if result is None else result
            self._commands.answer(request, result, now_s=now_s)


class Scene:
    """What a test plays with."""

    def __init__(
        self, services: VehicleServices, vehicle: ScriptedVehicle, memory: MemoryLink, link: StationLinkCore
    ) -> None:
        self.services, self.vehicle, self.memory, self.link = services, vehicle, memory, link

    async def pass_s(self, seconds: float) -> None:
        """Lets time go by."""
        loop = asyncio.get_running_loop()
        ended: asyncio.Future[None] = loop.create_future()
        loop.call_later(seconds, ended.set_result, None)
        await ended

    def cut(self) -> None:
        """Cuts the link."""
        self.memory.set_conditions(Conditions(loss=1.0))

    def mend(self) -> None:
        """Makes the link whole again."""
        self.memory.set_conditions(PERFECT)


def numbered(count: int = 40) -> list[Parameter]:
    """Parameters of several types."""
    kinds = (ParameterType.INT32, ParameterType.INT8, ParameterType.REAL32)
    return [parameter(f"GRP{n % 3}_P{n}", n + (0.25 if n % 3 == 2 else 0), kinds[n % 3]) for n in range(count)]


def over(
    play: Callable[[Scene], Awaitable[T]],
    conditions: Conditions = PERFECT,
    *,
    autopilot: int = PX4,
    parameters: Iterable[Parameter] = (),
    logs: Logs | None = None,
    folder: Path | None = None,
) -> T:
    """Plays a scene in virtual time."""

    async def main() -> T:
        loop = asyncio.get_running_loop()
        memory = MemoryLink(loop, random.Random(5), conditions)
        vehicle = ScriptedVehicle(
            loop, memory, autopilot=autopilot, parameters=parameters or numbered(), logs=logs or Logs(), folder=folder
        )
        link = StationLinkCore(memory.a.send, LinkContext(loop=loop, exchange=LocalExchange(), topics=TOPICS, boot=1))
        memory.a.on_data = link.receive
        services = VehicleServices(link, VEHICLE)
        try:
            return await play(Scene(services, vehicle, memory, link))
        finally:
            await services.close()
            link.close()
            vehicle.runner.stop()

    return run_virtual(main())
