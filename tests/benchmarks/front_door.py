"""The front door of a listening node beside Zenoh's own listener: latency and rate over TLS, and latency on a slow link.

Both listen in one process, and another process is connected to each; they have their turn in each round. The slow link is
a relay that passes on `SLOW_BYTES_S` from the listening process. What is told is the median of the rounds.
"""

import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median, quantiles

import msgspec
import zenoh
from msgspec.structs import replace
from tests.common.network.yard import NOW, Yard

from gloc3.exchange.zenoh_session import NodeSession, new_session, open_node
from gloc3.network.file import read_network

ROUNDS = 3
PACED, EVERY_S = 300, 0.004
SHORT, PICTURE, CHUNK = os.urandom(200), os.urandom(100_000), os.urandom(50_000)
CHUNKS = 1000
SLOW_BYTES_S = 1e6
SLOW_BUFFER = 32_768
SLOW_PICTURES, SLOW_EVERY_S = 100, 0.048
DRAIN_S = 5.0
SETTLE_S = 0.5
DIRECT, DOOR = "direct", "front door"


class Received(msgspec.Struct, frozen=True):
    """What came of one kind of message in a turn."""

    number: int
    p50_s: float
    p99_s: float
    last_s: float


def receive(file: str, address: str) -> None:
    """The other process: notes latencies until its input ends; a line of that asks for a report."""
    membership, delays_s, last_s = read_network(Path(file), NOW), dict[str, list[float]](), 0.0
    node = replace(membership.node(), connect=(address,))

    def note(sample: zenoh.Sample) -> None:
        nonlocal last_s
        last_s = time.monotonic()
        sent_s = float(sample.payload.to_bytes()[:20])
        delays_s.setdefault(str(sample.key_expr), []).append(last_s - sent_s)

    with new_session(node, membership.settings()) as session:
        subscriber = session.declare_subscriber("pelican/**", note)
        print("open", flush=True)
        for _ in sys.stdin:
            found = {}
            for key, values in delays_s.items():
                cuts = quantiles(values, n=100)
                found[key.rpartition("/")[2]] = Received(len(values), cuts[49], cuts[98], last_s)
            delays_s.clear()
            print(msgspec.json.encode(found).decode(), flush=True)
        subscriber.undeclare()  # type: ignore[no-untyped-call]


class Side:
    """A listening session, and the process that is connected to it."""

    def __init__(self, stack: ExitStack, yard: Yard, name: str, *, is_slow: bool) -> None:
        own, port = yard.membership("pelican.main"), _free_port()
        node = replace(own.node(), listen=(f"tls/127.0.0.1:{port}",))
        if name == DIRECT:
            opened = NodeSession(new_session(node, own.settings()), None)
        else:
            opened = open_node(node, own.settings())
            opened.accept(lambda _: None)
        stack.callback(opened.close)
        if is_slow:
            port = stack.enter_context(slow_link(port))
        file = yard.folder / "pelican.vision" / "network.yaml"
        self._child = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.front_door", str(file), f"tls/127.0.0.1:{port}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(self._end)
        self._line()
        drop, block = zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK
        urgent, low = zenoh.Priority.REAL_TIME, zenoh.Priority.DATA_LOW
        declare = opened.session.declare_publisher
        self.short = declare("pelican/short", congestion_control=drop, priority=urgent)
        self.picture = declare("pelican/picture", congestion_control=drop, priority=low)
        self.chunk = declare("pelican/chunk", congestion_control=block)

    def _line(self) -> str:
        assert self._child.stdout is not None
        return self._child.stdout.readline()

    def _end(self) -> None:
        assert self._child.stdin is not None
        self._child.stdin.close()
        self._child.wait(10.0)

    def report(self, after_s: float) -> dict[str, Received]:
        """What came, once it is there."""
        time.sleep(after_s)
        assert self._child.stdin is not None
        self._child.stdin.write("\n")
        self._child.stdin.flush()
        return msgspec.json.decode(self._line(), type=dict[str, Received])

    def paced(self) -> Received:
        """Short messages, one after the other."""
        for _ in range(PACED):
            self.short.put(_stamped(SHORT))
            time.sleep(EVERY_S)
        return self.report(SETTLE_S)["short"]

    def rate_b_s(self) -> float:
        """As many bytes as go."""
        begin_s = time.monotonic()
        for _ in range(CHUNKS):
            self.chunk.put(_stamped(CHUNK))
        found = self.report(SETTLE_S)["chunk"]
        return found.number * len(CHUNK) / (found.last_s - begin_s)

    def urgent(self) -> Received:
        """Short messages beside pictures that are too many for the link."""
        for _ in range(SLOW_PICTURES):
            self.picture.put(_stamped(PICTURE))
            for _ in range(3):
                self.short.put(_stamped(SHORT))
                time.sleep(SLOW_EVERY_S / 3)
        return self.report(DRAIN_S)["short"]


def _stamped(data: bytes) -> bytes:
    return b"%020.9f" % time.monotonic() + data


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def slow_link(port: int) -> Iterator[int]:
    """A relay to a port, slow on the way back; yields where it listens."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()

        def pump(source: socket.socket, target: socket.socket, bytes_s: float) -> None:
            try:
                while data := source.recv(4096):
                    time.sleep(len(data) / bytes_s)
                    target.sendall(data)
                target.shutdown(socket.SHUT_RDWR)
            except OSError:  # the other one has ended
                return

        def serve() -> None:
            client, _ = listener.accept()
            server = socket.socket()
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SLOW_BUFFER)
            server.connect(("127.0.0.1", port))
            threading.Thread(target=pump, args=(client, server, float("inf")), daemon=True).start()
            pump(server, client, SLOW_BYTES_S)

        threading.Thread(target=serve, daemon=True).start()
        yield int(listener.getsockname()[1])


def run() -> list[str]:
    """The lines of the report."""
    lines = []
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        yard = Yard(Path(folder) / "yard")
        near = {name: Side(stack, yard, name, is_slow=False) for name in (DIRECT, DOOR)}
        far = {name: Side(stack, yard, name, is_slow=True) for name in (DIRECT, DOOR)}
        time.sleep(SETTLE_S)
        paced = {name: list[Received]() for name in near}
        rates = {name: list[float]() for name in near}
        urgent = {name: list[Received]() for name in near}
        for _ in range(ROUNDS):
            for name, side in near.items():
                paced[name].append(side.paced())
                rates[name].append(side.rate_b_s())
                urgent[name].append(far[name].urgent())
        for name in near:
            p50_s, p99_s = (median(getattr(one, key) for one in paced[name]) for key in ("p50_s", "p99_s"))
            late_s = median(one.p50_s for one in urgent[name])
            lines.append(
                f"{name:<11} p50 {p50_s * 1e6:4.0f} µs, p99 {p99_s * 1e6:5.0f} µs; {median(rates[name]) / 1e6:4.0f} MB/s; "
                f"urgent beside pictures on a link of {SLOW_BYTES_S / 1e6:.0f} MB/s: p50 {late_s:.2f} s"
            )
    return lines


if __name__ == "__main__":
    receive(*sys.argv[1:])
