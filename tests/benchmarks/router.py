"""The router beside others': processor time of each forwarded message, delay, and what gets through.

Each router runs as a process of its own between two UDP sockets; the sender is another process. Ours is always there.
MAVProxy is taken from the interpreter of `MAVPROXY_PYTHON` or `runs/peers/mavproxy`, mavlink-router from PATH or
`runs/peers/mavlink-routerd`; a peer that is not there is left out, and the text says so.
"""

import asyncio
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import quantiles
from typing import NamedTuple

from gloc3.link.codec import Encoder, Frame, Parser, message, shape
from gloc3.link.endpoints import open_endpoint
from gloc3.link.message import Address
from gloc3.link.router import Router
from gloc3_onboard.routing import RoutedLink

ROOT = Path(__file__).parents[2]
PEERS = ROOT / "runs" / "peers"
HOST = "127.0.0.1"
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
SETTLE_S = 2.0
QUIET_HZ, QUIET_S = 200.0, 3.0
STEADY_HZ, STEADY_S = 2_000.0, 3.0
FAST_HZ, FAST_S = 10_000.0, 2.0
BUFFER_BYTES = 1 << 23


class Passed(NamedTuple):
    """What a router did with a stream of frames."""

    sent: int
    received: int
    cpu_us: float
    """Processor time of the router, of each frame that came out."""
    p50_us: float
    p99_us: float
    """Delay from the sender's socket to the receiver's."""


async def route(into: str, out: str) -> None:
    """Our router between two links, until it is ended."""
    loop = asyncio.get_running_loop()
    router = Router(Address(1, 191))
    for url in (into, out):
        link = RoutedLink(url, router, loop, lambda frames: frames)
        link.open(await open_endpoint(url, loop, link.receive))
    await asyncio.Event().wait()


def send(port: int, rate_hz: float, for_s: float) -> None:
    """Sends HIGHRES_IMU frames that carry the time of their sending in microseconds."""
    encoder = Encoder(1, 1)
    shape("HIGHRES_IMU")  # the dialect is read before the first frame is timed
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        begin_s = time.monotonic()
        for number in range(round(rate_hz * for_s)):
            while (left_s := begin_s + number / rate_hz - time.monotonic()) > 0.0:
                if left_s > 1e-3:
                    time.sleep(left_s - 5e-4)
            now_us = time.monotonic_ns() // 1000
            out.sendto(encoder.encode(message("HIGHRES_IMU", time_usec=now_us, xacc=1.0, zgyro=0.5)), (HOST, port))


def commands(into: int, out: int, scratch: Path) -> Iterator[tuple[str, list[str]]]:
    """The routers that are here, and how each is begun."""
    program = "import asyncio, sys; from tests.benchmarks.router import route; asyncio.run(route(*sys.argv[1:]))"
    yield "gloc3", [sys.executable, "-c", program, f"udpin://{HOST}:{into}", f"udpout://{HOST}:{out}"]
    routerd = shutil.which("mavlink-routerd") or str(PEERS / "mavlink-routerd")
    if Path(routerd).exists():
        yield "mavlink-router", [routerd, "-t", "0", "-e", f"{HOST}:{out}", f"{HOST}:{into}"]
    python = os.environ.get("MAVPROXY_PYTHON", str(PEERS / "mavproxy" / "bin" / "python"))
    if Path(python).exists():
        yield (
            "MAVProxy",
            [
                *(python, str(Path(python).with_name("mavproxy.py")), f"--master=udpin:{HOST}:{into}"),
                *(f"--out=udpout:{HOST}:{out}", "--daemon", "--non-interactive", f"--state-basedir={scratch}"),
                *("--default-modules=", "--streamrate=-1"),
            ],
        )


