"""Somebody on the way between station and vehicle holds a command back, and lets it go later: real UDP sockets."""

import asyncio
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.commands.programs import program
from tests.onboard.process.test_open_links import process_of

from gloc3.exchange import LocalExchange
from gloc3.mavlink.transport.endpoints import LOOPBACK, open_endpoint
from gloc3.messages.command_interface import CiReply, Control, ControlVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ControlState
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets


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


async def until(is_so: Callable[[], bool], within_s: float = 20.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.05)


async def test_a_command_that_was_held_back_does_nothing_when_it_comes(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    port, cable = free_ports(2, socket.SOCK_DGRAM)
    process = process_of(tmp_path, port=cable, station=f"udpin://127.0.0.1:{port}")
    await process.open()
    middle = MiddleMan(loop, port)
    there, reported = LocalExchange(), list[Envelope[Any]]()
    links: list[StationLinkCore] = []
    endpoint = await open_endpoint(
        f"udpout://127.0.0.1:{middle.port}", loop, lambda data: links[0].receive(data) if links else None
    )
    context = LinkContext(loop=loop, exchange=there, topics=TopicTable.installed(), boot=8, report=lambda _: None)
    links.append(StationLinkCore(endpoint.send, context, LinkSettings()))
    client = CommandClient(there, loop, "255", 8)
    replies: list[CiReply] = []
    holders: list[str] = []
    process.exchange.subscribe("pelican/ci/reply", lambda envelope: replies.append(envelope.payload))
    process.exchange.subscribe("pelican/ci/control", lambda envelope: holders.append(_holder(envelope)))
    there.subscribe("pelican/ci/summary", reported.append)
    try:
        with program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=tmp_path):
            await until(lambda: len(reported) > 1)
            while (await client.request("pelican", Control(verb=ControlVerb.REQUEST))).outcome is not Outcome.ACCEPTED:
                await asyncio.sleep(0.5)
            replies.clear()
            middle.is_holding = True
            ended = await client.request("pelican", Control(verb=ControlVerb.RELEASE), timeout_s=1.0)
            assert ended.outcome is Outcome.UNKNOWN
            await asyncio.sleep(0.5)
            middle.release()
            await until(lambda: bool(replies))
            assert replies[0].outcome is Outcome.REFUSED
            assert "after its time limit; send it again if it is still wanted" in replies[0].reason
            assert holders[-1] == "255"
            again = await client.request("pelican", Control(verb=ControlVerb.RELEASE))
            assert again.outcome is Outcome.ACCEPTED, "what is sent again is carried out"
    finally:
        client.close()
        links[0].close()
        middle.close()
        await endpoint.close()
        await process.close()


def _holder(envelope: Envelope[ControlState]) -> str:
    return envelope.payload.holder
