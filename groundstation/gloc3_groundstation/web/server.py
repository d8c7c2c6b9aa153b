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
from gloc3_groundstation.web.access import Access, WebRight, new_token
from gloc3_groundstation.web.glass import HEARTBEAT_S
from gloc3_groundstation.web.map_view import MapSource, MapView
from gloc3_groundstation.web.pictures_view import PicturesView
from gloc3_groundstation.web.terminal_view import Notify, TerminalView, TerminalWindow
from gloc3_groundstation.web.tiles import TileSource, is_tile

if TYPE_CHECKING:
    from aiohttp import web

HOST: Final = "127.0.0.1"
PORT: Final = 8000
CLOSE_S: Final = 1.0
"""So long a browser may take to learn that the station was closed."""
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; font-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy."""
STYLED: Final = {"Content-Security-Policy": POLICY.replace("style-src 'self'", "style-src 'self' 'unsafe-inline'")}
"""Of the terminal's page, which sets the sizes of its letters as styles, and of the one without access."""
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
    token: str = ""
    """Opens the pages; empty for a random one where other computers reach them, and for none where they do not."""
    is_read_only: bool = False
    """Whether nobody may command."""
    certificate: tuple[Path, Path] | None = None
    """Certificate and key for TLS; None for a connection that is not encrypted."""
    tiles: TileSource | None = None
    """Tiles of the map; None for a plain grid."""

    @property
    def is_exposed(self) -> bool:
        """Whether other computers reach it."""
        try:
            return not ip_address(self.host).is_loopback
        except ValueError:
            return self.host != "localhost"


class WebAddresses(msgspec.Struct, frozen=True, kw_only=True):
    """Where the pages are."""

    command: str
    """Opens the station for commands; empty where nobody may."""
    watch: str
    """Opens it read-only; empty where no token tells the two apart."""


