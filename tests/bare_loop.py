"""A process that only wakes up again and again: what it is late, any loop on this computer is in the same time.

`python -m tests.bare_loop` answers each line of its input with how late it was since the one before.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec

ROOT: Final = Path(__file__).parents[1]
PERIOD_S: Final = 0.01
END_S: Final = 10.0


class Lateness(msgspec.Struct, frozen=True, kw_only=True):
    """How late the loop woke up, s."""

    p99_s: float
    most_s: float


def lateness(late_s: list[float]) -> Lateness:
    """The lateness of some rounds; 0 of none."""
    ordered = sorted(late_s) or [0.0]
    return Lateness(p99_s=ordered[min(len(ordered) - 1, round(0.99 * len(ordered)))], most_s=ordered[-1])


class BareLoop:
    """The process, which runs."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def report(self) -> Lateness:
        """How late it was since the last report."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return msgspec.json.decode(self._process.stdout.readline(), type=Lateness)


@contextmanager
def bare_loop() -> Iterator[BareLoop]:
    """Runs the process for the duration of the block."""
    line = [sys.executable, "-m", "tests.bare_loop"]
    with subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        running = BareLoop(process)
        running.report()
        try:
            yield running
        finally:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(END_S)


def main() -> None:
    """Wakes up until the input ends."""
    late_s: list[float] = []

    def wake_up() -> None:
        while True:
            due_s = time.monotonic() + PERIOD_S
            time.sleep(PERIOD_S)
            late_s.append(time.monotonic() - due_s)

    threading.Thread(target=wake_up, daemon=True).start()
    for _ in sys.stdin:
        found = lateness(late_s[:])
        late_s.clear()
        print(msgspec.json.encode(found).decode(), flush=True)


if __name__ == "__main__":
    main()
