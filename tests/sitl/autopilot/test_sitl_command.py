"""The command `gloc3 sitl`: its options, its links on real sockets, and how it ends."""

import re
import signal
import socket
import subprocess
import sys

import pytest

from gloc3.errors import Misuse, Refused
from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.cli.sitl import app, read_home, read_link, read_parameter

PROGRAM = "import sys; from gloc3_sitl.cli.sitl import app; sys.exit(app(sys.argv[1:], result_action='return_value'))"


def test_links_are_for_stations_unless_the_port_or_a_word_says_companion() -> None:
    assert read_link("udpout://127.0.0.1:14550").kind is LinkKind.GROUND
    assert read_link("udpout://127.0.0.1:14540").kind is LinkKind.COMPANION
    assert read_link("companion=tcpin://0.0.0.0:5760") == ("tcpin://0.0.0.0:5760", LinkKind.COMPANION)
    with pytest.raises((Misuse, Refused), match="companion"):
        read_link("compagnon=udpin://0.0.0.0:1")


def test_homes_and_parameters_are_read_or_refused() -> None:
    assert read_home("47.5,8.5,400,90") == ((47.5, 8.5, 400.0), 90.0)
    for bad in ("47.5,8.5", "a,b,c,d", "97,0,0,0", "47,8,400,nan"):
        with pytest.raises((Misuse, Refused)):
            read_home(bad)
    assert read_parameter("NAV_DLL_ACT=2") == ("NAV_DLL_ACT", 2.0)
    with pytest.raises((Misuse, Refused)):
        read_parameter("NAV_DLL_ACT")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--vehicle", "pelikan"],
        ["--autopilot", "px5"],
        ["--speed", "0"],
        ["--wind", "99"],
        ["--battery", "2"],
        ["--param", "NAV_DLL_ACT=99"],
    ],
)
def test_options_that_make_no_sense_are_refused(arguments: list[str]) -> None:
    with pytest.raises((Misuse, Refused)):
        app(arguments, result_action="return_value")


@pytest.mark.sockets
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_talks_on_its_link_and_ends_clean_at_a_signal(number: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "--speed", "5", "--link", "udpin://127.0.0.1:0"],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    try:
        text = ""
        for line in process.stderr:
            text += line
            found = re.search(r"port (\d+)", line)
            if found:
                break
        assert found is not None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.settimeout(10.0)
            greeting = Encoder(255, 190).encode(message("HEARTBEAT", type=6, autopilot=8))
            station.sendto(greeting, ("127.0.0.1", int(found[1])))
            received = Parser(is_datagram=True).receive(station.recv(2048))
        assert received[0].sender == (1, 1)
        process.send_signal(number)
        text += process.communicate(timeout=60)[1]
        assert process.returncode == 0
        assert "Traceback" not in text
        assert "ended after" in text
    finally:
        process.kill()
        process.wait()