class WebServer:
    """Serves the pages, and connects browsers to the terminal."""

    def __init__(
        self,
        window: Callable[[], TerminalWindow | None],
        options: WebOptions,
        reported: Notify,
        warn: Callable[[str], None],
        map_source: MapSource | None = None,
    ) -> None:
        """Creates a server that does not listen yet.

        Args:
            window: returns the terminal; None before it exists.
            options: address, port, and who may do what.
            reported: called about viewers that connect or leave.
            warn: called about browsers that are refused.
            map_source: what the map shows; None for no map.
        """
        self._options = options
        self._warn = warn
        token = options.token or (new_token() if options.is_exposed else "")
        self.access: Final = Access(token, is_read_only=options.is_read_only)
        self._cookie = ""
        self._sockets: set[web.WebSocketResponse] = set()
        station = secrets.token_urlsafe(6)
        self._terminal = TerminalView(window, reported, station)
        self._map_view: MapView | None = None
        self._pictures_view: PicturesView | None = None
        if map_source is not None:
            info = None if options.tiles is None else options.tiles.info
            self._map_view = MapView(map_source, lambda: getattr(window(), "vehicle", ""), station, info)
            self._pictures_view = PicturesView(map_source.desk, lambda: getattr(window(), "vehicle", ""), station)

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[WebAddresses]:
        """Serves, and yields the addresses.

        Raises:
            Gloc3Error: a package is not installed.
            Refused: the address or the certificate cannot be used.
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
        app.router.add_get("/", self._index)
        app.router.add_get("/alive", self._alive)
        app.router.add_get("/ws", self._serve_terminal)
        app.router.add_get("/map", self._map)
        app.router.add_get("/map/ws", self._serve_map)
        app.router.add_get("/pictures", self._pictures)
        app.router.add_get("/pictures/ws", self._serve_pictures)
        app.router.add_get(r"/tiles/{zoom:\d{1,2}}/{column:\d{1,8}}/{row:\d{1,8}}", self._tile)
        app.router.add_static("/page", Path(str(PAGES)))
        app.router.add_static("/static", Path(str(textual_serve.__file__)).parent / "static")
        tls = None
        if self._options.certificate is not None:
            from gloc3_groundstation.web.certificate import load_pair  # with all of its cryptography

            tls = load_pair(*self._options.certificate)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=CLOSE_S)
        await runner.setup()
        host, port = self._options.host, self._options.port
        try:
            try:
                await web.TCPSite(runner, host, port, ssl_context=tls).start()
            except OSError as error:
                is_system = error.errno is not None and error.errno > 0  # else the resolver's, with words of its own
                reason = (os.strerror(error.errno or 0) if is_system else error.strerror or str(error)).lower()
                raise Refused(
                    f"the page cannot be served on {host} port {port}: {reason}; another port: --web-port, 0 for any "
                    "free one; another address: --web-host"
                ) from error
            port = runner.addresses[0][1]
            self._cookie = f"gloc3-{port}"
            yield self._addresses(f"{'http' if tls is None else 'https'}://{_named(host)}:{port}/")
        finally:
            self._terminal.close()
            with suppress(TimeoutError):  # of a browser that takes nothing any more
                async with asyncio.timeout(CLOSE_S):
                    for socket in tuple(self._sockets):
                        await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the station was closed")
            await runner.cleanup()
            if self._options.tiles is not None:
                await self._options.tiles.close()

    def _addresses(self, url: str) -> WebAddresses:
        token = {right: f"{url}?token={token}" for right, token in self.access.tokens.items()}
        command = token.get(WebRight.COMMAND, "") if token else "" if self.access.is_read_only else url
        return WebAddresses(command=command, watch=token.get(WebRight.WATCH, url if self.access.is_read_only else ""))

    # --- requests ---

    async def _guarded(self, request: "web.Request", handler: Handler) -> "web.StreamResponse":
        """Rejects requests without a right, from another site's page, or by a name that is not this computer's."""
        from aiohttp import web

        if not self._options.is_exposed and not _is_loopback_name(request.host, self._options.host):
            raise web.HTTPForbidden(text=f"The station is not served under the name {request.host!r}.\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text=f"The station is not for pages of {origin!r}.\n")
        right = self._right(request)
        response = self._refusal(request) if right is None else self._admit(request, right) or await handler(request)
        if not response.prepared:
            for name, value in HEADERS.items():
                response.headers.setdefault(name, value)
        return response

    def _right(self, request: "web.Request") -> WebRight | None:
        """The right that a request comes with."""
        token = request.query.get("token")
        if token is not None and self.access.tokens:
            return self.access.by_token(token)
        return self.access.by_cookie(request.cookies.get(self._cookie))

    def _admit(self, request: "web.Request", right: WebRight) -> "web.Response | None":
        """Replaces the token in the address by a cookie; None for a request without one."""
        from aiohttp import web

        if "token" not in request.query or not self.access.tokens:
            return None
        rest = {name: value for name, value in request.query.items() if name != "token"}
        response = web.Response(status=303, headers={"Location": str(request.rel_url.with_query(rest))})
        is_encrypted = self._options.certificate is not None
        value = self.access.cookie(right)
        response.set_cookie(self._cookie, value, httponly=True, samesite="Lax", secure=is_encrypted, path="/")
        return response

    def _refusal(self, request: "web.Request") -> "web.Response":
        """The page for who may not; a wrong token is counted and reported."""
        from aiohttp import web

        if "token" in request.query or self._cookie in request.cookies:
            text = self.access.refuse(request.remote or "a browser", asyncio.get_running_loop().time())
            if text:
                self._warn(text)
        text = PAGES.joinpath("refused.html").read_text(encoding="utf-8")
        return web.Response(status=403, text=text, content_type="text/html", headers=STYLED)

    async def _index(self, request: "web.Request") -> "web.Response":
        return _page("station.html", STYLED)

    async def _map(self, request: "web.Request") -> "web.Response":
        return _page("map.html", {})

    async def _pictures(self, request: "web.Request") -> "web.Response":
        return _page("pictures.html", {})

    async def _tile(self, request: "web.Request") -> "web.Response":
        """A tile of the map."""
        from aiohttp import web

        zoom, column, row = (int(request.match_info[name]) for name in ("zoom", "column", "row"))
        tiles = self._options.tiles
        tile = await tiles.tile(zoom, column, row) if tiles is not None and is_tile(zoom, column, row) else None
        if tile is None:
            raise web.HTTPNotFound(text="There is no such tile.\n")
        return web.Response(body=tile.data, content_type=tile.type, headers={"Cache-Control": "private, max-age=3600"})

    async def _alive(self, request: "web.Request") -> "web.Response":
        """Replies that the station runs, and serves this browser."""
        from aiohttp import web

        return web.Response(status=204)

    async def _serve_terminal(self, request: "web.Request") -> "web.WebSocketResponse":
        """One browser's window, from its opening to its end."""
        return await self._serve(request, self._terminal)

    async def _serve_map(self, request: "web.Request") -> "web.WebSocketResponse":
        """One browser's map, from its opening to its end."""
        return await self._serve(request, self._map_view)

    async def _serve_pictures(self, request: "web.Request") -> "web.WebSocketResponse":
        """One browser's pictures, from the opening of its page to its end."""
        return await self._serve(request, self._pictures_view)

    async def _serve(
        self, request: "web.Request", view: TerminalView | MapView | PicturesView | None
    ) -> "web.WebSocketResponse":
        from aiohttp import web

        if view is None:
            raise web.HTTPNotFound(text="There is no such page.\n")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=1_000_000)
        await socket.prepare(request)
        self._sockets.add(socket)
        may_command = self._right(request) is WebRight.COMMAND
        try:
            await view.serve(socket, request.remote or "a browser", may_command=may_command)
        finally:
            self._sockets.discard(socket)
        return socket


def _page(name: str, headers: dict[str, str]) -> "web.Response":
    """A page of the package."""
    from aiohttp import web

    text = PAGES.joinpath(name).read_text(encoding="utf-8")
    return web.Response(text=text, content_type="text/html", headers=headers)


def exposure(addresses: WebAddresses, user: str) -> str:
    """What pages that other computers reach lay open, in words."""
    url = addresses.command or addresses.watch
    port, is_encrypted = urlsplit(url).port, url.startswith("https:")
    what = (
        f"commands every vehicle of this station (start, abort, disarm, parameters) and reads and writes mission files "
        f"here as {user or 'this user'}"
        if addresses.command
        else "sees everything that this station shows"
    )
    return (
        f"warning: anyone with the address {url} {what}"
        + ("" if is_encrypted else "; nothing is encrypted without --web-tls")
        + f". Without --web-host only this computer reaches it, and others by: ssh -L {port}:127.0.0.1:{port} THIS_COMPUTER"
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
