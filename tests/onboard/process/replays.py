"""Attacks on the sockets of a real onboard process: a second autopilot, a held-back command, replayed frames, a flood."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import msgspec
from tests.commands.programs import program

from gloc3.clock import Clock
from gloc3.exchange import LocalExchange
from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser, message
from gloc3.mavlink.router import MOST_ADDRESSES
from gloc3.mavlink.signing import Signing, timestamp
from gloc3.mavlink.transport.endpoints import LOOPBACK, open_endpoint
from gloc3.messages.command_interface import CiReply, Control, ControlVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.platform.reader import load_platform
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.process import DEVICES, OnboardProcess
from gloc3_sitl.demo.demo import free_ports

KEY = bytes(range(32))
HEARTBEAT = message("HEARTBEAT", type=6, autopilot=8)
ARM = message("COMMAND_LONG", target_system=1, target_component=1, command=400, param1=1.0)
NEWCOMER = (77, 190)
HELD_BACK_S = 1.5


class Replayed(msgspec.Struct, frozen=True):
    """What came of one attack."""

    attack: str
    seen: str
    is_held_off: bool


def process_of(
    folder: Path, key: bytes | None = None, port: int = 0, station: str = "udpin://0.0.0.0:0"
) -> OnboardProcess:
    """An onboard process in this one, which is not open yet."""
    platform = load_platform("pelican_rtk", is_loading_classes=True, devices=DEVICES)
    options = ProcessOptions(
        platform="pelican_rtk",
        autopilot=f"udpin://:{port}",
        stations=(station,),
        out=folder,
        signing_key=key,
    )
    return OnboardProcess(options, platform, asyncio.get_running_loop())


@asynccontextmanager
async def opened(folder: Path, key: bytes | None = None) -> AsyncIterator[tuple[OnboardProcess, int, int]]:
    """An onboard process with its ports for the autopilot and for stations."""
    cable, port = free_ports(2, socket.SOCK_DGRAM)
    process = process_of(folder, key, cable, f"udpin://127.0.0.1:{port}")
    await process.open()
    try:
        yield process, cable, port
    finally:
        await process.close()


@contextmanager
def udp() -> Iterator[socket.socket]:
    """A socket of somebody on this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind((LOOPBACK, 0))
        made.setblocking(False)
        yield made


def received(opened_socket: socket.socket) -> list[MavlinkMessage]:
    """Everything that has come."""
    found: list[MavlinkMessage] = []
    parser = Parser(is_datagram=True)
    while True:
        try:
            data = opened_socket.recv(65_535)
        except BlockingIOError:
            return found
        found += [one for frame in parser.receive(data) if (one := frame.decode()) is not None]


def is_arming(one: MavlinkMessage) -> bool:
    """Whether it is the command of these attacks, and none of the companion's own."""
    return one.name == "COMMAND_LONG" and one.command == ARM.command


async def until(is_so: Callable[[], bool], within_s: float = 20.0) -> None:
    """Waits for something.

    Raises:
        TimeoutError: it has not come.
    """
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.05)


async def second_autopilot(folder: Path) -> Replayed:
    """A second peer claims the id of the autopilot, with a position of its own."""
    vehicle, forger = Encoder(1, 1), Encoder(1, 1)
    heartbeat = message("HEARTBEAT", type=2, autopilot=12)
    heights: set[float] = set()
    async with opened(folder) as (process, cable, _):
        process.exchange.subscribe(
            "pelican/autopilot_pose", lambda one: heights.add(round(one.payload.position_ned_m[2], 1))
        )
        with udp() as true, udp() as false:
            for number in range(40):
                for sender, encoder, down_m in ((true, vehicle, -5.0), (false, forger, -50.0)):
                    stamp = {"time_boot_ms": 100 * number}
                    for one in (
                        heartbeat,
                        message("ATTITUDE_QUATERNION", q1=1.0, **stamp),
                        message("LOCAL_POSITION_NED", z=down_m, **stamp),
                    ):
                        sender.sendto(encoder.encode(one), (LOOPBACK, cable))
                    await asyncio.sleep(0.05)
            (autopilot, *_) = process.vehicle.link_conditions()
    told = autopilot.intruder.partition(":")[2].partition(" ")[2]
    seen = f"heights taken: {', '.join(f'{-height:g} m' for height in sorted(heights)) or 'none'}; told: {told or 'nothing'}"
    return Replayed("a second peer claims to be autopilot 1/1, 50 m high", seen, heights == {-5.0} and bool(told))


