"""Direct lines of UDP links: what passes by them passes as by the loop, sooner, and nothing of it is lost or overtaken."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from functools import partial
from typing import Literal

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import Router
from gloc3.mavlink.services.compiling import Compiling, can_compile, kept_at, load, prepare
from gloc3.mavlink.services.lanes import Lanes
from gloc3.mavlink.transport import udp
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint
from gloc3_onboard.companion.routing import RoutedLink

pytestmark = pytest.mark.sockets

HOST = "127.0.0.1"
VEHICLE, OTHER = Encoder(1, 1), Encoder(2, 1)


class Peer:
    """A program at the other end, with a socket of its own."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((HOST, 0))
        self.socket.settimeout(5.0)
        self.port: int = self.socket.getsockname()[1]

    def say(self, port: int, *frames: bytes) -> None:
        self.socket.sendto(b"".join(frames), (HOST, port))

    def hear(self, count: int) -> list[Frame]:
        """So many frames; fewer come to nothing."""
        parser, heard = Parser(is_datagram=True), list[Frame]()
        while len(heard) < count:
            heard += parser.receive(self.socket.recv(65_535))
        return heard


class Stack:
    """A router with a link that vehicles reach and one that leads to a station."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.router = Router(Address(1, 191))
        self.vehicle, self.station = Peer(), Peer()
        self.kept: list[bytes] = []
        self.listened: list[Frame] = []
        self.links: list[RoutedLink] = []
        self.endpoints: list[Endpoint] = []

    async def open(self) -> None:
        def keep(link: str, direction: Literal["in", "out"], raw: bytes) -> None:
            if direction == "in" and link.startswith("udpin"):
                self.kept.append(raw)

        for url in (f"udpin://{HOST}:0", f"udpout://{HOST}:{self.station.port}"):
            link = RoutedLink(url, self.router, self.loop, self.listened.extend, keep)
            endpoint = await open_endpoint(url, self.loop, link.receive)
            link.open(endpoint)
            self.links.append(link)
            self.endpoints.append(endpoint)

    @property
    def port(self) -> int:
        return self.endpoints[0].local_port or 0

    async def is_known(self, peer: Peer, encoder: Encoder) -> None:
        """Has a peer's frames take the short way."""
        for number in range(2):
            before = len(self.kept) + 1
            peer.say(self.port, encoder.encode(message("ATTITUDE", time_boot_ms=number)))
            await asyncio.to_thread(self.station.hear, 1)
            await until(partial(self._has_kept, before))

    def tend(self) -> None:
        """What is done now and then."""
        for endpoint in self.endpoints:
            assert isinstance(endpoint, udp.UdpEndpoint)
            endpoint.tend()

    def _has_kept(self, count: int) -> bool:
        return len(self.kept) >= count


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(10):
        while not is_so():
            await asyncio.sleep(0.005)


@pytest.fixture(params=["interpreted", "compiled"])
async def stack(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Stack]:
    """As it is without numba, and as it is once the loop of its lines is compiled."""
    monkeypatch.setattr(udp, "COMPILING", here := Compiling())
    monkeypatch.setattr(here, "begin", lambda _failed: None)
    if request.param == "compiled":
        if not can_compile():
            pytest.skip("numba is not installed, or this is not Linux")
        prepare(kept_at())
        here.loop = load(kept_at())
    stack = Stack()
    await stack.open()
    yield stack
    for link in stack.links:
        link.close()
    for endpoint in stack.endpoints:
        await endpoint.close()
    for peer in (stack.vehicle, stack.station):
        peer.socket.close()


async def test_what_is_told_again_and_again_passes_while_the_loop_is_busy(stack: Stack) -> None:
    await stack.is_known(stack.vehicle, VEHICLE)
    before = len(stack.kept)
    frames = [VEHICLE.encode(message("ATTITUDE", time_boot_ms=100 + number)) for number in range(20)]
    for raw in frames:  # nothing is awaited from here on: the loop has no turn
        stack.vehicle.say(stack.port, raw)
    assert [frame.raw for frame in stack.station.hear(20)] == frames
    assert len(stack.kept) == before
    await until(lambda: len(stack.kept) == before + 20)
    assert stack.kept[before:] == frames, "who wants to know is told, in order"
    assert [frame.raw for frame in stack.listened[-20:]] == frames
    stack.tend()
    assert stack.endpoints[1].bytes_sent == sum(map(len, stack.kept))
    stack.links[0].close()
    counts = stack.links[0].routed.counts
    assert (counts.frames_in, counts.lost, counts.returned) == (22, 0, 0)
    assert stack.endpoints[0].bytes_received == sum(map(len, stack.kept)), "by the line, and before it"


