"""The bridge, seen and commanded by nodes of another library: nothing asked for that nobody subscribes to."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from tests.groundstation.looked_at import Viewer, pose, preview
from tests.groundstation.scripted_platform import ScriptedPlatform, refused
from tests.ros_peer import TRIGGER, Peer, peer, router

from gloc3.errors import Gloc3Error
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import Steer, Verb, Watch
from gloc3.ros2.node import RosNetwork, open_node
from gloc3.ros2.wire import Entity, EntityKind
from gloc3_groundstation.cli.ros2 import app
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.ros2.bridge import RosBridge
from gloc3_groundstation.ros2.missions import MissionServices
from gloc3_groundstation.station.station import Station

pytestmark = pytest.mark.sockets
EPOCH_S = 1_700_000_000.0


class Scene(NamedTuple):
    peer: Peer
    platform: ScriptedPlatform
    viewer: Viewer
    reports: list[str]
    services: set[str]
    """Those that the graph shows."""

    async def call(self, name: str) -> tuple[bool, str]:
        """Calls a service of the vehicle, as soon as the graph shows it."""
        await until(lambda: f"/heron/mission/{name}" in self.services)
        kind = "std_srvs/srv/Trigger"
        answer = await asyncio.to_thread(self.peer.call, f"/heron/mission/{name}", kind, TRIGGER)
        return answer.success, answer.message

    @property
    def watched(self) -> set[str]:
        return {want.topic for want in self.platform.watched.wants}


@asynccontextmanager
async def scene(folder: Path, mission: Path | None = None, *, is_read_only: bool = False) -> AsyncIterator[Scene]:
    """One vehicle, its station with a bridge, and the other library's nodes at the same router."""
    exchange, loop = LocalExchange(), asyncio.get_running_loop()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.001
    viewer = Viewer(exchange, platform)
    station = Station(exchange, loop, "255", 11)
    reports: list[str] = []
    began_s = loop.time()
    services: set[str] = set()

    def changed(entity: Entity, is_there: bool) -> None:
        if entity.kind is EntityKind.SERVER and entity.endpoint is not None:
            (services.add if is_there else services.discard)(entity.endpoint.name)

    def utc_s() -> float:
        return EPOCH_S + loop.time() - began_s

    with (
        router() as endpoint,
        peer(endpoint, folder) as other,
        open_node(RosNetwork(router=endpoint), "/gloc3") as node,
    ):
        node.watch(changed)
        desk = Desk(station)
        missions = None if is_read_only else MissionServices(desk, node, mission)
        bridge = RosBridge(desk, node, utc_s, 20.0, reports.append, missions)
        platform.speak()
        bridge.open()
        platform.speak_every(0.5)
        try:
            async with asyncio.timeout(30):
                yield Scene(other, platform, viewer, reports, services)
        finally:
            bridge.close()
            if missions is not None:
                missions.close()
            station.close()
            platform.is_deaf = True


async def until(condition: Callable[[], Any]) -> None:
    while not condition():
        await asyncio.sleep(0.02)


async def test_a_topic_is_asked_for_while_somebody_subscribes_to_it(tmp_path: Path) -> None:
    async with scene(tmp_path) as seen:
        poses = seen.peer.subscribe("/heron/pose", "nav_msgs/msg/Odometry")
        await until(lambda: seen.watched == {"pose"})
        while not poses:
            seen.viewer.show("pose", pose(2.0), 2.0)
            await asyncio.sleep(0.05)
        shown, known = poses[0], pose(2.0)
        north, east, down = known.position_ned_m
        at = shown.pose.pose.position
        assert (at.x, at.y, at.z) == pytest.approx((east, north, -down))
        assert shown.pose.covariance[0] == pytest.approx(known.position_std_m[1] ** 2)
        assert shown.header.frame_id == "map"
        assert 0.0 <= shown.header.stamp.sec + shown.header.stamp.nanosec * 1e-9 - EPOCH_S < 20.0
        seen.peer.close()
        await until(lambda: seen.platform.watched == Watch())


