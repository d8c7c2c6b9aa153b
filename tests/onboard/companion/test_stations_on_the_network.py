"""Real processes on a network of their own: an operator flies over it, an observer looks, a second way takes over."""

import signal
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, chdir, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest
from tests.commands.programs import Program, program

from gloc3 import __version__
from gloc3.cli.program import run
from gloc3.log.commands import list_commands
from gloc3.log.reader import LogReader
from gloc3.messages.command_interface import Inventory
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.platform.reader import whole_text
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


def made(folder: Path, *words: str) -> None:
    """Runs a command that is to succeed, in this process."""
    with chdir(folder):
        assert run(words) == 0, words


def pushed(folder: Path) -> Program:
    """The program that pushes the list of revoked members, after its end."""
    with program("network", "push", "yard/office/network.yaml", folder=folder) as push:
        assert push.end() == 0, push.text
    return push


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
def vehicle(folder: Path, *words: str, platform: str = "pelican_rtk") -> Iterator[Program]:
    """A simulated vehicle and its onboard process, on the network."""
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=folder),
        program(
            *("onboard", platform, "--autopilot", f"udpin://127.0.0.1:{cable}", "--out", "out"),
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


def test_a_pushed_list_reaches_a_vehicle_in_flight_through_a_router_and_its_end_leaves_what_is_safe(yard: Path) -> None:
    (port,) = free_ports(1, socket.SOCK_STREAM)
    made(yard, "network", "add", "yard", "root", "--role", "router", "--listen", f"127.0.0.1:{port}")
    for name in ("carol", "office"):
        made(yard, "network", "add", "yard", name, "--role", "operator")
    with (
        program("network", "router", "yard/root/network.yaml", folder=yard) as root,
        vehicle(yard) as onboard,
        station(yard, "alice", "--mission", "hop") as alice,
        station(yard, "carol") as carol,
    ):
        alice.await_line(lambda line: "mission is started" in line)
        carol.await_line(lambda line: "is heard" in line)
        made(yard, "network", "revoke", "yard", "carol")
        push = pushed(yard)
        assert {"alice: list 2", "carol: list 2", "pelican.main: list 2", "root: list 2"} <= set(push.lines), push.text
        for process in (onboard, root):
            process.await_line(lambda line: line.endswith("it revokes carol"))
        root.await_line(lambda line: "for 5 members" in line)
        assert alice.end() == 0, alice.text
        carol.interrupt()
        with station(yard, "carol", "--mission", "hop", "--wait", "4") as again:
            assert again.end() == 2, again.text
        assert "carol is revoked by list 2 of revoked members" in again.text
        register.confirm(yard / "yard", datetime.now(UTC) - timedelta(days=3), days=1)
        pushed(yard)
        onboard.await_line(lambda line: "list 3 of revoked members has ended" in line)
        with station(yard, "alice", "--mission", "hop") as alice:
            assert alice.end() == 4, alice.text
        assert "so that alice may only look, hold, pause, abort, return and land" in alice.text
        with station(yard, "alice", "--platform", "pelican", "--do", "hold", "--within", "2") as alice:
            alice.end()
        assert "error: hold" in alice.text
        assert "only look, hold" not in alice.text, "it is refused for another reason: " + alice.text


def test_inventory_and_logs_of_a_fleet_of_which_one_vehicle_is_not_there(yard: Path) -> None:
    made(yard, "network", "add", "yard", "heron.main", "--role", "platform")
    with vehicle(yard):
        with station(yard, "alice", "--mission", "hop") as alice:
            assert alice.end() == 0, alice.text
        listing = ("network", "inventory", "yard/bob/network.yaml", "--json", "--wait", "4")
        with program(*listing, folder=yard) as inventory:
            assert inventory.end() == 1, inventory.text
        assert "heron: did not respond within 4 s" in inventory.text
        json = inventory.text[inventory.text.index("{") : inventory.text.rindex("}") + 1]
        found = msgspec.json.decode(json, type=dict[str, Inventory])["pelican"]
        assert found.firmware.startswith("px4 1.")
        assert (found.version, found.armings) == (__version__, 1)
        assert 3.0 < found.armed_s < found.powered_s
        assert 50 <= found.battery_percent <= 100
        pull = ("log", "pull", "--platform", "all", "--wait", "4", "--out", "here")
        with program(*pull, "yard/bob/network.yaml", folder=yard) as observer:
            assert observer.end() == 1, observer.text
        assert "pelican/the current log was not closed: " in observer.text
        assert "pelican has no finished logs" in observer.text
        with program(*pull, "yard/alice/network.yaml", folder=yard) as operator:
            assert operator.end() == 1, operator.text
        assert "pelican/log.mcap" in operator.text
        assert "digest equal, deleted onboard" in operator.text
        assert "heron: did not respond" in operator.text
    assert (yard / "here" / "pelican" / "log.mcap").exists()


def test_a_radios_key_has_the_rights_of_its_member_and_every_refusal_names_who_may(yard: Path) -> None:
    made(yard, "network", "add", "yard", "carol", "--role", "operator")
    rights = "rights: [{member: alice, role: operator, of: [pelican], may: [land]}, {member: carol, role: commander, of: [all]}]"
    (yard / "yard" / "rights.yaml").write_text(rights)
    made(yard, "network", "rights", "yard")
    for name in ("carol", "nobody"):
        made(yard, "signing", "new", f"{name}.key")
    (yard / "pelican.yaml").write_text(f"{whole_text('pelican_rtk')}\nmembers: {{carol: carol.key}}\n")
    ports = free_ports(2, socket.SOCK_DGRAM)
    radios = {name: f"127.0.0.1:{port}" for name, port in zip(("carol", "nobody"), ports, strict=True)}
    links = [text for name, at in radios.items() for text in ("--station", f"udpin://{at}?key={name}.key")]
    with vehicle(yard, *links, platform="pelican.yaml") as onboard:
        assert "its key stands for no member, so its stations may only look" in onboard.text
        with station(yard, "alice", "--mission", "hop") as alice:
            assert alice.end() == 4, alice.text
        assert "this station is operator (only land)" in alice.text
        assert "alice may not use" in alice.text
        for name, code in (("nobody", 4), ("carol", 0)):
            radio = ("--link", f"udpout://{radios[name]}", "--signing-key", f"{name}.key")
            with program("station", "--headless", *radio, "--mission", "hop", "--take-over", folder=yard) as there:
                assert there.end() == code, there.text
            if code:
                assert "of pelican, and this link stands for no member" in there.text


def test_rights_hold_over_two_routers_which_are_processes_and_read_their_files_again(yard: Path) -> None:
    root, coast = (f"127.0.0.1:{port}" for port in free_ports(2, socket.SOCK_STREAM))
    made(yard, "network", "add", "yard", "root", "--role", "router", "--listen", root)
    made(yard, "network", "add", "yard", "coast", "--role", "router", "--listen", coast)
    for name in ("alice", "carol"):
        made(yard, "network", "add", "yard", name, "--role", "operator", "--to", "coast", "--renew")
    rights = "rights: [{member: alice, role: operator, of: [pelican], may: [land]}, {member: carol, role: operator, of: [all]}]"
    (yard / "yard" / "rights.yaml").write_text(rights)
    made(yard, "network", "rights", "yard")
    with (
        program("network", "router", "yard/root/network.yaml", folder=yard) as top,
        program("network", "router", "yard/coast/network.yaml", folder=yard) as below,
        vehicle(yard),
    ):
        top.await_line(lambda line: "router: pelican.main is connected" in line)
        with station(yard, "alice", "--mission", "hop") as alice:
            assert alice.end() == 4, alice.text
        assert "alice may not use" in alice.text
        with station(yard, "carol", "--mission", "hop") as carol:
            assert carol.end() == 0, carol.text
        below.await_line(lambda line: "router: carol has left" in line)
        made(yard, "network", "revoke", "yard", "carol")
        below.interrupt(signal.SIGHUP)
        below.await_line(lambda line: "coast of yard listens at" in line and "for 4 members" in line)
        with station(yard, "carol", "--mission", "hop", "--wait", "2") as again:
            assert again.end() == 5, again.text
        for router in (below, top):
            router.interrupt()
            assert router.end() == 0, router.text
