"""One-time codes: a newcomer makes its key itself, and gets its certificate over TLS from the inviting computer.

A code is 26 characters: 80 bits of the digest of the inviting computer's certificate, by which the newcomer knows that it
speaks to that computer, and 48 bits of a secret, by which it is known. The code ends with its first use, after some wrong
ones, and after its time.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import ssl
import tempfile
from base64 import b32decode, b32encode
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from datetime import timedelta
from hashlib import sha256
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import msgspec
from cryptography.hazmat.primitives.serialization import Encoding

from gloc3.clock import utc_now
from gloc3.errors import UNREADABLE, Gloc3Error, NoContact, Refused
from gloc3.network.authority import AUTHORITY, CERTIFICATE, KEY, SIGNING, make_temporary, read_certificate
from gloc3.network.enrolment import REQUEST, make_request
from gloc3.network.register import NETWORK_FILE
from gloc3.network.revocations import REVOCATIONS
from gloc3.network.rights_file import RIGHTS_FILE
from gloc3.store import replace_file

PIN_BYTES: Final = 10
SECRET_BYTES: Final = 6
GROUP: Final = 5
MOST_WRONG: Final = 5
"""So many wrong codes end an invitation: the chance to guess one is 2 in 10^14."""
MOST_OPEN: Final = 8
"""Connections at once; further ones are closed."""
STEP_S: Final = 10.0
"""Longest time for one message, s."""
LINE_BYTES: Final = 262_144
FILES: Final = (CERTIFICATE, SIGNING, AUTHORITY, NETWORK_FILE, REVOCATIONS, RIGHTS_FILE)
"""What a newcomer gets, where there is one: nothing of it is secret."""


class _Secret(msgspec.Struct, frozen=True):
    secret: str


class _Invited(msgspec.Struct, frozen=True):
    member: str


class _Request(msgspec.Struct, frozen=True):
    request: str
    """PKCS #10, PEM."""


class _Files(msgspec.Struct, frozen=True):
    files: dict[str, str] = {}
    refusal: str = ""


T = TypeVar("T")


class OneTimeCode(NamedTuple):
    """What a code holds."""

    pin: bytes
    """Begin of the SHA-256 digest of the certificate, DER."""
    secret: bytes

    @classmethod
    def read(cls, text: str) -> OneTimeCode:
        """A code as a person has typed it.

        Raises:
            Refused: it is none.
        """
        letters = text.replace("-", "").replace(" ", "").upper()
        with suppress(ValueError):
            data = b32decode(letters + "=" * (-len(letters) % 8))
            if len(data) == PIN_BYTES + SECRET_BYTES:
                return cls(data[:PIN_BYTES], data[PIN_BYTES:])
        raise Refused(f"{text!r} is no code: 26 letters and digits (2 to 7), as gloc3 network invite prints them")

    def __str__(self) -> str:
        letters = b32encode(self.pin + self.secret).decode().rstrip("=").lower()
        return "-".join(letters[at : at + GROUP] for at in range(0, len(letters), GROUP))


