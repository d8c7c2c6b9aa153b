"""The connection to a caster or a TCP server of corrections: begun again with growing waits until it is closed."""

import asyncio
import os
import ssl
from collections.abc import Callable
from typing import Final

from gloc3.clock import Clock, passed
from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.corrections.ntrip import (
    END_OF_TABLE,
    MOST_TABLE_BYTES,
    Mountpoint,
    NtripReply,
    OldCaster,
    ReplyKind,
    gga,
    read_table,
    request,
    unknown_mountpoint,
)
from gloc3_groundstation.corrections.source_url import SourceUrl

FIRST_WAIT_S: Final = 1.0
MOST_WAIT_S: Final = 60.0
"""Waits between attempts, s: the first, doubled up to the longest."""
CONNECT_WITHIN_S: Final = 10.0
SILENT_S: Final = 30.0
"""Silence after which a connection is begun again, s."""
GGA_PERIOD_S: Final = 10.0
POLL_PERIOD_S: Final = 1.0
READ_BYTES: Final = 4096


class NetworkSource:
    """One caster or server. It is connected as soon as it is made, on the running loop.

    Args:
        source: its address.
        on_data: called with the corrections.
        position: a vehicle's position, for a mountpoint that wants one; None while there is none.
    """

    def __init__(
        self, source: SourceUrl, on_data: Callable[[bytes], None], position: Callable[[], GeoPoint | None]
    ) -> None:
        self.problem = ""
        """Why there are no corrections; empty while they come."""
        self._source, self._on_data, self._position = source, on_data, position
        self._clock = Clock(asyncio.get_running_loop())
        self._version = 2
        self._table: dict[str, Mountpoint] | None = None
        self._has_data = False
        self._task = asyncio.get_running_loop().create_task(self._run())

    async def close(self) -> None:
        """Ends the connection."""
        self._task.cancel()
        await asyncio.wait([self._task])

    async def _run(self) -> None:
        wait_s = FIRST_WAIT_S
        while True:
            self._has_data = False
            try:
                await self._connect()
            except OldCaster as error:
                self.problem, self._version = str(error), 3 - self._version
            except Refused as error:
                self.problem = str(error)
            except TimeoutError:
                self.problem = f"nothing comes from {self._source.host}"
            except OSError as error:
                self.problem = f"{self._source.host}: {_text(error)}"
            wait_s = FIRST_WAIT_S if self._has_data else wait_s
            await passed(wait_s)
            wait_s = min(2.0 * wait_s, MOST_WAIT_S)

    async def _connect(self) -> None:
        source = self._source
        if not source.is_caster:
            await self._exchange(b"", self._receive)
            return
        if self._table is None:
            await self._fetch_table()
        mountpoint = (self._table or {}).get(source.mountpoint)
        wants_position = mountpoint is None or mountpoint.wants_position
        if not source.mountpoint:
            raise unknown_mountpoint(source, self._table or {})
        while mountpoint is not None and wants_position and self._position() is None:
            self.problem = f"{source.mountpoint} computes corrections for a position: waiting for a vehicle's"
            await passed(POLL_PERIOD_S)
        sentence = self._gga() if wants_position else ""
        reply, table = NtripReply(source, self._table), bytearray()

        def receive(data: bytes) -> bool:
            body = reply.receive(data)
            if reply.kind is ReplyKind.TABLE:
                table.extend(body)
                return _is_whole(table)
            self._receive(body)
            return False

        asked = request(source, source.mountpoint, version=self._version, position=sentence)
        await self._exchange(asked, receive, self._gga if wants_position else None)
        if reply.kind is None:
            reply.receive(b"\r\n\r\n")  # some casters close without the empty line that ends the head of a refusal
        if reply.kind is ReplyKind.TABLE:
            raise unknown_mountpoint(source, read_table(bytes(table)) or self._table or {})

    async def _fetch_table(self) -> None:
        """Asks for the source table; without one the mountpoint is requested all the same."""
        reply, table = NtripReply(self._source), bytearray()

        def receive(data: bytes) -> bool:
            table.extend(reply.receive(data))
            return _is_whole(table)

        try:
            await self._exchange(request(self._source, "", version=self._version), receive)
        except OldCaster:
            raise
        except (Refused, TimeoutError):
            return
        self._table = read_table(bytes(table))

    def _receive(self, data: bytes) -> bool:
        if data:
            self._has_data, self.problem = True, ""
            self._on_data(data)
        return False

    def _gga(self) -> str:
        place = self._position()
        return "" if place is None else gga(place, self._clock.utc_s())

    async def _exchange(
        self, asked: bytes, receive: Callable[[bytes], bool], sentence: Callable[[], str] | None = None
    ) -> None:
        """Connects, sends, and passes on what comes until that is enough or the other end closes.

        Raises:
            Refused: by `receive`, or the other end has closed the connection before anything came.
            OSError: the connection failed; a `TimeoutError` where nothing comes any more.
        """
        source, loop = self._source, asyncio.get_running_loop()
        context = ssl.create_default_context() if source.has_tls else None
        opened = asyncio.open_connection(source.host, source.port, ssl=context)
        reader, writer = await asyncio.wait_for(opened, CONNECT_WITHIN_S)
        timer: asyncio.TimerHandle | None = None

        def send_position() -> None:
            nonlocal timer
            if sentence is not None:
                writer.write(sentence().encode())
                timer = loop.call_later(GGA_PERIOD_S, send_position)

        try:
            writer.write(asked)
            send_position()
            came = False
            while data := await asyncio.wait_for(reader.read(READ_BYTES), SILENT_S):
                came = True
                if receive(data):
                    return
            if not came:
                raise OldCaster(f"{source.host} closes the connection without an answer")
            self.problem = f"{source.host} has closed the connection"
        finally:
            if timer is not None:
                timer.cancel()
            writer.transport.abort()


def _is_whole(table: bytearray) -> bool:
    return END_OF_TABLE in table or len(table) > MOST_TABLE_BYTES


def _text(error: OSError) -> str:
    """What is the matter with a connection, in the system's words and without its addresses."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted ({error.verify_message})"
    if isinstance(error, ssl.SSLError):
        return "it does not answer with TLS; ntrip:// is without"
    known = isinstance(error.errno, int) and error.errno > 0
    return os.strerror(error.errno).lower() if known and error.errno else str(error.strerror or error)
