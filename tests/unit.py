"""The quick tests, as `make unit` runs them: no flights, simulators, sockets, processes, searches or pictures.

Two processes take half of the files each. They import these alone and tell nobody of each test, so that together they need
three quarters of what workers of pytest-xdist would.
"""

import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
PARTS: Final = 2
OPTIONS: Final = ("-q", "-p", "no:hypothesispytest", "-p", "no:xdist", "@tests/quick.txt")


def run(reports: Path) -> int:
    """Runs all parts, prints what they say, one behind the other, and leaves a JUnit report of each.

    Args:
        reports: the folder for these.

    Returns:
        0 where everything has passed.
    """
    reports.mkdir(parents=True, exist_ok=True)
    running = []
    for part in range(PARTS):
        own = [
            f"--part={part}/{PARTS}",
            f"--junitxml={reports / f'unit-{part}.xml'}",
            "-o",
            f"cache_dir=.pytest_cache/{part}",
        ]
        called = [sys.executable, "-m", "pytest", *OPTIONS, *own]
        running.append(subprocess.Popen(called, cwd=ROOT, stdout=subprocess.PIPE, text=True))
    codes = []
    for process in running:
        text, _ = process.communicate()
        print(text, end="", flush=True)
        codes.append(process.returncode)
    return max(codes, key=abs)


if __name__ == "__main__":
    sys.exit(run(ROOT / "runs" / "tests"))
