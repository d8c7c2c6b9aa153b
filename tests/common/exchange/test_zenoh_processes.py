"""Zenoh between real processes: they meet, answer, end without hanging however they end, and come back."""

import asyncio
import signal
import sys
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from tests.common.exchange.middlewares import until

from gloc3.exchange import Publisher, request
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.exchange.zenoh_session import UNIX, ZenohEndpoints
from gloc3.messages.envelope import CommandRequest
from gloc3.messages.topics import TopicTable

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(120)]

CHILD = Path(__file__).with_name("zenoh_process.py")


def parent(place: str) -> AbstractContextManager[ZenohExchange]:
    return open_exchange(ZenohEndpoints(name="main", listen=(place,)), asyncio.get_running_loop(), TopicTable())


async def child(place: str) -> asyncio.subprocess.Process:
    pipe = asyncio.subprocess.PIPE
    return await asyncio.create_subprocess_exec(sys.executable, str(CHILD), place, stderr=pipe)


@pytest.mark.parametrize("ending", ["leave", "fail", "SIGINT", "SIGTERM", "SIGKILL"])
async def test_a_process_answers_and_ends_however_it_ends(ending: str, tmp_path: Path) -> None:
    place = f"{UNIX}/{tmp_path}/z"
    with parent(place) as exchange:
        alive: list[bool] = []
        exchange.watch("p/processes/*", lambda _, is_alive: alive.append(is_alive))
        process = await child(place)
        await until(lambda: alive == [True], within_s=60.0)
        publisher = Publisher(exchange, "p", "ci", 1)
        command = "check" if ending.startswith("SIG") else ending
        message = CommandRequest(request_id="1", command=command)
        reply = await request(exchange, publisher, "p/components/child/command", message, 20.0)
        assert reply.is_accepted
        if ending.startswith("SIG"):
            process.send_signal(signal.Signals[ending])
        _, words = await asyncio.wait_for(process.communicate(), 60.0)
        await until(lambda: alive == [True, False])
    expected = {"leave": 0, "fail": 1, "SIGINT": -2, "SIGTERM": -15, "SIGKILL": -9}
    assert process.returncode == expected[ending]
    assert (b"as was asked" in words) == (ending == "fail")
    assert b"panicked" not in words


async def test_a_place_that_a_killed_process_left_behind_is_taken_again(tmp_path: Path) -> None:
    place = f"{UNIX}/{tmp_path}/z"
    listener = (
        "import sys, time; from gloc3.exchange.zenoh_session import ZenohEndpoints, new_session\n"
        "with new_session(ZenohEndpoints(name='main', listen=(sys.argv[1],))):\n    print('open', flush=True); time.sleep(60)"
    )
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", listener, place, stdout=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    assert await process.stdout.readline() == b"open\n"
    process.kill()
    await process.wait()
    with parent(place):
        assert Path(place.partition("/")[2]).is_socket()
