"""A TCP relay that does to a connection what networks do: `python -m tests.onboard.nodes.relay LISTEN TO`, told on stdin.

`delay SECONDS`, `rate BYTES_S`, `partition` (nothing passes, nobody is told), `heal` (all is well again), `reset`.
"""

import asyncio
import sys
from collections.abc import Callable
from contextlib import suppress


class Relay:
    """The connections, and what is done to them."""

    def __init__(self, host: str, port: int) -> None:
        self._to = (host, port)
        self.delay_s, self.rate = 0.0, 0.0
        self._is_open = asyncio.Event()
        self._is_open.set()
        self._ends: set[asyncio.StreamWriter] = set()

    def obey(self, line: str) -> None:
        """Does what it is told."""
        word, _, value = line.strip().partition(" ")
        acts: dict[str, Callable[[], None]] = {
            "delay": lambda: setattr(self, "delay_s", float(value)),
            "rate": lambda: setattr(self, "rate", float(value)),
            "partition": self._is_open.clear,
            "heal": self._heal,
            "reset": self._reset,
        }
        acts[word]()

    def _heal(self) -> None:
        self.delay_s = self.rate = 0.0
        self._is_open.set()

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
        with suppress(OSError):
            while data := await reader.read(16_384):
                await self._is_open.wait()
                loop.call_later(self.delay_s, _write, writer, data)
                if self.rate:
                    await asyncio.sleep(len(data) / self.rate)
                await writer.drain()
        loop.call_later(self.delay_s, writer.close)


def _write(writer: asyncio.StreamWriter, data: bytes) -> None:
    if not writer.is_closing():
        writer.write(data)


async def main(listen: str, to: str) -> None:
    """Relays until stdin ends."""
    host, _, port = to.rpartition(":")
    relay = Relay(host, int(port))
    own, _, number = listen.rpartition(":")
    server = await asyncio.start_server(relay.serve, own, int(number))
    loop = asyncio.get_running_loop()
    async with server:
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            relay.obey(line)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
