"""What each command listens on, as the kernel says, and what it says of links that a network reaches."""

from pathlib import Path

import pytest
from tests.commands.listening import ALONE, listening
from tests.commands.programs import program

from gloc3.network.cli import app as network

pytestmark = pytest.mark.sockets

ON_LOOPBACK = {
    "sitl": ("companion link", "udp udp"),
    "sitl --autopilot ardupilot --sensors 0 --dvl a50://127.0.0.1:16171 --vehicle rov": (
        "Doppler velocity log",
        "tcp tcp tcp udp udp",
    ),
    "relay udpin://:15001 udpout://127.0.0.1:15002": ("relaying between", "udp udp"),
    "onboard pelican_rtk --out out": ("components; log in", "udp udp"),
    "onboard pelican_rtk --out out --network yard/pelican.main/network.yaml": ("components; log in", "tcp tcp udp"),
    "station --headless --config none.toml": ("listening on", "udp"),
    "station --web --foxglove --config none.toml": ("the station is at", "tcp tcp udp"),
    "station --web --config none.toml --network yard/alice/network.yaml": ("the station is at", "tcp"),
}
"""What each command says once its sockets are open, and their kinds; the platform of the network is on loopback."""


def make_network(folder: Path) -> None:
    yard = str(folder / "yard")
    for words in (
        ("init", yard),
        ("add", yard, "pelican.main", "--role", "platform", "--listen", "127.0.0.1:7447"),
        ("add", yard, "alice", "--role", "operator"),
    ):
        assert not network(words, result_action="return_value")


@pytest.mark.parametrize("line", ON_LOOPBACK)
def test_no_command_listens_to_a_network_unless_it_is_given_an_address(tmp_path: Path, line: str) -> None:
    words = line.split()
    if "--network" in words:
        make_network(tmp_path)
    with program(*words, folder=tmp_path, before=ALONE) as running:
        said, kinds = ON_LOOPBACK[line]
        running.await_line(lambda text: said in text)
        found = listening(running.process.pid)
    assert not [str(one) for one in found if one.is_open]
    assert " ".join(one.kind for one in found) == kinds, [str(one) for one in found]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("sitl --link tcpin://0.0.0.0:5790", "tcpin://0.0.0.0:5790 is open to the network and not signed"),
        ("sitl --vehicle rov --dvl a50://0.0.0.0:16171", "a50://0.0.0.0:16171 is open to the network"),
        ("relay udpin://0.0.0.0:15001 udpout://127.0.0.1:15002", "udpin://0.0.0.0:15001 is open to the network"),
        (
            "station --headless --config none.toml --acoustic auv=udpin://0.0.0.0:15003",
            "udpin://0.0.0.0:15003 is open to the network and not signed",
        ),
        ("station --web --config none.toml --web-host 0.0.0.0", "warning: anyone with the address"),
        (
            "doctor pelican_rtk --autopilot udpin://0.0.0.0:14540",
            "udpin://0.0.0.0:14540 is open to the network and not signed",
        ),
    ],
)
def test_a_link_that_is_open_to_the_network_is_told_at_the_start(tmp_path: Path, line: str, told: str) -> None:
    with program(*line.split(), folder=tmp_path, before=ALONE) as running:
        running.await_line(lambda text: told in text)
        assert [one for one in listening(running.process.pid) if one.is_open]
