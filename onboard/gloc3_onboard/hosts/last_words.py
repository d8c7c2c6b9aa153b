"""What a process that has ended said last, and the signal that ended it, for people."""

import re
import signal
from collections.abc import Sequence
from typing import Final

LINE_MAX: Final = 160

FATAL: Final = re.compile(r"Fatal Python error: (?P<what>.+)")
"""Where the fault handler's dump begins."""
_THREAD: Final = re.compile(r"(Current thread|Thread) 0x[0-9a-f]+.*most recent call first")
_FRAME: Final = re.compile(r'\s*File "(?P<file>[^"]+)", line (?P<line>\d+) in (?P<function>.+)')


def describe_exit(code: int) -> str:
    """How a process ended, by its code as `subprocess` gives it: `by SIGSEGV`, `with code 1`, `by itself`."""
    if code < 0:
        try:
            return f"by {signal.Signals(-code).name}"
        except ValueError:
            return f"by signal {-code}"
    return f"with code {code}" if code else "by itself"


def last_lines(lines: Sequence[str]) -> str:
    """The gist in a line of what a process wrote on stderr before it ended; empty if it wrote nothing.

    Of a crash that the fault handler caught, that is the error and the innermost function of the thread that had it.
    """
    reported = last_error(lines)
    fatal = FATAL.match(reported[0]) if reported else None
    if fatal is None:
        return _cut(reported[-1].strip()) if reported else ""
    frame = next(filter(None, map(_FRAME.match, reported)), None)
    where = f" in {frame['function']} ({frame['file'].rpartition('/')[2]}:{frame['line']})" if frame else ""
    return _cut(fatal["what"] + where)


def last_error(lines: Sequence[str]) -> list[str]:
    """The lines that tell why a process ended: of a dump only the error and the thread that had it, else all."""
    text = [line for line in lines if line.strip()]
    begin = next((index for index, line in enumerate(text) if FATAL.match(line)), None)
    if begin is None:
        return text
    starts = [index for index in range(begin, len(text)) if _THREAD.match(text[index])]
    thread = next((index for index in starts if text[index].startswith("Current")), starts[0] if starts else len(text))
    frames = []
    for line in text[thread + 1 :]:
        if not _FRAME.match(line):
            break
        frames.append(line)
    return [text[begin], *frames]


def _cut(text: str) -> str:
    return text if len(text) <= LINE_MAX else text[: LINE_MAX - 1] + "…"
