"""A link for observers: who is on it sees everything, and commands neither the platform nor its autopilot."""

import socket
import time
from pathlib import Path

import pytest
from tests.commands.programs import program

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]

REQUEST_MESSAGE, AUTOPILOT_VERSION = 512, 148


def answers(port: int, station: int, timeout_s: float) -> set[str]:
    """The kinds of messages that come on a link, after a station asked the autopilot for something there."""
    found: set[str] = set()
    parser, encoder = Parser(is_datagram=True), Encoder(station, 190)
    request = message(
        "COMMAND_LONG", target_system=1, target_component=1, command=REQUEST_MESSAGE, param1=AUTOPILOT_VERSION
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.settimeout(0.2)
        until_s = time.monotonic() + timeout_s
        requested_s = 0.0
        while time.monotonic() < until_s and "COMMAND_ACK" not in found:
            if time.monotonic() - requested_s > 0.5:
                requested_s = time.monotonic()
                line.sendto(encoder.encode(message("HEARTBEAT", type=6, autopilot=8)), ("127.0.0.1", port))
                line.sendto(encoder.encode(request), ("127.0.0.1", port))
            try:
                data = line.recv(2048)
            except TimeoutError:
                continue
            found |= {frame.shape.name for frame in parser.receive(data) if frame.shape is not None}
    return found


def test_who_is_on_it_sees_everything_and_commands_nothing(tmp_path: Path) -> None:
    port, operators, observers = free_ports(3, socket.SOCK_DGRAM)
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{port}", folder=tmp_path),
        program(
            *("onboard", "pelican_rtk", "--autopilot", f"udpin://127.0.0.1:{port}", "--out", "out"),
            *("--station", f"udpin://127.0.0.1:{operators}"),
            *("--station", f"udpin://127.0.0.1:{observers}?role=observer"),
            folder=tmp_path,
        ) as onboard,
    ):
        onboard.await_line(lambda line: "components; log in" in line)
        assert "COMMAND_ACK" in answers(operators, 253, 30.0)
        seen = answers(observers, 252, 4.0)
        assert {"HEARTBEAT", "ALTITUDE", "TUNNEL"} <= seen
        assert "COMMAND_ACK" not in seen
        with program(
            *("station", "--headless", "--mission", "hop", "--link", f"udpout://127.0.0.1:{observers}"),
            *("--station-id", "254"),
            folder=tmp_path,
        ) as station:
            assert station.end() == 4, station.text
        assert "station 254 may look and not command: it is an observer" in station.text
        onboard.interrupt()
        assert onboard.end() == 0, onboard.text
