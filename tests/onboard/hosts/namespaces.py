"""Three computers in one: network namespaces, joined by lines of their own, each but the first with a clock of its own."""

import fcntl
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[3]
VEHICLE, VISION, BASE = "vehicle", "vision", "base"
NETS: Final = {VISION: "10.77.1", BASE: "10.77.2"}
GROUND: Final = "10.77.3"
AHEAD_S: Final = {VISION: 5_000, BASE: 70_000}
"""How far their clocks are ahead."""


@cache
def missing() -> str:
    """Why there can be no such namespaces here; empty if there can."""
    probe = f"gloc3-probe-{os.getpid()}"
    with _alone("probe"):  # the first of all makes the folder that they are in, and two at once would fail
        try:
            made = run("ip", "netns", "add", probe, is_checked=False)
            run("ip", "netns", "del", probe, is_checked=False)
            clock = run("unshare", "--time", "--monotonic", "1", "true", is_checked=False)
        except OSError as error:
            return f"{error.filename} is not here"
    return "network and time namespaces cannot be made here: it needs Linux and root" if made or clock else ""


@contextmanager
def namespaces() -> Iterator[None]:
    """Three hosts, the vehicle joined with each of the others and with this computer by a line of its own.

    Their names and addresses are this computer's: one test at a time has them.
    """
    with _alone("namespaces"):
        _clear()
        try:
            for host in (VEHICLE, *NETS):
                run("ip", "netns", "add", _name(host))
                run("ip", "-n", _name(host), "link", "set", "lo", "up")
            for host, net in NETS.items():
                ends = (host[:6] + "-v", "netns", _name(VEHICLE), "type", "veth", "peer", "name", "wire")
                run("ip", "link", "add", *ends, "netns", _name(host))
                _raise(_name(VEHICLE), ends[0], f"{net}.1")
                _raise(_name(host), "wire", f"{net}.2")
            run("ip", "link", "add", "gloc3-g", "type", "veth", "peer", "name", "ground", "netns", _name(VEHICLE))
            _raise(_name(VEHICLE), "ground", f"{GROUND}.1")
            run("ip", "addr", "add", f"{GROUND}.2/24", "dev", "gloc3-g")
            run("ip", "link", "set", "gloc3-g", "up")
            yield
        finally:
            _clear()


def inside(host: str) -> tuple[str, ...]:
    """What runs a program on a host, with its clock."""
    clock = ("unshare", "--time", "--monotonic", str(AHEAD_S[host])) if host in AHEAD_S else ()
    return ("ip", "netns", "exec", _name(host), *clock)


def has_netem() -> bool:
    """Whether this computer's kernel has the emulator of networks."""
    is_there = run(*_tc(VISION, "add"), "netem", "loss", "1%", is_checked=False) == 0
    if is_there:
        run(*_tc(VISION, "del"))
    return is_there


def shape(host: str, *discipline: str) -> None:
    """Has a host's line to the vehicle queue what it sends in a way of its own; without one it does no more."""
    run(*_tc(host, "add" if discipline else "del"), *discipline)


def line(host: str, word: str) -> None:
    """Takes a host's line to the vehicle `down`, or `up` again."""
    run("ip", "-n", _name(host), "link", "set", "wire", word)


@contextmanager
def relay(host: str, listen: str, to: str) -> Iterator["subprocess.Popen[str]"]:
    """A relay on a host, which is told on its stdin what to do."""
    words = [*inside(host), sys.executable, "-m", "tests.onboard.hosts.relay", listen, to]
    running = subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, text=True)
    try:
        yield running
    finally:
        running.kill()
        running.wait()
        assert running.stdin is not None
        running.stdin.close()


def run(*words: str, is_checked: bool = True) -> int:
    """Runs a program; its exit code."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert not (is_checked and done.returncode), f"{' '.join(words)}: {done.stderr}"
    return done.returncode


@contextmanager
def _alone(what: str) -> Iterator[None]:
    path = Path(tempfile.gettempdir()) / f"gloc3-{what}-{os.getuid()}.lock"
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _tc(host: str, word: str) -> tuple[str, ...]:
    return ("tc", "-n", _name(host), "qdisc", word, "dev", "wire", "root")


def _raise(space: str, device: str, address: str) -> None:
    run("ip", "-n", space, "addr", "add", f"{address}/24", "dev", device)
    run("ip", "-n", space, "link", "set", device, "up")


def _clear() -> None:
    for host in (VEHICLE, *NETS):
        run("ip", "netns", "del", _name(host), is_checked=False)
    run("ip", "link", "del", "gloc3-g", is_checked=False)


def _name(host: str) -> str:
    return f"gloc3-{host}"
