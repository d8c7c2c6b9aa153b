"""Our parameter services against MAVSDK's, over UDP that loses datagrams."""

import asyncio

import pytest
from mavsdk.asyncio import ComponentType, Configuration
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.param_server import ParamServerAsync

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import ParameterType, parameter
from gloc3.mavlink.services.parameter_client import ParameterClient, ParameterResult
from gloc3.mavlink.services.parameter_server import ParameterServer

from .mavsdk_peer import running, until

pytestmark = pytest.mark.sockets


async def test_mavsdk_reads_and_sets_our_parameters() -> None:
    integers = [parameter(f"N{number}", number, ParameterType.INT32) for number in range(30)]
    server = ParameterServer(Address(1, 1), [*integers, parameter("SPEED", 2.5)])
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with running([server], configuration, loss=0.02) as (_, mavsdk):
        system = await mavsdk.first_autopilot(timeout_s=60)
        assert system is not None
        client = ParamAsync(system)
        assert await client.get_param_float("SPEED") == 2.5
        assert await client.get_param_int("N7") == 7
        await client.set_param_int("N7", -8_388_607)
        assert server["N7"] == -8_388_607
        everything = await client.get_all_params()
        assert len(everything.int_params) == 30
        assert [each.name for each in everything.float_params] == ["SPEED"]


async def test_we_read_and_set_mavsdks_parameters() -> None:
    client = ParameterClient(Address(255, 190))
    configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
    async with running([client], configuration, own=Address(255, 190), loss=0.02) as (runner, mavsdk):
        server = ParamServerAsync(await mavsdk.server_component())
        for number in range(20):
            await server.provide_param_int(f"N{number}", number)
        await server.provide_param_float("SPEED", 2.5)
        loop = asyncio.get_running_loop()
        await until(lambda: runner.parser.frames_received > 0)
        fetch = client.fetch(Address(1, 1), now_s=loop.time())
        runner.settle()
        await until(lambda: fetch.result is not None)
        assert fetch.result is ParameterResult.DONE
        assert {name: each.value for name, each in fetch.parameters.items()} == {
            **{f"N{number}": number for number in range(20)},
            "SPEED": 2.5,
        }
        call = client.set(Address(1, 1), "N3", 33, now_s=loop.time())
        runner.settle()
        await until(lambda: call.result is not None)
        assert call.result is ParameterResult.DONE
        assert await server.retrieve_param_int("N3") == 33
