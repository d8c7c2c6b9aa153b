"""Endpoints over real sockets and a pseudo terminal."""

import asyncio
import fcntl
import os
import pty
import select
import socket
import termios
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import suppress

import pytest

from gloc3.errors import Refused
from gloc3.mavlink import codec
from gloc3.mavlink.signing import Signing
from gloc3.mavlink.transport import pinning, serial_line, tcp, udp
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint
from gloc3.mavlink.transport.udp import UdpServerEndpoint, senders_in

pytestmark = pytest.mark.sockets

RATE_NAMES = {f"B{digit}" for digit in range(1, 10)}
STUCK_BYTES = 65536
"""More than a line without a reader accepts."""
FRAMES = [codec.Encoder(1, 1).encode(codec.message("ATTITUDE", time_boot_ms=n)) for n in range(1, 4)]


class Opener:
    """Opens endpoints and closes them all at the end."""

    def __init__(self) -> None:
        self.opened: list[Endpoint] = []

    async def __call__(self, url: str, *, pins_autopilot: bool = False) -> tuple[Endpoint, list[bytes]]:
        received: list[bytes] = []
        loop = asyncio.get_running_loop()
        endpoint = await open_endpoint(url, loop, received.append, pins_autopilot=pins_autopilot)
        self.opened.append(endpoint)
        return endpoint, received


@pytest.fixture
async def opener() -> AsyncIterator[Opener]:
    opener = Opener()
    yield opener
    for endpoint in opener.opened:
        await endpoint.close()


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not is_so():
            await asyncio.sleep(0.005)


async def test_udp_listener_answers_everyone_it_has_heard_from(opener: Opener) -> None:
    server, received = await opener("udpin://127.0.0.1:0")
    assert server.local_port
    assert not server.is_connected
    server.send(b"nobody there")
    clients = [await opener(f"udpout://127.0.0.1:{server.local_port}") for _ in range(2)]
    for number, (client, _) in enumerate(clients):
        client.send(FRAMES[number])
    await until(lambda: len(received) == 2)
    server.send(FRAMES[2])
    await until(lambda: all(answers == [FRAMES[2]] for _, answers in clients))
    assert server.is_datagram
    assert server.is_connected


async def test_udp_listener_sends_what_is_for_one_system_to_those_who_were_heard_as_it(opener: Opener) -> None:
    server, received = await opener("udpin://127.0.0.1:0")
    clients = [await opener(f"udpout://127.0.0.1:{server.local_port}") for _ in range(3)]
    for system, (client, _) in zip((7, 8, 8), clients, strict=True):
        client.send(codec.Encoder(system, 1).encode(codec.message("ATTITUDE")))
    await until(lambda: len(received) == 3)
    encoder = codec.Encoder(255, 190)
    for_7, for_8, for_9, for_all = (
        encoder.encode(codec.message("COMMAND_LONG", command=400, target_system=target)) for target in (7, 8, 9, 0)
    )
    for frames in (for_7, for_8, for_9, for_all, for_7 + for_8):
        server.send(frames)
    own = [[for_7, for_9, for_all, for_7 + for_8], *2 * [[for_8, for_9, for_all, for_7 + for_8]]]
    await until(lambda: [answers for _, answers in clients] == own)


def test_the_systems_behind_a_peer_are_read_off_its_datagrams() -> None:
    key = Signing(bytes(32), link_id=1, now=1)
    signed = codec.Encoder(5, 1, key).encode(codec.message("ATTITUDE"))
    previous = bytes((0xFE, 9, 0, 6, 1, 0)) + bytes(11)
    assert list(senders_in(signed + previous + FRAMES[0])) == [(5, 1), (6, 1), (1, 1)]
    assert list(senders_in(b"\x00" * 40)) == []
    assert list(senders_in(FRAMES[0][:3])) == []