async def replayed_frames(folder: Path) -> Replayed:
    """Signed frames of a station are recorded, and sent again from another socket."""
    at_autopilot, texts = list[str](), list[str]()
    async with opened(folder, KEY) as (process, cable, port):
        process.exchange.subscribe(
            "pelican/components/station_link/event", lambda envelope: texts.append(envelope.payload.text)
        )
        clock = Clock(asyncio.get_running_loop())
        signing = Signing(KEY, link_id=3, now=timestamp(clock.utc_s()))
        station, autopilot = Encoder(255, 190, signing), Encoder(1, 1)
        with udp() as cable_end, udp() as true, udp() as forger:
            frames = [station.encode(HEARTBEAT), station.encode(ARM)]
            held_back, last = station.encode(ARM), station.encode(HEARTBEAT)

            async def say(sender: socket.socket, *what: bytes) -> int:
                """Sends frames; how many commands reach the autopilot."""
                for one in what:
                    sender.sendto(one, (LOOPBACK, port))
                await asyncio.sleep(0.5)
                at_autopilot[:] = [one.name for one in received(cable_end) if is_arming(one)]
                return len(at_autopilot)

            for _ in range(10):
                cable_end.sendto(autopilot.encode(message("HEARTBEAT", type=2, autopilot=12)), (LOOPBACK, cable))
                await asyncio.sleep(0.05)
            genuine = await say(true, *frames, last)
            again = await say(forger, *frames)
            late = await say(forger, held_back)
            unsigned = await say(forger, Encoder(255, 190).encode(ARM))
    seen = (
        f"commands that reach the autopilot: {genuine} of 1 genuine, {again} of 1 sent again, {late} of 1 held back until a "
        f"later one had come, {unsigned} of 1 unsigned; told: {'; '.join(sorted({text.partition('(')[2].partition(')')[0] for text in texts}))}"
    )
    return Replayed("signed frames are recorded and sent again", seen, (genuine, again, late, unsigned) == (1, 0, 0, 0))