@contextmanager
def running(command: list[str], scratch: Path) -> Iterator[subprocess.Popen[bytes]]:
    """One router."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)} if "-c" in command[1:2] else dict(os.environ)
    process = subprocess.Popen(
        command, cwd=scratch, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def cpu_s(process: subprocess.Popen[bytes]) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def passed(
    process: subprocess.Popen[bytes], receiver: socket.socket, into: int, rate_hz: float, for_s: float
) -> Passed:
    """Sends a stream through a router and looks at what comes out."""
    wanted, parser = shape("HIGHRES_IMU").id, Parser(is_datagram=True)
    before_s = cpu_s(process)
    program = "import sys; from tests.benchmarks.router import send; send(int(sys.argv[1]), *map(float, sys.argv[2:]))"
    sender = subprocess.Popen(
        [sys.executable, "-c", program, str(into), str(rate_hz), str(for_s)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    arrived: list[tuple[int, bytes]] = []
    receiver.settimeout(1.0)
    while True:
        try:
            data = receiver.recv(65_535)
        except TimeoutError:
            if sender.poll() is not None:
                break
            continue
        arrived.append((time.monotonic_ns() // 1000, data))
    used_s = cpu_s(process) - before_s
    delays = [
        at_us - decoded.time_usec
        for at_us, data in arrived
        for frame in parser.receive(data)
        if frame.message_id == wanted and (decoded := frame.decode()) is not None
    ]
    sent = round(rate_hz * for_s)
    cuts = quantiles(delays, n=100) if len(delays) > 1 else [float("nan")] * 99
    return Passed(sent, len(delays), used_s / max(1, len(delays)) * 1e6, cuts[49], cuts[98])


def _drain(receiver: socket.socket) -> None:
    receiver.settimeout(0.5)
    with suppress(TimeoutError):
        while True:
            receiver.recv(65_535)


def measure() -> dict[str, tuple[Passed, Passed, Passed]]:
    """Of each router that is here: quiet, steady and fast streams."""
    found: dict[str, tuple[Passed, Passed, Passed]] = {}
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((HOST, 0))
            into = probe.getsockname()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            receiver.bind((HOST, 0))
            for name, command in commands(into, receiver.getsockname()[1], scratch):
                with running(command, scratch) as process:
                    time.sleep(SETTLE_S)
                    send(into, 10.0, 1.0)
                    _drain(receiver)
                    streams = ((QUIET_HZ, QUIET_S), (STEADY_HZ, STEADY_S), (FAST_HZ, FAST_S))
                    quiet, steady, fast = (passed(process, receiver, into, *stream) for stream in streams)
                    found[name] = quiet, steady, fast
    return found


def core_us() -> float:
    """Of one frame inside our router, from bytes to the links, in processor time."""
    router, encoder = Router(Address(1, 191)), Encoder(1, 1)
    sent: list[Frame] = []
    vehicle, station = router.attach("vehicle", sent.append), router.attach("station", sent.append)
    parser = Parser(is_datagram=True)
    for frame in parser.receive(Encoder(255, 190).encode(message("HEARTBEAT"))):
        router.route(station, frame, 0.0)
    frames = [encoder.encode(message("ATTITUDE", time_boot_ms=number)) for number in range(20_000)]
    begin_s = time.process_time()
    for number, raw in enumerate(frames):
        for frame in parser.receive(raw):
            router.route(vehicle, frame, number * 1e-4)
    return (time.process_time() - begin_s) / len(frames) * 1e6


def run() -> list[str]:
    """A line a router."""
    found = measure()
    lines = [f"one frame inside the router, bytes to links: {core_us():.2f} µs"]
    for name, (quiet, steady, fast) in found.items():
        lines.append(
            f"{name:15} {steady.cpu_us:7.1f} µs of processor a frame at {STEADY_HZ:.0f}/s    delay at {QUIET_HZ:.0f}/s "
            f"p50 {quiet.p50_us:5.0f} p99 {quiet.p99_us:5.0f} µs    {fast.received} of {fast.sent} at {FAST_HZ:.0f}/s"
        )
    lines += [f"{peer}: not here" for peer in ("mavlink-router", "MAVProxy") if peer not in found]
    return lines
