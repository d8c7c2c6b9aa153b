"""The log and the folders of an onboard process in wall time."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import Final, Literal

import msgspec

from gloc3.clock import Clock
from gloc3.component.context import HostContext
from gloc3.errors import UNREADABLE, Finding, InputError, Refused
from gloc3.log.description import RunDescription
from gloc3.log.selection import TopicChoice
from gloc3.mavlink.services.files.ftp_files import Files
from gloc3.mavlink.signing import MAY_BE_OFF, TICKS_PER_S, Signing, Stream, Streams, timestamp
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import parse_url
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3.platform.places import ProcessPlace
from gloc3.platform.platform import Platform
from gloc3.platform.reader import find_platform, whole_text
from gloc3.store import DocumentFile, RecordFile, RecordStore
from gloc3_onboard.command_server.log_shelf import LogStore
from gloc3_onboard.command_server.site import Usage
from gloc3_onboard.companion.files import shared_files
from gloc3_onboard.inputs import Storage
from gloc3_onboard.parts import Parts
from gloc3_onboard.process.computer import start_of_computer
from gloc3_onboard.process.event_narration import Report
from gloc3_onboard.process.log_files import LogFiles, log_stem
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.run_log import RunLog
from gloc3_onboard.process.storage import PictureFolder
from gloc3_onboard.sensors.devices import Rig
from gloc3_onboard.sensors.rig import calibrations

AHEAD: Final = 4 * TICKS_PER_S
"""Margin added to stored timestamps, so that not every frame is written to disk; after a crash, peers are accepted
again once it has passed."""


class SigningMemory:
    """The progress of the signers of each key, in a file for each key, which does not reveal the key.

    Args:
        folder: where the files are.
        clock: the process's clock.
        reported: is told once where it cannot be kept.
    """

    def __init__(self, folder: Path, clock: Clock, reported: Callable[[str], None]) -> None:
        self._folder, self._clock, self._reported = folder, clock, reported
        self._kept: dict[bytes, _Kept] = {}

    def signing(self, key: bytes, link_id: int) -> Signing:
        """Signing of one link; links with the same key share timestamps."""
        if key not in self._kept:
            name = sha256(b"streams of the key " + key).hexdigest()[:16]
            self._kept[key] = _Kept(self._folder / f"signing-{name}.state", self._clock, self._reported)
        return Signing(
            key,
            link_id=link_id,
            now=timestamp(self._clock.utc_s()),
            streams=self._kept[key].streams,
            is_clock_right=self._clock.is_utc_right,
        )

    def close(self) -> None:
        """Writes down how far it came to the frame."""
        for kept in self._kept.values():
            kept.write(ahead=0)


class _Kept:
    """One key's streams and their file."""

    def __init__(self, path: Path, clock: Clock, reported: Callable[[str], None]) -> None:
        self._path, self._reported = path, reported
        self._records = RecordStore(RecordFile(path), f"times of signed frames in {path}")
        self._written = self._read(clock)
        """In the file; a frame that is later is taken only after that is."""
        self.streams: Final = Streams(self._written, self._noted)

    def write(self, ahead: int) -> None:
        """Writes all timestamps, increased by a margin."""
        self._written = {stream: time + ahead for stream, time in self.streams.latest.items()}
        record = msgspec.msgpack.encode([(*stream, time) for stream, time in self._written.items()])
        self._records.rewrite([record], outlives_power_cut=not ahead)
        if self._records.problem:
            reported, self._reported = self._reported, lambda _: None
            reported(
                f"{self._records.problem}: after a restart, signed frames of the minute before it may be accepted again"
            )

    def _noted(self, stream: Stream) -> None:
        if self.streams.latest[stream] > self._written.get(stream, -1):
            self.write(AHEAD)

    def _read(self, clock: Clock) -> dict[Stream, int]:
        """What still matters: new streams of older times are refused anyway, and those of later ones."""
        records, rows = self._records.load(), list[tuple[int, int, int, int]]()
        problem = self._records.problem
        try:
            rows = msgspec.msgpack.decode(records[0], type=list[tuple[int, int, int, int]]) if records else []
        except UNREADABLE as error:
            problem = f"{self._path} cannot be read: {error}"
        if problem:
            self._reported(f"{problem}: a new one is started")
        now, is_right = timestamp(clock.utc_s()), clock.is_utc_right()
        return {
            (system, component, link): time
            for system, component, link, time in rows
            if not is_right or abs(time - now) <= MAY_BE_OFF + AHEAD
        }


