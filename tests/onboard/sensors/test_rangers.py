"""Range finders on serial lines: frames as in their makers' manuals, damage, and both devices over a pseudo-terminal."""

import os
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error
from gloc3_onboard.components.samplers.height import HeightSampler
from gloc3_onboard.sensors import threaded
from gloc3_onboard.sensors.registry import parse_source
from gloc3_onboard.sensors.sources.ranger import Ranger
from gloc3_onboard.sensors.sources.ranger_wire import LwnxPacket, LwnxReader, RangeDecoder, lwnx_packet

TEN_METRES = bytes.fromhex("59 59 e8 03 90 01 40 0a 78")
"""Benewake's example of 1000 cm (0x03e8), with a strength of 400."""
TOO_WEAK = bytes.fromhex("59 59 ff ff 0a 00 40 0a 04")
NOTHING = bytes.fromhex("59 59 00 00 20 00 40 0a 1c")
WITHIN_S = 10.0


def test_a_frame_is_a_distance_in_centimetres_and_its_codes_are_no_echo() -> None:
    assert RangeDecoder().receive(TEN_METRES + TOO_WEAK + NOTHING) == [10.0, None, None]


def test_frames_come_in_any_pieces_and_damaged_ones_are_left_out() -> None:
    decoder = RangeDecoder()
    stream = b"\x59\x01" + TEN_METRES + TEN_METRES[:4] + b"\x00" + TEN_METRES + b"\x59\x59\x59" + TEN_METRES
    found = [distance for byte in stream for distance in decoder.receive(bytes([byte]))]
    assert found == [10.0, 10.0, 10.0]
    assert decoder.damaged > 0
    wrong = TEN_METRES[:-1] + b"\x79"
    assert RangeDecoder().receive(wrong + TEN_METRES) == [10.0]


def test_a_packet_of_lwnx_has_length_direction_and_checksum() -> None:
    """The length counts the command; the checksum is XMODEM's, of all bytes before it."""
    assert lwnx_packet(0) == bytes.fromhex("aa 40 00 00") + _crc(bytes.fromhex("aa 40 00 00"))
    assert lwnx_packet(30, b"\x05") == bytes.fromhex("aa 81 00 1e 05") + _crc(bytes.fromhex("aa 81 00 1e 05"))


def _crc(data: bytes) -> bytes:
    """CRC-16 with the polynomial 0x1021 from 0, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return struct.pack("<H", value)


def test_packets_come_in_any_pieces_and_damaged_ones_are_left_out() -> None:
    reader, packet = LwnxReader(), lwnx_packet(44, struct.pack("<h", 123))
    stream = b"\xaa\x00" + packet + packet[:-1] + b"\x00" + packet + b"LW20 menu\r\n" + packet
    found = [one for byte in stream for one in reader.receive(bytes([byte]))]
    assert found == [LwnxPacket(44, struct.pack("<h", 123))] * 3
    assert reader.damaged > 0
    reader.receive(b"\xaa\xff\xff" + bytes(2000))
    assert reader.receive(packet) == found[:1]


@contextmanager
def terminal(peer: Callable[[int, threading.Event], None]) -> Iterator[str]:
    """A serial line on whose other end a device is; its path."""
    device, ours = os.openpty()
    tty.setraw(ours)
    stop = threading.Event()
    thread = threading.Thread(target=peer, args=(device, stop), daemon=True)
    thread.start()
    try:
        yield os.ttyname(ours)
    finally:
        stop.set()
        thread.join(WITHIN_S)
        os.close(device)
        os.close(ours)


def tf_mini(device: int, stop: threading.Event) -> None:
    """Sends distances by itself."""
    while not stop.wait(0.01):
        os.write(device, TEN_METRES)


def lw20(device: int, stop: threading.Event) -> None:
    """Does not answer its first two requests, and streams what it was told to."""
    reader, requests, output, is_streaming = LwnxReader(), 0, 0, False
    os.set_blocking(device, False)
    while not stop.wait(0.01):
        try:
            data = os.read(device, 1000)
        except BlockingIOError:
            data = b""
        for packet in reader.receive(data):
            requests += 1
            if packet.command == 0 and requests > 2:
                os.write(device, lwnx_packet(0, b"LW20".ljust(16, b"\0")))
            elif packet.command == 27:
                (output,) = struct.unpack("<I", packet.data)
            elif packet.command == 30:
                is_streaming = packet.data == b"\x05"
        if is_streaming and output == 1 << 2:
            os.write(device, lwnx_packet(44, struct.pack("<h", 456)))


@pytest.mark.sockets
@pytest.mark.parametrize(("scheme", "peer", "height_m"), [("benewake", tf_mini, 10.0), ("lightware", lw20, 4.56)])
def test_a_sampler_reports_what_a_device_on_a_serial_line_measures(
    scheme: str, peer: Callable[[int, threading.Event], None], height_m: float
) -> None:
    with terminal(peer) as path, Bench() as bench:
        url = parse_source("height", f"{scheme}://{path}?offset_m=0.05")
        device = Ranger("height", url, bench.loop.time)
        row = ComponentRow(name="height", class_name="x:Y", rate_hz=20.0)
        bench.host(row, lambda: HeightSampler(device))
        end_s = time.monotonic() + WITHIN_S
        while not bench.all("height"):
            assert time.monotonic() < end_s
            time.sleep(0.02)
            bench.run(0.1)
        found = bench.last("height")
        assert found.height_m == pytest.approx(height_m + 0.05)
        assert found.is_valid
        bench.command("height", "stop")
        until(lambda: not device.is_reading)


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def chatter(device: int, stop: threading.Event) -> None:
    """Another device."""
    while not stop.wait(0.005):
        os.write(device, b"$GPGGA,123519,4807.038,N\r\n")


@pytest.mark.sockets
@pytest.mark.parametrize(
    ("scheme", "why"),
    [("benewake", "does not send frames of a Benewake"), ("lightware", "does not answer as a LightWare")],
)
def test_another_device_is_given_up_with_the_reason(scheme: str, why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threaded, "GIVE_UP_S", 0.0)
    with terminal(chatter) as path:
        device = Ranger("height", parse_source("height", f"{scheme}://{path}"), time.monotonic)
        device.open()
        until(lambda: not device.is_reading)
        with pytest.raises(Gloc3Error, match=why):
            device.height()


def test_a_device_that_is_not_there_is_refused() -> None:
    device = Ranger("height", parse_source("height", "benewake:///dev/ttyNONE"), time.monotonic)
    with pytest.raises(Gloc3Error, match="/dev/ttyNONE is not there; is it plugged in"):
        device.on_height(lambda: None)
