"""Regions: a router sums up its vehicles, stations get details only of those that they watch; uplinks replace each other."""

import asyncio
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
from tests.commands.programs import program
from tests.common.exchange.middlewares import until
from tests.common.network.test_routers import Alice, add, joined_yard, routed
from tests.common.network.test_stations_on_the_network import Server
from tests.common.network.yard import NOW, Yard, free_port

from gloc3.errors import Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.envelope import Message
from gloc3.messages.summaries import (
    ControlState,
    Health,
    MissionSummary,
    RegionSummary,
    Summary,
    VehicleLine,
    VehicleSummary,
)
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.file import read_network
from gloc3.network.regions import RegionReporter
from gloc3.network.stations import join_platforms

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
VEHICLE = VehicleSummary(
    t_s=1.0,
    mode="AUTO.LOITER",
    is_armed=True,
    landed="in_air",
    battery_percent=83,
    position_m=(0.0, 0.0, 0.0),
    speed_m_s=0.0,
    heading_deg=0,
    is_pose_valid=True,
    has_pilot_control=False,
    is_autopilot_connected=True,
)
STATE: dict[str, Message] = {
    "summary": Summary(table=0, health=Health.FAULTY, lines=[]),
    "vehicle": VEHICLE,
    "mission": MissionSummary(name="m", digest="x", state="running"),
    "control": ControlState(holder="alice"),
}


def say(publisher: Publisher, platform: str) -> None:
    for topic, message in STATE.items():
        publisher.publish(f"{platform}/ci/{topic}", message, 0.0)


def regions(yard: Yard) -> dict[str, list[str]]:
    routers = [
        name for name, one in register.read_register(yard.folder).members.items() if one.role is MemberRole.ROUTER
    ]
    return {name: read_network(yard.folder / name / "network.yaml", NOW).file.region for name in routers}


async def test_a_summary_has_what_was_heard_and_how_long_ago() -> None:
    exchange, loop = LocalExchange(), asyncio.get_running_loop()
    found: list[RegionSummary] = []
    exchange.subscribe("regions/coast/health", lambda one: found.append(one.payload))
    reporter = RegionReporter(exchange, loop, "coast", ["heron", "shag"], 1)
    say(Publisher(exchange, "heron", "ci", 1), "heron")
    say(Publisher(exchange, "stork", "ci", 1), "stork")
    await until(lambda: len(found) == 2)
    reporter.close()
    heron, shag = found[1].vehicles
    assert heron == VehicleLine(
        "heron", heron.age_s, "faulty", "AUTO.LOITER", True, "in_air", 83, "m", "running", "alice"
    )
    assert 1.5 < heron.age_s < 3.0
    assert shag == VehicleLine("shag", -1.0)
    assert len(msgspec.msgpack.encode(heron)) <= 60


async def test_a_station_above_gets_the_health_of_all_and_details_of_whom_it_watches(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    add(yard, "heron.main", MemberRole.PLATFORM, to=["coast"])
    add(yard, "dora", MemberRole.OPERATOR, to=["root"], watches=["pelican"])
    assert regions(yard) == {"root": ["pelican"], "coast": ["heron"]}
    with pytest.raises(Refused, match="'regions' cannot be a name"):
        add(yard, "regions.main", MemberRole.PLATFORM)
    with pytest.raises(Refused, match=r"there is no platform 'pelicn'.*pelican"):
        add(yard, "erin", MemberRole.OPERATOR, watches=["pelicn"])
    topics = TopicTable.installed()
    with ExitStack() as stack:
        for name in ("root", "coast"):
            stack.enter_context(routed(yard, name))
        pelican, heron = (stack.enter_context(yard.open(f"{name}.main")) for name in ("pelican", "heron"))
        network, dora, received = stack.enter_context(yard.open("dora")), LocalExchange(topics), dict[str, object]()
        for pattern in ("*/ci/*", "regions/*/health"):
            network.here.subscribe(pattern, lambda one: received.__setitem__(one.topic, one.payload))
        membership = yard.membership("dora")
        watched = membership.file.watches
        stack.callback(
            join_platforms(
                network, dora, topics, "dora", signer=membership.signer(), unsent=pytest.fail, watched=watched
            )
        )
        publishers = Publisher(pelican, "pelican", "ci", 1), Publisher(heron, "heron", "ci", 1)

        def is_there() -> bool:
            say(publishers[0], "pelican")
            say(publishers[1], "heron")
            region = received.get("regions/coast/health")
            return isinstance(region, RegionSummary) and region.vehicles[0].health == "faulty" and len(received) >= 6

        await until(is_there, 15.0)
        assert sorted(received) == sorted(
            [*(f"pelican/ci/{topic}" for topic in STATE), "regions/coast/health", "regions/root/health"]
        )


async def test_a_router_whose_uplink_dies_goes_on_by_the_other_one(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    for name in ("left", "right"):
        add(yard, name, MemberRole.ROUTER, to=["root"], listen=[f"127.0.0.1:{free_port()}"])
    listen = register.read_register(yard.folder).members["coast"].listen
    add(yard, "coast", MemberRole.ROUTER, to=["left", "right"], listen=listen)
    with pytest.raises(Refused, match="left would be connected in a circle, by coast"):
        add(yard, "left", MemberRole.ROUTER, to=["coast"], listen=["127.0.0.1:7"])
    loop = asyncio.get_running_loop()
    with ExitStack() as stack:
        routers = {
            name: stack.enter_context(program("network", "router", f"yard/{name}/network.yaml", folder=tmp_path))
            for name in ("root", "left", "right", "coast")
        }
        main, network = stack.enter_context(yard.open("pelican.main")), stack.enter_context(yard.open("alice"))
        server, alice = Server(main, yard), Alice(yard, network)
        await alice.request(server)
        assert "left is connected" in routers["coast"].text
        for used, other in (("left", "right"), ("right", "left")):
            routers[used].process.kill()
            await asyncio.sleep(0.2)
            if used == "right":
                routers["left"] = stack.enter_context(
                    program("network", "router", "yard/left/network.yaml", folder=tmp_path)
                )
            begin_s = loop.time()
            await alice.request(server, 30.0)
            assert loop.time() - begin_s < 15.0
            assert f"router: {other} is connected" in routers["coast"].text
        assert server.bridge.forgeries == {}
        alice.part()
        server.bridge.close()
