"""A file written by a thread, so that a slow disk delays no one."""

import errno
import os
import threading
from pathlib import Path
from typing import Final

MOST_WAITING: Final = 64_000_000
"""Bytes that may wait for the disk: some seconds of pictures."""


class DiskFile:
    """Buffered file: content goes to the operating system with the next `flush`, in a thread; `close` waits for that.

    Args:
        path: made anew.

    Raises:
        OSError: it cannot be made. From `write`, `flush` and `close`: what was written before could not be written, or too
            much is waiting.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._fresh: list[bytes] = []
        """Not flushed yet."""
        self._changed = threading.Condition()
        self._due: list[bytes] = []
        self._waiting = 0
        """Bytes that are flushed, and not written yet."""
        self._is_closing = False
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._write_all, name=f"log: {path.name}", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> int:
        """Takes data; returns how many bytes, which is all of them."""
        self._fresh.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Starts writing the data received so far, in the thread."""
        with self._changed:
            if self._error is not None:
                raise self._error
            self._waiting += sum(map(len, self._fresh))
            self._due += self._fresh
            self._fresh = []
            if self._waiting > MOST_WAITING:
                self._error = OSError(errno.EIO, f"the disk is too slow: {MOST_WAITING // 1_000_000} MB are waiting")
                raise self._error
            self._changed.notify()

    def fileno(self) -> int:
        """Descriptor for the data that is already written."""
        return self._file.fileno()

    def close(self) -> None:
        """Writes the remaining data, and closes the file when it is on disk."""
        with self._changed:
            self._due += self._fresh
            self._fresh, self._is_closing = [], True
            self._changed.notify()
        self._thread.join()
        with self._file:
            if self._error is not None:
                raise self._error
            os.fsync(self._file.fileno())

    def _write_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._due or self._is_closing)
                data, self._due = b"".join(self._due), []
                if not data or self._error is not None:
                    return
            try:
                self._write(data)
            except OSError as error:
                with self._changed:
                    self._error = error
                return
            with self._changed:
                self._waiting -= len(data)

    def _write(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
