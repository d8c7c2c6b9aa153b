"""Sends the logs of a folder elsewhere, each once, by a command of the user's choice."""

import os
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.clock import utc_now
from gloc3.errors import Refused
from gloc3.log.writer import MAGIC
from gloc3.store import replace_file

SENT: Final = "sent.txt"
"""What was sent, in the folder of the logs: a line for each file, with its size in bytes."""
FILE: Final = "{}"
"""Stands for the file in the command."""
ABANDONED_S: Final = 600.0
"""An unfinished log that has not been written to for so long will not be finished: its process has died."""


class Sending(NamedTuple):
    """What was done."""

    sent: tuple[str, ...]
    failed: tuple[str, ...]
    """Names of files whose command failed; they are tried again by the next call."""
    running: tuple[str, ...]
    """Logs that are still written."""


def send_logs(folder: Path, command: str, report: Callable[[str], None]) -> Sending:
    """Runs the command for each log that is complete and was not sent yet, the oldest first; `.tlog` files go along.

    Args:
        folder: with the logs.
        command: of the shell's form, but run without a shell; `{}` is the file, and stands at the end where there is none.
        report: called about each file.

    Raises:
        Refused: the folder or the command cannot be used.
    """
    words = words_of(command)
    paths = _logs(folder)
    known = _read_sent(folder)
    sent, failed, running = list[str](), list[str](), list[str]()
    for log in paths:
        if not _is_complete(log):
            running.append(log.name)
            continue
        for path in (log, log.with_suffix(".tlog")):
            if not path.exists() or known.get(path.name) == path.stat().st_size:
                continue
            if problem := _send(words, path):
                report(f"{path.name} was not sent: {problem}")
                failed.append(path.name)
                continue
            report(f"{path.name} was sent")
            known[path.name] = path.stat().st_size
            _write_sent(folder, known)
            sent.append(path.name)
    return Sending(tuple(sent), tuple(failed), tuple(running))


def words_of(command: str) -> list[str]:
    """The words of a command, with `{}` for the file.

    Raises:
        Refused: it is none.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise Refused(f"{command!r} is no command: {error}") from error
    if not words:
        raise Refused("the command is empty; for example: rclone copy {} remote:logs")
    return words if any(FILE in word for word in words) else [*words, FILE]


def _logs(folder: Path) -> list[Path]:
    try:
        found = [path for path in folder.iterdir() if path.suffix == ".mcap"]
        return sorted(found, key=lambda path: (path.stat().st_mtime, path.name))
    except OSError as error:
        raise Refused(f"{folder} cannot be read: {error.strerror or error}") from error


def _is_complete(log: Path) -> bool:
    """Whether nothing more is written to a log."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - len(MAGIC)))
        is_finished = file.read() == MAGIC and log.stat().st_size > len(MAGIC)
    return is_finished or utc_now().timestamp() - log.stat().st_mtime > ABANDONED_S


def _send(words: list[str], path: Path) -> str:
    """Runs the command for a file; the reason where it fails, empty otherwise."""
    command = [word.replace(FILE, str(path)) for word in words]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        return f"{words[0]}: {error.strerror or error}"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines() or done.stdout.strip().splitlines()
    return f"{words[0]} ended with {done.returncode}" + (f": {lines[-1]}" if lines else "")


def _read_sent(folder: Path) -> dict[str, int]:
    try:
        lines = os.fsdecode((folder / SENT).read_bytes()).splitlines()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise Refused(f"{folder / SENT} cannot be read: {error.strerror or error}") from error
    pairs = [line.rpartition("\t") for line in lines]
    return {name: int(size) for name, _, size in pairs if name and size.isdecimal()}


def _write_sent(folder: Path, known: dict[str, int]) -> None:
    text = "".join(f"{name}\t{size}\n" for name, size in known.items())
    try:
        replace_file(folder / SENT, os.fsencode(text))
    except OSError as error:
        raise Refused(f"{folder / SENT} cannot be written: {error.strerror or error}") from error