async def test_what_claims_the_id_of_an_autopilot_that_is_heard_from_another_peer_is_dropped_and_told(
    opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, received = await opener("udpin://127.0.0.1:0", pins_autopilot=True)
    true, second = [(await opener(f"udpout://127.0.0.1:{server.local_port}"))[0] for _ in range(2)]
    true.send(FRAMES[0])
    await until(lambda: received == [FRAMES[0]])
    station = codec.Encoder(255, 190).encode(codec.message("HEARTBEAT"))
    second.send(station)
    second.send(FRAMES[1] + station)
    await until(lambda: bool(server.intruder))
    assert received == [FRAMES[0], station], "what it sends as somebody else is heard"
    assert server.intruder.startswith(f"127.0.0.1:{second.local_port} claims to be autopilot 1/1, which is heard from")
    server.send(FRAMES[2])
    monkeypatch.setattr(pinning, "PINNED_S", 0.0)
    second.send(FRAMES[1])
    await until(lambda: received[2:] == [FRAMES[1]])


async def test_a_second_client_that_claims_the_id_of_an_autopilot_is_dropped_and_told_over_tcp_as_well(
    opener: Opener,
) -> None:
    server, received = await opener("tcpin://127.0.0.1:0", pins_autopilot=True)
    true, second = [(await opener(f"tcpout://127.0.0.1:{server.local_port}"))[0] for _ in range(2)]
    await until(lambda: true.is_connected and second.is_connected)
    true.send(FRAMES[0])
    await until(lambda: received == [FRAMES[0]])
    station = codec.Encoder(255, 190).encode(codec.message("HEARTBEAT"))
    second.send(FRAMES[1] + station)
    await until(lambda: bool(server.intruder) and len(received) > 1)
    assert received == [FRAMES[0], station], "what it sends as somebody else is heard"
    assert " claims to be autopilot 1/1, which is heard from 127.0.0.1:" in server.intruder
    assert server.dropped == 1
    await true.close()

    async def takes_over() -> None:
        while received[2:] != [FRAMES[2]]:
            second.send(FRAMES[2])
            await asyncio.sleep(0.05)
            del received[2:-1]

    await asyncio.wait_for(takes_over(), 2.0)  # long before PINNED_S: the first one has closed its connection


async def test_a_second_port_of_the_host_that_is_sent_to_does_not_become_its_autopilot(opener: Opener) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as true,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as lie,
    ):
        true.bind(("127.0.0.1", 0))
        port = true.getsockname()[1]
        client, received = await opener(f"udpout://127.0.0.1:{port}", pins_autopilot=True)
        client.send(FRAMES[0])
        _, address = true.recvfrom(1000)
        true.sendto(FRAMES[1], address)
        await until(lambda: received == [FRAMES[1]])
        lie.sendto(FRAMES[2], address)
        await until(lambda: bool(client.intruder))
        assert received == [FRAMES[1]]


async def test_udp_listener_keeps_a_bounded_number_of_peers_and_forgets_silent_ones(
    opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udp, "MOST_PEERS", 2)
    server, received = await opener("udpin://127.0.0.1:0")
    assert isinstance(server, UdpServerEndpoint)
    for _ in range(3):
        client, _ = await opener(f"udpout://127.0.0.1:{server.local_port}")
        client.send(b"x")
    await until(lambda: server.unknown_refused == 1)
    assert len(received) == 2
    monkeypatch.setattr(udp, "PEER_EXPIRES_S", -1.0)
    assert server.peers == []
    client.send(b"y")
    await until(lambda: len(received) == 3)


