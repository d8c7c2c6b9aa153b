"""`gloc3 sitl --firmware`: what is started and how, with a stand-in for the firmware, and what is refused."""

import asyncio
import fcntl
import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.sitl.firmware import stand_in
from tests.sitl.firmware.json_peer import JsonPeer
from tests.sitl.firmware.px4_peer import Px4Peer

from gloc3.errors import Refused
from gloc3_sitl.cli.sitl import app
from gloc3_sitl.firmware import real_time_pacer
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.firmware.kinds import preset_text, read_parameters
from gloc3_sitl.firmware.run import FirmwareOptions, run_firmware
from gloc3_sitl.world import World

ROOT = Path(stand_in.__file__).parents[3]
PX4_PORT = 4563


@pytest.fixture
def alone_on_px4_port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """PX4 has ten ports, and computes its own: of all processes that test, one at a time uses it."""
    with (tmp_path_factory.getbasetemp().parent / "px4-port").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def program(folder: Path, kind: str) -> Path:
    """The stand-in as a program of its own."""
    file = folder / "stand-in"
    paths = os.pathsep.join([str(ROOT), *(entry for entry in sys.path if entry)])
    file.write_text(
        f'#!/bin/sh\nPYTHONPATH="{paths}" exec {sys.executable} -m tests.sitl.firmware.stand_in {kind} "$@"\n'
    )
    file.chmod(0o755)
    return file


def options(firmware: str, **settings: Any) -> FirmwareOptions:
    body = BodySettings(is_without_gps=settings.pop("no_gps", False))
    return FirmwareOptions(
        **{
            "firmware": firmware,
            "world": World.load("open"),
            "body": body,
            "parameters": {},
            "links": (),
            "seconds": 0.3,
            "port": 0 if firmware == "ardupilot" else PX4_PORT,
            **settings,
        }
    )


def free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


@pytest.mark.sockets
async def test_ardupilot_is_started_with_its_parameters_links_and_home_and_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "firmware").mkdir()
    (tmp_path / "firmware" / "eeprom.bin").write_text("of an earlier flight")
    code = await run_firmware(
        options(
            "ardupilot",
            binary=program(tmp_path, "ardupilot"),
            links=("udpout://127.0.0.1:14999", "tcpin://0.0.0.0:5799"),
            parameters={"WPNAV_SPEED": 200.0},
            no_gps=True,
            out=tmp_path,
        )
    )
    assert code == 0
    reported = json.loads((tmp_path / "firmware" / "told.json").read_text())["arguments"]
    given = dict(zip(reported[::2], reported[1::2], strict=True))
    assert given["--model"] == "JSON:127.0.0.1"
    assert given["--home"].startswith("47.")
    assert given["--serial0"] == "udpclient:127.0.0.1:14999"
    assert given["--serial1"] == "tcp:5799"
    assert given["--serial2"] == "none:0"
    assert given["--rate"] == "800"
    files = [tmp_path / "firmware" / name for name in given["--defaults"].split(",")]
    read = [read_parameters(file.read_text()) for file in files]
    assert read[0]["FRAME_CLASS"] == 1.0
    assert read[1]["VISO_TYPE"] == 1.0
    assert read[2] == {"WPNAV_SPEED": 200.0}
    assert not (tmp_path / "firmware" / "eeprom.bin").exists()
    text = capsys.readouterr().err
    assert "ArduPilot itself listens on two UDP ports" in text
    assert "ArduPilot connected; it drives the simulated time" in text
    assert "s of simulated time" in text


@pytest.mark.sockets
@pytest.mark.usefixtures("alone_on_px4_port")
async def test_px4_is_started_with_its_parameters_and_flies_in_lock_step(tmp_path: Path) -> None:
    code = await run_firmware(
        options("px4", binary=program(tmp_path, "px4"), parameters={"NAV_DLL_ACT": 0.0}, out=tmp_path, no_gps=True)
    )
    assert code == 0
    reported = json.loads((tmp_path / "firmware" / "told.json").read_text())
    assert reported["arguments"][:3] == ["-d", "-i", str(PX4_PORT - 4560)]
    environment = reported["environment"]
    assert environment["PX4_SIM_HOST_ADDR"] == "127.0.0.1"
    given = (tmp_path / "firmware" / "px4-rc.params").read_text().splitlines()
    assert {"param set CA_ROTOR_COUNT 4", "param set EKF2_GPS_CTRL 0", "param set NAV_DLL_ACT 0"} <= {*given}


@pytest.mark.sockets
@pytest.mark.usefixtures("alone_on_px4_port")
async def test_a_parameter_that_px4_does_not_have_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = options("px4", binary=program(tmp_path, "px4"), parameters={"NOT_THERE": 1.0}, out=tmp_path)
    assert await run_firmware(given) == 1
    assert "PX4: it has no parameter NOT_THERE" in capsys.readouterr().err


@pytest.mark.sockets
@pytest.mark.usefixtures("alone_on_px4_port")
async def test_a_build_tree_s_px4_gets_its_root_file_system(tmp_path: Path) -> None:
    (tmp_path / "build" / "bin").mkdir(parents=True)
    binary = program(tmp_path / "build" / "bin", "px4")
    scripts = tmp_path / "build" / "etc" / "init.d-posix"
    scripts.mkdir(parents=True)
    (scripts / "rcS").write_text("")
    assert await run_firmware(options("px4", binary=binary, out=tmp_path)) == 0
    arguments = json.loads((tmp_path / "firmware" / "told.json").read_text())["arguments"]
    assert arguments[-1] == str(tmp_path / "build" / "etc")


