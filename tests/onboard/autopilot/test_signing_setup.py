"""A key for an autopilot: shown, sent, and looked whether it signs with it; pymavlink judges at the other end."""

import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gloc3.cli.program import run
from gloc3_onboard.autopilot import signing_setup
from gloc3_onboard.cli import signing as signing_cli

pytestmark = pytest.mark.sockets

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))


class Autopilot:
    """As little of one as can be given a key, on pymavlink's own signing; what is not signed for it it does not hear."""

    def __init__(self, key: bytes | None = None, *, is_deaf: bool = False, is_armed: bool = False) -> None:
        self._link = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=1, source_component=1)
        self._link.first_byte = False  # it would begin anew, without its key, with the first frame that it hears
        self.url = f"udpout://127.0.0.1:{self._link.port.getsockname()[1]}"
        self.key = key
        self._is_deaf, self._is_armed = is_deaf, is_armed
        self._is_over = threading.Event()
        self._sign()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()
        self._link.close()

    def _sign(self) -> None:
        if self.key is None:
            self._link.disable_signing()
        else:
            self._link.setup_signing(self.key, sign_outgoing=True)

    def _run(self) -> None:
        while not self._is_over.wait(0.01):
            while (received := self._link.recv_match()) is not None:
                if received.get_type() == "SETUP_SIGNING" and not self._is_deaf:
                    key = bytes(received.secret_key)
                    self.key = key if any(key) else None
                    self._sign()
            mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self._is_armed else 0
            if self._link.last_address or self._link.clients:
                self._link.mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, mode, 0, 4)


@pytest.fixture
def begin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Autopilot]]:
    for name in ("mavlink", "current_dialect"):  # to be put back afterwards
        monkeypatch.setattr(mavutil, name, getattr(mavutil, name))
    monkeypatch.setenv("MAVLINK20", "1")
    monkeypatch.setenv("MAVLINK_DIALECT", "ardupilotmega")
    mavutil.set_dialect("ardupilotmega")
    begun: list[Autopilot] = []

    def start(key: bytes | None = None, *, is_deaf: bool = False, is_armed: bool = False) -> Autopilot:
        begun.append(Autopilot(key, is_deaf=is_deaf, is_armed=is_armed))
        return begun[-1]

    yield start
    for autopilot in begun:
        autopilot.close()


@pytest.fixture(autouse=True)
def in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signing_cli, "LISTEN_S", 0.6)
    monkeypatch.setattr(signing_cli, "COUNT_S", 0.15)
    monkeypatch.setattr(signing_setup, "HEARTBEAT_S", 0.05)


def file_of(folder: Path, key: bytes, name: str = "link.key") -> str:
    path = folder / name
    path.write_bytes(key)
    path.chmod(0o600)
    return str(path)


def test_a_new_key_is_random_and_for_its_owner_alone_and_overwrites_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from gloc3.mavlink.signing_key import read_signing_key

    paths = [tmp_path / "one", tmp_path / "two"]
    assert [run(["signing", "new", str(path)]) for path in paths] == [0, 0]
    assert {stat.S_IMODE(path.stat().st_mode) for path in paths} == {0o600}
    assert read_signing_key(paths[0]) != read_signing_key(paths[1])
    before = paths[0].read_bytes()
    assert run(["signing", "new", str(paths[0])]) == 2
    assert paths[0].read_bytes() == before
    assert "is there already" in capsys.readouterr().err


def test_an_autopilot_gets_a_key_is_shown_to_sign_with_it_and_forgets_it_again(
    tmp_path: Path, begin: Callable[..., Autopilot], capsys: pytest.CaptureFixture[str]
) -> None:
    autopilot, key = begin(), file_of(tmp_path, KEY)
    link = ["--autopilot", autopilot.url, "--key", key]
    assert run(["signing", "show", *link]) == 1
    assert "not signed" in capsys.readouterr().err
    assert run(["signing", "set", *link, "--yes"]) == 0
    assert autopilot.key == KEY
    text = capsys.readouterr().err
    assert "PX4 1/1" in text
    assert "it is sent the key of" in text
    assert "signed with this key" in text.splitlines()[-1]
    assert KEY.hex() not in text
    assert run(["signing", "show", *link]) == 0
    assert run(["signing", "remove", *link, "--yes"]) == 0
    assert autopilot.key is None


def test_a_key_is_changed_only_with_the_present_one(tmp_path: Path, begin: Callable[..., Autopilot]) -> None:
    autopilot, key = begin(OTHER), file_of(tmp_path, KEY)
    link = ["--autopilot", autopilot.url, "--key", key, "--yes"]
    assert run(["signing", "set", *link]) == 1
    assert autopilot.key == OTHER, "it does not hear what is not signed with its key"
    assert run(["signing", "set", *link, "--present-key", file_of(tmp_path, OTHER, "old")]) == 0
    assert autopilot.key == KEY


def test_an_autopilot_that_does_not_take_the_key_is_told(
    tmp_path: Path, begin: Callable[..., Autopilot], capsys: pytest.CaptureFixture[str]
) -> None:
    autopilot = begin(is_deaf=True)
    assert run(["signing", "set", "--autopilot", autopilot.url, "--key", file_of(tmp_path, KEY), "--yes"]) == 1
    assert "it has not accepted the key" in capsys.readouterr().err


def test_nothing_is_sent_to_the_armed_nor_without_a_yes_nor_over_a_network(
    tmp_path: Path, begin: Callable[..., Autopilot], capsys: pytest.CaptureFixture[str]
) -> None:
    armed, idle, key = begin(is_armed=True), begin(), file_of(tmp_path, KEY)
    assert run(["signing", "set", "--autopilot", armed.url, "--key", key, "--yes"]) == 2
    assert "it is armed" in capsys.readouterr().err
    assert run(["signing", "set", "--autopilot", idle.url, "--key", key]) == 2
    assert "add --yes" in capsys.readouterr().err
    assert run(["signing", "set", "--autopilot", "udpin://0.0.0.0:0", "--key", key, "--yes"]) == 2
    assert "over which the key would go unencrypted" in capsys.readouterr().err
    assert armed.key is None
    assert idle.key is None


def test_where_no_autopilot_is_that_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["signing", "show", "--autopilot", "udpin://127.0.0.1:0", "--key", file_of(tmp_path, KEY)]) == 1
    assert "no autopilot responds" in capsys.readouterr().err
