"""The files of a folder of logs: which is the next, and which are the oldest."""

import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gloc3.errors import Refused
from gloc3.platform.places import ProcessPlace, is_in_one_process
from gloc3.platform.platform import Platform

LOG: Final = "log"
MOST_LOGS: Final = 1_000_000
ANY_LOG: Final = re.compile(rf"({LOG}(?:-[a-z].*?)?)(?:-(\d{{1,6}}))?\.(?:mcap|tlog)")
"""Of any process: its stem, and the number."""


def log_stem(platform: Platform, place: ProcessPlace) -> str:
    """What the logs of a process are called: `log`, or `log-HOST[-PROCESS]` where the platform has several processes."""
    parts = () if is_in_one_process(platform) else place
    return "-".join((LOG, *filter(None, parts)))


@dataclass
class _Log:
    """The files of one number."""

    paths: list[Path] = field(default_factory=list)
    size: int = 0
    written_s: float = 0.0


class LogFiles:
    """Logs `log.mcap`, `log-2.mcap`, `log-3.mcap`…, each with a `.tlog` of the same name.

    Args:
        folder: where they are.
        stem: what their names begin with.
    """

    def __init__(self, folder: Path, stem: str = LOG) -> None:
        self.folder, self._stem = folder, stem
        self._form = re.compile(rf"{re.escape(stem)}(?:-(\d{{1,6}}))?\.(?:mcap|tlog)")

    def numbered(self) -> dict[int, list[Path]]:
        """The files that there are, by their number, the oldest first."""
        found: dict[int, list[Path]] = {}
        for path in sorted(self.folder.iterdir()) if self.folder.is_dir() else ():
            if match := self._form.fullmatch(path.name):
                found.setdefault(int(match[1] or 1), []).append(path)
        return dict(sorted(found.items()))

    def next(self) -> Path:
        """The log after the last one: numbers are not used again while a later one is there.

        Raises:
            Refused: there are too many.
        """
        number = max(self.numbered(), default=0) + 1
        if number >= MOST_LOGS:
            raise Refused(f"the logs in {self.folder} have been numbered up to {number - 1}; move them elsewhere")
        return self.folder / (f"{self._stem}.mcap" if number == 1 else f"{self._stem}-{number}.mcap")

    def prune(self, most_bytes: int) -> list[Path]:
        """Deletes the oldest logs of the folder, of whichever process, until the rest is no larger than that.

        The last one of each process is never deleted. Tells which were.

        Raises:
            OSError: one cannot be deleted.
        """
        logs: dict[str, dict[int, _Log]] = {}
        for path in sorted(self.folder.iterdir()):
            if match := ANY_LOG.fullmatch(path.name):
                with suppress(FileNotFoundError):  # another process has just deleted it
                    found, log = path.stat(), logs.setdefault(match[1], {}).setdefault(int(match[2] or 1), _Log())
                    log.paths.append(path)
                    log.size += found.st_size
                    log.written_s = max(log.written_s, found.st_mtime)
        total = sum(log.size for of_one in logs.values() for log in of_one.values())
        past = [(number, log) for of_one in logs.values() for number, log in of_one.items() if number < max(of_one)]
        removed: list[Path] = []
        for _, log in sorted(past, key=lambda each: (each[1].written_s, each[0])):
            if total <= most_bytes:
                break
            for path in log.paths:
                path.unlink(missing_ok=True)
            removed += log.paths
            total -= log.size
        return removed
