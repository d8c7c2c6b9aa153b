"""Fetches the logs of a platform: resumes, compares digests, and only then has them deleted onboard."""

import asyncio
import hashlib
import re
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Final, Protocol

import msgspec

from gloc3.clock import VirtualLoop, passed
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.base import Exchange
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp_client import FtpClient
from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    ConfirmLog,
    CutLog,
    DigestLog,
    ListLogs,
    LogChunk,
    LogOnboard,
    ReadLog,
)
from gloc3.messages.envelope import Envelope
from gloc3_groundstation.desk import flights
from gloc3_groundstation.services.files import FileService
from gloc3_groundstation.services.machines import Machines, Wire
from gloc3_groundstation.services.saving import PartFile
from gloc3_groundstation.station.command_client import Declined, NotDelivered, Unanswered
from gloc3_groundstation.station.station import Station

TRY_AGAIN_S: Final = 1.0
"""Delay after a failure, once the platform is in contact, s."""
DIGEST_S: Final = 120.0
"""Longest time for a vehicle to compute the digest of a large log, s."""
SETTLE_S: Final = 30.0
"""So long a log that was just ended may be finished onboard."""
CHUNK_BYTES: Final = 1 << 15
WINDOW: Final = 8
"""Pieces that are requested and have not arrived: the most that can be queued on the route."""
CHUNK_S: Final = 1.0
"""Time after which a piece that has not arrived is requested again, s."""
LOST_S: Final = 10.0
"""Time without data after which the connection counts as lost, s."""

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*(\.[A-Za-z0-9]+)+")
"""Name of a log: it comes from the platform and becomes the name of a local file."""
DIGEST: Final = re.compile(r"[0-9a-f]{64}")
OnFraction = Callable[[str, int, int], None]
"""Called with a log's name, its downloaded bytes, and its size."""


class Carrier(Protocol):
    """A transport for the bytes of a log."""

    async def fetch(self, name: str, size: int, part: PartFile, on_bytes: Callable[[int], None]) -> None:
        """Downloads the missing part of a log.

        Raises:
            Refused: the connection was lost, or the log does not exist; a partial download is kept.
        """


class FtpCarrier:
    """Carrier over MAVLink FTP, from the companion.

    Args:
        machines: runs the client.
        client: implements the protocol.
        target: the companion.
    """

    def __init__(self, machines: Machines, client: FtpClient, target: Address) -> None:
        self._files = FileService(machines, client, target)

    async def fetch(self, name: str, size: int, part: PartFile, on_bytes: Callable[[int], None]) -> None:
        """See `Carrier`."""
        del size  # the protocol tells it
        await self._files.read_into(f"/logs/{name}", part, on_bytes)


class ChunkCarrier:
    """Carrier over the network of platforms and stations, by requests; a few pieces are under way at a time.

    Args:
        station: sends the requests.
        exchange: the station's.
        platform: owner of the logs.
    """

    def __init__(self, station: Station, exchange: Exchange, platform: str) -> None:
        self._station, self._exchange, self._platform = station, exchange, platform

    async def fetch(self, name: str, size: int, part: PartFile, on_bytes: Callable[[int], None]) -> None:
        """See `Carrier`."""
        at = part.opened(size)
        on_bytes(at)
        came: dict[int, bytes] = {}
        requested_s: dict[int, float] = {}
        problem: list[str] = []
        reports = asyncio.Event()

        def handle(envelope: Envelope[LogChunk]) -> None:
            chunk = envelope.payload
            if chunk.station == self._station.id and chunk.name == name and chunk.offset in requested_s:
                came[chunk.offset] = chunk.data
                if chunk.reason:
                    problem.append(chunk.reason)
                reports.set()

        unsubscribe = self._exchange.subscribe(f"{self._platform}/log_chunk", handle)
        received_s = self._station.now_s()
        try:
            while at < size:
                now_s = self._station.now_s()
                for offset in range(at, min(size, at + WINDOW * CHUNK_BYTES), CHUNK_BYTES):
                    if offset not in came and now_s >= requested_s.get(offset, float("-inf")) + CHUNK_S:
                        requested_s[offset] = now_s
                        self._station.client.send(self._platform, ReadLog(name=name, offset=offset, size=CHUNK_BYTES))
                reports.clear()
                try:
                    async with asyncio.timeout(CHUNK_S):
                        await reports.wait()
                    received_s = self._station.now_s()
                except TimeoutError:
                    if self._station.now_s() - received_s >= LOST_S:
                        raise Refused(f"no data of {name} received for {LOST_S:g} s") from None
                if problem:
                    raise Refused(f"{name}: {problem[0]}")
                while at in came:
                    data = came.pop(at)
                    requested_s.pop(at)
                    if len(data) != min(CHUNK_BYTES, size - at):
                        raise Refused(f"{name} is not as long as it was")
                    part.write(data)
                    at += len(data)
                    on_bytes(at)
        finally:
            unsubscribe()


