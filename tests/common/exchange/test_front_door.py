"""The front door with real sockets and TLS: strangers keep nobody out, are closed in time, and are reported."""

import asyncio
import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest
from tests.common.exchange.middlewares import until
from tests.common.network.yard import Yard

from gloc3.errors import Gloc3Error
from gloc3.exchange import Publisher, front_door, zenoh
from gloc3.exchange.admission import OF_ADDRESS
from gloc3.exchange.zenoh import ZenohExchange
from gloc3.exchange.zenoh_session import open_node
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Image

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
STRANGER = "127.0.0.2"
MOST, _ = OF_ADDRESS
JOINED_S = 3.0


@pytest.fixture
def yard(tmp_path: Path) -> Yard:
    return Yard(tmp_path / "yard")


@contextmanager
def strangers(yard: Yard, number: int, first: bytes = b"") -> Iterator[list[socket.socket]]:
    """Connections from an address that nobody else uses."""
    host, _, port = yard.address.rpartition(":")
    with ExitStack() as stack:
        opened = []
        for _ in range(number):
            one = socket.create_connection((host, int(port)), source_address=(STRANGER, 0))
            opened.append(stack.enter_context(one))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.setblocking(False)
            with suppress(ConnectionError):  # it may be closed already
                one.send(first)
        yield opened


def is_closed(one: socket.socket) -> bool:
    """Whether the other end has closed a connection."""
    try:
        return one.recv(4096) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def keep(received: list[bytes], envelope: Envelope[Image]) -> None:
    """Keeps the bytes of a picture."""
    received.append(envelope.payload.data)


async def joined_s(yard: Yard, main: ZenohExchange, member: str = "alice") -> float:
    """How long it takes until a member that connects is there."""
    loop = asyncio.get_running_loop()
    here = list[str]()
    main.watch(f"members/{member}/**", lambda token, is_here: here.append(token) if is_here else None)
    begin_s = loop.time()
    with yard.open(member) as network:
        network.declare_alive(f"members/{member}/revocations/1")
        await until(lambda: here)
        return loop.time() - begin_s


@pytest.mark.parametrize(
    "first", [b"", b"\x16\x03\x01\x02\x00", b"GET / HTTP/1.1\r\n\r\n"], ids=["idle", "TLS", "HTTP"]
)
async def test_three_hundred_connections_of_a_stranger_keep_no_member_out(yard: Yard, first: bytes) -> None:
    reported = list[str]()
    with yard.open("pelican.main", troubled=lambda _, text: reported.append(text)) as main:
        with strangers(yard, 300, first):
            assert await joined_s(yard, main) < JOINED_S
        assert await joined_s(yard, main) < JOINED_S
        await until(lambda: reported)
        assert main.problems() == {f"refused {STRANGER}": 300 - MOST}
    assert reported == [
        f"refused {STRANGER}: too many connections without a handshake come from there ({300 - MOST} so far)"
    ]


async def test_each_break_is_reported_once(yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh, "CALM_S", 2.0)
    reported = list[str]()
    with yard.open("pelican.main", troubled=lambda _, text: reported.append(text)):
        for number, wait_s in ((1, 0.0), (1, 0.0), (2, 2.5)):
            await asyncio.sleep(wait_s)
            with strangers(yard, MOST + 20):
                await asyncio.sleep(1.0)
            assert len(reported) == number


@pytest.mark.parametrize("first", [b"", b"\x16\x03\x01\x02\x00", b"GET /"], ids=["idle", "TLS", "HTTP"])
async def test_a_connection_without_a_handshake_is_closed_in_time(
    yard: Yard, first: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front_door, "HELLO_S", 0.2)
    monkeypatch.setattr(front_door, "HANDSHAKE_S", 0.4)
    with yard.open("pelican.main") as main, strangers(yard, 1, first) as (one,):
        await until(lambda: is_closed(one))
        assert await joined_s(yard, main) < JOINED_S


async def test_a_member_stays_connected_longer_than_a_handshake_may_take(
    yard: Yard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front_door, "HANDSHAKE_S", 0.3)
    with yard.open("pelican.main") as main, yard.open("alice") as alice:
        changes = list[bool]()
        main.watch("members/alice/**", lambda _, is_here: changes.append(is_here))
        alice.declare_alive("members/alice/revocations/1")
        await until(lambda: changes)
        await asyncio.sleep(0.6)
        assert changes == [True]
        assert main.problems() == {}


async def test_large_messages_pass_whole_in_both_directions(yard: Yard) -> None:
    data = bytes(range(256)) * 12_000
    with (
        yard.open("pelican.main", is_sharing=False) as main,
        yard.open("pelican.vision", is_sharing=False) as vision,
    ):
        for name, sender, receiver in (("front", main, vision), ("down", vision, main)):
            received: list[bytes] = []
            receiver.subscribe(f"pelican/camera/{name}", partial(keep, received))
            publisher = Publisher(sender, "pelican", "test", 1)
            while not received:
                publisher.publish(f"pelican/camera/{name}", Image(camera=name, width=1, height=1, data=data), 0.0)
                await asyncio.sleep(0.2)
            assert received[0] == data


async def test_both_halves_end_together_and_the_address_is_free_at_once(yard: Yard) -> None:
    own = yard.membership("pelican.main")
    with yard.open("pelican.main") as main:
        left = list[bool]()
        main.watch("members/alice/**", lambda _, is_here: left.append(not is_here))
        with yard.open("alice") as alice:
            alice.declare_alive("members/alice/revocations/1")
            await until(lambda: left)
        await until(lambda: left[-1])
        with pytest.raises(Gloc3Error, match=f"tls/{yard.address}: Address already in use"):
            open_node(own.node(), own.settings())
    opened = open_node(own.node(), own.settings())
    opened.close()
