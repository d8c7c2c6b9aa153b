"""The way by sound on real sockets, through the program that stands in for the water: summaries here, orders there."""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.groundstation.scripted_platform import VEHICLE
from tests.groundstation.station_scene import Scene, scene

from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.acoustic import MOST_BYTES
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3.messages.command_interface import CiReply, CiRequest, Emergency, EmergencyVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import MissionSummary
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links import acoustic_route
from gloc3_groundstation.links.acoustic_route import open_modem
from gloc3_onboard.companion.acoustic_link import AcousticLink, ModemSettings

pytestmark = pytest.mark.sockets


class Diver:
    """A platform that can be heard by sound alone; it takes every order."""

    def __init__(self) -> None:
        topics, self._loop = TopicTable.installed(), asyncio.get_running_loop()
        self.exchange = LocalExchange(topics)
        self.orders: list[EmergencyVerb] = []
        self.frames: list[bytes] = []
        self._publisher = Publisher(self.exchange, "heron", "command_server", 1)
        self.exchange.subscribe("heron/ci/request", self._take)

    @asynccontextmanager
    async def sounding(self, url: str, key: bytes | None = None) -> AsyncIterator[None]:
        """Its modem, which tells five times a second."""
        links: list[AcousticLink] = []
        endpoint = await open_endpoint(url, self._loop, lambda data: links[0].receive(data) if links else None)

        def send(data: bytes) -> None:
            self.frames.append(data)
            endpoint.send(data)

        links.append(AcousticLink("heron", self.exchange, self._loop, 1, send, ModemSettings(key, period_s=0.2)))
        self._publisher.publish("heron/ci/vehicle", VEHICLE, 0.0)
        self._publisher.publish("heron/ci/mission", MissionSummary(name="m", digest="d", state="running"), 0.0)
        try:
            yield
        finally:
            links[0].close()
            await endpoint.close()

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        request = envelope.payload
        assert isinstance(request.body, Emergency)
        self.orders.append(request.body.verb)
        reply = CiReply(sender=request.sender, boot=request.boot, sequence=request.sequence, outcome=Outcome.ACCEPTED)
        self._publisher.publish("heron/ci/reply", reply, self._loop.time())


def reported(here: Scene, text: str) -> bool:
    """Whether the station has told something."""
    return any(text in event.text for event in here.station.fleet.events)


async def test_what_dives_is_seen_and_stopped_by_sound_through_a_relay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(acoustic_route, "AGAIN_S", 0.3)
    water = ("--link", "acoustic", "--rate", "0", "--latency", "0", "--loss", "0.3")
    async with scene(None) as here:
        modem = await open_modem("heron", "udpin://127.0.0.1:0", here.station, here.exchange, 11)
        port = modem.local_port
        with program("relay", "udpin://127.0.0.1:0", f"udpout://127.0.0.1:{port}", *water, folder=tmp_path) as relay:
            line = await asyncio.to_thread(relay.await_line, lambda line: "relaying between" in line)
            found = re.search(r"udpin://127.0.0.1:(\d+)", line)
            assert found is not None, line
            diver = Diver()
            async with diver.sounding(f"udpout://127.0.0.1:{found[1]}"):
                await here.until("title", "heron")
                await here.until("facts", "acoustic messages only")
                assert re.search(r"acoustic  x 0.0  y 0.0  h 0.0 m\n +\d+ s ago: running", here.shown("facts"))
                await here.press("space")
                await here.wait(lambda: reported(here, "heron has accepted command hold (acoustic)"))
            relay.interrupt()
            assert await asyncio.to_thread(relay.end) == 0
            assert re.fullmatch(r"\d+ datagrams; \d+ lost, 0 dropped from full queues", relay.lines[-1])
        await modem.close()
    assert set(diver.orders) == {EmergencyVerb.HOLD}
    assert len(diver.orders) == 1, "an order that is repeated is carried out once"
    assert max(map(len, diver.frames)) == MOST_BYTES


async def test_a_modem_with_another_key_is_not_believed(tmp_path: Path) -> None:
    for name in ("ours", "theirs"):
        (tmp_path / name).write_text(f"passphrase: the key that is {name}\n")
        (tmp_path / name).chmod(0o600)
    async with scene(None) as here:
        url = f"udpin://127.0.0.1:0?key={tmp_path / 'ours'}"
        modem = await open_modem("heron", url, here.station, here.exchange, 11)
        water, diver = f"udpout://127.0.0.1:{modem.local_port}", Diver()
        async with diver.sounding(water, read_signing_key(tmp_path / "theirs")):
            await here.wait(lambda: len(diver.frames) > 3)
        assert here.station.fleet.get("heron") is None
        async with diver.sounding(water, read_signing_key(tmp_path / "ours")):
            await here.wait(lambda: here.station.fleet.get("heron") is not None)
        await modem.close()
