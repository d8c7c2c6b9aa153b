"""A real process whose memory is limited, and a component in it that leaks: it is told once, and the rest works on."""

import re
import resource
import signal
import socket
from pathlib import Path

import pytest
from tests.commands.programs import ROOT, Program, program

from gloc3.mavlink.codec import Encoder, message
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets

LEFT_BYTES = 120 << 20
"""What the process may grow by, once it is up."""
PLATFORM = """\
platform: pelican
extends: pelican_rtk
components:
  - {name: pose}
  - {name: leaker, class: "tests.onboard.process.leaker:Leaker", rate_hz: 20, on_fault: {reinitialize: {times: 1}, then: land}}
"""


def limit(running: Program, left_bytes: int) -> None:
    """Limits the address space of a running program to a little more than it has."""
    pages = int(Path(f"/proc/{running.process.pid}/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + left_bytes
    resource.prlimit(running.process.pid, resource.RLIMIT_AS, (most, most))


def test_memory_that_is_used_up_is_told_once_and_the_others_work_on(tmp_path: Path) -> None:
    (tmp_path / "leaky.yaml").write_text(PLATFORM)
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    words = ("onboard", "leaky.yaml", "--autopilot", f"udpin://127.0.0.1:{cable}", "--station", "udpout://127.0.0.1:9")
    python_path = ("env", f"PYTHONPATH={ROOT}")
    with program(*words, "--out", "out", folder=tmp_path, before=python_path) as onboard:
        onboard.await_line(lambda line: "components; log in" in line)
        limit(onboard, LEFT_BYTES)
        once = onboard.await_line(lambda line: "leaker: working -> faulty: out of memory" in line, 30.0)
        behind = onboard.lines.index(once) + 1
        onboard.await_line(lambda line: line == once, 30.0, behind)  # another one had taken its place
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            autopilot.sendto(Encoder(1, 1).encode(message("HEARTBEAT", type=2, autopilot=12)), ("127.0.0.1", cable))
            onboard.await_line(lambda line: "px4 autopilot found as 1/1" in line, 30.0)
        onboard.interrupt(signal.SIGTERM)
        assert onboard.end(30.0) == 0, onboard.text
    told = [
        line for line in onboard.lines if re.search(r"out of memory: the process has \d+ MiB of at most \d+ MiB", line)
    ]
    assert len(told) == 1, onboard.text
    assert not [line for line in onboard.lines if "Traceback" in line or re.search(r"\.py:\d+ ", line)], onboard.text
    faulty = {line.split(": ")[1] for line in onboard.lines if "-> faulty" in line}
    assert faulty <= {"leaker", "command_server"}, onboard.text


@pytest.mark.parametrize("most_kib", [250_000, 600_000])
def test_memory_that_does_not_suffice_for_the_start_is_told_in_one_sentence(most_kib: int, tmp_path: Path) -> None:
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    words = ("onboard", "pelican_rtk", "--autopilot", f"udpin://127.0.0.1:{cable}", "--station", "udpout://127.0.0.1:9")
    limited = ("bash", "-c", f'ulimit -v {most_kib}; exec "$@"', "limited")
    with program(*words, "--out", "out", folder=tmp_path, before=limited) as onboard:
        assert onboard.end(30.0) == 1, onboard.text
    (told,) = [line for line in onboard.lines if "out of memory" in line]
    assert re.fullmatch(
        r"gloc3 onboard: out of memory: the process has \d+ MiB of at most \d+ MiB; raise its limit .*", told
    )
    assert onboard.lines[-1] == told
    assert not [line for line in onboard.lines if "Traceback" in line or "Error" in line], onboard.text