async def test_nothing_is_overtaken_by_what_takes_the_short_way(stack: Stack) -> None:
    await stack.is_known(stack.vehicle, VEHICLE)
    names = ["ATTITUDE", "HEARTBEAT", "ATTITUDE", "SYSTEM_TIME", "ATTITUDE", "COMMAND_LONG"] * 30
    frames = [VEHICLE.encode(message(name)) for name in names]
    for raw in frames:
        stack.vehicle.say(stack.port, raw)
    heard = await asyncio.to_thread(stack.station.hear, len(frames))
    assert [frame.raw for frame in heard] == frames
    await until(lambda: stack.kept[-len(frames) :] == frames)
    stack.links[0].close()
    assert stack.links[0].routed.counts.lost == 0


async def test_each_peer_of_a_port_has_a_line_and_nobody_else_gets_the_port(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udp, "MOST_LINES", 2)
    peers = [stack.vehicle, Peer(), Peer()]
    for number, peer in enumerate(peers):
        await stack.is_known(peer, Encoder(10 + number, 1))
    with pytest.raises(Refused, match="in use by another program"):
        await open_endpoint(f"udpin://{HOST}:{stack.port}", stack.loop, lambda _: None)
    shared = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with shared:
        shared.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            shared.bind((HOST, stack.port))
    to_all = Encoder(255, 190).encode(message("HEARTBEAT"))
    to_one = Encoder(255, 190).encode(message("COMMAND_LONG", target_system=11))
    station = stack.endpoints[1].local_port or 0
    stack.station.say(station, to_all)
    stack.station.say(station, to_one)
    for peer, wanted in zip(peers, ([to_all], [to_all, to_one], [to_all]), strict=True):
        assert [frame.raw for frame in await asyncio.to_thread(peer.hear, len(wanted))] == wanted
    for peer in peers[1:]:
        peer.socket.close()


async def test_who_was_not_there_gets_the_first_frame_when_he_comes(stack: Stack) -> None:
    stack.station.socket.close()
    for number in range(3):
        stack.vehicle.say(stack.port, VEHICLE.encode(message("ATTITUDE", time_boot_ms=number)))
        await asyncio.sleep(0.02)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as back:
        back.bind((HOST, stack.station.port))
        back.settimeout(5.0)
        raw = VEHICLE.encode(message("ATTITUDE", time_boot_ms=9))
        stack.vehicle.say(stack.port, raw)
        assert await asyncio.to_thread(back.recv, 1000) == raw


async def test_a_line_that_leads_no_more_is_given_up_and_nothing_is_lost(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    await stack.is_known(stack.vehicle, VEHICLE)
    with monkeypatch.context() as patch:  # as after the computer got another address
        patch.setattr(udp, "source_towards", lambda _peer, _family: "203.0.113.7")
        patch.setattr(udp, "connect", lambda _own, _others, _peer: None)
        stack.vehicle.say(stack.port, *(VEHICLE.encode(message("ATTITUDE", time_boot_ms=9)) for _ in range(5)))
        stack.tend()
        stack.vehicle.say(stack.port, *(VEHICLE.encode(message("ATTITUDE", time_boot_ms=10)) for _ in range(5)))
        await asyncio.to_thread(stack.station.hear, 10)
    stack.tend()
    await stack.is_known(stack.vehicle, VEHICLE)
    stack.vehicle.say(stack.port, VEHICLE.encode(message("ATTITUDE", time_boot_ms=99)))
    assert len(stack.station.hear(1)) == 1, "there is a line again"


@pytest.mark.parametrize("stack", ["interpreted"], indirect=True)
async def test_what_goes_wrong_on_a_line_is_told_and_the_loop_takes_over(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[BaseException | None] = []
    stack.loop.set_exception_handler(lambda _, context: told.append(context.get("exception")))
    await stack.is_known(stack.vehicle, VEHICLE)

    def fail(_self: Lanes, *_: object) -> bool:
        raise ValueError("broken")

    with monkeypatch.context() as patch:
        patch.setattr(Lanes, "_is_new", fail)
        stack.vehicle.say(stack.port, VEHICLE.encode(message("ATTITUDE", time_boot_ms=7)))
        await until(lambda: len(told) == 1)
    assert [str(error) for error in told] == ["broken"]
    stack.tend()
    stack.vehicle.say(stack.port, VEHICLE.encode(message("ATTITUDE", time_boot_ms=8)))
    assert len(await asyncio.to_thread(stack.station.hear, 1)) == 1
