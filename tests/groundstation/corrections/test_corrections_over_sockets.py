"""Corrections from a caster, a TCP server and a serial base over real sockets, to simulated vehicles that use them."""

import asyncio
import os
import pty
import ssl
import subprocess
import tty
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.common.rtcm_frames import base_position, framed, observations
from tests.groundstation.services.test_services_with_sitl import simulated, until

from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.corrections import source as connection
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.snapshots import CorrectionsSnapshot, PlatformSnapshot

from .caster import Caster, serving

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

BASE = GeoPoint(47.4067, 8.5456, 490.0)
"""A kilometre north of the vehicle."""


def corrections(number: int) -> bytes:
    """Observations each time, the longest in four pieces; the base's position and what is too long now and then."""
    rare = base_position(BASE) + framed(bytes((0x43, 0x50)) + bytes(800)) if number % 5 == 0 else b""
    damaged = bytearray(observations(80, 1097, number))
    damaged[20] ^= 1
    return rare + observations(650, 1077, number) + observations(100, 1087, number) + bytes(damaged)


@asynccontextmanager
async def station(*urls: str, folder: Path | None = None) -> AsyncIterator[GroundStation]:
    ground = GroundStation(StationSetup(boot=5, record=folder))
    try:
        await ground.open(urls)
        yield ground
    finally:
        await ground.close()


def state(ground: GroundStation) -> CorrectionsSnapshot:
    found = ground.station.fleet.corrections
    assert found is not None
    return found


def fix_of(ground: GroundStation, name: str) -> int:
    platform = ground.station.fleet.get(name)
    return 0 if platform is None or platform.autopilot is None else platform.autopilot.fix_type


def vehicle(ground: GroundStation, name: str) -> PlatformSnapshot:
    found = ground.station.fleet.get(name)
    assert found is not None
    return found


def causes(ground: GroundStation) -> list[str]:
    return [cause.text for cause in alerts.causes(ground.station.fleet, ground.station.now_s()) if cause.what == "rtk"]


@pytest.mark.both_styles
@pytest.mark.parametrize(("style", "name", "version"), [("px4", "px4-1", 2), ("ardupilot", "ardupilot-1", 1)])
async def test_a_rover_gets_rtk_from_a_caster_and_loses_it_with_an_alert(
    style: str, name: str, version: int, tmp_path: Path
) -> None:
    caster = Caster(frames=corrections, version=version, wants_position=True)
    with simulated(style, "--plain-gps") as port:
        async with serving(caster), station(f"udpout://127.0.0.1:{port}", folder=tmp_path) as ground:
            await until(lambda: fix_of(ground, name) == 3)
            await ground.corrections.open(f"ntrip://me:s%2Fcret@127.0.0.1:{caster.port}/BASE")
            await until(lambda: fix_of(ground, name) == 6)
            await until(lambda: state(ground).base_ecef_m is not None and state(ground).rate_byte_s > 500.0)
            shown = state(ground)
            assert shown.types[:2] == (1005, 1077)
            assert 1087 in shown.types
            assert shown.damaged > 0
            assert shown.oversized > 0
            assert shown.links == 1
            assert any(line.startswith("$GPGGA,") for line in caster.positions), "it wants to know where the rover is"
            assert causes(ground) == []
            caster.is_sending = False
            await until(lambda: causes(ground) != [])
            await until(lambda: fix_of(ground, name) == 3)
            assert causes(ground)[0].startswith("no RTK corrections for more than 10 s")
            caster.is_sending = True
            await until(lambda: fix_of(ground, name) == 6)
            await until(lambda: causes(ground) == [])
            await ground.corrections.stop()
            assert ground.station.fleet.corrections is None
            texts = [event.text for event in ground.station.fleet.events]
            assert f"RTK corrections come from ntrip://127.0.0.1:{caster.port}/BASE" in texts
    kept = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert b"BASE" in kept
    assert not any(secret in kept for secret in (b"s/cret", b"s%2Fcret", b"bWU6cy9jcmV0")), "no password in any record"


