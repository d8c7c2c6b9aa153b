"""One-time codes: a newcomer joins over TLS with a key of its own, once, in time; who guesses or listens in gets nothing."""

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.common.network.yard import LONG, NOW, Yard, free_port

from gloc3.errors import NoContact, Refused
from gloc3.network import invitations, register
from gloc3.network.access import MemberRole
from gloc3.network.authority import read_key
from gloc3.network.enrolment import RequestedKeys, fingerprint, requested_keys
from gloc3.network.file import read_network
from gloc3.network.invitations import MOST_OPEN, MOST_WRONG, Invitation, OneTimeCode, files_of, join

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
OPERATOR = register.NetworkMember(role=MemberRole.OPERATOR, certificate="", until="")


class Inviting:
    """An open invitation."""

    def __init__(self, yard: Yard) -> None:
        self.yard, self.told = yard, list[str]()
        self.opened = asyncio.get_running_loop().create_future()
        self.invitation = Invitation("dora", self._enrol, self.told.append)

    def _enrol(self, request: bytes) -> dict[str, str]:
        keys = requested_keys(request, "dora", "its request")
        register.add(self.yard.folder, "dora", OPERATOR, NOW, LONG, is_renewed=False, keys=keys)
        return files_of(self.yard.folder / "dora")


@asynccontextmanager
async def inviting(
    folder: Path, within_s: float = 30.0
) -> AsyncIterator[tuple[Inviting, OneTimeCode, int, asyncio.Task[None]]]:
    one = Inviting(Yard(folder / "yard"))

    def opened(code: str, port: int) -> None:
        one.opened.set_result((OneTimeCode.read(code), port))

    task = asyncio.create_task(one.invitation.serve("127.0.0.1", 0, within_s, opened))
    code, port = await one.opened
    yield one, code, port, task
    task.cancel()
    with suppress(asyncio.CancelledError, Refused):
        await task


def test_a_newcomer_joins_with_a_key_that_never_leaves_its_computer(tmp_path: Path) -> None:
    Yard(tmp_path / "yard")
    laptop = tmp_path / "laptop"
    laptop.mkdir()
    invited = ("network", "invite", "yard", "dora", "--role", "operator", "--at", f"127.0.0.1:{free_port()}")
    with program(*invited, folder=tmp_path) as there:
        line = there.await_line(lambda text: text.startswith("gloc3 network join "))
        with program(*line.split()[1:], folder=laptop) as newcomer:
            assert newcomer.end() == 0, newcomer.text
        assert "dora is of dora, operator, on yard" in newcomer.text
        assert there.end() == 0, there.text
        with program(*line.split()[1:], "--out", "again", folder=laptop) as second:
            assert second.end() == 1, second.text
        assert "nothing listens at 127.0.0.1:" in second.text
    assert "the files changed for pelican.main" in there.text
    own = read_network(laptop / "dora" / "network.yaml", NOW)
    digits = fingerprint(RequestedKeys(read_key(laptop / "dora" / "key.pem").public_key()))
    assert f"dora has joined; fingerprint of its key: {digits}" in there.text
    assert own.file.connect
    assert own.revocations is not None
    assert not (tmp_path / "yard" / "dora" / "key.pem").exists()
    assert not (laptop / "dora" / "request.pem").exists()
    with program(*invited, folder=tmp_path) as again:
        assert again.end() == 2
    assert "dora is already a member" in again.text, "before a code is made"


async def test_a_code_counts_once_and_wrong_ones_end_it(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (one, code, port, task):
        assert OneTimeCode.read(f" {str(code).upper()} ".replace("-", " ")) == code
        wrong = code._replace(secret=bytes(6))
        for number in range(1, MOST_WRONG):
            with pytest.raises(Refused, match="the code is wrong, or has ended"):
                await join(wrong, "127.0.0.1", port, tmp_path / "laptop")
            assert one.told[-1] == f"a wrong code came from 127.0.0.1 ({number} of {MOST_WRONG})"
        assert not (tmp_path / "laptop").exists(), "no key for nothing"
        folder = await join(code, "127.0.0.1", port, tmp_path / "laptop")
        assert read_network(folder / "network.yaml", NOW).file.member == "dora"
        await task
        with pytest.raises(NoContact):
            await join(code, "127.0.0.1", port, tmp_path / "other")
        with pytest.raises(Refused, match="already holds the files of a member"):
            await join(code, "127.0.0.1", port, tmp_path / "laptop")


async def test_five_wrong_codes_or_the_end_of_its_time_end_a_code(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (one, code, port, task):
        for _ in range(MOST_WRONG):
            with pytest.raises(Refused, match="the code is wrong"):
                await join(code._replace(secret=bytes(6)), "127.0.0.1", port, tmp_path / "laptop")
        with pytest.raises(Refused, match="5 wrong codes came: the code for dora has ended; invite again"):
            await task
        with pytest.raises((NoContact, Refused)):
            await join(code, "127.0.0.1", port, tmp_path / "laptop")
        assert "dora" not in register.read_register(one.yard.folder).members
    async with inviting(tmp_path / "late", 0.2) as (_, _, _, task):
        with pytest.raises(Refused, match=r"nobody came within 0\.00333333 min: the code for dora has ended"):
            await task


async def test_nothing_is_sent_to_another_computer_than_the_one_that_made_the_code(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (_, code, _, _), inviting(tmp_path / "other") as (other, _, port, _):
        with pytest.raises(Refused, match=r"another computer answers at 127\.0\.0\.1:.* nothing was sent"):
            await join(code, "127.0.0.1", port, tmp_path / "laptop")
        await asyncio.sleep(0.1)
        assert other.told == []
    silent = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0)
    async with silent:
        with pytest.raises(NoContact, match="does not answer as an inviting computer does"):
            await join(code, "127.0.0.1", silent.sockets[0].getsockname()[1], tmp_path / "laptop")
    assert not (tmp_path / "laptop").exists()


async def test_idle_long_and_damaged_connections_keep_no_newcomer_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(invitations, "STEP_S", 0.5)
    async with inviting(tmp_path) as (one, code, port, task):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        for data in (b"x" * 500_000, b"\xff\n", b'{"secret": 7}\n', b'{"secret": "\xc3\xa4"}\n', b"[[[[\n"):
            _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
            writer.write(data)
            with suppress(OSError):
                await writer.drain()
        idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(100)]
        secured = [await asyncio.open_connection("127.0.0.1", port, ssl=context) for _ in range(3 * MOST_OPEN)]
        await asyncio.sleep(0.8)
        folder = await join(code, "127.0.0.1", port, tmp_path / "laptop")
        assert folder.exists()
        await task
        for _, writer in (*idle, *secured):
            writer.close()
        assert one.told == ["a wrong code came from 127.0.0.1 (1 of 5)"], "the one with a letter that is none"


async def test_a_request_that_cannot_be_used_ends_nothing(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (one, code, port, _):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        writer.write(b'{"secret": "%s"}\n{"request": "x"}\n' % code.secret.hex().encode())
        assert await reader.readline() == b'{"member":"dora"}\n'
        assert b"not a request" in await reader.readline()
        writer.close()
        assert not one.invitation.has_joined
        await join(code, "127.0.0.1", port, tmp_path / "laptop")


@pytest.mark.parametrize("text", ["", "abc", "0" * 26, "a" * 25, "ä" * 26])
def test_what_is_no_code_is_refused_before_anything_is_sent(text: str) -> None:
    with pytest.raises(Refused, match="is no code: 26 letters and digits"):
        OneTimeCode.read(text)
