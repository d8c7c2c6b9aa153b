"""Our end of the mission protocol against MAVSDK's, over UDP that loses datagrams."""

import asyncio
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.mission_raw_server import MissionRawServerAsync
from mavsdk.plugins.mission_raw import MissionItem

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.plan import Plan, PlanItem, PlanResult, PlanType

from .mavsdk_peer import running, until
from .mission_transfer import plan

pytestmark = pytest.mark.sockets


def theirs(items: Plan, kind: PlanType) -> list[Any]:
    return [
        MissionItem(
            seq=number,
            frame=item.frame,
            command=item.command,
            current=int(item.is_current),
            autocontinue=int(item.autocontinue),
            param1=item.param1,
            param2=item.param2,
            param3=item.param3,
            param4=item.param4,
            x=item.x,
            y=item.y,
            z=item.z,
            mission_type=int(kind),
        )
        for number, item in enumerate(items)
    ]


def ours(items: list[Any]) -> Plan:
    return tuple(
        PlanItem(
            command=item.command,
            frame=item.frame,
            is_current=item.current == 1,
            autocontinue=item.autocontinue == 1,
            param1=item.param1,
            param2=item.param2,
            param3=item.param3,
            param4=item.param4,
            x=item.x,
            y=item.y,
            z=item.z,
        )
        for item in items
    )


@pytest.mark.parametrize(("loss", "items"), [(0.0, 800), (0.02, 200), (0.05, 100)])
async def test_mavsdk_uploads_to_our_server_and_reads_back(loss: float, items: int) -> None:
    server = MissionServer(Address(1, 1))
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with running([server], configuration, loss=loss) as (_, mavsdk):
        system = await mavsdk.first_autopilot(timeout_s=60)
        assert system is not None
        missions = MissionRawAsync(system)
        wanted = plan(5, items)
        await missions.upload_mission(theirs(wanted, PlanType.MISSION))
        assert server.plans[PlanType.MISSION] == wanted
        assert ours(await missions.download_mission()) == wanted
        fence = tuple(PlanItem(command=5001, param1=3.0, x=n, y=n, frame=3) for n in range(3))
        await missions.upload_geofence(theirs(fence, PlanType.FENCE))
        assert server.plans[PlanType.FENCE] == fence
        assert ours(await missions.download_geofence()) == fence
        await missions.clear_mission()
        await until(lambda: server.plans[PlanType.MISSION] == ())


@pytest.mark.parametrize(("loss", "items"), [(0.0, 800), (0.02, 200), (0.05, 100)])
async def test_our_client_uploads_to_mavsdks_server(loss: float, items: int) -> None:
    client = MissionClient(Address(255, 190))
    configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
    async with running([client], configuration, own=Address(255, 190), loss=loss) as (runner, mavsdk):
        server = MissionRawServerAsync(await mavsdk.server_component())
        received: list[Plan] = []

        async def listen() -> None:
            async for result, incoming in server.subscribe_incoming_mission():
                if result.value == 1:
                    received.append(ours(incoming.mission_items))

        listening = asyncio.create_task(listen())
        loop = asyncio.get_running_loop()

        async def finish(transfer: Transfer) -> PlanResult | None:
            runner.settle()
            await until(lambda: transfer.result is not None)
            return transfer.result

        await until(lambda: runner.parser.frames_received > 0)
        wanted = plan(6, items)
        target = Address(1, 1)
        assert await finish(client.upload(target, wanted, now_s=loop.time())) is PlanResult.ACCEPTED
        await until(lambda: received[-1:] == [wanted])
        download = client.download(target, now_s=loop.time())
        assert await finish(download) is PlanResult.ACCEPTED
        assert download.items == wanted
        listening.cancel()
        await asyncio.wait([listening])