async def test_what_a_caster_refuses_is_told_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "FIRST_WAIT_S", 0.2)
    caster = Caster(frames=corrections)
    async with station() as ground:
        unused = Caster(frames=corrections)
        async with serving(unused):
            pass
        source = ground.corrections
        await source.open(f"ntrip://127.0.0.1:{unused.port}/BASE")
        await until(lambda: state(ground).problem == "127.0.0.1: connection refused")
        async with serving(unused):
            await until(lambda: "asks for a user and a password (401)" in state(ground).problem)
        async with serving(caster):
            at = f"127.0.0.1:{caster.port}"
            caster.version = 1  # it closes without the end of its answer
            await source.open(f"ntrip://me:wrong@{at}/BASE")
            await until(lambda: "refuses the user or the password for 'BASE' (401)" in state(ground).problem)
            await source.open(f"ntrip://me:s%2Fcret@{at}/BAES")
            wanted = "no mountpoint 'BAES' at 127.0.0.1; did you mean 'BASE'? It has BASE, HILL"
            await until(lambda: state(ground).problem == wanted)
            await source.open(f"ntrip://{at}")
            await until(lambda: "a mountpoint has to be named" in state(ground).problem)
            await source.open(f"ntrip://me:s%2Fcret@{at}/HILL")
            await until(lambda: state(ground).received_s is not None)
            assert state(ground).problem == ""
        await until(lambda: state(ground).problem != "")
        before = state(ground).received_s
        async with serving(caster):
            await until(lambda: state(ground).received_s != before)
        texts = "\n".join(event.text for event in ground.station.fleet.events)
        assert "cret" not in texts
        assert "wrong" not in texts


async def test_a_caster_with_tls_has_to_be_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "FIRST_WAIT_S", 0.2)
    context, authority = certificates(tmp_path)
    async with serving(Caster(frames=corrections), context) as caster, station() as ground:
        url = f"ntrips://me:s%2Fcret@localhost:{caster.port}/BASE"
        await ground.corrections.open(url)
        await until(lambda: "its certificate is not trusted" in state(ground).problem)
        monkeypatch.setenv("SSL_CERT_FILE", str(authority))
        await until(lambda: state(ground).received_s is not None)


def certificates(folder: Path) -> tuple[ssl.SSLContext, Path]:
    """A server's context, and the file of the authority that vouches for it."""
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    subprocess.run(
        [
            *(
                "openssl",
                "req",
                "-x509",
                "-newkey",
                "ec",
                "-pkeyopt",
                "ec_paramgen_curve:prime256v1",
                "-nodes",
                "-days",
                "2",
            ),
            *("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"),
            *("-keyout", str(key), "-out", str(certificate)),
        ],
        check=True,
        capture_output=True,
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    return context, certificate


async def test_a_base_on_a_serial_line_and_one_behind_tcp() -> None:
    master, slave = pty.openpty()
    tty.setraw(master)
    async with station() as ground:
        await ground.corrections.open(f"serial://{os.ttyname(slave)}:115200")
        sending = asyncio.ensure_future(send_often(master))
        await until(lambda: state(ground).received_s is not None)
        sending.cancel()

        async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"$GNGGA,1*00\r\n" + corrections(0))
            await writer.drain()
            writer.close()
            server.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        await ground.corrections.open(f"tcp://127.0.0.1:{port}")
        await until(lambda: ground.station.fleet.corrections is not None and state(ground).received_s is not None)
        await until(lambda: state(ground).problem == "127.0.0.1: connection refused")
    os.close(master)
    os.close(slave)


async def send_often(master: int) -> None:
    number = 0
    while True:
        os.write(master, b"\xb5\x62\x01\x07" + corrections(number))
        number += 1
        await asyncio.sleep(0.2)
