"""Commands of a script to a headless station: what they say, when they are sent, and lines of them from a pipe or file."""

import asyncio
import os
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.messages.command_interface import Verb

VERBS: Final = (Verb.PAUSE, Verb.RESUME, Verb.SKIP, Verb.ABORT)
FORM: Final = "VERB [TASK[.ACTION]] [@SECONDS], such as pause@30s, resume or skip sweep.wall@60s"
READ_BYTES: Final = 4096

_COMMAND: Final = re.compile(r"\s*(?P<verb>[^\s@]+)(?:\s+(?P<target>[^\s@]+))?\s*(?:@\s*(?P<at>[^\s@]+))?\s*")
_SECONDS: Final = re.compile(r"(\d{1,6}(?:\.\d{1,3})?)(?:\s*s)?")


class ScriptCommand(msgspec.Struct, frozen=True, kw_only=True):
    """What an operator would do to the mission, a task or an action by a key."""

    verb: Verb
    target: str = ""
    """Empty for the mission, `TASK`, or `TASK.ACTION`."""
    at_s: float = 0.0
    """Seconds after the start of the mission; at once where that is over."""

    def __str__(self) -> str:
        return f"{self.verb} {self.target or 'the mission'}"


def parse_command(text: str) -> ScriptCommand:
    """Reads a command.

    Raises:
        Refused: it is none.
    """
    found = _COMMAND.fullmatch(text)
    verb, target, at = found.group("verb", "target", "at") if found is not None else ("", None, None)
    seconds = _SECONDS.fullmatch(at) if at is not None else None
    if verb not in VERBS or (at is not None and seconds is None):
        raise Refused(f"{text.strip()!r} is no command; one is {FORM}; verbs are {', '.join(VERBS)}")
    if verb == Verb.SKIP and not target:
        raise Refused(f"{text.strip()!r} does not say what to skip, such as skip sweep.wall@60s")
    return ScriptCommand(verb=Verb(verb), target=target or "", at_s=float(seconds[1]) if seconds is not None else 0.0)


def read_lines(loop: asyncio.AbstractEventLoop, descriptor: int, receive: Callable[[str], None]) -> Callable[[], None]:
    """Reads lines from a pipe, terminal or file as they come, without blocking.

    Args:
        loop: in which `receive` is called.
        descriptor: of the open file.
        receive: takes each line that is not empty.

    Returns:
        What ends the reading.
    """
    rest = bytearray()

    def is_open() -> bool:
        data = os.read(descriptor, READ_BYTES)
        rest.extend(data or b"\n")
        *lines, last = rest.split(b"\n")
        rest[:] = last
        for line in lines:
            if text := line.decode(errors="replace").strip():
                receive(text)
        if not data:
            stop()
        return bool(data)

    def stop() -> None:
        with suppress(OSError):
            loop.remove_reader(descriptor)

    try:
        loop.add_reader(descriptor, is_open)
    except PermissionError:  # a file on disk: it cannot be waited for, and does not block
        while is_open():
            pass
    return stop
