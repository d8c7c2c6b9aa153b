"""The loop that calls who reads promptly by itself: nothing else is late or lost for it."""

import asyncio
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from gloc3.link.endpoints import open_endpoint
from gloc3.link.prompt_loop import PromptLoop

pytestmark = pytest.mark.sockets


@pytest.fixture
def loop() -> Iterator[PromptLoop]:
    loop = PromptLoop()
    yield loop
    loop.close()


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    here.setblocking(False)
    with here, there:
        yield here, there


Pair = tuple[socket.socket, socket.socket]


def test_a_prompt_reader_is_called_and_what_it_asks_for_happens_at_once(loop: PromptLoop, pair: Pair) -> None:
    here, there = pair
    asked: list[bytes] = []
    done = loop.create_future()

    def read() -> None:
        asked.append(here.recv(100))
        if len(asked) == 3:
            loop.call_soon(done.set_result, loop.time())

    loop.read_promptly(here.fileno(), read)
    for number in range(3):
        loop.call_later(0.01 * number, there.send, bytes([number]))
    loop.run_until_complete(asyncio.wait_for(done, 60.0))
    assert asked == [b"\0", b"\1", b"\2"]


def test_timers_and_other_readers_are_not_kept_waiting_by_a_flood(loop: PromptLoop, pair: Pair) -> None:
    here, there = pair
    rang: list[float] = []

    def read() -> None:
        here.recv(100)
        there.send(b"again")

    async def work() -> None:
        loop.read_promptly(here.fileno(), read)
        there.send(b"first")
        begin_s = loop.time()
        other, end = socket.socketpair()
        with other, end:
            other.setblocking(False)
            loop.call_later(0.05, end.send, b"x")
            assert await asyncio.wait_for(loop.sock_recv(other, 10), 60.0) == b"x"
            rang.append(loop.time() - begin_s)
        assert await asyncio.wait_for(loop.run_in_executor(None, lambda: 7), 60.0) == 7
        loop.remove_reader(here.fileno())

    loop.run_until_complete(work())
    assert 0.05 <= rang[0] < 30.0


def test_what_a_prompt_reader_raises_is_told_and_ends_nothing(loop: PromptLoop, pair: Pair) -> None:
    here, there = pair
    told: list[dict[str, Any]] = []
    loop.set_exception_handler(lambda _, context: told.append(context))

    def read() -> None:
        here.recv(100)
        raise ValueError("broken")

    async def work() -> None:
        loop.read_promptly(here.fileno(), read)
        for _ in range(2):
            there.send(b"x")
            await asyncio.sleep(0.01)

    loop.run_until_complete(work())
    assert [type(context["exception"]) for context in told] == [ValueError, ValueError]


def test_an_endpoint_reads_promptly_and_closes(loop: PromptLoop) -> None:
    heard: list[bytes] = []

    async def work() -> None:
        server = await open_endpoint("udpin://127.0.0.1:0", loop, heard.append)
        client = await open_endpoint(f"udpout://127.0.0.1:{server.local_port}", loop, lambda _: None)
        for number in range(1000):
            client.send(bytes([number & 0xFF]))
        while len(heard) < 1000:
            await asyncio.sleep(0.001)
        await server.close()
        client.send(b"nobody")
        await asyncio.sleep(0.01)
        await client.close()

    loop.run_until_complete(asyncio.wait_for(work(), 60.0))
    assert heard == [bytes([number & 0xFF]) for number in range(1000)]
