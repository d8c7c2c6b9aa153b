"""Real processes on a network of their own: an operator flies over it, an observer looks, a second way takes over."""

import signal
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from tests.commands.programs import Program, program

from gloc3.log.commands import list_commands
from gloc3.log.reader import LogReader
from gloc3.messages.topics import TopicTable
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


def made(folder: Path, *words: str) -> None:
    """Runs a command that is to succeed."""
    with program(*words, folder=folder) as command:
        assert command.end() == 0, command.text


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    """A network of one platform, an operator and an observer."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    made(tmp_path, "network", "init", "yard")
    made(tmp_path, "network", "add", "yard", "pelican.main", "--role", "platform", "--listen", f"127.0.0.1:{port}")
    made(tmp_path, "network", "add", "yard", "alice", "--role", "operator")
    made(tmp_path, "network", "add", "yard", "bob", "--role", "observer")
    return tmp_path


@contextmanager
def vehicle(folder: Path, *words: str) -> Iterator[Program]:
    """A simulated vehicle and its onboard process, on the network."""
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=folder),
        program(
            *("onboard", "pelican_rtk", "--autopilot", f"udpin://127.0.0.1:{cable}", "--out", "out"),
            *("--network", "yard/pelican.main/network.yaml", *words),
            folder=folder,
        ) as onboard,
    ):
        onboard.await_line(lambda line: "components; log in" in line)
        yield onboard
        onboard.interrupt()
        assert onboard.end() == 0, onboard.text


def station(folder: Path, member: str, *words: str) -> AbstractContextManager[Program]:
    """A station on the network."""
    network = f"yard/{member}/network.yaml"
    return program("station", "--headless", "--network", network, *words, folder=folder)


def test_an_operator_flies_over_it_and_an_observer_may_only_look(yard: Path) -> None:
    with vehicle(yard):
        with station(yard, "bob", "--mission", "hop") as bob:
            assert bob.end() == 4, bob.text
        assert "pelican  is heard" in bob.text, bob.text
        assert "station bob may look and not command: it is an observer" in bob.text
        with station(yard, "alice", "--mission", "hop") as alice:
            assert alice.end() == 0, alice.text
    with LogReader(yard / "out" / "log.mcap", TopicTable.installed().types) as reader:
        commands = list_commands(reader)
    assert {(one.sender, one.role, one.way) for one in commands} == {("alice", "operator", "network")}
    assert [one.what.split()[0] for one in commands] == ["Control", "LoadMission", "Steer"]


def test_a_revoked_member_is_shut_out_while_it_runs_and_its_mission_goes_on_by_radio(yard: Path) -> None:
    (radio,) = free_ports(1, socket.SOCK_DGRAM)
    with vehicle(yard, "--station", f"udpin://127.0.0.1:{radio}") as onboard:
        with station(yard, "alice", "--mission", "hop", "--link", f"udpout://127.0.0.1:{radio}") as alice:
            alice.await_line(lambda line: "mission is started" in line)
            made(yard, "network", "revoke", "yard", "alice")
            onboard.process.send_signal(signal.SIGHUP)
            onboard.await_line(lambda line: "is reloaded: 1 other member" in line)
            assert alice.end() == 0, alice.text
        assert alice.text.count(" is heard") == 1, "it never fell silent: " + alice.text
        with station(yard, "alice", "--mission", "hop", "--wait", "6") as again:
            assert again.end() == 5, again.text
        assert "pelican did not respond" in again.text or "a platform did not respond" in again.text, again.text
