"""Shared memory between processes of one computer: what is held is not written over, and what is killed leaves nothing."""

import asyncio
import os
import signal
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.common.exchange.middlewares import until

from gloc3.exchange.near import AHEAD, DEPTH, NearLink, NearServer, NearTopic
from gloc3.exchange.shared_slots import SLOTS, Slots

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
NO_OWNER = 65534
READER = """
import asyncio, sys
from gloc3.exchange.near import NearLink
async def live():
    link = NearLink(asyncio.get_running_loop(), sys.argv[1], lambda head, body: print(len(body), flush=True), print)
    link.show(bytes.fromhex(sys.argv[2]))
    await asyncio.sleep(60)
asyncio.run(live())
"""
WRITER = """
import asyncio
from gloc3.exchange.near import NearServer
async def live():
    server = NearServer(asyncio.get_running_loop())
    topic = server.open()
    print(server.name, topic.ticket.hex(), flush=True)
    while True:
        topic.send(b"head", bytes(100_000))
        await asyncio.sleep(0.01)
asyncio.run(live())
"""


class Heard:
    """What one reader of a topic hears."""

    def __init__(self) -> None:
        self.messages: list[tuple[bytes, bytes]] = []
        self.ends: list[str] = []

    def read(self, name: str, ticket: bytes) -> NearLink:
        """Begins to read."""

        def handle(head: bytes, body: bytes) -> None:
            self.messages.append((head, body))

        link = NearLink(asyncio.get_running_loop(), name, handle, self.ends.append)
        link.show(ticket)
        return link


@contextmanager
def served() -> Iterator[tuple[NearServer, NearTopic]]:
    """A topic of this process."""
    server = NearServer(asyncio.get_running_loop())
    try:
        yield server, server.open()
    finally:
        server.close()


async def reach(topic: NearTopic, received: Heard) -> None:
    """Sends until it is heard, and forgets that."""

    def send() -> bool:
        topic.send(b"", b"hello")
        return False

    await until(lambda: received.messages or send())
    await asyncio.sleep(0.1)
    received.messages.clear()


async def test_messages_arrive_as_they_are_whether_short_or_longer_than_all_before() -> None:
    with served() as (server, topic):
        received = Heard()
        link = received.read(server.name, topic.ticket)
        await reach(topic, received)
        sent = [(b"head %d" % size, os.urandom(size)) for size in (0, 1, 4096, 5_000, 300_000, 7, 2_000_000)]
        for head, body in sent:
            assert topic.send(head, body) == ""
        await until(lambda: len(received.messages) == len(sent))
        assert received.messages == sent
        link.close()
        await until(lambda: topic.send(b"", b"nobody") == "" and not topic.readers)
        assert received.messages == sent


async def test_what_a_reader_has_not_read_is_not_written_over_and_a_busy_one_takes_the_newest() -> None:
    with served() as (server, topic):
        received = Heard()
        link = received.read(server.name, topic.ticket)
        await reach(topic, received)
        reasons = [topic.send(b"", bytes([number]) * 100_000) for number in range(2 * AHEAD)]
        assert reasons == [""] * AHEAD + ["a receiver on this computer is too slow"] * AHEAD
        await until(lambda: len(received.messages) == DEPTH)
        assert received.messages == [(b"", bytes([number]) * 100_000) for number in range(AHEAD - DEPTH, AHEAD)]
        assert link.late == AHEAD - DEPTH
        assert topic.send(b"", b"next") == ""
        await until(lambda: received.messages[-1] == (b"", b"next"))
        link.close()


def test_places_are_used_again_when_all_have_read_them_and_not_before() -> None:
    slots = Slots(10)
    slots.hold(slots.write(b"kept", 1) or 0)
    kept = SLOTS - 1
    slots.hold(kept)
    slots.release(kept)
    used = set()
    while (slot := slots.write(b"other", 2)) is not None:
        slots.hold(slot)
        used.add(slot)
    assert used == set(range(SLOTS)) - {kept}
    slots.release(kept)
    assert slots.write(b"now", 3) == kept
    slots.close()


async def test_without_the_ticket_of_a_topic_nothing_of_it_is_read() -> None:
    with served() as (server, topic):
        received, guessed = Heard(), Heard()
        link = received.read(server.name, topic.ticket)
        guessed.read(server.name, bytes(16))
        await reach(topic, received)
        await until(lambda: guessed.ends == [""])
        assert not guessed.messages
        link.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else for a while")
async def test_another_user_is_refused_at_both_ends() -> None:
    with served() as (server, topic):
        here = os.geteuid()
        os.seteuid(NO_OWNER)
        try:
            with pytest.raises(PermissionError, match="belongs to another user"):
                Heard().read(server.name, topic.ticket)
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
                stranger.connect(b"\0gloc3-" + server.name.encode())
                stranger.send(topic.ticket)
                os.seteuid(here)
                stranger.setblocking(False)
                await asyncio.sleep(0.2)
                topic.send(b"", b"secret")
                with pytest.raises(ConnectionResetError):
                    stranger.recv(100)
        finally:
            os.seteuid(here)
        assert not topic.readers


async def test_memory_that_could_shrink_under_a_reader_is_refused() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(b"\0gloc3-forged")
        listener.listen()
        received = Heard()
        received.read("forged", bytes(16))
        other, _ = listener.accept()
        file = os.memfd_create("forged")
        os.ftruncate(file, 4096 * (SLOTS + 1))
        socket.send_fds(other, [struct.pack("<QQI", 0, 0, 4096)], [file])
        await until(lambda: received.ends)
        assert received.ends == ["the other end's shared memory could change its size"]
        os.close(file)
        other.close()


async def test_processes_that_are_killed_leave_nothing_behind() -> None:
    before = set(Path("/dev/shm").iterdir())
    pipe = asyncio.subprocess.PIPE
    with served() as (server, topic):
        words = (server.name, topic.ticket.hex())
        reader = await asyncio.create_subprocess_exec(sys.executable, "-c", READER, *words, stdout=pipe)
        await until(lambda: topic.readers or topic.send(b"", b""), within_s=60.0)
        reader.send_signal(signal.SIGSTOP)
        assert topic.send(b"", bytes(100_000)) == ""
        assert topic.held == 1
        reader.kill()
        await reader.communicate()
        topic.send(b"", b"")
        assert (topic.readers, topic.held) == (0, 0)
    writer = await asyncio.create_subprocess_exec(sys.executable, "-c", WRITER, stdout=pipe)
    assert writer.stdout is not None
    name, ticket = (await writer.stdout.readline()).decode().split()
    received = Heard()
    received.read(name, bytes.fromhex(ticket))
    await until(lambda: received.messages, within_s=60.0)
    writer.kill()
    await writer.wait()
    await until(lambda: received.ends == [""])
    assert received.messages[0] == (b"head", bytes(100_000))
    assert set(Path("/dev/shm").iterdir()) <= before
