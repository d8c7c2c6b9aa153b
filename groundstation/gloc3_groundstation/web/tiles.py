"""Map tiles from an MBTiles file, a folder, or a server that the user names; nothing else is ever fetched.

Tiles are the usual squares of the Web Mercator projection, by zoom, column from the west and row from the north.
"""

import asyncio
import re
import sqlite3
import threading
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol
from urllib.parse import urlsplit

import msgspec

from gloc3.errors import Refused

if TYPE_CHECKING:
    import aiohttp

DEEPEST: Final = 22
KEPT: Final = 512
"""Tiles of a server that are kept in memory."""
LARGEST: Final = 2_000_000
"""Bytes of a tile."""
FETCH_S: Final = 10.0
TYPES: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
PLACES: Final = ("{z}", "{x}", "{y}")


class TileInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Properties of a set of tiles."""

    least_zoom: int = 0
    most_zoom: int = DEEPEST
    attribution: str = ""
    """Who is to be named on the map."""


class Tile(msgspec.Struct, frozen=True):
    """A picture."""

    type: str
    data: bytes


class TileSource(Protocol):
    """A set of tiles."""

    info: TileInfo

    async def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """A tile; None where there is none."""

    async def close(self) -> None:
        """Reads no more."""


class MbTiles:
    """Tiles in one file (MBTiles 1.3).

    Args:
        path: the file.

    Raises:
        Refused: it is no file of pictures.
    """

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            self._file = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False)
            rows = dict(self._file.execute("SELECT name, value FROM metadata").fetchall())
            least, most = self._file.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        except sqlite3.Error as error:
            raise Refused(f"--tiles {path}: not an MBTiles file: {error}") from error
        kind = str(rows.get("format", "png"))
        if kind not in TYPES:
            raise Refused(f"--tiles {path}: its tiles are {kind!r}; pictures are needed: {', '.join(TYPES)}")
        if least is None:
            raise Refused(f"--tiles {path}: it holds no tiles")
        self._type = TYPES[kind]
        self.info = TileInfo(
            least_zoom=int(least), most_zoom=int(most), attribution=_plain(str(rows.get("attribution", "")))
        )

    async def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """A tile; None where there is none, or it cannot be read."""
        return await asyncio.to_thread(self._read, zoom, column, (1 << zoom) - 1 - row)  # rows count from the south

    async def close(self) -> None:
        """Closes the file."""
        with self._lock:
            self._file.close()

    def _read(self, zoom: int, column: int, row: int) -> Tile | None:
        query = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        try:
            with self._lock:
                found = self._file.execute(query, (zoom, column, row)).fetchone()
        except sqlite3.Error:
            return None
        return Tile(self._type, bytes(found[0])) if found and isinstance(found[0], bytes) else None


class TileFolder:
    """Tiles in files `ZOOM/COLUMN/ROW.png` (also jpg and webp).

    Args:
        path: the folder.

    Raises:
        Refused: it holds none.
    """

    def __init__(self, path: Path) -> None:
        zooms = [int(each.name) for each in path.iterdir() if each.name.isdecimal() and each.is_dir()]
        if not zooms:
            raise Refused(f"--tiles {path}: no folders ZOOM/COLUMN with pictures ROW.png in it")
        self._path = path
        self.info = TileInfo(least_zoom=min(zooms), most_zoom=min(max(zooms), DEEPEST))

    async def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """A tile; None where there is none."""
        return await asyncio.to_thread(self._read, zoom, column, row)

    async def close(self) -> None:
        """Nothing is open."""

    def _read(self, zoom: int, column: int, row: int) -> Tile | None:
        for suffix, kind in TYPES.items():
            try:
                return Tile(kind, (self._path / str(zoom) / str(column) / f"{row}.{suffix}").read_bytes())
            except OSError:
                continue
        return None


class TileServer:
    """Tiles of a server, requested as the map shows them and kept in memory.

    Args:
        template: its URL with `{z}`, `{x}` and `{y}`.

    Raises:
        Refused: it is no such URL.
    """

    def __init__(self, template: str) -> None:
        place = urlsplit(template)
        if place.scheme not in ("http", "https") or not place.hostname:
            raise Refused(f"--tiles {template}: http:// or https:// and a host are expected")
        missing = [name for name in PLACES if name not in template]
        others = sorted(set(re.findall(r"\{[^{}]*\}", template)) - set(PLACES))
        if missing or others:
            wrong = f"{' and '.join(missing)} missing" if missing else f"{', '.join(others)} is not known"
            raise Refused(f"--tiles {template}: {wrong}; a URL needs {{z}}, {{x}} and {{y}}")
        self.info = TileInfo(most_zoom=19)
        self._template = template
        self._kept: OrderedDict[tuple[int, int, int], Tile | None] = OrderedDict()
        self._session: aiohttp.ClientSession | None = None

    async def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """A tile; None where the server has none, or does not answer."""
        import aiohttp

        key = zoom, column, row
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        if self._session is None:
            timeout = aiohttp.ClientTimeout(total=FETCH_S)
            self._session = aiohttp.ClientSession(timeout=timeout, headers={"User-Agent": "gloc3-station"})
        url = self._template.replace("{z}", str(zoom)).replace("{x}", str(column)).replace("{y}", str(row))
        try:
            async with self._session.get(url, allow_redirects=False) as reply:
                data = await reply.content.read(LARGEST + 1)
                while len(data) <= LARGEST and (more := await reply.content.read(LARGEST + 1 - len(data))):
                    data += more
                is_there = reply.status == 200 and reply.content_type in TYPES.values() and len(data) <= LARGEST
                tile = Tile(reply.content_type, data) if is_there else None
                is_final = reply.status in (200, 204, 404)
        except (aiohttp.ClientError, TimeoutError, ValueError):
            return None
        if is_final:
            self._kept[key] = tile
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return tile

    async def close(self) -> None:
        """Closes connections."""
        if self._session is not None:
            await self._session.close()


def open_tiles(given: str, attribution: str | None = None) -> TileSource:
    """Opens tiles by what the user named.

    Args:
        given: a URL, an MBTiles file, or a folder.
        attribution: who is to be named on the map; None for whom the tiles name themselves.

    Raises:
        Refused: it is none of these.
    """
    source = _opened(given)
    if attribution is not None:
        source.info = msgspec.structs.replace(source.info, attribution=attribution)
    return source


def _opened(given: str) -> TileSource:
    if "://" in given:
        return TileServer(given)
    path = Path(given).expanduser()
    try:
        if path.is_dir():
            return TileFolder(path)
        with path.open("rb"):
            pass
    except OSError as error:
        raise Refused(f"--tiles {given}: {(error.strerror or str(error)).lower()}") from error
    return MbTiles(path)


def is_tile(zoom: int, column: int, row: int) -> bool:
    """Whether there can be a tile of that zoom, column and row."""
    return 0 <= zoom <= DEEPEST and 0 <= column < 1 << zoom and 0 <= row < 1 << zoom


def _plain(text: str) -> str:
    """Text without markup."""
    return " ".join(re.sub(r"<[^<>]*>", "", text).replace("&copy;", "©").replace("&amp;", "&").split())[:200]
