"""Our log server against MAVSDK's client, over UDP that loses datagrams."""

import random
from pathlib import Path

import pytest
from mavsdk.asyncio import ComponentType, Configuration
from mavsdk.asyncio.plugins.log_files import LogFilesAsync

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.log_server import LogEntry, LogServer

from .mavsdk_peer import running

pytestmark = pytest.mark.sockets

CONTENT = random.Random(2).randbytes(20_000)


class OneLog:
    def entries(self) -> list[LogEntry]:
        return [LogEntry(0, len(CONTENT), 1_700_000_000)]

    def read(self, number: int, offset: int, size: int) -> bytes:
        return CONTENT[offset : offset + size]

    def erase(self) -> None:
        raise OSError


async def test_mavsdk_lists_and_reads_our_logs(tmp_path: Path) -> None:
    server = LogServer(Address(1, 1), OneLog())
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with running([server], configuration, loss=0.02) as (_, mavsdk):
        system = await mavsdk.first_autopilot(timeout_s=60)
        assert system is not None
        logs = LogFilesAsync(system)
        (entry,) = await logs.get_entries()
        assert entry.size_bytes == len(CONTENT)
        async for _progress in logs.download_log_file(entry, str(tmp_path / "log.bin")):
            pass
        assert (tmp_path / "log.bin").read_bytes() == CONTENT