@asynccontextmanager
async def ftp_carrier(wire: Wire, companion: Address) -> AsyncIterator[FtpCarrier]:
    """A carrier on one of the station's MAVLink links."""
    client = FtpClient(wire.own)
    machines = Machines(wire, companion.system, [client])
    try:
        yield FtpCarrier(machines, client, companion)
    finally:
        machines.close()


class Pulled(msgspec.Struct, frozen=True, kw_only=True):
    """A log that is here."""

    path: Path
    sha256: str
    size: int
    drops: int
    """Number of lost connections during the download."""
    is_deleted: bool
    """Onboard."""


class LogPuller:
    """Downloads logs of one platform.

    Args:
        station: sends requests to the platform.
        platform: its name.
        carrier: transfers the data.
        on_fraction: called with the progress.
        reported: called with text for users.
    """

    def __init__(
        self,
        station: Station,
        platform: str,
        carrier: Carrier,
        on_fraction: OnFraction = lambda _name, _here, _size: None,
        reported: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._station, self._platform, self._carrier = station, platform, carrier
        self._on_fraction, self._reported = on_fraction, reported

    async def cut(self) -> None:
        """Ends the log that is being written, and waits until it is finished.

        Raises:
            Gloc3Error: the platform refuses.
        """
        await self._request(CutLog())
        until_s = self._station.now_s() + SETTLE_S
        while sum(log.is_open for log in await self.list()) > 2 and self._station.now_s() < until_s:
            await passed(TRY_AGAIN_S)

    async def list(self) -> list[LogOnboard]:
        """The logs onboard, by their names.

        Raises:
            Gloc3Error: the platform refuses.
        """
        reply = await self._request(ListLogs())
        try:
            logs = msgspec.convert(reply.result.get("logs", []), list[LogOnboard])
        except msgspec.ValidationError as error:
            raise Refused(f"the log list of {self._platform} cannot be read: {error}") from error
        for log in logs:
            if not NAME.fullmatch(log.name):
                raise Refused(f"{self._platform} lists a log with an invalid name: {log.name!r}")
        return sorted(logs, key=lambda log: (len(log.name), log.name))  # log, log-2, log-10

    async def pull(self, log: LogOnboard, folder: Path, *, is_kept: bool = False) -> Pulled:
        """Downloads a log into a folder; resumes after lost connections until it is complete or this is cancelled.

        Args:
            log: the log.
            folder: the target folder.
            is_kept: whether it is kept onboard.

        Raises:
            Gloc3Error: it no longer exists, its digest differs twice, or it cannot be written here.
        """
        path, drops = folder / log.name, 0
        wanted = await self._digest(log)
        if path.exists() and not await self._is_here(
            path, wanted
        ):  # of another run, whose logs were counted from 1, too
            path = path.with_name(f"{path.stem}-{wanted[:8]}{path.suffix}")
        was_here = await self._is_here(path, wanted)
        if not was_here:
            for attempt in (1, 2):
                part = PartFile(path)
                drops += await self._fetch(log, part)
                found = await _in_thread(partial(_sha256_of_part, part))
                if found == wanted:
                    part.finish()
                    break
                part.discard()
                self._reported(f"{log.name} arrived with another digest: {'once more' if attempt == 1 else 'given up'}")
            else:
                raise Refused(f"{log.name} has the digest {wanted} onboard, and the received file {found}")
        is_deleted = False
        if not is_kept:
            with _put_aside(path) if was_here else nullcontext():
                is_deleted = await self._confirm(log, wanted)
        return Pulled(path=path, sha256=wanted, size=log.size, drops=drops, is_deleted=is_deleted)

    async def _confirm(self, log: LogOnboard, sha256: str) -> bool:
        """Confirms a completed download; returns whether the log is deleted onboard."""
        try:
            await self._request(ConfirmLog(name=log.name, sha256=sha256))
        except Declined as error:
            self._reported(f"{log.name} is here, and stays onboard: {error}")
            return False
        return True

    async def _digest(self, log: LogOnboard) -> str:
        reply = await self._request(DigestLog(name=log.name), DIGEST_S)
        digest, size = reply.result.get("sha256"), reply.result.get("size")
        if not isinstance(digest, str) or not DIGEST.fullmatch(digest) or size != log.size:
            raise Refused(f"{log.name} has changed since it was listed")
        return digest

    async def _fetch(self, log: LogOnboard, part: PartFile) -> int:
        """Downloads the data; returns the number of lost connections."""
        drops = 0
        while True:
            try:
                await self._carrier.fetch(
                    log.name, log.size, part, lambda here: self._on_fraction(log.name, here, log.size)
                )
            except Refused as error:
                if part.problem is not None or not self._has_been_silent():
                    await self._refuse_if_deleted(log, error)
                drops += 1
                self._reported(f"{error}; it resumes when {self._platform} is heard again")
                await self._note_contact()
            else:
                return drops
            finally:
                part.close()
            if part.problem is not None:
                raise part.problem

    async def _refuse_if_deleted(self, log: LogOnboard, error: Refused) -> None:
        """Raises the error if a log no longer exists, because retrying is useless."""
        try:
            logs = await self.list()
        except Unanswered:
            return
        if log.name not in [one.name for one in logs]:
            raise error

    def _has_been_silent(self) -> bool:
        platform = self._station.fleet.get(self._platform)
        return platform is None or platform.is_quiet_link(self._station.now_s())

    async def _note_contact(self) -> None:
        await passed(TRY_AGAIN_S)
        await flights.until(self._station, lambda: not self._has_been_silent())

    @staticmethod
    async def _is_here(path: Path, wanted: str) -> bool:
        return path.is_file() and await _in_thread(lambda: _sha256_of(path)) == wanted

    async def _request(self, body: AnyBody, timeout_s: float = 16.0) -> CiReply:
        """Repeats a request until the platform answers: these requests may be executed twice."""
        while True:
            try:
                return await self._station.client.carry_out(self._platform, body, timeout_s)
            except Gloc3Error as error:
                if not isinstance(error, Unanswered | NotDelivered):
                    raise
                self._reported(f"{error}; requested again when {self._platform} is heard")
                await self._note_contact()


@contextmanager
def _put_aside(path: Path) -> Iterator[None]:
    """Gives a log another name meanwhile: the folder in which it was found may be the vehicle's own, as in simulation."""
    aside = path.with_name(f"{path.name}.here")
    path.rename(aside)
    try:
        yield
    finally:
        aside.rename(path)


async def _in_thread(work: Callable[[], str]) -> str:
    """Does what takes long beside the loop; in virtual time there are no threads."""
    loop = asyncio.get_running_loop()
    return work() if isinstance(loop, VirtualLoop) else await loop.run_in_executor(None, work)


def _sha256_of_part(part: PartFile) -> str:
    digest = hashlib.sha256()
    for piece in part.pieces():
        digest.update(piece)
    return digest.hexdigest()


def _sha256_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
