"""Targets of what arrives on a MAVLink link: frames, signatures, and the messages of every microservice."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx as checksum
from tests.fuzz.target import fuzz_target

from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser, message, shape
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.router import Router
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.calibration import Calibration, CalibrationKind
from gloc3.mavlink.services.calibration_ardupilot import ArduPilotCalibration
from gloc3.mavlink.services.calibration_px4 import Px4Calibration
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.files.ftp import DATA_BYTES, read_payload
from gloc3.mavlink.services.files.ftp_client import FtpClient
from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3.mavlink.services.files.log_client import LogClient
from gloc3.mavlink.services.heartbeat import MavlinkPeers
from gloc3.mavlink.services.mission_client import MissionClient
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.parameter import Parameter, ParameterType
from gloc3.mavlink.services.parameter_client import ParameterClient
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3.mavlink.services.statustext import StatusTextReceiver
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.mavlink.signing import Signing, SigningVerdict, is_signed_with

VEHICLE, STATION = Address(1, 1), Address(255, 190)
KEY: Final = bytes(range(32))
NAMES: Final = (
    "HEARTBEAT",
    "COMMAND_LONG",
    "PARAM_SET",
    "SYSTEM_TIME",
    "FILE_TRANSFER_PROTOCOL",
    "SETUP_SIGNING",
    "TUNNEL",
)
MOST_SENT: Final = 1000
"""Messages that a service may answer one message with."""


@fuzz_target("gloc3.mavlink")
def mavlink_stream(data: bytes) -> None:
    """From any stream or datagram come only frames whose bytes are in it; each is decoded, and every byte is counted."""
    for size in (len(data) or 1, 7, 64):
        parser = Parser()
        stream = data + bytes(300)  # quiet enough behind it to end every doubt
        frames = [
            frame for begin in range(0, len(stream), size) for frame in parser.receive(stream[begin : begin + size])
        ]
        assert sum(len(frame.raw) for frame in frames) + parser.bytes_dropped == len(stream)
        for frame in frames:
            assert frame.raw in stream
            frame.decode()
    datagrams = Parser(is_datagram=True)
    for frame in datagrams.receive(data):
        frame.decode()
        assert frame.sender.system == frame.system


@fuzz_target("gloc3.mavlink.router", "gloc3.mavlink.fair_share")
def router(data: bytes) -> None:
    """Frames of anybody on three links are forwarded unchanged, never to where they came from, and few senders are kept."""
    sent: dict[str, list[Frame]] = {"autopilot": [], "station": [], "network": []}
    router = Router(Address(1, 191))
    links = [router.attach(name, sent[name].extend) for name in sent]
    place, now_s = 0, 0.0
    while place + 6 <= len(data):
        head, length = data[place], data[place + 1]
        payload = data[place + 6 : place + 6 + length]
        system, component, sequence = data[place + 2 : place + 5]
        name = NAMES[data[place + 5] % len(NAMES)]
        place, now_s = place + 6 + length, now_s + (head >> 2) / 20.0
        source = links[head % len(links)]
        frame = framed(name, payload, bytes((sequence, system, component)))
        counts = {link: len(frames) for link, frames in sent.items()}
        router.route(source, [frame], now_s)
        for link, frames in sent.items():
            added = frames[counts[link] :]
            assert len(added) <= 1
            assert all(one.raw == frame.raw for one in added)
            assert not (added and link == source.name)


@fuzz_target("gloc3.mavlink")
def signing(data: bytes) -> None:
    """No frame counts as genuine that is not signed with the key, or that has come before; few are remembered."""
    signing = Signing(KEY, link_id=1, now=1000)
    genuine = set[bytes]()
    for frame in Parser(is_datagram=True).receive(data):
        verdict = signing.verify(frame)
        if verdict is SigningVerdict.GENUINE:
            assert is_signed_with(KEY, frame)
            assert frame.raw not in genuine
            genuine.add(frame.raw)
    assert signing.timestamp < 1 << 48
    signing.sign(Encoder(1, 1).encode(message("HEARTBEAT")))


def messages_of(data: bytes, names: tuple[str, ...]) -> list[tuple[MavlinkMessage, bytes]]:
    """Messages whose payloads are pieces of the data: a byte that names one, a length, and what is in it."""
    found, place = [], 0
    while place + 2 <= len(data):
        name, length = names[data[place] % len(names)], data[place + 1]
        payload = data[place + 2 : place + 2 + length]
        place += 2 + length
        found.append((decoded(name, payload), payload))
    return found


def framed(name: str, payload: bytes, sender: bytes = b"\0\1\1") -> Frame:
    """A frame of that message with such a payload: its sequence, system and component, and a right checksum."""
    layout = shape(name)
    body = payload[: layout.size].ljust(1, b"\0")
    head = bytes([0xFD, len(body), 0, 0]) + sender + layout.id.to_bytes(3, "little") + body
    check = checksum(head[1:] + layout.crc_extra)
    (frame,) = Parser(is_datagram=True).receive(head + check.to_bytes(2, "little"))
    return frame


def decoded(name: str, payload: bytes) -> MavlinkMessage:
    """A message of that name with such a payload, as it comes out of a frame."""
    found = framed(name, payload).decode()
    assert found is not None
    return found


def drive(services: list[Microservice[Any]], data: bytes, sender: Address) -> None:
    """Has services receive any messages of theirs, a tenth of a second apart."""
    names = tuple(sorted(set().union(*(service.handles for service in services))))
    now_s = 0.0
    for received, _ in messages_of(data, names):
        now_s += 0.1
        for service in services:
            if received.name in service.handles:
                service.receive(received, sender, now_s)
            service.tick(now_s)
            sent = service.outgoing()
            assert len(sent) <= MOST_SENT
            for one in sent:
                Encoder(9, 9).encode(one)
            due_s = service.next_tick_s()
            assert due_s is None or due_s == due_s
            service.events()


@fuzz_target("gloc3.mavlink.services")
def clients_of_services(data: bytes) -> None:
    """Whatever an autopilot answers, a station's services raise nothing, and send little and only what can be sent."""
    parameters, missions, logs = ParameterClient(STATION), MissionClient(STATION), LogClient(STATION)
    parameters.fetch(VEHICLE, now_s=0.0)
    parameters.set(VEHICLE, "A", 1.0, ParameterType.REAL32, now_s=0.0)
    missions.download(VEHICLE, now_s=0.0)
    logs.list(VEHICLE, now_s=0.0)
    commands = MavCommandClient(STATION)
    commands.send_long(VEHICLE, 400, (1.0,), now_s=0.0)
    calibrations: list[Calibration] = [
        Px4Calibration(STATION, VEHICLE, CalibrationKind.ACCELEROMETER),
        ArduPilotCalibration(STATION, VEHICLE, CalibrationKind.MAGNETOMETER),
    ]
    for calibration in calibrations:
        calibration.begin(0.0)
    rest: list[Microservice[Any]] = [StatusTextReceiver(STATION), TimeSync(STATION, VEHICLE), MavlinkPeers(STATION)]
    drive([parameters, missions, logs, commands, *calibrations, *rest], data, VEHICLE)


