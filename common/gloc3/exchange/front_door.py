"""The front door of a node that listens with TLS: a relay that keeps connections without a handshake from Zenoh.

Zenoh 1.10 pauses its listener for 0.1 s after each connection that ends without a TLS handshake, so that ten a second keep
everybody out. It therefore listens on a loopback port, and the door at the announced addresses. The door hands over what
begins as TLS, and closes what Zenoh does not report as a link in time. It passes the bytes on as they are: the encryption
is between the members.
"""

from __future__ import annotations

import asyncio
import re
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from threading import Thread
from typing import Final

from gloc3.errors import Gloc3Error
from gloc3.exchange.admission import Admission, caller_of

HELLO_S: Final = 1.5
"""The first bytes of a connection come within this time, s."""
HANDSHAKE_S: Final = 5.0
"""So long the handshake may take afterwards, s."""
TCP_NOTSENT_LOWAT: Final = 25
"""Of Linux."""
TLS: Final = "tls/"
HANDSHAKE_RECORD: Final = b"\x16"
"""The first byte of TLS."""
HELLO_BYTES: Final = 1 << 14
LOOPBACK: Final = "127.0.0.1"
BACKLOG: Final = 1024
BUFFER_BYTES: Final = 1 << 16
"""Buffer between Zenoh and the door: small, since what is in it is sent before more urgent messages."""
UNSENT_BYTES: Final = 1 << 14
"""So much waits for the network besides what is under way, for the same reason."""
RESET: Final = struct.pack("ii", 1, 0)
"""Lingering that closes a connection at once."""
PAUSE_S: Final = 0.1
"""Pause after a connection that cannot be accepted, for want of file descriptors, s."""
REPORT_S: Final = 0.5
"""Refused connections are reported together after this time, s."""
REPORTED: Final = 100
"""Number of addresses in a report."""
EVERYBODY: Final = "everybody"
DRAINED_S: Final = 0.3
"""So long a door that closes passes on what is under way, s."""
LINGER_S: Final = 10.0
"""So long a caller may take to receive the last bytes of a connection that Zenoh has closed, s."""
PORT: Final = re.compile(rf"{TLS}{LOOPBACK}:(\d+)")
TOO_MANY: Final = "too many connections without a handshake come from there"

Refused = Callable[[Mapping[tuple[str, str], int]], None]
"""Called in the door's thread with the number of connections that were refused, by address and reason."""


