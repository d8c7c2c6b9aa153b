"""The logs onboard, for stations that fetch them: listed, read in pieces, their digests, deleted when one has them."""

import hashlib
import re
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Final, ParamSpec, Protocol, TypeVar

import msgspec

from gloc3.errors import Gloc3Error
from gloc3.messages.command_interface import (
    CiReply,
    CiRequest,
    ConfirmLog,
    CutLog,
    DigestLog,
    LogChunk,
    LogOnboard,
    Outcome,
    ReadLog,
)
from gloc3_onboard.command_server.journal import answer

P = ParamSpec("P")
R = TypeVar("R")
LOG_NAME: Final = re.compile(r"log(-[a-z0-9_-]+)?\.(mcap|tlog)")
LARGEST_CHUNK_BYTES: Final = 1 << 16
MOST_PENDING: Final = 32
"""Greatest number of pending requests; stations repeat further ones."""
_PIECE_BYTES: Final = 1 << 20


class LogStoreBase(Protocol):
    """The log store as the command interface server uses it."""

    def handle(self, request: CiRequest) -> CiReply | None:
        """Takes a request about logs; the answer where that is known at once."""

    def collect(self) -> list[CiReply | LogChunk]:
        """The answers that are ready."""


class NoLogStore:
    """A log store without logs."""

    def handle(self, request: CiRequest) -> CiReply | None:
        """Refuses."""
        return answer(request, Outcome.REFUSED, "no logs are kept here")

    def collect(self) -> list[CiReply | LogChunk]:
        """Nothing."""
        return []


class LogStore:
    """A folder of logs, read by workers, so that nothing waits for the disk.

    Args:
        folder: the folder.
        unfinished: returns the logs still being written.
        cut: ends the current log and starts the next.
        workers: executor of slow work.
    """

    def __init__(
        self, folder: Path, unfinished: Callable[[], set[Path]], cut: Callable[[], None], workers: Executor
    ) -> None:
        self._folder, self._unfinished, self._cut, self._workers = folder, unfinished, cut, workers
        self._pending: set[tuple[str, int, int]] = set()
        self._cuts: deque[tuple[str, int, int]] = deque(maxlen=MOST_PENDING)
        self._ready: deque[CiReply | LogChunk] = deque()
        self._digests: dict[tuple[Path, int, int], str] = {}

    def handle(self, request: CiRequest) -> CiReply | None:
        """Handles a request about logs; one already under way is not started again."""
        body, key = request.body, (request.sender, request.boot, request.sequence)
        if isinstance(body, CutLog):
            try:
                if key not in self._cuts:  # a repeat cuts nothing twice
                    self._cut()
            except Gloc3Error as error:
                return answer(request, Outcome.REFUSED, str(error))
            self._cuts.append(key)
            return answer(request)
        if key in self._pending:
            return None
        if len(self._pending) >= MOST_PENDING:
            return None if isinstance(body, ReadLog) else answer(request, Outcome.REFUSED, "too much is asked at once")
        self._pending.add(key)
        unfinished = self._unfinished()
        job = self._workers.submit(self._done, request, unfinished)
        job.add_done_callback(lambda done: self._ready.append(done.result()))
        return None

    def collect(self) -> list[CiReply | LogChunk]:
        """The answers that are ready."""
        found: list[CiReply | LogChunk] = []
        while self._ready:
            found.append(self._ready.popleft())
        return found

    def _done(self, request: CiRequest, unfinished: set[Path]) -> CiReply | LogChunk:
        """Carries out a request, on a worker thread and without exceptions."""
        body = request.body
        try:
            match body:
                case ReadLog():
                    return self._read(request, body)
                case DigestLog(name=name):
                    return answer(request, result={"sha256": self._digest(self._path(name)), "size": self._size(name)})
                case ConfirmLog():
                    return self._delete(request, body, unfinished)
                case _:
                    return self._list(request, unfinished)
        except (OSError, Gloc3Error) as error:
            reason = error.strerror or str(error) if isinstance(error, OSError) else str(error)
            if isinstance(body, ReadLog):
                return LogChunk(station=request.sender, name=body.name, offset=body.offset, data=b"", reason=reason)
            return answer(request, Outcome.REFUSED, reason)
        finally:
            self._pending.discard((request.sender, request.boot, request.sequence))

    def _list(self, request: CiRequest, unfinished: set[Path]) -> CiReply:
        found = sorted(path for path in self._folder.iterdir() if LOG_NAME.fullmatch(path.name) and path.is_file())
        logs = [LogOnboard(path.name, path.stat().st_size, path in unfinished) for path in found]
        return answer(request, result={"logs": msgspec.to_builtins(logs)})

    def _read(self, request: CiRequest, body: ReadLog) -> LogChunk:
        path = self._path(body.name)
        with path.open("rb") as file:
            file.seek(min(max(0, body.offset), path.stat().st_size))
            data = file.read(min(max(0, body.size), LARGEST_CHUNK_BYTES))
        return LogChunk(station=request.sender, name=body.name, offset=body.offset, data=data)

    def _delete(self, request: CiRequest, body: ConfirmLog, unfinished: set[Path]) -> CiReply:
        path = self._path(body.name, is_needed=False)
        if not path.exists():
            return answer(request, reason=f"{body.name} is not here any more")
        if path in unfinished:
            return answer(request, Outcome.REFUSED, f"{body.name} is still being written")
        if self._digest(path) != body.sha256.lower():
            return answer(request, Outcome.REFUSED, f"{body.name} has another digest here: it is kept")
        path.unlink()
        return answer(request, reason=f"{body.name} is deleted")

    def _size(self, name: str) -> int:
        return self._path(name).stat().st_size

    def _digest(self, path: Path) -> str:
        about = path.stat()
        key = (path, about.st_size, about.st_mtime_ns)
        if key not in self._digests:
            digest = hashlib.sha256()
            with path.open("rb") as file:
                while piece := file.read(_PIECE_BYTES):
                    digest.update(piece)
            self._digests = {known: value for known, value in self._digests.items() if known[0] != path}
            self._digests[key] = digest.hexdigest()
        return self._digests[key]

    def _path(self, name: str, *, is_needed: bool = True) -> Path:
        """The file of a log.

        Raises:
            FileNotFoundError: there is none of that name.
        """
        path = self._folder / name
        if not LOG_NAME.fullmatch(name) or (is_needed and not path.is_file()):
            raise FileNotFoundError(2, f"there is no log {name!r}")
        return path
