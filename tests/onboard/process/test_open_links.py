"""What an onboard process says of links that a network reaches, and whom it takes for its autopilot."""

import asyncio
import socket
from pathlib import Path

import pytest
from tests.onboard.process.replays import process_of

from gloc3.mavlink.codec import Encoder, message
from gloc3.mavlink.transport.endpoints import LOOPBACK

pytestmark = pytest.mark.sockets

OPEN = "is open to the network and not signed"


@pytest.mark.parametrize("key", [None, bytes(32)])
async def test_a_link_to_stations_on_a_network_is_told_at_the_start_unless_it_is_signed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: bytes | None
) -> None:
    process = process_of(tmp_path, key)
    await process.open()
    await process.close()
    told = [line for line in capsys.readouterr().err.splitlines() if OPEN in line]
    assert [("udpin://0.0.0.0:0" in line) for line in told] == ([True] if key is None else [])


async def test_the_first_peer_is_the_autopilot_and_a_second_one_is_told(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    process = process_of(tmp_path, port=port)
    await process.open()
    try:
        (autopilot, *_) = process.vehicle.link_conditions()
        frame = Encoder(1, 1).encode(message("HEARTBEAT", type=2, autopilot=12))
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
        ):
            assert not autopilot.intruder
            async with asyncio.timeout(20.0):
                while not autopilot.intruder:
                    first.sendto(frame, (LOOPBACK, port))
                    await asyncio.sleep(0.05)
                    second.sendto(frame, (LOOPBACK, port))
                    await asyncio.sleep(0.05)
                    (autopilot, *_) = process.vehicle.link_conditions()
            own = second.getsockname()[1]
        assert autopilot.intruder.startswith(
            f"127.0.0.1:{own} claims to be autopilot 1/1, which is heard from 127.0.0.1:"
        )
    finally:
        await process.close()
