"""Memory and processor share of each process of the demonstration, while it flies."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WARM_S = 12.0
WATCH_S = 8.0


def _children(pid: int) -> dict[str, int]:
    """The processes that the demonstration started, by subcommand."""
    found: dict[str, int] = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            command = (folder / "cmdline").read_bytes().split(b"\0")
        except (OSError, ValueError):
            continue
        if parent == pid and b"gloc3" in command:
            found[command[command.index(b"gloc3") + 1].decode()] = int(folder.name)
    return found


def _usage(pid: int) -> tuple[float, float]:
    """Resident memory in MB and processor seconds so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    ticks = os.sysconf("SC_CLK_TCK")
    memory = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    return memory, (int(fields[11]) + int(fields[12])) / ticks


def watch(mission: str, *options: str) -> dict[str, tuple[float, float]]:
    """Resident memory in MB and share of a core of each process of a demonstration, by its subcommand."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gloc3", "demo", mission, *options, "--out", f"{folder}/demo"]
        demo = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            time.sleep(WARM_S)
            children = _children(demo.pid)
            before = {name: _usage(pid)[1] for name, pid in children.items()}
            time.sleep(WATCH_S)
            after = {name: _usage(pid) for name, pid in children.items()}
        finally:
            demo.send_signal(2)
            demo.wait(30.0)
    return {name: (memory, (cpu_s - before[name]) / WATCH_S) for name, (memory, cpu_s) in after.items()}


def run() -> list[str]:
    """One line a process."""
    return [
        f"{name:<10} {memory:6.0f} MB resident   {100.0 * share:5.1f} % of a core"
        for name, (memory, share) in sorted(watch("inspection").items())
    ]
