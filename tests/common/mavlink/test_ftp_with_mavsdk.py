"""Our file transfer against MAVSDK's, over UDP that loses datagrams."""

import asyncio
import random
from pathlib import Path

import pytest
from mavsdk.asyncio import ComponentType, Configuration
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.ftp_server import FtpServerAsync

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp import FtpError
from gloc3.mavlink.services.files.ftp_client import FtpCall, FtpClient
from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import FtpServer

from .mavsdk_peer import running, until

pytestmark = pytest.mark.sockets

CONTENT = random.Random(2).randbytes(20_000)


@pytest.mark.parametrize("uses_burst", [False, True])
async def test_mavsdk_reads_and_writes_our_files(tmp_path: Path, uses_burst: bool) -> None:
    top, local = tmp_path / "vehicle", tmp_path / "station"
    top.mkdir()
    local.mkdir()
    (top / "flight.bin").write_bytes(CONTENT)
    (local / "plan.bin").write_bytes(CONTENT[::-1])
    server = FtpServer(Address(1, 1), FolderFiles(top))
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with running([server], configuration, loss=0.01) as (_, mavsdk):
        system = await mavsdk.first_autopilot(timeout_s=60)
        assert system is not None
        ftp = FtpAsync(system)
        await ftp.set_target_compid(1)
        listed = await ftp.list_directory("/")
        assert [entry.name for entry in listed.entries] == ["flight.bin"]
        async for _progress in ftp.download("/flight.bin", str(local), uses_burst):
            pass
        assert (local / "flight.bin").read_bytes() == CONTENT
        async for _progress in ftp.upload(str(local / "plan.bin"), "/"):
            pass
        assert (top / "plan.bin").read_bytes() == CONTENT[::-1]
        assert await ftp.are_files_identical(str(local / "plan.bin"), "/plan.bin")
        await ftp.create_directory("/new")
        await ftp.rename("/plan.bin", "/new/plan.bin")
        assert (top / "new" / "plan.bin").exists()
        await ftp.remove_file("/new/plan.bin")
        await ftp.remove_directory("/new")
        assert not (top / "new").exists()


async def test_we_read_and_write_mavsdks_files(tmp_path: Path) -> None:
    (tmp_path / "flight.bin").write_bytes(CONTENT)
    client = FtpClient(Address(255, 190))
    configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
    async with running([client], configuration, own=Address(255, 190), loss=0.01) as (runner, mavsdk):
        server = FtpServerAsync(await mavsdk.server_component())
        await server.set_root_dir(str(tmp_path))
        loop = asyncio.get_running_loop()
        target = Address(1, 1)
        await until(lambda: runner.parser.frames_received > 0)

        async def finish(call: FtpCall) -> FtpError | None:
            runner.settle()
            await until(lambda: call.result is not None)
            return call.result

        for uses_burst in (True, False):
            read = client.read(target, "/flight.bin", uses_burst=uses_burst, now_s=loop.time())
            assert await finish(read) is FtpError.NONE
            assert read.data == CONTENT
        assert await finish(client.write(target, "/new.bin", CONTENT[:3000], now_s=loop.time())) is FtpError.NONE
        assert (tmp_path / "new.bin").read_bytes() == CONTENT[:3000]
        listed = client.list(target, "/", now_s=loop.time())
        assert await finish(listed) is FtpError.NONE
        assert sorted((entry.name, entry.size) for entry in listed.entries) == [
            ("flight.bin", 20_000),
            ("new.bin", 3000),
        ]
        assert await finish(client.remove(target, "/new.bin", now_s=loop.time())) is FtpError.NONE
        assert not (tmp_path / "new.bin").exists()