class FrontDoor:
    """Listens at the announced addresses; `open` starts it, `close` ends it.

    Args:
        endpoints: Zenoh's, all of TLS over TCP.

    Raises:
        Gloc3Error: an address is in use or invalid.
    """

    def __init__(self, endpoints: Sequence[str]) -> None:
        self._admission = Admission()
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, name="front door", daemon=True)
        self._serving = set[asyncio.Task[None]]()
        self._relays = set[_Relay]()
        self._unfinished: dict[int, _Relay] = {}
        self._refused: dict[tuple[str, str], int] = {}
        self._report: Refused | None = None
        self._listeners: list[socket.socket] = []
        self._reserved: socket.socket | None = None
        for endpoint in endpoints:
            host, _, port = endpoint.removeprefix(TLS).rpartition(":")
            try:
                self._listeners.append(_bound(host.strip("[]"), int(port)))
                self._listeners[-1].listen(BACKLOG)
            except OSError as error:
                self.close()
                raise Gloc3Error(f"the network cannot be opened at {endpoint}: {error.strerror}") from error
        self._reserved = _bound(LOOPBACK, 0)
        self._inner = (LOOPBACK, int(self._reserved.getsockname()[1]))

    @property
    def endpoint(self) -> str:
        """Where Zenoh has to listen."""
        host, port = self._inner
        return f"{TLS}{host}:{port}#so_sndbuf={BUFFER_BYTES}"

    def open(self, refused: Refused) -> None:
        """Starts to accept, in a thread of its own, once Zenoh listens at `endpoint`.

        Args:
            refused: called about connections that were closed at once.
        """
        self._report = refused
        assert self._reserved is not None
        self._reserved.close()
        for listener in self._listeners:
            self._loop.add_reader(listener, self._accept, listener)
        self._thread.start()

    def note_link(self, source: str) -> None:
        """Zenoh reports, in a thread of its own, that a link is complete.

        Args:
            source: its other end, as Zenoh writes addresses.
        """
        if found := PORT.match(source):
            with suppress(RuntimeError):  # it is closed
                self._loop.call_soon_threadsafe(self._complete, int(found[1]))

    def close(self) -> None:
        """Frees the addresses and ends all connections; a session that was closed before can still say goodbye."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        for one in (self._reserved, *self._listeners):
            if one is not None:
                one.close()
        self._loop.close()

    async def _end(self) -> None:
        for listener in self._listeners:
            self._loop.remove_reader(listener)
            listener.close()
        for task in self._serving:
            task.cancel()
        await asyncio.gather(*self._serving, return_exceptions=True)
        if self._relays:
            await asyncio.wait([one.ended for one in self._relays], timeout=DRAINED_S)
        for relay in self._relays:
            relay.abort()
        await asyncio.gather(*(one.ended for one in self._relays))

    # --- accepting ---

    def _accept(self, listener: socket.socket) -> None:
        for _ in range(BACKLOG):
            try:
                outer, address = listener.accept()
            except BlockingIOError:
                return
            except OSError as error:
                self._refuse(EVERYBODY, str(error))
                self._loop.remove_reader(listener)
                self._loop.call_later(PAUSE_S, self._loop.add_reader, listener, self._accept, listener)
                return
            caller = caller_of(address[0])
            if self._admission.enter(caller, self._loop.time()):
                task = self._loop.create_task(self._serve(outer, caller))
                self._serving.add(task)
                task.add_done_callback(partial(self._end_serving, outer))
            else:
                outer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                outer.close()
                self._refuse(caller, TOO_MANY)

    async def _serve(self, outer: socket.socket, caller: str) -> None:
        """Serves a connection until its handshake is complete, or has failed."""
        is_complete = False
        try:
            outer.setblocking(False)
            async with asyncio.timeout(HELLO_S):
                hello = await self._loop.sock_recv(outer, HELLO_BYTES)
            if hello.startswith(HANDSHAKE_RECORD):
                async with asyncio.timeout(HANDSHAKE_S):
                    is_complete = await self._hand_over(outer, hello)
        except OSError:  # or a time-out, which is one: the connection has failed
            is_complete = False
        finally:
            self._admission.leave(caller, self._loop.time(), is_complete=is_complete)

    def _end_serving(self, outer: socket.socket, task: asyncio.Task[None]) -> None:
        self._serving.discard(task)
        outer.close()  # unless a relay has taken it over; also where the task was cancelled before it began

    async def _hand_over(self, outer: socket.socket, hello: bytes) -> bool:
        """Connects a connection to Zenoh, and waits until the link is complete, or has ended (False)."""
        loop, relay = self._loop, _Relay(self._loop, hello)
        with socket.socket() as inner:
            inner.setblocking(False)
            inner.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            outer.setsockopt(socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, UNSENT_BYTES)
            await loop.sock_connect(inner, self._inner)
            port = inner.getsockname()[1]
            self._unfinished[port] = relay
            try:
                await loop.connect_accepted_socket(lambda: relay.near, socket.socket(fileno=inner.detach()))
                await loop.connect_accepted_socket(lambda: relay.far, socket.socket(fileno=outer.detach()))
                self._relays.add(relay)
                relay.ended.add_done_callback(lambda _: self._relays.discard(relay))
                return await relay.is_complete
            except BaseException:
                relay.abort()
                raise
            finally:
                del self._unfinished[port]

    def _refuse(self, who: str, why: str) -> None:
        if not self._refused:
            self._loop.call_later(REPORT_S, self._report_refused)
        key = (who, why) if (who, why) in self._refused or len(self._refused) < REPORTED else ("others", why)
        self._refused[key] = self._refused.get(key, 0) + 1

    def _report_refused(self) -> None:
        refused, self._refused = self._refused, {}
        if self._report is not None:
            self._report(refused)

    def _complete(self, port: int) -> None:
        if port in self._unfinished:
            _settle(self._unfinished[port].is_complete, value=True)


class _Relay:
    """A connection that was handed over."""

    def __init__(self, loop: asyncio.AbstractEventLoop, hello: bytes) -> None:
        self.loop = loop
        self.is_complete: asyncio.Future[bool] = loop.create_future()
        self.ended: asyncio.Future[bool] = loop.create_future()
        self.near, self.far = _End(self), _End(self, hello)
        """The ends at Zenoh and at the caller."""
        self.near.other, self.far.other = self.far, self.near

    def end(self) -> None:
        """Both ends are lost."""
        _settle(self.is_complete, value=False)
        _settle(self.ended, value=True)

    def abort(self) -> None:
        """Ends both ends at once."""
        for end in (self.near, self.far):
            if end.transport is not None:
                end.transport.abort()


class _End(asyncio.Protocol):
    """One end of a relay: what it receives is sent at the other end, which holds it up when it cannot send."""

    other: _End

    def __init__(self, relay: _Relay, hello: bytes = b"") -> None:
        self._relay = relay
        self._hello = hello
        """What was received before."""
        self._is_lost = False
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.set_write_buffer_limits(0)
        if self._hello:
            self.data_received(self._hello)

    def data_received(self, data: bytes) -> None:
        if self.other.transport is not None:
            self.other.transport.write(data)

    def pause_writing(self) -> None:
        if self.other.transport is not None:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        if self.other.transport is not None:
            self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        self._is_lost = True
        if self.other.transport is not None:
            self.other.transport.close()
            self._relay.loop.call_later(LINGER_S, self.other.transport.abort)
        if self.other._is_lost or self.other.transport is None:
            self._relay.end()


def _settle(future: asyncio.Future[bool], *, value: bool) -> None:
    if not future.done():
        future.set_result(value)


def _bound(host: str, port: int) -> socket.socket:
    """A TCP socket at an address.

    Raises:
        OSError: it is in use or invalid.
    """
    family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    one = socket.socket(family, kind)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    one.setblocking(False)
    try:
        one.bind(place)
    except OSError:
        one.close()
        raise
    return one
