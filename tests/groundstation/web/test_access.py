"""Who may open the pages: tokens, cookies, rights, certificates; in pure units, and on real sockets."""

import asyncio
import http.client
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import pytest
from tests.commands.programs import program
from tests.groundstation.web.test_web import Served, emergencies, served
from websockets.exceptions import InvalidStatus

from gloc3.errors import Refused
from gloc3_groundstation.web.access import REPORTED_S, Access, WebRight, new_token, read_token
from gloc3_groundstation.web.certificate import fingerprint, load_pair, self_signed
from gloc3_groundstation.web.server import WebAddresses, WebOptions, exposure

NOW = datetime(2026, 3, 1, tzinfo=UTC)


class Reply(NamedTuple):
    status: int
    location: str
    cookie: str
    text: str
    headers: dict[str, str]


async def fetch(url: str, cookie: str = "", context: ssl.SSLContext | None = None) -> Reply:
    """One request, whose redirection is not followed."""

    def request() -> Reply:
        place = urlsplit(url)
        host, port = place.hostname or "", place.port
        made = (
            http.client.HTTPSConnection(host, port, context=context)
            if context
            else http.client.HTTPConnection(host, port)
        )
        made.request("GET", f"{place.path}?{place.query}".rstrip("?"), headers={"Cookie": cookie} if cookie else {})
        reply = made.getresponse()
        text, headers = reply.read().decode("utf-8", "replace"), dict(reply.headers)
        made.close()
        return Reply(reply.status, headers.get("Location", ""), headers.get("Set-Cookie", ""), text, headers)

    return await asyncio.to_thread(request)


def here_of(served: Served, address: str) -> str:
    """An address with a token, on this computer."""
    return f"{served.url}?{urlsplit(address).query}"


async def cookie_of(served: Served, address: str) -> str:
    return (await fetch(here_of(served, address))).cookie.partition(";")[0]


# --- pure ---


def test_a_token_gives_its_right_and_the_one_for_watching_does_not_lead_to_the_other() -> None:
    access = Access("t" * 22)
    command, watch = access.tokens[WebRight.COMMAND], access.tokens[WebRight.WATCH]
    assert access.by_token(command) is WebRight.COMMAND
    assert access.by_token(watch) is WebRight.WATCH
    assert Access(watch).by_token(command) is None
    for wrong in ("", command[:-1], command + "t", "ä", access.cookie(WebRight.COMMAND)):
        assert access.by_token(wrong) is None
    for right in WebRight:
        assert access.by_cookie(access.cookie(right)) is right
    assert access.by_cookie(None) is None
    assert access.by_cookie(command) is None, "a token is no cookie"


def test_read_only_has_no_token_for_commands_and_without_tokens_everybody_watches() -> None:
    access = Access("t" * 22, is_read_only=True)
    assert set(access.tokens) == {WebRight.WATCH}
    assert access.by_token("t" * 22) is None
    assert Access("", is_read_only=True).by_cookie(None) is WebRight.WATCH
    assert Access("").by_cookie(None) is WebRight.COMMAND


def test_wrong_tokens_are_counted_and_reported_once_a_minute() -> None:
    access = Access("t" * 22)
    assert access.refuse("10.0.0.9", 0.0) == "the page was refused to 10.0.0.9: wrong token (1 in all)"
    assert [access.refuse("10.0.0.9", 1.0 + n) for n in range(3)] == ["", "", ""]
    text = access.refuse("10.0.0.9", REPORTED_S)
    assert text == "the page was refused to 10.0.0.9: wrong token, and 3 more before it (5 in all)"


def test_a_token_file_is_made_once_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "token"
    token = read_token(path)
    assert len(token) >= 22
    assert path.stat().st_mode & 0o777 == 0o600
    assert read_token(path) == token
    path.chmod(0o640)
    with pytest.raises(Refused, match=r"other users can access .*0640.*chmod 600"):
        read_token(path)


@pytest.mark.parametrize("text", ["", "short", "x" * 200, "a b c d e f g h i j k l", "ä" * 20, "token\0" * 4])
def test_a_file_without_a_token_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "token"
    path.touch(0o600)
    path.write_text(text)
    with pytest.raises(Refused, match="--web-token"):
        read_token(path)
    with pytest.raises(Refused, match="--web-token"):
        read_token(tmp_path)


def test_a_self_signed_certificate_is_kept_until_it_expires_or_the_address_changes(tmp_path: Path) -> None:
    folder = tmp_path / "made"
    pair = self_signed(folder, "192.0.2.7", NOW)
    first = fingerprint(pair[0])
    assert len(first) == 95
    load_pair(*pair)
    assert pair[1].stat().st_mode & 0o777 == 0o600
    assert fingerprint(self_signed(folder, "192.0.2.7", NOW + timedelta(days=300))[0]) == first
    assert fingerprint(self_signed(folder, "station.example", NOW)[0]) != first
    second = fingerprint(pair[0])
    assert fingerprint(self_signed(folder, "station.example", NOW + timedelta(days=395))[0]) != second


