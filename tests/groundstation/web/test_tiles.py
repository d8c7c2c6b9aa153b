"""Tiles: from an MBTiles file, a folder, and a server that was named; what is none of these is refused."""

import sqlite3
from pathlib import Path

import pytest
from aiohttp import web

from gloc3.errors import Refused
from gloc3_groundstation.web.tiles import MbTiles, Tile, TileServer, is_tile, open_tiles

PICTURE = b"\x89PNG picture"


def mbtiles(path: Path, kind: str = "png") -> Path:
    """A file with one tile, in column 5 of 8 and row 2 from the north."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        file.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        file.executemany(
            "INSERT INTO metadata VALUES (?, ?)",
            [("format", kind), ("attribution", '<a href="https://maps.example">&copy; Mapmakers</a>')],
        )
        file.execute("INSERT INTO tiles VALUES (3, 5, 5, ?)", (PICTURE,))
    file.close()
    return path


async def test_a_file_gives_its_tiles_by_rows_from_the_north_and_its_attribution(tmp_path: Path) -> None:
    tiles = open_tiles(str(mbtiles(tmp_path / "map.mbtiles")))
    assert await tiles.tile(3, 5, 2) == Tile("image/png", PICTURE)
    assert await tiles.tile(3, 5, 5) is None
    assert (tiles.info.least_zoom, tiles.info.most_zoom, tiles.info.attribution) == (3, 3, "© Mapmakers")
    await tiles.close()
    named = open_tiles(str(tmp_path / "map.mbtiles"), "Survey 2026")
    assert named.info.attribution == "Survey 2026"
    await named.close()


async def test_a_folder_gives_its_tiles(tmp_path: Path) -> None:
    for zoom, suffix in ((3, "png"), (12, "webp")):
        (tmp_path / str(zoom) / "5").mkdir(parents=True)
        (tmp_path / str(zoom) / "5" / f"2.{suffix}").write_bytes(PICTURE)
    tiles = open_tiles(str(tmp_path))
    assert await tiles.tile(12, 5, 2) == Tile("image/webp", PICTURE)
    assert await tiles.tile(3, 5, 3) is None
    assert (tiles.info.least_zoom, tiles.info.most_zoom) == (3, 12)


@pytest.mark.sockets
async def test_a_server_is_asked_for_each_tile_once_and_only_pictures_of_bounded_size_count() -> None:
    asked: list[str] = []

    async def reply(request: web.Request) -> web.Response:
        asked.append(request.path_qs)
        match request.match_info["x"]:
            case "1":
                return web.Response(body=PICTURE, content_type="image/png")
            case "2":
                return web.Response(text="<script>", content_type="text/html")
            case "3":
                return web.Response(body=bytes(3_000_000), content_type="image/png")
        raise web.HTTPFound("http://elsewhere.example/")

    app = web.Application()
    app.router.add_get("/{z}/{x}/{y}.png", reply)
    runner = web.AppRunner(app)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    url = f"http://127.0.0.1:{runner.addresses[0][1]}/{{z}}/{{x}}/{{y}}.png?key=k"
    tiles = open_tiles(url)
    try:
        assert asked == [], "nothing is fetched unasked"
        assert [await tiles.tile(3, 1, 2) for _ in range(2)] == [Tile("image/png", PICTURE)] * 2
        assert asked == ["/3/1/2.png?key=k"]
        assert [await tiles.tile(3, column, 0) for column in (2, 3, 4)] == [None] * 3
    finally:
        await tiles.close()
        await runner.cleanup()
    assert await tiles.tile(3, 1, 2) == Tile("image/png", PICTURE)


async def test_a_server_that_does_not_answer_gives_no_tile() -> None:
    tiles = TileServer("http://127.0.0.1:1/{z}/{x}/{y}")
    assert await tiles.tile(0, 0, 0) is None
    await tiles.close()


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("ftp://maps.example/{z}/{x}/{y}", "http:// or https://"),
        ("https://maps.example/{z}/{x}", "{y} missing"),
        ("https://{s}.maps.example/{z}/{x}/{y}", "{s} is not known"),
        ("none.mbtiles", "no such file"),
    ],
)
def test_what_is_no_source_of_tiles_is_refused_with_the_reason(given: str, reason: str) -> None:
    with pytest.raises(Refused) as refused:
        open_tiles(given)
    assert reason in str(refused.value)
    assert given in str(refused.value)


def test_files_without_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="'pbf'; pictures are needed"):
        MbTiles(mbtiles(tmp_path / "vector.mbtiles", "pbf"))
    (tmp_path / "text").write_text("no database")
    with pytest.raises(Refused, match="not an MBTiles file"):
        open_tiles(str(tmp_path / "text"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(Refused, match="no folders ZOOM/COLUMN"):
        open_tiles(str(tmp_path / "empty"))


def test_only_tiles_that_can_be_are_looked_for() -> None:
    assert is_tile(0, 0, 0)
    assert is_tile(3, 7, 7)
    for wrong in ((3, 8, 0), (3, 0, -1), (23, 0, 0)):
        assert not is_tile(*wrong)
