"""`gloc3 preset` against a running autopilot: the difference is shown, set only when told to, and read again."""

import socket
from pathlib import Path

import pytest
from tests.commands.programs import program

from gloc3.cli.program import run
from gloc3_onboard.cli import preset as preset_cli
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets


def test_a_preset_is_shown_and_set_only_when_told_to(tmp_path: Path) -> None:
    port = free_ports(1, socket.SOCK_DGRAM)[0]
    link = ["--autopilot", f"udpin://127.0.0.1:{port}"]
    file = tmp_path / "mine.yaml"
    file.write_text(
        "preset: mine\nstyle: px4\nvehicle: copter\nparameters:\n"
        "  NAV_DLL_ACT: {value: 2, why: it returns}\n  COM_OF_LOSS_T: {value: 0.7}\n"
    )
    missing = tmp_path / "lacking.yaml"
    missing.write_text(file.read_text() + "  NO_SUCH_ONE: {value: 1}\n")
    with program("sitl", "--link", f"companion=udpout://127.0.0.1:{port}", folder=tmp_path) as sitl:
        sitl.await_line(lambda line: "companion link" in line)
        codes, texts = [], []
        for wanted, *what in ((file, "apply"), (file, "apply", "--yes"), (missing, "diff")):
            with program("preset", what[0], str(wanted), *what[1:], *link, folder=tmp_path) as preset:
                codes.append(preset.end())
                texts.append(preset.text)
        assert codes == [2, 0, 1], texts
    for text in texts[:2]:
        assert "- NAV_DLL_ACT 0\n+ NAV_DLL_ACT 2   # it returns" in text
    assert "there is no terminal to ask on; add --yes to apply it" in texts[0]
    assert "2 set and read again" in texts[1]
    assert "the autopilot does not have 1 of 3" in texts[2]


def test_nobody_waits_long_for_an_autopilot_that_is_not_there(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preset_cli, "LISTEN_S", 0.3)
    url = f"tcpout://127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"
    assert run(["preset", "diff", "px4_vision", "--autopilot", url]) == 1
    assert f"{url}: no autopilot responds: connection refused" in capsys.readouterr().err
