"""The router beside others': processor time of each forwarded message, delay, and what gets through.

Each router runs as a process of its own between two UDP sockets; the sender is another process. Ours, mavlink-router and the
way without any router have their turn second by second, so that what the computer does meanwhile is the same for all;
MAVProxy, which also works when nothing comes, has a turn of its own. What is told is the median of the rounds.
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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

from gloc3.mavlink.codec import Encoder, Frame, Parser, message, shape
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import Router
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3.mavlink.transport.udp import enlarge
from gloc3_onboard.companion.routing import RoutedLink

ROOT = Path(__file__).parents[2]
PEERS = ROOT / "runs" / "peers"
HOST = "127.0.0.1"
SETTLE_S = 1.5
TURN_S = 1.0
ROUNDS = 3
BUFFER_BYTES = 1 << 23
_CPU_CLOCK = 2
"""Of the kernel's kinds of clocks of a process, as clock_getcpuclockid(3) makes them."""
DIRECT, OURS, C_PEER, PYTHON_PEER = "no router", "gloc3", "mavlink-router", "MAVProxy"


class Stream(NamedTuple):
    """What is sent through a router."""

    rate_hz: float
    """Frames a second."""
    for_s: float
    together: int = 1
    """Frames in a datagram; what comes by a fast serial line or from an autopilot's buffer comes so."""

    @property
    def text(self) -> str:
        """For people."""
        return f"{self.rate_hz:,.0f}/s{f' by {self.together}' if self.together > 1 else ''}"


QUIET, STEADY, TOGETHER, FAST = Stream(200, 6), Stream(2_000, 2), Stream(2_000, 6, 10), Stream(10_000, 2)
"""Those with few datagrams last longer: the hundredth part of them is to be more than the first ones."""
STREAMS = (QUIET, STEADY, TOGETHER, FAST)


class Passed(NamedTuple):
    """What a router did with a stream of frames."""

    sent: int
    received: int
    cpu_us: float
    """Processor time of the router, of each frame that came out."""
    p50_us: float
    p99_us: float
    """Delay from before the sender's socket to the receiver's."""


async def route(into: str, out: str) -> None:
    """Our router between two links, until it is ended."""
    loop = asyncio.get_running_loop()
    router = Router(Address(1, 191))
    for url in (into, out):
        link = RoutedLink(url, router, loop)
        link.open(await open_endpoint(url, loop, link.receive))
    await asyncio.Event().wait()


def begin(into: str, out: str) -> None:
    """The same as a process."""
    asyncio.run(route(into, out))


def send(ports: Sequence[int], rate_hz: float, for_s: float, together: float = 1.0) -> None:
    """Sends HIGHRES_IMU frames to each port in turn, a second each, for some seconds in all to each.

    They carry the time of their sending, in nanoseconds, and in `xacc` whose turn it is.
    """
    encoder, each = Encoder(1, 1), round(together)
    shape("HIGHRES_IMU")  # the dialect is read before the first frame is timed
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for turn in range(max(1, round(for_s)) * len(ports)):
            index, begin_s = turn % len(ports), time.monotonic()
            for number in range(0, round(rate_hz * min(for_s, TURN_S)), each):
                while (left_s := begin_s + number / rate_hz - time.monotonic()) > 0.0:
                    if left_s > 1e-3:
                        time.sleep(left_s - 5e-4)
                now_ns = time.monotonic_ns()
                imu = [message("HIGHRES_IMU", time_usec=now_ns, xacc=float(index), id_=one) for one in range(each)]
                out.sendto(b"".join(map(encoder.encode, imu)), (HOST, ports[index]))


class Way(NamedTuple):
    """A router, or none, between two sockets."""

    name: str
    into: int
    command: Sequence[str] = ()


def routes(out: int, scratch: Path) -> Iterator[tuple[Way, ...]]:
    """The routers that are here: those that have their turns together, and then MAVProxy."""
    others = {way.name: way for way in _routers(out, scratch)}
    alone = others.pop(PYTHON_PEER, None)
    yield (Way(DIRECT, out), *others.values())
    if alone is not None:
        yield (alone,)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def _routers(out: int, scratch: Path) -> Iterator[Way]:
    """The routers that are here, and how each is begun."""
    into = _free_port()
    program = "import sys; from tests.benchmarks.router import begin; begin(*sys.argv[1:])"
    yield Way(OURS, into, [sys.executable, "-c", program, f"udpin://{HOST}:{into}", f"udpout://{HOST}:{out}"])
    routerd = shutil.which("mavlink-routerd") or str(PEERS / "mavlink-routerd")
    if Path(routerd).exists():
        into = _free_port()
        yield Way(C_PEER, into, [routerd, "-t", "0", "-e", f"{HOST}:{out}", f"{HOST}:{into}"])
    python = os.environ.get("MAVPROXY_PYTHON", str(PEERS / "mavproxy" / "bin" / "python"))
    if Path(python).exists():
        into = _free_port()
        yield Way(
            PYTHON_PEER,
            into,
            [
                *(python, str(Path(python).with_name("mavproxy.py")), f"--master=udpin:{HOST}:{into}"),
                *(f"--out=udpout:{HOST}:{out}", "--daemon", "--non-interactive", f"--state-basedir={scratch}"),
                *("--default-modules=", "--streamrate=-1"),
            ],
        )


