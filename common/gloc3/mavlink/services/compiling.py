"""Has the loop of direct lines compiled where numba is installed; the process does not wait for it.

What is compiled is kept in the user's folder for such things, so that only the first start on a computer compiles, in a
process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, cast

from gloc3.component.guard import guard
from gloc3.errors import Refused
from gloc3.mavlink.services.fast_line import Loop

LOOP: Final = "gloc3.mavlink.services.compiled_line"
_SOURCES: Final = ("compiled_line.py", "fast_line.py", "gaps.py", "parser.py")
"""What goes into it."""
_COMPILERS: Final = ("numba", "llvmlite", "numpy")
_NICE: Final = 10


def can_compile() -> bool:
    """Whether what compiles is installed, on a computer that it is written for."""
    return sys.platform == "linux" and find_spec("numba") is not None


def load(folder: Path) -> Loop:
    """The loop, from a folder where it is kept, or compiled now and kept there."""
    settings: Any = import_module("numba.core.config")
    settings.CACHE_DIR = str(folder)
    return cast("Loop", import_module(LOOP))


def kept_at() -> Path:
    """Where it is kept: another folder for each version of it, and of what compiles it."""
    here = Path(__file__).parent
    digest = sha256(sys.version.encode())
    for name in _SOURCES:
        digest.update((here / name).read_bytes())
    for name in _COMPILERS:
        digest.update(version(name).encode())
    caches = os.environ.get("CACHE_DIRECTORY")  # a service's
    folder = Path(caches or os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    return (folder if caches else folder / "gloc3") / f"line-{digest.hexdigest()[:16]}"


def prepare(folder: Path) -> None:
    """Has it compiled into a folder, by a process of its own, if nobody has done that yet.

    Raises:
        Refused: the folder cannot be written, or the compiler failed.
    """
    import fcntl  # Linux's, as all of this

    whole = folder / "whole"
    if whole.exists():
        return
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another process may be about it
            if not whole.exists():
                _compile(folder)
                whole.touch()
    except OSError as error:
        raise Refused(f"{folder}: {error.strerror}") from error


def _compile(folder: Path) -> None:
    command = [sys.executable, "-m", __name__, str(folder)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        last = done.stderr.strip().rpartition("\n")[2]
        raise Refused(f"the compiler ended with {done.returncode}: {last}")


class Compiling:
    """The loop of this process, once it is there."""

    def __init__(self) -> None:
        self.loop: Loop | None = None
        self._is_begun = False

    def begin(self, failed: Callable[[BaseException], None]) -> None:
        """Begins to load it, in a thread, where that can be and has not been done.

        Args:
            failed: told, in that thread, what went wrong; all goes on without it then.
        """
        if not self._is_begun and can_compile():
            self._is_begun = True
            threading.Thread(target=self._work, args=(failed,), name="compiling", daemon=True).start()

    def _work(self, failed: Callable[[BaseException], None]) -> None:
        _, error = guard(self._load)
        if error is not None:
            failed(error)

    def _load(self) -> None:
        folder = kept_at()
        prepare(folder)
        self.loop = load(folder)


COMPILING: Final = Compiling()
"""Of this process."""


def main(folder: str) -> None:
    """Fills a folder, out of everybody's way."""
    with suppress(OSError):  # a service may not be allowed even that
        os.nice(_NICE)
    load(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1])
