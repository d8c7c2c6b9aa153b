"""A real ArduCopter behind `gloc3 onboard`: it reboots, and is asked for its streams again; it is given a key, and keeps to it."""

import asyncio
import shutil
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.onboard.real_vehicle import COPTER, Lines, simulated

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder
from gloc3.mavlink.transport.endpoints import open_endpoint

pytestmark = [
    pytest.mark.firmware,
    pytest.mark.sockets,
    pytest.mark.thorough,
    pytest.mark.timeout(300),
    pytest.mark.skipif(shutil.which("arducopter") is None, reason="arducopter is not on PATH: see docs/firmware.md"),
]

REBOOT = 246
ASKED_FOR = codec.shape("ATTITUDE_QUATERNION").id
"""What ArduPilot sends only when it is asked to, at this rate."""
RATE_HZ = 20.0
WATCHED_S = 5.0


@pytest.fixture
def lines(tmp_path: Path) -> Iterator[Lines]:
    with simulated(COPTER, tmp_path / "sitl") as found:
        yield found


def received_s(log: Path) -> list[float]:
    """When what was asked for came, in seconds, by a `.tlog`: a time before each frame."""
    data, times, place = log.read_bytes(), [], 0
    while place + 20 <= len(data):
        us, magic, length, flags = struct.unpack_from(">QBBB", data, place)
        is_new = magic == 0xFD
        if is_new and int.from_bytes(data[place + 15 : place + 18], "little") == ASKED_FOR:
            times.append(us * 1e-6)
        place += 8 + length + (12 + 13 * (flags & 1) if is_new else 8)
    return times


def rate_hz(times_s: list[float]) -> float:
    """How often it came in the last seconds of its coming."""
    return sum(t_s > times_s[-1] - WATCHED_S for t_s in times_s) / WATCHED_S if times_s else 0.0


async def reboot(url: str) -> None:
    endpoint = await open_endpoint(url, asyncio.get_running_loop(), lambda _: None)
    await asyncio.sleep(1.0)
    command = codec.message("COMMAND_LONG", target_system=1, target_component=1, command=REBOOT, param1=1.0)
    endpoint.send(Encoder(255, 190).encode(command))
    await asyncio.sleep(1.0)
    await endpoint.close()


async def test_after_a_reboot_it_is_asked_for_its_streams_again(tmp_path: Path, lines: Lines) -> None:
    with program("onboard", "copter", "--autopilot", lines.first, "--out", "out", folder=tmp_path) as onboard:
        await asyncio.to_thread(onboard.await_line, lambda line: "autopilot found" in line)
        await asyncio.sleep(2.0 * WATCHED_S)
        before = received_s(tmp_path / "out" / "log.tlog")
        await reboot(lines.second)
        await asyncio.to_thread(onboard.await_line, lambda line: "the autopilot has restarted" in line)
        await asyncio.sleep(2.0 * WATCHED_S)
        onboard.interrupt()
        assert onboard.end() == 0, onboard.text
    after = received_s(tmp_path / "out" / "log.tlog")[len(before) :]
    assert rate_hz(before) > 0.5 * RATE_HZ
    assert rate_hz(after) > 0.5 * RATE_HZ


def test_it_takes_a_key_and_hears_only_who_has_it(tmp_path: Path, lines: Lines) -> None:
    def signing(*words: str) -> int:
        with program("signing", *words, folder=tmp_path) as running:
            return running.end()

    def requester(url: str, out: str) -> float:
        with program("onboard", "copter", "--autopilot", url, "--out", out, folder=tmp_path) as onboard:
            onboard.await_line(lambda line: "autopilot found" in line)
            time.sleep(2.0 * WATCHED_S)
            onboard.interrupt()
            assert onboard.end() == 0, onboard.text
        return rate_hz(received_s(tmp_path / out / "log.tlog"))

    link = ["--autopilot", lines.second, "--key", "radio.key"]
    assert signing("new", "radio.key") == 0
    assert signing("show", *link) == 1
    assert signing("set", *link, "--yes") == 0
    assert signing("show", *link) == 0
    assert requester(lines.second, "unsigned") == 0.0
    assert requester(f"{lines.second}?key=radio.key", "signed") > 0.5 * RATE_HZ
    assert signing("remove", *link, "--yes") == 0
    assert signing("show", *link) == 1