async def test_the_peers_of_one_host_keep_out_nobody_of_another(
    opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udp, "MOST_PEERS", 4)
    server, received = await opener("udpin://127.0.0.1:0")
    assert isinstance(server, UdpServerEndpoint)
    flood = [(await opener(f"udpout://127.0.0.1:{server.local_port}"))[0] for _ in range(6)]
    for client in flood:
        client.send(b"x")
    await until(lambda: server.unknown_refused == 2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.2", 0))
        other.sendto(b"y", ("127.0.0.1", server.local_port or 0))
        await until(lambda: received[4:] == [b"y"])
        assert server.origin == "127.0.0.2"
        for client in flood:
            client.send(b"x")
        await until(lambda: len(received) == 8)
        assert server.peers[-1] == other.getsockname()
        assert len(server.peers) == 4


async def test_a_peer_that_comes_late_gets_the_first_datagram(opener: Opener) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client, _ = await opener(f"udpout://127.0.0.1:{port}")
    for _ in range(3):
        client.send(FRAMES[0])
        await asyncio.sleep(0.01)
    _, received = await opener(f"udpin://127.0.0.1:{port}")
    client.send(FRAMES[1])
    await until(lambda: received == [FRAMES[1]])


async def test_a_burst_of_datagrams_is_kept(opener: Opener) -> None:
    server, received = await opener("udpin://127.0.0.1:0")
    client, _ = await opener(f"udpout://127.0.0.1:{server.local_port}")
    for _ in range(1000):
        client.send(FRAMES[0])
    await until(lambda: len(received) == 1000)


@pytest.mark.parametrize("scheme", ["udpin", "tcpin"])
async def test_a_port_in_use_is_said(opener: Opener, scheme: str) -> None:
    first, _ = await opener(f"{scheme}://127.0.0.1:0")
    with pytest.raises(Refused, match=f"port {first.local_port} is in use by another program"):
        await opener(f"{scheme}://127.0.0.1:{first.local_port}")


async def test_an_address_that_is_not_ours_is_said(opener: Opener) -> None:
    with pytest.raises(Refused, match=r"0\.0\.0\.0 listens on all"):
        await opener("udpin://203.0.113.7:0")


async def test_tcp_server_keeps_its_clients_streams_apart(opener: Opener) -> None:
    server, received = await opener("tcpin://127.0.0.1:0")
    clients = [await opener(f"tcpout://127.0.0.1:{server.local_port}") for _ in range(2)]
    await until(lambda: all(client.is_connected for client, _ in clients))
    for half in (slice(None, 15), slice(15, None)):
        for number, (client, _) in enumerate(clients):
            client.send(FRAMES[number][half])
            await asyncio.sleep(0.01)
    await until(lambda: sorted(received) == sorted(FRAMES[:2]))
    server.send(FRAMES[2])
    await until(lambda: all(b"".join(answers) == FRAMES[2] for _, answers in clients))


async def test_tcp_client_connects_again(opener: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gloc3.mavlink.transport.tcp.RECONNECT_S", 0.01)
    server, _ = await opener("tcpin://127.0.0.1:0")
    client, received = await opener(f"tcpout://127.0.0.1:{server.local_port}")
    await until(lambda: client.is_connected)
    port = server.local_port
    await server.close()
    await until(lambda: not client.is_connected and client.problem != "")
    client.send(b"lost")
    assert client.dropped == 1
    await until(lambda: client.problem == "connection refused")
    server, _ = await opener(f"tcpin://127.0.0.1:{port}")
    await until(lambda: client.is_connected and server.is_connected)
    server.send(FRAMES[0])
    await until(lambda: received == [FRAMES[0]])


class Peer:
    """A program to which endpoints connect; its kernel holds little that it does not read."""

    def __init__(self) -> None:
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.listener.bind(("127.0.0.1", 0))
        self.listener.listen()
        self.url = f"tcpout://127.0.0.1:{self.listener.getsockname()[1]}"

    def accept(self) -> socket.socket:
        taken = self.listener.accept()[0]
        taken.setblocking(False)
        return taken


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.listener.close()


async def test_a_tcp_peer_that_accepts_nothing_is_lost(
    opener: Opener, monkeypatch: pytest.MonkeyPatch, peer: Peer
) -> None:
    monkeypatch.setattr(tcp, "DEAD_S", 0.3)
    client, _ = await opener(peer.url)
    await until(lambda: client.is_connected)
    with peer.accept():
        async with asyncio.timeout(60):
            while client.is_connected:
                client.send(bytes(1000))
                await asyncio.sleep(0.001)
    assert client.problem == "connection timed out"
    assert client.dropped > 0


async def test_a_tcp_peer_that_is_slow_is_kept(opener: Opener, monkeypatch: pytest.MonkeyPatch, peer: Peer) -> None:
    monkeypatch.setattr(tcp, "DEAD_S", 0.5)
    monkeypatch.setattr(tcp, "STALE_S", 0.1)
    client, _ = await opener(peer.url)
    await until(lambda: client.is_connected)
    with peer.accept() as end:
        for _ in range(100):
            for _ in range(100):
                client.send(FRAMES[0])
            await asyncio.sleep(0.01)
            with suppress(BlockingIOError):
                end.recv(1000)  # a fourth of what is sent
            assert client.is_connected
    assert client.dropped > 0


async def test_a_tcp_peer_gets_no_frames_late_that_it_did_not_accept(
    opener: Opener, monkeypatch: pytest.MonkeyPatch, peer: Peer
) -> None:
    monkeypatch.setattr(tcp, "STALE_S", 0.1)
    client, _ = await opener(peer.url)
    await until(lambda: client.is_connected)
    encoder, data, received = codec.Encoder(1, 1), b"", [-1]
    for number in range(1000):
        client.send(encoder.encode(codec.message("ATTITUDE", time_boot_ms=number)))
        await asyncio.sleep(0.0)
    await asyncio.sleep(0.2)
    client.send(encoder.encode(codec.message("ATTITUDE", time_boot_ms=1000)))
    with peer.accept() as end:
        while received[-1] != 1000:
            with suppress(BlockingIOError):
                data += end.recv(65536)
            frames = [frame.decode() for frame in codec.Parser().receive(data)]
            received = [message.time_boot_ms for message in frames if message is not None] or [-1]
            await asyncio.sleep(0.005)
    assert 999 not in received
    assert client.dropped == 1001 - len(received)


async def test_a_tcp_server_that_does_not_answer_is_said(
    opener: Opener, monkeypatch: pytest.MonkeyPatch, peer: Peer
) -> None:
    monkeypatch.setattr(tcp, "CONNECT_S", 0.1)
    peer.listener.listen(0)
    with socket.create_connection(peer.listener.getsockname()):  # takes the only place in the queue
        client, _ = await opener(peer.url)
        await until(lambda: client.problem == "no answer within 0.1 s")


async def test_of_too_many_tcp_clients_one_that_is_silent_makes_room(
    opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tcp, "MOST_CLIENTS", 2)
    server, received = await opener("tcpin://127.0.0.1:0")
    address = ("127.0.0.1", server.local_port or 0)
    with socket.create_connection(address) as silent, socket.create_connection(address) as speaking:
        speaking.sendall(FRAMES[0])
        await until(lambda: received == [FRAMES[0]])
        with socket.create_connection(address):
            await until(lambda: server.problem == "more than 2 clients")
        monkeypatch.setattr(tcp, "SILENT_S", 0.0)
        with socket.create_connection(address) as newcomer:
            newcomer.sendall(FRAMES[1])
            speaking.sendall(FRAMES[2])
            await until(lambda: sorted(received) == sorted(FRAMES))
        assert silent.recv(1) == b"", "it is disconnected"


async def test_serial_line_both_ways_and_a_missing_device(opener: Opener) -> None:
    master, slave = pty.openpty()
    try:
        endpoint, received = await opener(f"serial://{os.ttyname(slave)}:57600")
        await until(lambda: endpoint.is_connected)
        os.write(master, FRAMES[0])
        await until(lambda: b"".join(received) == FRAMES[0])
        endpoint.send(FRAMES[1])
        await until(lambda: endpoint.bytes_sent > 0)
        assert os.read(master, 300) == FRAMES[1]
        missing, _ = await opener("serial:///dev/gloc3-is-not-there:57600")
        await until(lambda: missing.problem == "no such file or directory")
        assert not missing.is_connected
        await endpoint.close()
        await missing.close()
    finally:
        os.close(master)
        os.close(slave)


def _line_rate(descriptor: int) -> int:
    """The rate that a line is set to, in baud."""
    code = termios.tcgetattr(descriptor)[5]
    return next(int(name[1:]) for name, value in vars(termios).items() if name[:2] in RATE_NAMES and value == code)


async def test_the_rate_of_a_serial_line_is_found(opener: Opener) -> None:
    master, slave = pty.openpty()
    try:
        endpoint, received = await opener(f"serial://{os.ttyname(slave)}:auto")
        tried: list[int] = []
        while not endpoint.is_connected:
            rate = _line_rate(slave)
            tried += [rate] if tried[-1:] != [rate] else []
            wrong = bytes(byte ^ 0xA5 for byte in FRAMES[0])  # what a line of another rate makes of it
            os.write(master, FRAMES[0] if rate == 921_600 else wrong)
            if rate != 921_600:
                assert received == [], "nothing is taken for heard before the rate is known"
                endpoint.send(FRAMES[1])
            await asyncio.sleep(0.02)
        assert tried[-3:] == [57_600, 115_200, 921_600]
        assert endpoint.bytes_sent == 0, "nothing is sent at a rate that may be wrong"
        assert endpoint.problem == ""
        os.write(master, FRAMES[2])
        await until(lambda: b"".join(received).endswith(FRAMES[2]))
        await endpoint.close()
    finally:
        os.close(master)
        os.close(slave)


async def test_a_serial_line_that_another_program_holds_says_so(opener: Opener) -> None:
    master, slave = pty.openpty()
    other = os.open(os.ttyname(slave), os.O_RDWR | os.O_NOCTTY)
    try:
        fcntl.flock(other, fcntl.LOCK_EX)
        endpoint, _ = await opener(f"serial://{os.ttyname(slave)}:57600")
        await until(lambda: endpoint.problem == "in use by another program")
        assert not endpoint.is_connected
        await endpoint.close()
    finally:
        for number in (other, slave, master):
            os.close(number)


async def test_a_line_with_flow_control_that_nobody_lets_flow_says_so(
    opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_line, "WRITE_TIMEOUT_S", 0.1)
    master, slave = pty.openpty()
    try:
        plain, _ = await opener(f"serial://{os.ttyname(slave)}:57600")
        await until(lambda: plain.is_connected)
        assert not termios.tcgetattr(slave)[2] & termios.CRTSCTS
        await plain.close()
        endpoint, _ = await opener(f"serial_flowcontrol://{os.ttyname(slave)}:57600")
        await until(lambda: endpoint.is_connected)
        assert termios.tcgetattr(slave)[2] & termios.CRTSCTS
        for _ in range(200):
            endpoint.send(bytes(1000))
        await until(lambda: endpoint.dropped > 0 and "wired for flow control" in endpoint.problem)
        await endpoint.close()
    finally:
        os.close(master)
        os.close(slave)


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """The other end of a line, and the name of this one."""
    master, slave = pty.openpty()
    os.set_blocking(master, False)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


async def read_until(master: int, wanted: bytes) -> bytes:
    """What the other end of a line receives up to some bytes."""
    received = b""
    async with asyncio.timeout(60):
        while not received.endswith(wanted):
            with suppress(BlockingIOError):
                received += os.read(master, 65536)
            await asyncio.sleep(0.005)
    return received


async def test_a_frame_that_has_waited_for_a_stuck_line_is_not_sent_late(
    terminal: tuple[int, str], opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    master, device = terminal
    monkeypatch.setattr(serial_line, "WRITE_TIMEOUT_S", 0.5)
    endpoint, _ = await opener(f"serial://{device}:921600")
    await until(lambda: endpoint.is_connected)
    monkeypatch.setattr(serial_line, "WRITE_TIMEOUT_S", 0.2)
    endpoint.send(bytes(STUCK_BYTES))
    endpoint.send(FRAMES[0])
    await until(lambda: endpoint.dropped > 0)
    endpoint.send(FRAMES[1])
    received = await read_until(master, FRAMES[1])
    assert FRAMES[0] not in received
    assert endpoint.dropped == 2
    assert len(received) < 8192, "what the kernel holds for the line is discarded, too"


async def test_a_stuck_line_keeps_the_newest_frames(
    terminal: tuple[int, str], opener: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    master, device = terminal
    monkeypatch.setattr(serial_line, "WRITE_TIMEOUT_S", 60.0)
    monkeypatch.setattr(serial_line, "WAITING_FRAMES", 2)
    endpoint, _ = await opener(f"serial://{device}:921600")
    await until(lambda: endpoint.is_connected)
    endpoint.send(bytes(STUCK_BYTES))
    await asyncio.to_thread(select.select, [master], [], [])
    for frame in FRAMES:
        endpoint.send(frame)
    assert endpoint.dropped == 1
    received = await read_until(master, FRAMES[2])
    assert received.endswith(bytes(10) + FRAMES[1] + FRAMES[2])