@contextmanager
def running(command: Sequence[str], scratch: Path) -> Iterator[subprocess.Popen[bytes]]:
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
    """Processor time that a process has used, that of threads which have ended included."""
    return time.clock_gettime(~process.pid << 3 | _CPU_CLOCK)


def passed(
    group: Sequence[Way], processes: Mapping[str, subprocess.Popen[bytes]], receiver: socket.socket, stream: Stream
) -> dict[str, Passed]:
    """Sends a stream each way in turn, and looks at what comes out."""
    wanted, parser = shape("HIGHRES_IMU").id, Parser(is_datagram=True)
    before_s = {name: cpu_s(process) for name, process in processes.items()}
    program = (
        "import sys; from tests.benchmarks.router import send; "
        "send([int(port) for port in sys.argv[1].split(',')], *map(float, sys.argv[2:]))"
    )
    sender = subprocess.Popen(
        [sys.executable, "-c", program, ",".join(str(way.into) for way in group), *map(str, stream)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    arrived: list[tuple[int, bytes]] = []
    receiver.settimeout(0.7)
    while True:
        try:
            data = receiver.recv(65_535)
        except TimeoutError:
            if sender.poll() is not None:
                break
            continue
        arrived.append((time.monotonic_ns(), data))
    used_s = {name: cpu_s(process) - before_s[name] for name, process in processes.items()}
    delays_us: dict[str, list[float]] = {way.name: [] for way in group}
    for at_ns, data in arrived:
        for frame in parser.receive(data):
            if frame.message_id == wanted and (decoded := frame.decode()) is not None:
                delays_us[group[round(decoded.xacc)].name].append((at_ns - decoded.time_usec) / 1e3)
    sent = round(stream.rate_hz * stream.for_s)
    found: dict[str, Passed] = {}
    for name, delays in delays_us.items():
        cuts = quantiles(delays, n=100) if len(delays) > 1 else [float("nan")] * 99
        cpu_us = used_s.get(name, 0.0) / max(1, len(delays)) * 1e6
        found[name] = Passed(sent, len(delays), cpu_us, cuts[49], cuts[98])
    return found


def _drain(receiver: socket.socket) -> None:
    receiver.settimeout(0.5)
    with suppress(TimeoutError):
        while True:
            receiver.recv(65_535)


def one_round(scratch: Path) -> dict[str, dict[Stream, Passed]]:
    """Every stream through every router that is here, and through none."""
    found: dict[str, dict[Stream, Passed]] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        enlarge(receiver, BUFFER_BYTES)
        receiver.bind((HOST, 0))
        for group in routes(receiver.getsockname()[1], scratch):
            with ExitStack() as stack:
                processes = {
                    way.name: stack.enter_context(running(way.command, scratch)) for way in group if way.command
                }
                time.sleep(SETTLE_S)
                send([way.into for way in group], 10.0, 0.5)
                time.sleep(SETTLE_S)  # what is passed on at all may have brought more of the router up
                _drain(receiver)
                for stream in STREAMS:
                    for name, result in passed(group, processes, receiver, stream).items():
                        found.setdefault(name, {})[stream] = result
    return found


def measure(rounds: int = ROUNDS) -> list[dict[str, dict[Stream, Passed]]]:
    """Some rounds."""
    with tempfile.TemporaryDirectory() as folder:
        return [one_round(Path(folder)) for _ in range(rounds)]


def typical(rounds: list[dict[str, dict[Stream, Passed]]]) -> dict[str, dict[Stream, Passed]]:
    """The median of each figure; of what was received the least."""
    return {
        name: {
            stream: Passed(
                rounds[0][name][stream].sent,
                min(each[name][stream].received for each in rounds),
                *(median(each[name][stream][index] for each in rounds) for index in (2, 3, 4)),
            )
            for stream in STREAMS
        }
        for name in rounds[0]
    }


def core_us() -> float:
    """Of one frame inside our router, from bytes to the links, in processor time."""
    router, encoder = Router(Address(1, 191)), Encoder(1, 1)
    sent: list[Frame] = []
    vehicle, station = router.attach("vehicle", sent.extend), router.attach("station", sent.extend)
    parser = Parser(is_datagram=True)
    router.route(station, parser.receive(Encoder(255, 190).encode(message("HEARTBEAT"))), 0.0)
    frames = [encoder.encode(message("ATTITUDE", time_boot_ms=number)) for number in range(20_000)]
    begin_s = time.process_time()
    for number, raw in enumerate(frames):
        router.route(vehicle, parser.receive(raw), number * 1e-4)
    return (time.process_time() - begin_s) / len(frames) * 1e6


def run() -> list[str]:
    """A line a router and stream."""
    found = typical(measure())
    lines = [f"one frame inside the router, bytes to links: {core_us():.2f} µs"]
    for name, streams in found.items():
        for stream, result in streams.items():
            lines.append(
                f"{name:15} {stream.text:13} {result.cpu_us:7.1f} µs of processor a frame    "
                f"delay p50 {result.p50_us:6.1f} p99 {result.p99_us:7.0f} µs    {result.received} of {result.sent} frames"
            )
    lines += [f"{peer}: not here" for peer in (C_PEER, PYTHON_PEER) if peer not in found]
    return lines