class ProcessStorage:
    """Storage of an onboard process: its log, its state, and the progress of its links' signers.

    Args:
        options: what was asked for.
        platform: the platform file.
        place: which process of it this is.
        context: of the process.
        report: receives what a person should know.
    """

    def __init__(
        self, options: ProcessOptions, platform: Platform, place: ProcessPlace, context: HostContext, report: Report
    ) -> None:
        self._options, self._platform, self._place = options, platform, place
        self._context, self._report = context, report
        self.out: Final = options.folder(platform)
        self.logs: Final = options.logs or self.out
        self._log: RunLog | None = None
        self._readers = ThreadPoolExecutor(2, "logs")
        self._writer = ThreadPoolExecutor(1, "pictures")
        self._signing = SigningMemory(self.out, context.clock, lambda text: report(Severity.WARNING, text))

    def sign(self, url: str, number: int) -> Signing | None:
        """What signs the link of this number, where there is a key; that of the command line is for links to stations."""
        key = self._key(url, number)
        return None if key is None else self._signing.signing(key, number & 0xFF)

    def member_of(self, url: str, number: int) -> str:
        """The member of the network for whom the key of a link stands; empty for none.

        Raises:
            InputError: a member's key cannot be read, or is another's.
        """
        key, folder = self._key(url, number), find_platform(self._options.platform).parent
        keys = dict[bytes, str]()
        for member, file in self._platform.members.items():
            other = keys.setdefault(read_signing_key(folder / file), member)
            if other != member:
                message = f"{member} and {other} have the same key, so that nobody knows who signs"
                raise InputError([Finding(file=str(folder / file), message=message, hint="give each member a key")])
        return "" if key is None else keys.get(key, "")

    def _key(self, url: str, number: int) -> bytes | None:
        return key_of(url) or (self._options.signing_key if number else None)

    def files(self, metadata: Mapping[str, bytes]) -> Files:
        """What is shared with stations of others: missions, logs and metadata.

        Raises:
            Refused: the folder cannot be written.
        """
        try:
            return shared_files(self.out, self.logs, metadata)
        except OSError as error:
            raise Refused(f"the folder {self.out} cannot be written: {error.strerror}") from error

    def open(self, path: Callable[[], Sequence[Vector3]], rig: Rig, parts: Parts) -> Storage:
        """Starts the next log of the folder; returns the vehicle's storage.

        Args:
            path: returns the path requested so far.
            rig: camera calibrations, for the pictures.
            parts: list of opened parts.

        Raises:
            Refused: a folder cannot be written.
        """
        log = self._log = parts.add("run log", self._open_log(path, rig))
        parts.add("signing memory", self._signing)
        return Storage(
            journal=RecordFile(self.out / "requests.journal"),
            progress=RecordFile(self.out / "progress.state"),
            reports=RecordFile(self.out / "events.store"),
            memory=RecordFile(self.out / "memory.state"),
            log_store=LogStore(self.logs, lambda: log.unfinished, log.cut, parts.add("disk readers", self._readers)),
            pictures=PictureFolder(
                self.logs / log.path.stem.replace("log", "images", 1),
                rig,
                self._context.clock.utc_offset,
                parts.add("picture writer", self._writer),
            ),
            computer_start=start_of_computer(),
            worker=ThreadPoolExecutor(1, "mission check"),
            usage=DocumentFile(self.out / "usage.json", Usage),
        )

    def _open_log(self, path: Callable[[], Sequence[Vector3]], rig: Rig) -> RunLog:
        for folder in (self.out, self.logs):
            if folder.is_file():
                raise Refused(f"{folder} is a file, not a folder")
        context = self._context
        try:
            for folder in (self.out, self.logs):
                folder.mkdir(parents=True, exist_ok=True)
            return RunLog(
                LogFiles(self.logs, log_stem(self._platform, self._place)),
                self._options.log_limits,
                context.clock,
                context.topics,
                context.exchange.here,
                context.loop,
                {"platform": self._platform.platform},
                RunDescription(self._platform, whole_text(self._options.platform), calibrations(self._platform, rig)),
                path,
                self._report,
            )
        except OSError as error:
            raise Refused(f"{error.filename or self.logs} cannot be written: {error.strerror}") from error

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what the log records.

        Raises:
            Refused: a pattern fits no topic, or there is no log yet.
        """
        if self._log is None:
            raise Refused("no log is being written")
        return self._log.select(chosen)

    def show_path(self, points_ned_m: Sequence[Vector3]) -> None:
        """Writes the path requested so far into the log."""
        if self._log is not None:
            self._log.show_path(points_ned_m)

    @property
    def mb_per_min(self) -> float:
        """How fast the log grows."""
        return 0.0 if self._log is None else self._log.mb_per_min

    @property
    def log(self) -> Path | None:
        """The file that is being written."""
        return None if self._log is None else self._log.path

    @property
    def problem(self) -> str:
        """Why the log is not written any more; empty while it is."""
        return "" if self._log is None else self._log.problem

    def record_frame(self, link: str, direction: Literal["in", "out"], frame: bytes) -> None:
        """Keeps a MAVLink frame, once there is a log."""
        if self._log is not None:
            self._log.record_frame(link, direction, frame)

    async def close(self) -> None:
        """Finishes the log and the pictures."""
        self._signing.close()
        self._writer.shutdown()
        if self._log is not None:
            await self._log.close()
        self._readers.shutdown(cancel_futures=True)


def key_of(url: str) -> bytes | None:
    """The key from the file named by a link's URL.

    Raises:
        Refused: the file cannot be read.
    """
    file = parse_url(url).key
    return read_signing_key(Path(file).expanduser()) if file else None
