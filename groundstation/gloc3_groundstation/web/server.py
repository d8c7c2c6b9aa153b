"""The station in a browser: one page with textual-serve's terminal, one websocket, one window at a time.

The station itself runs in this process, from its start to its end. A browser is only a view: when its window is closed
or reloaded, links, recording and control continue.
"""

import asyncio
import os
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from ipaddress import ip_address
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING, Final, Protocol
from urllib.parse import urlsplit

import msgspec

from gloc3.errors import UNREADABLE, Gloc3Error, Refused

if TYPE_CHECKING:
    from aiohttp import web

HOST: Final = "127.0.0.1"
PORT: Final = 8000
HEARTBEAT_S: Final = 5.0
"""Heartbeat period; a browser counts as gone after half of it without an answer."""
MOST_WAITING: Final = 1_000_000
"""Queued bytes for a slow browser, beyond which the terminal is redrawn once the browser has caught up."""
NOT_YET_S: Final = 0.05
CLOSE_S: Final = 1.0
"""So long a browser may take to learn that the station was closed."""
LARGEST: Final = 1000
"""Columns or lines that a browser may ask for."""
HEADERS: Final = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
REPLACED: Final = (
    "\x1b[2J\x1b[H\r\n  The station is shown in another window.\r\n\r\n  Press enter to show it here; it is then no "
    "longer shown there.\r\n"
)

Handler = Callable[["web.Request"], Awaitable["web.StreamResponse"]]
Notify = Callable[[str, bool], None]
"""Called with text about a viewer that connects or leaves, and whether there is one now."""


class TerminalWindow(Protocol):
    """The terminal, as a browser sees it."""

    def attach(self, show: Callable[[bytes], None], columns: int, lines: int) -> None:
        """Draws the whole terminal, and changes from then on."""

    def detach(self) -> None:
        """Draws nothing more."""

    def typed(self, text: str) -> None:
        """Handles a terminal's input sequences for keys and mouse."""

    def resized(self, columns: int, lines: int) -> None:
        """Lays out for another size."""

    def focused(self, is_focused: bool) -> None:
        """Whether keys go to the terminal."""


class WebOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of the web server."""

    host: str = HOST
    port: int = PORT
    """0 takes any free one."""

    @property
    def is_exposed(self) -> bool:
        """Whether other computers reach it."""
        try:
            return not ip_address(self.host).is_loopback
        except ValueError:
            return self.host != "localhost"


class _Glass:
    """Websocket of one browser, with a queue of output."""

    def __init__(self, socket: "web.WebSocketResponse", columns: int, lines: int) -> None:
        self.socket: Final = socket
        self.columns, self.lines = columns, lines
        self.is_behind = False
        """Whether output was dropped, so that all must be redrawn."""
        self._waiting = bytearray()
        self._has_some = asyncio.Event()

    def show(self, data: bytes) -> None:
        if len(self._waiting) + len(data) > MOST_WAITING:
            self.is_behind = True
            self._waiting.clear()
        elif not self.is_behind:
            self._waiting += data
        self._has_some.set()

    async def send(self, redraw: Callable[[], None]) -> None:
        """Sends the output until it is cancelled or the browser is gone."""
        while not self.socket.closed:
            await self._has_some.wait()
            self._has_some.clear()
            if self.is_behind:
                self.is_behind = False
                redraw()
            data, self._waiting = bytes(self._waiting), bytearray()
            try:
                await self.socket.send_bytes(data)
            except ConnectionError:
                return


class WebServer:
    """Serves the page, and connects a single browser to the terminal."""

    def __init__(self, window: Callable[[], TerminalWindow | None], options: WebOptions, reported: Notify) -> None:
        """Creates a server that does not listen yet.

        Args:
            window: returns the terminal; None before it exists.
            options: address and port.
            reported: called about viewers that connect or leave.
        """
        self._window = window
        self._options = options
        self._reported = reported
        self._key = secrets.token_urlsafe(12) if options.is_exposed else ""
        self._sockets: set[web.WebSocketResponse] = set()
        self._shown: _Glass | None = None
        self._page = files("gloc3_groundstation.web").joinpath("web_page.html").read_text(encoding="utf-8")

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[str]:
        """Serves, and yields the URL.

        Raises:
            Gloc3Error: a package is not installed.
            Refused: the address is not available.
        """
        try:
            import textual_serve
            from aiohttp import WSCloseCode, web
        except ImportError as error:
            raise Gloc3Error("--web needs textual-serve: pip install 'gloc3[groundstation]'") from error

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guarded(request, handler)

        app = web.Application(middlewares=[guard])
        prefix = f"/{self._key}" if self._key else ""
        app.router.add_get(f"{prefix}/", self._index)
        app.router.add_get(f"{prefix}/ws", self._poll_terminal)
        app.router.add_static(f"{prefix}/static", Path(str(textual_serve.__file__)).parent / "static")
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=CLOSE_S)
        await runner.setup()
        host, port = self._options.host, self._options.port
        try:
            try:
                await web.TCPSite(runner, host, port).start()
            except OSError as error:
                is_system = error.errno is not None and error.errno > 0  # else the resolver's, with words of its own
                reason = (os.strerror(error.errno or 0) if is_system else error.strerror or str(error)).lower()
                raise Refused(
                    f"the page cannot be served on {host} port {port}: {reason}; another port: --web-port, 0 for any "
                    "free one; another address: --web-host"
                ) from error
            port = runner.addresses[0][1]
            yield f"http://{_named(host)}:{port}{prefix}/"
        finally:
            self._shown = None
            with suppress(TimeoutError):  # of a browser that takes nothing any more
                async with asyncio.timeout(CLOSE_S):
                    for socket in tuple(self._sockets):
                        await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the station was closed")
            await runner.cleanup()

    # --- requests ---

    async def _guarded(self, request: "web.Request", handler: Handler) -> "web.StreamResponse":
        """Rejects requests from another site's page, or by a host name that does not belong to this station."""
        from aiohttp import web

        if not self._options.is_exposed and not _is_loopback_name(request.host, self._options.host):
            raise web.HTTPForbidden(text=f"The station is not served under the name {request.host!r}.\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text=f"The station is not for pages of {origin!r}.\n")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _index(self, request: "web.Request") -> "web.Response":
        from aiohttp import web

        return web.Response(text=self._page, content_type="text/html")

    async def _poll_terminal(self, request: "web.Request") -> "web.WebSocketResponse":
        """One browser's window, from its opening to its end."""
        from aiohttp import WSMsgType, web

        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=1_000_000)
        await socket.prepare(request)
        self._sockets.add(socket)
        glass = _Glass(socket, *(_side(request.query.get(name), name) for name in ("width", "height")))
        sender = asyncio.get_running_loop().create_task(glass.send(lambda: self._draw(glass)))
        who = request.remote or "a browser"
        try:
            if self._shown is None:
                self._replace_terminal(glass, who)
            else:
                glass.show(REPLACED.encode())
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    await self._reported_by(glass, message.data, who)
        finally:
            sender.cancel()
            self._sockets.discard(socket)
            self._leave(glass, who)
        return socket

    async def _reported_by(self, glass: _Glass, data: str, who: str) -> None:
        """Handles a message of textual-serve's page; unknown ones are ignored."""
        try:
            kind, *values = msgspec.json.decode(data, type=list[object])
        except (*UNREADABLE, ValueError):
            return
        is_shown, window = self._shown is glass, self._window()
        match kind, *values:
            case "ping", str(value):
                await glass.socket.send_str(msgspec.json.encode(["pong", value]).decode())
            case "resize", {"width": int(columns), "height": int(lines)}:
                glass.columns, glass.lines = _side(columns, "width"), _side(lines, "height")
                if is_shown and window is not None:
                    window.resized(glass.columns, glass.lines)
            case "stdin", str(text) if not is_shown:
                if "\r" in text:
                    self._replace_terminal(glass, who)
            case "stdin", str(text) if window is not None:
                window.typed(text)
            case ("focus" | "blur",) if is_shown and window is not None:
                window.focused(kind == "focus")

    # --- whose window it is ---

    def _replace_terminal(self, glass: _Glass, who: str) -> None:
        other, self._shown = self._shown, glass
        if other is not None:
            other.show(REPLACED.encode())
        self._reported(f"the station is shown to {who}", True)
        self._draw(glass)

    def _draw(self, glass: _Glass) -> None:
        """Draws all of the terminal; a little later where that is not there yet."""
        window = self._window()
        if self._shown is not glass:
            return
        if window is None:
            asyncio.get_running_loop().call_later(NOT_YET_S, self._draw, glass)
        else:
            window.attach(glass.show, glass.columns, glass.lines)

    def _leave(self, glass: _Glass, who: str) -> None:
        if self._shown is glass:
            self._shown = None
            window = self._window()
            if window is not None:
                window.detach()
            self._reported(f"{who} has disconnected; the station runs on without a viewer", False)


def exposure(url: str, user: str) -> str:
    """What a page that other computers reach lays open, in words."""
    port = urlsplit(url).port
    return (
        f"warning: anyone with the address {url} commands every vehicle of this station (start, abort, disarm, "
        f"parameters) and reads and writes mission files here as {user or 'this user'}; nothing is encrypted. Without "
        f"--web-host only this computer reaches it, and others by: ssh -L {port}:127.0.0.1:{port} THIS_COMPUTER"
    )


def _named(host: str) -> str:
    """A host as written in a URL."""
    try:
        address = ip_address(host)
    except ValueError:
        return host
    if address.is_unspecified:
        return gethostname()
    return f"[{address}]" if address.version == 6 else str(address)


def _is_loopback_name(host: str, served: str) -> bool:
    """Whether the header `Host` names this computer, under any port, because a tunnel may have a different one."""
    name = urlsplit(f"//{host}").hostname or ""
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return name in ("localhost", served)


def _side(value: object, name: str) -> int:
    """Columns or lines as reported by a browser."""
    number = int(value) if isinstance(value, int) or (isinstance(value, str) and value.isdecimal()) else 0
    return min(number, LARGEST) if number > 0 else {"width": 80, "height": 24}[name]