async def flood(folder: Path) -> Replayed:
    """Invented senders from one socket; then one who is new there commands the autopilot, and waits for its answer."""
    ack = message("COMMAND_ACK", command=400, target_system=NEWCOMER[0], target_component=NEWCOMER[1])
    count = 2 * MOST_ADDRESSES
    async with opened(folder) as (_, cable, port):
        autopilot = Encoder(1, 1)
        with udp() as cable_end, udp() as stranger:
            for _ in range(10):
                cable_end.sendto(autopilot.encode(message("HEARTBEAT", type=2, autopilot=12)), (LOOPBACK, cable))
                await asyncio.sleep(0.05)
            for number in range(count):
                who = Encoder(2 + number // 200, 1 + number % 200)
                stranger.sendto(who.encode(HEARTBEAT), (LOOPBACK, port))
                if number % 50 == 0:
                    await asyncio.sleep(0.02)
            await asyncio.sleep(0.5)
            received(cable_end), received(stranger)
            stranger.sendto(Encoder(*NEWCOMER).encode(ARM), (LOOPBACK, port))
            await asyncio.sleep(0.5)
            commands = [one for one in received(cable_end) if is_arming(one)]
            cable_end.sendto(autopilot.encode(ack), (LOOPBACK, cable))
            await asyncio.sleep(0.5)
            answers = [one for one in received(stranger) if one.name == "COMMAND_ACK"]
    seen = f"of a newcomer's command behind the same address {len(commands)} reached the autopilot, {len(answers)} answer came back"
    return Replayed(f"{count} invented senders fill the table of a link", seen, bool(commands) and bool(answers))


async def held_back(folder: Path) -> Replayed:
    """Somebody on the way holds a station's command back until the station has given it up."""
    loop = asyncio.get_running_loop()
    async with opened(folder) as (process, cable, port):
        middle = MiddleMan(loop, port)
        there, reported = LocalExchange(), list[Envelope[Any]]()
        links: list[StationLinkCore] = []
        endpoint = await open_endpoint(
            f"udpout://127.0.0.1:{middle.port}", loop, lambda data: links[0].receive(data) if links else None
        )
        context = LinkContext(loop=loop, exchange=there, topics=TopicTable.installed(), boot=8, report=lambda _: None)
        links.append(StationLinkCore(endpoint.send, context, LinkSettings()))
        client = CommandClient(there, loop, "255", 8)
        replies, holders = list[CiReply](), list[str]()
        process.exchange.subscribe("pelican/ci/reply", lambda envelope: replies.append(envelope.payload))
        process.exchange.subscribe("pelican/ci/control", lambda envelope: holders.append(envelope.payload.holder))
        there.subscribe("pelican/ci/summary", reported.append)
        request, release = Control(verb=ControlVerb.REQUEST), Control(verb=ControlVerb.RELEASE)
        try:
            with program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=folder):
                await until(lambda: len(reported) > 1)
                while (await client.request("pelican", request)).outcome is not Outcome.ACCEPTED:
                    await asyncio.sleep(0.5)
                replies.clear()
                middle.is_holding = True
                ended = await client.request("pelican", release, timeout_s=HELD_BACK_S)
                await asyncio.sleep(0.5)
                middle.release()
                await until(lambda: bool(replies))
                late, holder = replies[0], holders[-1]
                again = await client.request("pelican", release)
        finally:
            client.close()
            links[0].close()
            middle.close()
            await endpoint.close()
    seen = (
        f"the station is told {ended.outcome}; when it comes it is {late.outcome}: {late.reason}; "
        f"control is with {holder or 'nobody'}; sent again it is {again.outcome}"
    )
    outcomes = (ended.outcome, late.outcome, again.outcome)
    return Replayed(
        f"a command is held back for {HELD_BACK_S + 0.5:g} s",
        seen,
        outcomes == (Outcome.UNKNOWN, Outcome.REFUSED, Outcome.ACCEPTED) and holder == "255",
    )


class MiddleMan:
    """Passes datagrams between a station and a vehicle's port, and keeps the station's while it is told to."""

    def __init__(self, loop: asyncio.AbstractEventLoop, port: int) -> None:
        self.is_holding = False
        self.held: list[bytes] = []
        self._loop = loop
        self._front, self._back = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._front.bind((LOOPBACK, 0))
        self._back.connect((LOOPBACK, port))
        self._station: tuple[str, int] | None = None
        self.port: int = self._front.getsockname()[1]
        for one, handle in ((self._front, self._from_station), (self._back, self._from_vehicle)):
            one.setblocking(False)
            loop.add_reader(one, handle)

    def release(self) -> None:
        """Lets go of what was held back, in its order."""
        self.is_holding = False
        for data in self.held:
            self._back.send(data)

    def close(self) -> None:
        for one in (self._front, self._back):
            self._loop.remove_reader(one)
            one.close()

    def _from_station(self) -> None:
        data, self._station = self._front.recvfrom(65_535)
        if self.is_holding:
            self.held.append(data)
        else:
            self._back.send(data)

    def _from_vehicle(self) -> None:
        data = self._back.recv(65_535)
        if self._station is not None:
            self._front.sendto(data, self._station)


ATTACKS = (second_autopilot, held_back, replayed_frames, flood)
