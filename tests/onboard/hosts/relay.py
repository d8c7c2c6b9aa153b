"""A relay that does to a link what networks do: `python -m tests.onboard.hosts.relay [udp/]LISTEN TO`, told on stdin.

`delay SECONDS`, `rate BYTES_S`, `partition` (nothing passes, nobody is told), `heal` (all is well again); of a TCP connection
also `reset`, of datagrams `loss SHARE`, both ways.
"""

import asyncio
import random
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

UDP = "udp/"
MOST_PENDING = 1000
"""Pieces of a connection's data, in each direction."""
Address = tuple[str, int]


class Relay:
    """What is done to everything that passes."""

    def __init__(self, to: Address) -> None:
        self._to = to
        self._delay_s, self._rate = 0.0, 0.0
        self._is_open = asyncio.Event()
        self._is_open.set()

    def obey(self, line: str) -> None:
        """Does what it is told."""
        word, _, value = line.strip().partition(" ")
        self._acts()[word](float(value or 0.0))

    def _acts(self) -> dict[str, Callable[[float], Any]]:
        return {
            "delay": lambda value: setattr(self, "_delay_s", value),
            "rate": lambda value: setattr(self, "_rate", value),
            "partition": lambda _: self._is_open.clear(),
            "heal": lambda _: self._heal(),
        }

    def _heal(self) -> None:
        self._delay_s = self._rate = 0.0
        self._is_open.set()


class Connections(Relay):
    """Passes TCP connections on."""

    def __init__(self, to: Address) -> None:
        super().__init__(to)
        self._ends: set[asyncio.StreamWriter] = set()

    def _acts(self) -> dict[str, Callable[[float], Any]]:
        return {**super()._acts(), "reset": lambda _: self._reset()}

    def _reset(self) -> None:
        for end in self._ends:
            end.transport.abort()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One connection."""
        await self._is_open.wait()
        try:
            there, back = await asyncio.open_connection(*self._to)
        except OSError:
            writer.close()
            return
        self._ends |= {writer, back}
        await asyncio.gather(self._pass(reader, back), self._pass(there, writer))
        self._ends -= {writer, back}

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()
        running: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(MOST_PENDING)
        writing = loop.create_task(_write(running, writer))
        with suppress(OSError):
            while data := await reader.read(16_384):
                await self._is_open.wait()
                await running.put((loop.time() + self._delay_s, data))
                if self._rate:
                    await asyncio.sleep(len(data) / self._rate)
        await running.put((loop.time() + self._delay_s, b""))
        await writing


class Datagrams(Relay):
    """Passes datagrams of one client on, and the answers back."""

    def __init__(self, to: Address) -> None:
        super().__init__(to)
        self._loss, self._chance = 0.0, random.Random(1)
        self._client: Address | None = None
        self._front: asyncio.DatagramTransport | None = None
        self._back: asyncio.DatagramTransport | None = None

    async def open(self, own: Address) -> None:
        """Opens both sides."""
        loop = asyncio.get_running_loop()
        self._front, _ = await loop.create_datagram_endpoint(lambda: _End(self._forth), local_addr=own)
        self._back, _ = await loop.create_datagram_endpoint(lambda: _End(self._back_again), remote_addr=self._to)

    def _acts(self) -> dict[str, Callable[[float], Any]]:
        return {**super()._acts(), "loss": lambda value: setattr(self, "_loss", value)}

    def _heal(self) -> None:
        super()._heal()
        self._loss = 0.0

    def _forth(self, data: bytes, client: Address) -> None:
        self._client = client
        assert self._back is not None
        self._pass(self._back.sendto, data)

    def _back_again(self, data: bytes, _: Address) -> None:
        if self._client is not None:
            assert self._front is not None
            self._pass(self._front.sendto, data, self._client)

    def _pass(self, send: Callable[..., None], *datagram: Any) -> None:
        if self._is_open.is_set() and self._chance.random() >= self._loss:
            asyncio.get_running_loop().call_later(self._delay_s, send, *datagram)


class _End(asyncio.DatagramProtocol):
    def __init__(self, handle: Callable[[bytes, Address], None]) -> None:
        self._take = handle

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._take(data, addr)

    def error_received(self, exc: Exception) -> None:
        """The other side is not there yet: a datagram that is lost."""


async def _write(running: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter) -> None:
    """Writes what is under way when it is due, in its order, until its end."""
    loop = asyncio.get_running_loop()
    while True:
        due_s, data = await running.get()
        await asyncio.sleep(due_s - loop.time())
        if not data:
            writer.close()
            return
        if not writer.is_closing():
            writer.write(data)
            with suppress(OSError):
                await writer.drain()


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    return host, int(port)


async def main(listen: str, to: str) -> None:
    """Relays until stdin ends."""
    loop = asyncio.get_running_loop()
    own = _address(listen.removeprefix(UDP))
    relay: Relay
    if listen.startswith(UDP):
        relay = datagrams = Datagrams(_address(to))
        await datagrams.open(own)
    else:
        relay = connections = Connections(_address(to))
        await asyncio.start_server(connections.serve, *own)
    while line := await loop.run_in_executor(None, sys.stdin.readline):
        relay.obey(line)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
