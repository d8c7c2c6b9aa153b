"""An NTRIP caster of both versions, as a peer: source table, passwords, mountpoints, chunks, and the positions it is sent."""

import asyncio
import ssl
from base64 import b64encode
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import msgspec

CREDENTIALS = b64encode(b"me:s/cret").decode()
PERIOD_S = 0.2


class Caster(msgspec.Struct, kw_only=True):
    """What it serves, and what it has received."""

    frames: Callable[[int], bytes]
    """The corrections of its n-th period."""
    version: int = 2
    wants_position: bool = False
    port: int = 0
    is_sending: bool = True
    requests: list[str] = msgspec.field(default_factory=list)
    positions: list[str] = msgspec.field(default_factory=list)
    connected: set[asyncio.StreamWriter] = msgspec.field(default_factory=set)

    @property
    def table(self) -> bytes:
        wants = int(self.wants_position)
        rows = "".join(
            f"STR;{name};x;RTCM 3.3;;2;GPS;x;CHE;47;8;{wants};0;x;none;B;N;9600;\r\n" for name in ("BASE", "HILL")
        )
        return f"CAS;x;2101;x;x;0;CHE;47;8\r\n{rows}ENDSOURCETABLE\r\n".encode()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connected.add(writer)
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode()
            self.requests.append(head)
            await self._answer(head, reader, writer)
        except (ConnectionError, asyncio.IncompleteReadError):
            pass
        finally:
            self.connected.discard(writer)
            writer.close()

    async def _answer(self, head: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        is_new = self.version == 2 and "Ntrip-Version: Ntrip/2.0" in head
        name = head.split()[1].removeprefix("/")
        if name not in ("BASE", "HILL"):
            kind = (
                b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable"
                if is_new
                else b"SOURCETABLE 200 OK\r\nContent-Type: text/plain"
            )
            writer.write(kind + b"\r\nContent-Length: %d\r\n\r\n" % len(self.table) + self.table)
            await writer.drain()
            return
        if f"Authorization: Basic {CREDENTIALS}\r\n" not in head:
            ended = b'\r\nWWW-Authenticate: Basic realm="x"\r\n\r\n' if is_new else b"\r\n"
            writer.write(b"HTTP/1.1 401 Unauthorized" + ended)
            await writer.drain()
            return
        chunked = b"HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nContent-Type: gnss/data\r\nTransfer-Encoding: chunked\r\n\r\n"
        writer.write(chunked if is_new else b"ICY 200 OK\r\n\r\n")
        listening = asyncio.ensure_future(self._listen(reader))
        try:
            number = 0
            while not listening.done():
                data = self.frames(number) if self.is_sending else b""
                if data:
                    writer.write(b"%x\r\n%s\r\n" % (len(data), data) if is_new else data)
                    await writer.drain()
                number += 1
                await asyncio.sleep(PERIOD_S)
        finally:
            listening.cancel()

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        while line := await reader.readline():
            self.positions.append(line.decode().strip())


@asynccontextmanager
async def serving(caster: Caster, context: ssl.SSLContext | None = None) -> AsyncIterator[Caster]:
    """Serves it on its port, or on any."""
    server = await asyncio.start_server(caster.serve, "127.0.0.1", caster.port, ssl=context)
    caster.port = server.sockets[0].getsockname()[1]
    try:
        yield caster
    finally:
        server.close()
        for writer in caster.connected:
            writer.transport.abort()
        while caster.connected:
            await asyncio.sleep(0.01)