class Invitation:
    """Waits for one newcomer.

    Args:
        member: its name.
        enrol: makes its certificate from a request, PEM; returns the files for it, by name.
        report: called with text for users.
    """

    def __init__(self, member: str, enrol: Callable[[bytes], Mapping[str, str]], report: Callable[[str], None]) -> None:
        self._member, self._enrol, self._report = member, enrol, report
        self._secret = secrets.token_bytes(SECRET_BYTES)
        self._open = self._wrong = 0
        self._ended = asyncio.Event()
        self.has_joined = False

    async def serve(self, host: str, port: int, within_s: float, opened: Callable[[str, int], None]) -> None:
        """Listens until the newcomer has its certificate.

        Args:
            host: address to listen at.
            port: port there; 0 for any.
            within_s: longest time.
            opened: called with the code and the port once it listens.

        Raises:
            Gloc3Error: the address cannot be opened.
            Refused: nobody came in time, or too many wrong codes.
        """
        context, pin = _server_context(within_s)
        try:
            server = await asyncio.start_server(
                self._receive, host, port, ssl=context, limit=LINE_BYTES, ssl_handshake_timeout=STEP_S
            )
        except OSError as error:
            raise Gloc3Error(f"{host}:{port} cannot be opened: {error.strerror or error}") from error
        async with server:
            opened(str(OneTimeCode(pin, self._secret)), int(server.sockets[0].getsockname()[1]))
            with suppress(TimeoutError):
                async with asyncio.timeout(within_s):
                    await self._ended.wait()
        if not self.has_joined:
            why = (
                f"{MOST_WRONG} wrong codes came"
                if self._ended.is_set()
                else f"nobody came within {within_s / 60.0:g} min"
            )
            raise Refused(f"{why}: the code for {self._member} has ended; invite again")

    async def _receive(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._open >= MOST_OPEN or self._ended.is_set():
            writer.close()
            return
        self._open += 1
        try:
            with suppress(OSError, ValueError, TimeoutError, asyncio.IncompleteReadError, *UNREADABLE):
                await self._talk(reader, writer)
        finally:
            self._open -= 1
            writer.close()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One conversation."""
        given = await _receive(reader, _Secret)
        if self._ended.is_set():
            return
        if not hmac.compare_digest(given.secret.encode(), self._secret.hex().encode()):
            self._wrong += 1
            self._report(
                f"a wrong code came from {writer.get_extra_info('peername')[0]} ({self._wrong} of {MOST_WRONG})"
            )
            if self._wrong >= MOST_WRONG:
                self._ended.set()
            return
        await _send(writer, _Invited(self._member))
        request = (await _receive(reader, _Request)).request
        if self._ended.is_set():
            return
        try:
            files = self._enrol(request.encode())
        except Gloc3Error as error:
            self._report(str(error))
            await _send(writer, _Files(refusal=str(error)))
            return
        self.has_joined = True
        try:
            await _send(writer, _Files(dict(files)))
        finally:
            self._ended.set()


def files_of(folder: Path) -> dict[str, str]:
    """The files of a member that are sent to it."""
    return {name: (folder / name).read_text() for name in FILES if (folder / name).exists()}


async def join(code: OneTimeCode, host: str, port: int, into: Path | None = None, token: str = "") -> Path:
    """Joins a network: makes a key, has it certified, and writes the files of the member.

    Args:
        code: the code.
        host: where the inviting computer is.
        port: its port.
        into: folder to create for the member; None for one with its name.
        token: URI of a token, in which the key that signs its requests is or is to be; empty for none.

    Returns:
        The folder.

    Raises:
        NoContact: nobody answers there.
        Refused: another computer answers, or the code is wrong or has ended.
        InputError: there is a key that cannot be used.
    """
    if into is not None:
        _check_folder(into)
    try:
        async with _connected(host, port) as (reader, writer):
            certificate = writer.get_extra_info("ssl_object").getpeercert(binary_form=True) or b""
            if not hmac.compare_digest(sha256(certificate).digest()[:PIN_BYTES], code.pin):
                raise Refused(
                    f"another computer answers at {host}:{port} than the one that has made the code; nothing was sent"
                )
            await _send(writer, _Secret(code.secret.hex()))
            try:
                member = (await _receive(reader, _Invited)).member
            except asyncio.IncompleteReadError:
                raise Refused("the code is wrong, or has ended: ask for another one") from None
            folder = into or Path(member)
            _check_folder(folder)
            make_request(folder, member, token)
            await _send(writer, _Request((folder / REQUEST).read_text()))
            answer = await _receive(reader, _Files)
    except ConnectionRefusedError as error:
        raise NoContact(f"nothing listens at {host}:{port}: the code has ended, or was made elsewhere") from error
    except (OSError, ValueError, asyncio.IncompleteReadError, *UNREADABLE) as error:
        raise NoContact(
            f"{host}:{port} does not answer as an inviting computer does: {error or 'no answer'}"
        ) from error
    if answer.refusal:
        raise Refused(answer.refusal)
    for name in FILES:
        if name in answer.files:
            replace_file(folder / name, answer.files[name].encode())
    (folder / REQUEST).unlink()
    return folder


def _check_folder(folder: Path) -> None:
    if (folder / NETWORK_FILE).exists():
        raise Refused(f"{folder} already holds the files of a member; choose another folder: --out")


def _server_context(within_s: float) -> tuple[ssl.SSLContext, bytes]:
    """TLS with a certificate for one invitation, and the pin of that."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_temporary(folder, utc_now(), timedelta(seconds=within_s))
        context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
        data = read_certificate(folder / CERTIFICATE).public_bytes(Encoding.DER)
    return context, sha256(data).digest()[:PIN_BYTES]


@asynccontextmanager
async def _connected(host: str, port: int) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A TLS connection; the caller has to compare the certificate, since no authority is known yet."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    async with asyncio.timeout(STEP_S):
        reader, writer = await asyncio.open_connection(host, port, ssl=context, limit=LINE_BYTES)
    try:
        yield reader, writer
    finally:
        writer.close()


async def _send(writer: asyncio.StreamWriter, message: msgspec.Struct) -> None:
    writer.write(msgspec.json.encode(message) + b"\n")
    async with asyncio.timeout(STEP_S):
        await writer.drain()


async def _receive(reader: asyncio.StreamReader, kind: type[T]) -> T:
    async with asyncio.timeout(STEP_S):
        line = await reader.readuntil(b"\n")
    return msgspec.json.decode(line, type=kind)