@pytest.mark.sockets
async def test_a_firmware_that_ends_by_itself_is_told_with_its_last_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await run_firmware(options("ardupilot", binary=program(tmp_path, "neither"))) == 1
    assert "Failed to find location" in capsys.readouterr().err


@pytest.mark.sockets
async def test_a_firmware_that_runs_already_is_waited_for_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    running = asyncio.ensure_future(run_firmware(options("ardupilot", is_running=True, port=port, seconds=0.1)))
    await asyncio.sleep(0.2)
    assert f"waiting for ArduPilot on port {port}: arducopter --model JSON:127.0.0.1" in capsys.readouterr().err
    peer = JsonPeer()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as link:
        link.setblocking(False)
        loop = asyncio.get_running_loop()
        while not running.done():
            await loop.sock_sendto(link, peer.servos(), ("127.0.0.1", port))
            try:
                async with asyncio.timeout(0.3):
                    peer.take(await loop.sock_recv(link, 2048))
            except TimeoutError:
                continue
    assert await running == 0
    assert peer.now_s >= 0.1


@pytest.mark.sockets
async def test_a_flight_that_falls_behind_again_and_again_is_told_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(real_time_pacer, "MOST_BEHIND_S", 0.01)
    port, peer = PX4_PORT + 2, Px4Peer(boot_steps=0)
    running = asyncio.ensure_future(run_firmware(options("px4", is_running=True, port=port, seconds=0.1)))
    await asyncio.sleep(0.1)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    while not running.done():
        writer.write(peer.take(await reader.read(4096)))
        await asyncio.sleep(0.03)
    writer.close()
    assert await running == 0
    assert capsys.readouterr().err.count("too slow or too busy for this speed") == 1


async def ended(reader: asyncio.StreamReader) -> bool:
    """Whether nothing comes but the end."""
    try:
        return await reader.read(100) == b""
    except ConnectionError:
        return True


@pytest.mark.sockets
async def test_a_px4_that_is_gone_may_come_again_and_a_second_one_is_turned_away() -> None:
    port = PX4_PORT + 1
    running = asyncio.ensure_future(run_firmware(options("px4", is_running=True, port=port, seconds=None)))
    await asyncio.sleep(0.1)
    for _ in range(2):
        peer = Px4Peer()
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(peer.send_hello())
        while peer.now_us < 200_000:
            writer.write(peer.take(await reader.read(4096)))
        second, other = await asyncio.open_connection("127.0.0.1", port)
        assert await ended(second)
        other.close()
        writer.close()
        await asyncio.sleep(0.05)
    running.cancel()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--firmware", "ardupilott"], "did you mean 'ardupilot'"),
        (["--firmware", "ardupilot", "--firmware-binary", "/none/arducopter"], "is not a program"),
        (["--firmware", "ardupilot", "--battery", "0.5"], "its own battery"),
        (["--firmware", "ardupilot", "--plain-gps"], "its own satellite receiver"),
        (["--firmware", "ardupilot", "--firmware-running", "--link", "udpout://127.0.0.1:1"], "keeps its own links"),
        (["--firmware", "ardupilot", "--firmware-binary", sys.executable, "--link", "udpin://0.0.0.0:1"], "udpout://"),
        (["--firmware", "px4", "--firmware-binary", sys.executable, "--link", "udpout://127.0.0.1:1"], "omit --link"),
        (["--firmware", "px4", "--firmware-binary", sys.executable, "--firmware-port", "9"], "from 4560"),
        (["--firmware-running"], "need --firmware"),
        (["--firmware", "px4", "--firmware-port", "99999"], "from 0 to 65535"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: list[str], reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        app([*arguments, "--world", "open"], result_action="return_value")


def test_without_the_program_it_is_said_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(Refused, match=r"arducopter is not on PATH; docs/firmware\.md"):
        app(["--firmware", "ardupilot", "--world", "open"], result_action="return_value")


@pytest.mark.parametrize(
    "name", ["ardupilot_pelican.parm", "ardupilot_odometry.parm", "px4_pelican.params", "px4_odometry.params"]
)
def test_parameter_files_can_be_read_and_have_names_that_fit(name: str) -> None:
    assert all(len(key) <= 16 for key in read_parameters(preset_text(name), name))


def test_a_parameter_file_that_is_wrong_says_where() -> None:
    with pytest.raises(Refused, match=r"mine:2: 'B' is not NAME VALUE"):
        read_parameters("A 1  # one\nB\n", "mine")


@pytest.mark.parametrize(("firmware", "vehicle"), [("px4", "quadplane"), ("px4", "rover"), ("ardupilot", "quadplane")])
async def test_a_vehicle_for_which_nobody_has_tuned_a_firmware_is_refused_with_what_flies_it(
    firmware: str, vehicle: str
) -> None:
    with pytest.raises(
        Refused, match=f"cannot fly the vehicle {vehicle} here: .* set up for pelican.* Leave out --firmware"
    ):
        await run_firmware(options(firmware, body=BodySettings(vehicle=vehicle)))
