"""The station in a browser: pages, and textual-serve's terminal over one websocket for each window.

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
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import msgspec

from gloc3.errors import Gloc3Error, Refused
from gloc3_groundstation.web.terminal_view import HEARTBEAT_S, Notify, TerminalView, TerminalWindow

if TYPE_CHECKING:
    from aiohttp import web

HOST: Final = "127.0.0.1"
PORT: Final = 8000
CLOSE_S: Final = 1.0
"""So long a browser may take to learn that the station was closed."""
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; font-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy; the terminal sets the sizes of its letters as styles in the page."""
HEADERS: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": POLICY,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
PAGES: Final = files("gloc3_groundstation.web").joinpath("page")

Handler = Callable[["web.Request"], Awaitable["web.StreamResponse"]]


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


class WebServer:
    """Serves the pages, and connects browsers to the terminal."""

    def __init__(self, window: Callable[[], TerminalWindow | None], options: WebOptions, reported: Notify) -> None:
        """Creates a server that does not listen yet.

        Args:
            window: returns the terminal; None before it exists.
            options: address and port.
            reported: called about viewers that connect or leave.
        """
        self._options = options
        self._key = secrets.token_urlsafe(12) if options.is_exposed else ""
        self._sockets: set[web.WebSocketResponse] = set()
        self._terminal = TerminalView(window, reported, secrets.token_urlsafe(6))

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
        app.router.add_get(f"{prefix}/alive", self._alive)
        app.router.add_get(f"{prefix}/ws", self._serve_terminal)
        app.router.add_static(f"{prefix}/page", Path(str(PAGES)))
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
            self._terminal.close()
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

        return web.Response(text=PAGES.joinpath("station.html").read_text(encoding="utf-8"), content_type="text/html")

    async def _alive(self, request: "web.Request") -> "web.Response":
        """Replies that the station runs, and serves this browser."""
        from aiohttp import web

        return web.Response(status=204)

    async def _serve_terminal(self, request: "web.Request") -> "web.WebSocketResponse":
        """One browser's window, from its opening to its end."""
        from aiohttp import web

        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=1_000_000)
        await socket.prepare(request)
        self._sockets.add(socket)
        try:
            await self._terminal.serve(socket, request.remote or "a browser", may_command=True)
        finally:
            self._sockets.discard(socket)
        return socket


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
