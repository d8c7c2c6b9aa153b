"""All tests, as `make test` runs them: those in wall time, and beside them, of lower priority, those in virtual time.

What flies by real sockets acts on silence within tenths of a second, and rightly so: it is to have the processor when
it wants it. What fails in wall time all the same is run once more when nothing else runs.
"""

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread
from typing import IO, Final

ROOT: Final = Path(__file__).parents[1]
WALL, VIRTUAL = "wall", "virtual"
LATER: Final = 10
"""By so much the priority of the tests in virtual time is lower, as `nice` counts."""
WORKERS: Final = {WALL: "4", VIRTUAL: "2"}
"""Of each group: what runs in wall time mostly waits."""
_WHICH: Final = {WALL: "sockets", VIRTUAL: "not sockets"}
_WITHOUT: Final = {WALL: ("-p", "no:hypothesispytest"), VIRTUAL: ()}
"""No search runs in wall time; the plugin would read all sources for constants to try."""
_SOME_FAILED: Final = 1
"""What pytest ends with where tests ran, and not all of them passed."""


def command(group: str, reports: Path, *more: str) -> list[str]:
    """How pytest is called for a group; its JUnit report is named like the group."""
    return [
        *([] if group == WALL else ["nice", "-n", str(LATER)]),
        *(sys.executable, "-m", "pytest", "-q", "-m", _WHICH[group], f"--junitxml={reports / group}.xml"),
        *_WITHOUT[group],
        *("-o", f"cache_dir=.pytest_cache/{group}", *more),
    ]


def _report(lines: IO[str], turn: Lock) -> None:
    """Prints whole lines, so that two can speak at a time."""
    with lines:
        for line in lines:
            with turn:
                print(line, end="", flush=True)


def _yield_as_a_session(reference: int) -> None:
    """Where Linux shares the processor among sessions (`man 7 sched`, autogroups), `nice` counts only within one."""
    with suppress(OSError):  # it does not
        Path(f"/proc/{reference}/autogroup").write_text(str(LATER), encoding="ascii")


def run(reports: Path, folder: Path = ROOT) -> int:
    """Runs both groups, prints what they say, and leaves a JUnit report of each, and `alone.xml` of what was run again.

    Args:
        reports: the folder for these.
        folder: of the project whose tests they are.

    Returns:
        0 where everything has passed, at the latest when it was run alone.
    """
    reports.mkdir(parents=True, exist_ok=True)
    (reports / "alone.xml").unlink(missing_ok=True)
    running, speakers, turn = {}, [], Lock()
    for group in _WHICH:
        called = command(group, reports, "-n", WORKERS[group], "--dist", "worksteal")
        running[group] = subprocess.Popen(called, cwd=folder, stdout=subprocess.PIPE, text=True, start_new_session=True)
        speakers.append(Thread(target=_report, args=(running[group].stdout, turn)))
        speakers[-1].start()
    _yield_as_a_session(running[VIRTUAL].pid)
    try:
        codes = {group: process.wait() for group, process in running.items()}
    except KeyboardInterrupt:
        for process in running.values():  # a terminal tells its own session alone
            process.send_signal(signal.SIGINT)
        raise
    finally:
        for speaker in speakers:
            speaker.join()
    if codes[WALL] == _SOME_FAILED:
        print("what has failed in wall time, once more, alone:", flush=True)
        again = command(WALL, reports, "--last-failed", f"--junitxml={reports / 'alone.xml'}")
        codes[WALL] = subprocess.run(again, cwd=folder, check=False).returncode
    return max(codes.values(), key=abs)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(run(ROOT / "runs" / "tests"))
    except KeyboardInterrupt:
        sys.exit(130)
