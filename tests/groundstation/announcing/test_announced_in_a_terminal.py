"""A vehicle's battery rings the bell of a real terminal, and is spoken by the program that the operator has."""

import re
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.groundstation.real_terminal import PtyTerminal, until

from gloc3.mavlink.codec import Encoder, message
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets


class Bells:
    """A terminal whose bells are counted; the ends of titles (OSC) are none."""

    def __init__(self, screen: PtyTerminal) -> None:
        self._shown = b""
        self._feed = screen.emulator.feed
        screen.emulator.feed = self._keep  # type: ignore[method-assign]

    @property
    def count(self) -> int:
        return re.sub(rb"\x1b\][^\x07\x1b]*\x07", b"", self._shown).count(b"\a")

    def _keep(self, data: bytes) -> None:
        self._shown += data
        self._feed(data)


@contextmanager
def station(folder: Path, *options: str) -> Iterator[tuple[PtyTerminal, int]]:
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    link = ("--link", f"udpin://127.0.0.1:{port}")
    screen = PtyTerminal(("station", "--no-record", *link, *options), folder, 100, 30)
    try:
        yield screen, port
    finally:
        screen.close()


def test_an_alert_rings_and_is_spoken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "spd-say"
    own.write_text(f'#!/bin/sh\necho "$*" >> {tmp_path}/said\n')
    own.chmod(own.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with station(tmp_path, "--bell", "warning", "--speech", "error") as (screen, port):
        bells, encoder = Bells(screen), Encoder(1, 1)
        until(screen, str(port))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for _ in range(300):
                beat = message("HEARTBEAT", type=2, autopilot=12, base_mode=81, custom_mode=0, system_status=3)
                vehicle.sendto(encoder.encode(beat), ("127.0.0.1", port))
                charge = message("SYS_STATUS", voltage_battery=14000, battery_remaining=12)
                vehicle.sendto(encoder.encode(charge), ("127.0.0.1", port))
                screen.text()
                if (tmp_path / "said").exists() and bells.count:
                    break
                time.sleep(0.1)
    assert (tmp_path / "said").read_text() == "--wait px4-1, critical: battery at or below 15 %\n"
    assert bells.count == 1


def test_without_a_speech_program_the_station_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with station(tmp_path, "--speech", "warning") as (screen, _):
        until(screen, "no speech program is found (spd-say, espeak-ng, espeak or say)")
