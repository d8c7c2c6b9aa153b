"""A key for all: given to the autopilot by our command, used by the onboard process and by a station, as programs."""

import asyncio
import socket
from collections import Counter
from collections.abc import Callable
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


LOCKED_OUT = "signs its messages, and this link has no key"


async def answers(
    port: int, setup: StationSetup, reported: list[str], is_over: Callable[[Counter[str]], bool], within_s: float
) -> Counter[str]:
    """What a station receives, for all or for itself, that asks the autopilot behind the onboard process until it is over."""
    received: Counter[str] = Counter()

    def receive(frame: Frame) -> None:
        if frame.shape is not None and frame.target_system in (0, setup.system):
            received[f"{frame.system}/{frame.component} {frame.shape.name}"] += 1

    ground = GroundStation(setup, report=reported.append)
    try:
        await ground.open([f"udpout://127.0.0.1:{port}"])
        ((_, link),) = ground.links.routes()
        link.listen(receive)
        for _ in range(round(within_s / 0.25)):
            if is_over(received):
                break
            if link.received():
                link.send(ASK)
            await asyncio.sleep(0.25)
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
            wanted = {"1/1 AUTOPILOT_VERSION", "1/1 COMMAND_ACK", "1/191 HEARTBEAT"}
            known = StationSetup(boot=1, signing_key=read_signing_key(Path(key)))
            knows = asyncio.run(answers(station, known, reported, wanted.issubset, 60.0))
            assert wanted <= set(knows)
            assert reported == []
            stranger = StationSetup(boot=2, system=254)  # what the other has asked for is not answered to this one
            asyncio.run(
                answers(station, stranger, reported, lambda _: any(LOCKED_OUT in text for text in reported), 60.0)
            )
            assert any(LOCKED_OUT in text for text in reported)
            learns = asyncio.run(answers(station, stranger, reported, lambda _: False, 3.0))
            assert learns, "it receives what is sent to all"
            assert not learns["1/1 COMMAND_ACK"]
            onboard.interrupt()
            assert onboard.end() == 0, onboard.text
        assert run(["signing", "remove", *link, "--yes"]) == 0
        assert run(["signing", "show", *link]) == 1
    assert "not signed" in onboard.text, "who was kept out is told"
