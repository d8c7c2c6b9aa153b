"""A key for all: given to the autopilot by our command, used by the onboard process and by a station, as programs."""

import asyncio
import socket
import time
from collections import Counter
from pathlib import Path

import pytest
from tests.commands.programs import program

from gloc3.cli.program import run
from gloc3.mavlink.codec import Frame, message
from gloc3.mavlink.signing_key import read_signing_key
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_onboard.cli import signing as signing_cli
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]

ASK = message("COMMAND_LONG", target_system=1, target_component=1, command=512, param1=148.0)
"""The autopilot's version."""


async def answers(port: int, key: bytes | None, reported: list[str], within_s: float) -> Counter[str]:
    """What a station hears that asks the autopilot behind the onboard process, until it is answered or time is up."""
    received: Counter[str] = Counter()

    def receive(frame: Frame) -> None:
        if frame.shape is not None:
            received[f"{frame.system}/{frame.component} {frame.shape.name}"] += 1

    ground = GroundStation(StationSetup(boot=1, signing_key=key), report=reported.append)
    try:
        await ground.open([f"udpout://127.0.0.1:{port}"])
        ((_, link),) = ground.links.routes()
        link.listen(receive)
        for _ in range(round(within_s / 0.25)):
            if link.received():
                link.send(ASK)
            await asyncio.sleep(0.25)
            if received["1/1 AUTOPILOT_VERSION"]:
                break
    finally:
        await ground.close()
    return received


def test_with_the_key_a_station_reaches_the_autopilot_and_without_it_nobody_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(signing_cli, "LISTEN_S", 20.0)  # no longer than needed, but on a machine that is busy
    vehicle, station = free_ports(2, socket.SOCK_DGRAM)
    key = str(tmp_path / "radio.key")
    assert run(["signing", "new", key]) == 0
    link = ["--autopilot", f"udpout://127.0.0.1:{vehicle}", "--key", key]
    with program("sitl", "--link", f"companion=udpin://127.0.0.1:{vehicle}", folder=tmp_path) as sitl:
        sitl.await_line(lambda line: "companion link" in line)
        assert run(["signing", "show", *link]) == 1
        assert run(["signing", "set", *link, "--yes"]) == 0
        assert run(["signing", "show", *link]) == 0
        url = f"udpout://127.0.0.1:{vehicle}?key={key}"
        assert run(["preset", "diff", "px4_vision", "--autopilot", url]) == 1
        capsys.readouterr()
        run(["doctor", "pelican_rtk", "--autopilot", url, "--wait", "20", "--json"])
        assert '"name":"parameters","verdict":"ok"' in capsys.readouterr().out
        with program(
            *("onboard", "pelican_rtk", "--autopilot", url),
            *("--station", f"udpin://127.0.0.1:{station}", "--signing-key", key, "--out", "out"),
            folder=tmp_path,
        ) as onboard:
            onboard.await_line(lambda line: "components; log in" in line)
            reported: list[str] = []
            knows = asyncio.run(answers(station, read_signing_key(Path(key)), reported, 60.0))
            assert knows["1/1 AUTOPILOT_VERSION"]
            assert knows["1/191 HEARTBEAT"]
            assert reported == []
            time.sleep(2.0)  # what was asked several times is answered as often
            stranger = asyncio.run(answers(station, None, reported, 3.0))
            assert not stranger["1/1 AUTOPILOT_VERSION"]
            assert any("signs its messages, and this link has no key" in text for text in reported)
            onboard.interrupt()
            assert onboard.end() == 0, onboard.text
        assert run(["signing", "remove", *link, "--yes"]) == 0
        assert run(["signing", "show", *link]) == 1
    assert "not signed" in onboard.text, "who was kept out is told"
