"""What range finders send: Benewake's frames, and packets of LightWare's LWNX protocol."""

import struct
from typing import Final, NamedTuple

from fastcrc import crc16

HEAD: Final = b"\x59\x59"
FRAME_BYTES: Final = 9
NO_ECHO: Final = 0xFFF0
"""From here on a distance is a code of Benewake: too weak, saturated, dazzled."""

START: Final = 0xAA
LEAST_BYTES: Final = 6
"""Start, two of flags, command, two of checksum."""
MOST_BYTES: Final = 40
"""The longest packet that is read here is a name of 16 bytes; longer ones come from bytes that only look like a start."""
PRODUCT_NAME, DISTANCE_OUTPUT, STREAM, DISTANCE = 0, 27, 30, 44
"""LightWare's commands."""
FIRST_MEDIAN: Final = struct.pack("<I", 1 << 2)
"""Distances to send: the median of the first return."""
STREAM_DISTANCES: Final = b"\x05"


class RangeDecoder:
    """Frames of Benewake's TF series: distance in centimetres, signal strength, checksum."""

    def __init__(self) -> None:
        self.damaged = 0
        """Times at which bytes were no frame."""
        self._remainder = bytearray()

    def receive(self, data: bytes) -> list[float | None]:
        """Receives bytes and returns the distances that are complete, in metres; None for one without an echo."""
        self._remainder += data
        found: list[float | None] = []
        while len(self._remainder) >= FRAME_BYTES:
            frame = bytes(self._remainder[:FRAME_BYTES])
            if not frame.startswith(HEAD) or sum(frame[:-1]) & 0xFF != frame[-1]:
                self.damaged += 1
                begin = self._remainder.find(HEAD, 1)
                del self._remainder[: begin if begin > 0 else len(self._remainder) - 1]
                continue
            del self._remainder[:FRAME_BYTES]
            (distance_cm,) = struct.unpack_from("<H", frame, 2)
            found.append(None if distance_cm == 0 or distance_cm >= NO_ECHO else distance_cm * 0.01)
        return found


class LwnxPacket(NamedTuple):
    """A packet of a LightWare range finder."""

    command: int
    data: bytes


def lwnx_packet(command: int, data: bytes = b"") -> bytes:
    """The bytes of a packet that writes `data`, or without any reads."""
    packet = struct.pack("<BHB", START, (len(data) + 1) << 6 | bool(data), command) + data
    return packet + struct.pack("<H", crc16.xmodem(packet))


class LwnxReader:
    """Cuts packets out of a stream."""

    def __init__(self) -> None:
        self.damaged = 0
        """Times at which bytes were no packet."""
        self._remainder = bytearray()

    def receive(self, data: bytes) -> list[LwnxPacket]:
        """Receives bytes and returns the packets that are complete."""
        self._remainder += data
        found: list[LwnxPacket] = []
        while len(self._remainder) >= LEAST_BYTES:
            _, flags, command = struct.unpack_from("<BHB", self._remainder)
            end = 3 + (flags >> 6) + 2
            is_possible = self._remainder[0] == START and LEAST_BYTES <= end <= MOST_BYTES
            if is_possible and len(self._remainder) < end:
                break
            packet = bytes(self._remainder[:end])
            if not is_possible or crc16.xmodem(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                self.damaged += 1
                begin = self._remainder.find(START, 1)
                del self._remainder[: begin if begin > 0 else len(self._remainder)]
                continue
            del self._remainder[:end]
            found.append(LwnxPacket(command, packet[4:-2]))
        return found