@fuzz_target("gloc3.mavlink.services")
def servers_of_services(data: bytes) -> None:
    """Whatever a station asks, a vehicle's services raise nothing, and send little and only what can be sent."""
    rows = [Parameter("A", 1.0, ParameterType.REAL32), Parameter("B_NAME_OF_16_ABC", 7, ParameterType.INT32)]
    drive([ParameterServer(VEHICLE, rows), MissionServer(VEHICLE), TimeSync(VEHICLE)], data, STATION)


@fuzz_target("gloc3.mavlink.services.files")
def ftp(data: bytes) -> None:
    """Any requests and answers are survived; nothing outside the served folder is read, changed or named."""
    with TemporaryDirectory(prefix="gloc3-ftp-") as name:
        outside = Path(name, "outside")
        outside.write_bytes(b"secret")
        folder = Path(name, "served")
        folder.mkdir()
        (folder / "a.txt").write_bytes(b"abc" * 200)
        server, client = FtpServer(VEHICLE, FolderFiles(folder, most_bytes=100_000)), FtpClient(STATION)
        client.read(VEHICLE, "/a.txt", now_s=0.0)
        client.list(VEHICLE, "/", now_s=0.0)
        now_s = 0.0
        for received, _ in messages_of(data, ("FILE_TRANSFER_PROTOCOL",)):
            now_s += 0.05
            server.receive(received, STATION, now_s)
            client.receive(received, VEHICLE, now_s)
            for service in (server, client):
                service.tick(now_s)
                for sent in service.outgoing():
                    answer = read_payload(sent.payload)
                    assert answer is not None
                    assert len(answer.data) <= DATA_BYTES
                    assert b"secret" not in answer.data
                service.events()
        assert sorted(path.name for path in Path(name).iterdir()) == ["outside", "served"]
        assert outside.read_bytes() == b"secret"