def test_certificates_that_cannot_be_used_are_refused_with_the_reason(tmp_path: Path) -> None:
    certificate, key = self_signed(tmp_path / "a", "localhost", NOW)
    other = self_signed(tmp_path / "b", "localhost", NOW)[1]
    for wrong, reason in (
        ((certificate, other), "key values mismatch"),
        ((tmp_path / "none.crt", key), "No such file"),
        ((key, key), "--web-tls"),
    ):
        with pytest.raises(Refused, match=reason):
            load_pair(*wrong)
    with pytest.raises(Refused, match="holds no certificate"):
        fingerprint(key)


# --- on sockets ---


@pytest.mark.sockets
async def test_the_token_leaves_the_address_for_a_cookie_and_without_either_there_is_a_clear_page() -> None:
    async with served(WebOptions(host="0.0.0.0", port=0)) as here:
        opened = await fetch(here_of(here, here.addresses.command) + "&fontsize=20")
        assert (opened.status, opened.location) == (303, "/?fontsize=20")
        cookie, *marks = opened.cookie.split("; ")
        assert {"HttpOnly", "Path=/", "SameSite=Lax"} <= set(marks)
        assert urlsplit(here.addresses.command).query.partition("=")[2] not in cookie
        shown = await fetch(here.url, cookie)
        assert shown.status == 200
        assert "default-src 'none'" in shown.headers["Content-Security-Policy"]
        assert (await fetch(f"{here.url}alive", cookie)).status == 204
        for path in ("", "ws", "alive", "static/js/textual.js", "page/station.js"):
            refused = await fetch(here.url + path)
            assert refused.status == 403
            assert "This address does not open the station" in refused.text
        assert here.warned == [], "nobody has guessed"
        for wrong in ("?token=guessed", "alive?token="):
            assert (await fetch(here.url + wrong)).status == 403
        assert (await fetch(here.url, f"{cookie[:-1]}-")).status == 403
        assert here.warned == ["the page was refused to 127.0.0.1: wrong token (1 in all)"]
        with pytest.raises(InvalidStatus, match="403"):
            async with here.page():
                pass
        async with here.page(cookie=cookie) as page:
            await page.until("heron   HOLD   disarmed")


@pytest.mark.sockets
async def test_who_may_only_watch_mirrors_the_terminal_and_keys_and_hold_do_nothing() -> None:
    async with served(WebOptions(port=0, token=new_token())) as here:
        watch, command = [await cookie_of(here, url) for url in (here.addresses.watch, here.addresses.command)]
        async with here.page(90, 30, cookie=watch) as first, here.page(100, 40, cookie=command) as page:
            (hello,) = await first.message("hello")
            assert not hello["may_command"]
            await page.until("heron   HOLD   disarmed")
            await first.until("heron   HOLD   disarmed")
            while (await first.message("size")) != [100, 40]:
                pass
            first.terminal.resize(100, 40)
            for message in (("stdin", " ", first.beat_ms), ("stdin", "2", first.beat_ms), ("hold", first.beat_ms)):
                await first.report(*message)
                await first.message("read_only")
            await page.press("9")
            await first.until("9 Events")
            assert not emergencies(here)
            assert "the data flows from end to end" not in first.terminal.text()
        assert any("watches the station, read-only" in text for text in here.reported)


@pytest.mark.sockets
async def test_a_read_only_station_commands_nothing() -> None:
    async with served(WebOptions(port=0, is_read_only=True)) as here, here.page() as page:
        assert here.addresses.command == ""
        await page.until("heron   HOLD   disarmed")
        await page.report("hold", page.beat_ms)
        await page.message("read_only")
        assert not emergencies(here)
        assert "sees everything" in exposure(here.addresses, "ann")


@pytest.mark.sockets
async def test_the_program_serves_with_tls_and_prints_the_fingerprint_and_both_addresses(tmp_path: Path) -> None:
    options = ("--link", "udpin://127.0.0.1:0", "--no-record", "--config", "station.toml")
    pair = self_signed(tmp_path / "tls", "127.0.0.1", datetime.now(UTC))
    tls = ("--web-tls", f"{pair[0]},{pair[1]}", "--web-token", "token")
    with program("station", "--web", "--web-port", "0", *tls, *options, folder=tmp_path) as station:
        line = await asyncio.to_thread(station.await_line, lambda line: line.startswith("the station is at"))
        url = line.split()[4]
        assert url.startswith("https://127.0.0.1:")
        assert any(fingerprint(pair[0]) in line for line in station.lines)
        assert any(line.startswith("read-only, the station is at https://") for line in station.lines)
        context = ssl.create_default_context(cafile=str(pair[0]))
        opened = await fetch(url, context=context)
        assert opened.status == 303
        assert "Secure" in opened.cookie
        assert (await fetch(url.partition("?")[0], opened.cookie.partition(";")[0], context)).status == 200
        station.interrupt()
        await asyncio.to_thread(station.end)


def test_what_lies_open_is_said_with_the_address_and_whether_it_is_encrypted() -> None:
    plain = exposure(WebAddresses(command="http://station:8000/?token=x", watch=""), "ann")
    for text in (
        "?token=x",
        "commands every vehicle",
        "as ann",
        "nothing is encrypted without --web-tls",
        "ssh -L 8000:",
    ):
        assert text in plain
    assert "nothing is encrypted" not in exposure(
        WebAddresses(command="https://station:8000/?token=x", watch=""), "ann"
    )
