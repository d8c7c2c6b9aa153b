"""Foxglove's live view, seen by a real client: the log's channels and schemas, nothing asked for that nobody looks at."""

import asyncio
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, NamedTuple

import pytest
from tests.groundstation.looked_at import Viewer, pose, preview
from tests.groundstation.scripted_platform import ScriptedPlatform
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.log.payloads import PayloadEncoder
from gloc3.messages.command_interface import Watch
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Image, Pose
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.web.live_view import IMAGE_RATE_HZ, RATE_HZ, LiveView

pytestmark = pytest.mark.sockets
TABLE = TopicTable.installed()


class Seen(NamedTuple):
    client: ClientConnection
    platform: ScriptedPlatform
    viewer: Viewer
    view: LiveView
    channels: dict[str, dict[str, Any]]
    info: dict[str, Any]

    async def subscribe(self, number: int, topic: str) -> None:
        channel = self.channels[topic]["id"]
        request = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel}]}
        await self.client.send(json.dumps(request))

    async def message(self, number: int) -> dict[str, Any]:
        """The next message of a subscription."""
        async for data in self.client:
            if isinstance(data, bytes) and data[0] == 1 and struct.unpack_from("<I", data, 1)[0] == number:
                found: dict[str, Any] = json.loads(data[13:])
                return found
        raise AssertionError("the server has gone")

    async def until_watched(self, *topics: str) -> None:
        while tuple(want.topic for want in self.platform.watched.wants) != topics:
            await asyncio.sleep(0.01)


@asynccontextmanager
async def scene() -> AsyncIterator[Seen]:
    """A client that has been told the channels of one vehicle."""
    exchange, loop = LocalExchange(), asyncio.get_running_loop()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.001
    viewer = Viewer(exchange, platform)
    station = Station(exchange, loop, "255", 11)
    view = LiveView(station, exchange, loop, TABLE, 1_000_000.0)
    platform.speak()
    try:
        url = view.open(0)
        async with asyncio.timeout(20), connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
            seen = Seen(client, platform, viewer, view, {}, {})
            while not {"heron/pose", "heron/camera/ground", "heron/ci/vehicle"} <= set(seen.channels):
                data = json.loads(await client.recv())
                if data["op"] == "serverInfo":
                    seen.info.update(data)
                for channel in data.get("channels", []):
                    seen.channels[channel["topic"]] = channel
            yield seen
    finally:
        view.close()
        station.close()
        platform.is_deaf = True


async def test_the_channels_are_those_of_the_log_and_there_is_nothing_to_command_with() -> None:
    async with scene() as seen:
        name, text = PayloadEncoder(Pose).schema
        channel = seen.channels["heron/pose"]
        assert (channel["encoding"], channel["schemaName"], channel["schema"]) == ("json", name, text.decode())
        assert channel["schemaName"] == "foxglove.PoseInFrame"
        assert seen.channels["heron/camera/ground"]["schemaName"] == PayloadEncoder(Image).schema[0]
        assert seen.info["capabilities"] == []
        assert seen.platform.watched == Watch(), "nobody has subscribed to anything"


async def test_a_topic_is_asked_for_while_a_client_has_subscribed_to_it() -> None:
    async with scene() as seen:
        await seen.subscribe(5, "heron/pose")
        await seen.until_watched("pose")
        assert seen.platform.watched.wants[0].rate_hz == RATE_HZ
        seen.viewer.show("pose", pose(0.0), 3.0)
        shown = await seen.message(5)
        assert shown["position_ned_m"] == [4.0, 0.0, -2.0]
        assert shown["pose"]["position"] == {"x": 4.0, "y": 0.0, "z": -2.0}
        await seen.client.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [5]}))
        await seen.until_watched()


async def test_a_client_that_goes_away_leaves_nobody_looking() -> None:
    async with scene() as seen:
        await seen.subscribe(5, "heron/pose")
        await seen.until_watched("pose")
        await seen.client.close()
        await seen.until_watched()


async def test_what_the_station_hears_anyhow_is_not_asked_for() -> None:
    async with scene() as seen:
        await seen.subscribe(6, "heron/ci/vehicle")
        await asyncio.sleep(0.1)
        for _ in range(5):
            seen.platform.speak()
            await asyncio.sleep(0.02)
        assert (await seen.message(6))["mode"] == "HOLD"
        assert seen.platform.watched == Watch()


async def test_a_camera_is_shown_as_an_image() -> None:
    async with scene() as seen:
        await seen.subscribe(7, "heron/camera/ground")
        await seen.until_watched("camera/ground")
        assert seen.platform.watched.wants[0].rate_hz == IMAGE_RATE_HZ
        seen.viewer.show("camera/ground", preview(0.0), 3.0)
        shown = await seen.message(7)
        assert (shown["width"], shown["height"], shown["format"]) == (64, 48, "png")


async def test_a_client_can_neither_publish_nor_call() -> None:
    async with scene() as seen:
        await seen.client.send(
            json.dumps(
                {
                    "op": "advertise",
                    "channels": [{"id": 1, "topic": "heron/setpoint", "encoding": "json", "schemaName": "x"}],
                }
            )
        )
        while True:
            data = await seen.client.recv()
            answer = json.loads(data) if isinstance(data, str) else {}
            if answer.get("op") == "status":
                break
        assert "advertise" in answer["message"].lower() or "capab" in answer["message"].lower(), answer


async def test_a_port_that_is_taken_is_said_in_words() -> None:
    async with scene() as seen:
        port = int(str(seen.view._server.port))
        exchange, loop = LocalExchange(), asyncio.get_running_loop()
        other = LiveView(Station(exchange, loop, "254", 12), exchange, loop, TABLE, 0.0)
        with pytest.raises(Refused, match="--foxglove-port"):
            other.open(port)
