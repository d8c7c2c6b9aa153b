"""`gloc3 doctor`: the list on the vehicle's computer, over real sockets, and its exit codes."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gloc3.cli.program import _call
from gloc3.errors import Gloc3Error
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3.messages.preflight import Check, Verdict, red
from gloc3.platform.reader import load_platform
from gloc3_onboard.cli.doctor import app
from gloc3_onboard.cli.doctor_run import DoctorOptions, examine
from gloc3_onboard.process.computer import HostComputer
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.world import World

pytestmark = pytest.mark.sockets
PELICAN = load_platform("pelican_rtk")


@asynccontextmanager
async def vehicle(style: str, **parameters: float) -> AsyncIterator[str]:
    """A simulated vehicle that has stood for a while; gives where it is heard."""
    loop = asyncio.get_running_loop()
    simulator = Simulator(World.load("hold"), SimulatorSettings(style=style, parameters=parameters))
    receivers: list[Callable[[bytes], None]] = []
    endpoint = await open_endpoint("tcpin://127.0.0.1:0", loop, lambda data: receivers[0](data))  # noqa: PLW0108
    receivers.append(simulator.attach(endpoint.send, LinkKind.COMPANION, is_datagram=endpoint.is_datagram))
    simulator.advance(4.0)
    simulator.start(loop, 4.0)
    try:
        yield f"tcpout://127.0.0.1:{endpoint.local_port}"
    finally:
        simulator.stop()
        await endpoint.close()


async def examined(url: str, folder: Path, wait_s: float = 20.0) -> dict[str, Check]:
    checks = await examine(DoctorOptions(PELICAN, url, folder, wait_s))
    return {check.title: check for check in checks}


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
async def test_a_vehicle_that_is_right_has_nothing_red(style: str, tmp_path: Path) -> None:
    async with vehicle(style) as url:
        found = await examined(url, tmp_path / "out")
    assert red(found.values()) == []
    assert found["failsafes: low battery"].verdict is Verdict.OK
    assert found["sensors: position"].verdict is Verdict.OK
    assert found["computer: disk speed"].finding.startswith("writes ")
    assert not (tmp_path / "out").exists()


async def test_a_vehicle_that_is_set_otherwise_is_red(tmp_path: Path) -> None:
    async with vehicle("px4", NAV_DLL_ACT=2.0) as url:
        found = await examined(url, tmp_path)
    assert [check.title for check in red(found.values())] == ["failsafes: link loss"]


async def test_a_port_that_is_taken_says_so(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    used = await open_endpoint("udpin://127.0.0.1:0", loop, lambda _: None)
    try:
        url = f"udpin://127.0.0.1:{used.local_port}"
        found = await examined(url, tmp_path, 0.2)
    finally:
        await used.close()
    assert found["computer: port"].verdict is Verdict.RED
    assert "another program" in found["computer: port"].advice


def test_exit_codes_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silent = ["--autopilot", "udpin://127.0.0.1:0", "--wait", "0.2", "--out", str(tmp_path)]
    assert _call(app, ["pelican_rtk", *silent, "--json"]) == 1
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"group": "autopilot", "name": "answers", "verdict": "red"}.items() <= lines[0].items()
    assert _call(app, ["pelican_rtk", *silent]) == 1
    assert "red      autopilot: answers: no heartbeat received\n         -> check its power" in capsys.readouterr().out
    for wrong in (
        ["pelikan"],
        ["pelican_rtk", "--autopilot", "nowhere"],
        ["pelican_rtk", "--wait", "0"],
        ["pelican_rtk", "--system-id", "251"],
    ):
        with pytest.raises(Gloc3Error):
            _call(app, wrong)


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> float:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("gloc3_onboard.process.computer.write_speed_mb_s", refuse)
    from gloc3.clock import Clock

    loop = asyncio.new_event_loop()
    computer = HostComputer(tmp_path, Clock(loop), lambda: "the log cannot be written: no space")
    computer.measure()
    loop.close()
    state = computer.state()
    assert "Permission denied" in state.disk_problem
    assert state.log_problem
    assert state.disk_free_mb > 0.0


def test_a_file_where_the_folder_should_be_is_told(tmp_path: Path) -> None:
    from gloc3.clock import Clock

    (tmp_path / "out").write_text("not a folder")
    loop = asyncio.new_event_loop()
    computer = HostComputer(tmp_path / "out", Clock(loop))
    computer.measure()
    loop.close()
    assert computer.state().disk_problem.endswith("out exists already and is not a folder")