async def test_transforms_and_pictures_come_as_what_ros_has_for_them(tmp_path: Path) -> None:
    async with scene(tmp_path) as seen:
        transforms = seen.peer.subscribe("/tf", "tf2_msgs/msg/TFMessage")
        pictures = seen.peer.subscribe("/heron/camera/ground/compressed", "sensor_msgs/msg/CompressedImage")
        await until(lambda: seen.watched == {"pose", "camera/ground"})
        assert {want.topic: want.rate_hz for want in seen.platform.watched.wants}["camera/ground"] == 1.0
        while not (transforms and pictures):
            seen.viewer.show("pose", pose(0.0), 0.0)
            seen.viewer.show("camera/ground", preview(), 0.0, 2.0)
            await asyncio.sleep(0.05)
        (moved,) = transforms[0].transforms
        assert (moved.header.frame_id, moved.child_frame_id) == ("map", "base_link")
        turn = moved.transform.rotation
        assert (turn.z, turn.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6), "north is the map's y"
        assert pictures[0].format == "webp"
        pixels = cv2.imdecode(np.asarray(pictures[0].data, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert pixels is not None
        assert pixels.shape == (48, 64)


async def test_diagnostics_name_every_component(tmp_path: Path) -> None:
    async with scene(tmp_path) as seen:
        reports = seen.peer.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        await until(lambda: reports and all(one.level == 0 for one in reports[-1].status))
        names = {one.name for one in reports[-1].status}
        assert {"heron: pose", "heron: pose_backup", "heron: command_server"} <= names
        assert {one.message for one in reports[-1].status} == {"working", "quiet"}
        seen.platform.problem("pose", "no pictures")
        await until(lambda: any(one.level == 2 for one in reports[-1].status))
        (faulty,) = (one for one in reports[-1].status if one.level)
        assert (faulty.name, faulty.message) == ("heron: pose", "faulty: no pictures")


async def test_missions_are_commanded_with_the_rights_of_a_station(tmp_path: Path) -> None:
    async with scene(tmp_path) as seen:
        assert await seen.call("state") == (False, "no mission is loaded")
        seen.platform.advance("running", depart="running")
        assert await seen.call("pause") == (True, "the mission is paused")
        success, text = await seen.call("state")
        assert success, text
        assert text.startswith("running: ")
        assert await seen.call("abort") == (True, "the mission is aborted")
        steered = [body.verb for body in seen.platform.requests if isinstance(body, Steer)]
        assert steered == [Verb.PAUSE, Verb.ABORT]


async def test_a_refusal_comes_with_its_reason(tmp_path: Path) -> None:
    async with scene(tmp_path) as seen:
        seen.platform.answer_next(Steer, refused("there is no mission to resume"))
        success, text = await seen.call("resume")
        assert not success
        assert "there is no mission to resume" in text


async def test_a_bridge_that_may_only_read_serves_nothing(tmp_path: Path) -> None:
    async with scene(tmp_path, is_read_only=True) as seen:
        reports = seen.peer.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        await until(lambda: reports)
        assert seen.services == set()


async def test_a_router_that_is_not_there_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gloc3_groundstation.ros2.bridge.WITHOUT_ROUTER_S", 0.0)
    station = Station(LocalExchange(), asyncio.get_running_loop(), "255", 11)
    reports: list[str] = []
    with open_node(RosNetwork(router="tcp/127.0.0.1:1"), "/gloc3") as node:
        bridge = RosBridge(Desk(station), node, lambda: EPOCH_S, 20.0, reports.append, None)
        bridge.open()
        bridge.close()
    station.close()
    assert reports == ["no router of ROS 2 at tcp/127.0.0.1:1: start one, such as rmw_zenohd"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--read-only", "--mission", "hop"], "--mission goes without --read-only"),
        (["--zenoh-config", "nowhere.json5"], "--zenoh-config nowhere.json5: there is no such file"),
        (["--mission", "nope"], "no such mission"),
        (["--router", "nonsense", "--link", "udpout://127.0.0.1:9"], "'nonsense' is no Zenoh endpoint"),
        (["--node", "a b", "--link", "udpout://127.0.0.1:9"], "'a b' is no name in ROS"),
    ],
)
def test_wrong_use_is_refused_with_the_reason(arguments: list[str], reason: str) -> None:
    with pytest.raises(Gloc3Error, match=reason):
        app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
