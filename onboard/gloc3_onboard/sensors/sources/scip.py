"""SCIP 2, the language of Hokuyo's range scanners: replies cut out of a stream, checked and decoded; no I/O.

Hokuyo, "URG Series Communication Protocol Specification SCIP-Version 2.0" (C-42-03320B).
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error

STOP: Final = b"QT\n"
IDENTIFY: Final = b"PP\n"
LASER_ON: Final = b"BM\n"
BLOCK: Final = 64
"""Characters of data in a line, before its checksum."""
MOST_BYTES: Final = 1 << 16
"""Of one reply."""
STAMP_MS: Final = 1 << 24
"""The scanner's clock wraps there."""
FAILED: Final = "the scanner does not send SCIP 2"


class ScipError(Gloc3Error):
    """A reply that cannot be read."""


class ScannerParameters(NamedTuple):
    """Properties that a scanner reports."""

    model: str
    min_mm: int
    max_mm: int
    steps_a_turn: int
    first: int
    last: int
    front: int
    """The step that points ahead."""
    turns_a_minute: int


class ScipScan(NamedTuple):
    """One turn."""

    stamp_ms: int
    """Of the scanner's own clock, modulo 2**24."""
    ranges_mm: Sequence[int]


class ScipReader:
    """Cuts replies out of a stream: lines, ended by an empty one."""

    def __init__(self) -> None:
        self._remainder = b""

    def receive(self, data: bytes) -> list[list[bytes]]:
        """Handles received bytes; returns the complete replies.

        Raises:
            ScipError: a reply does not end.
        """
        self._remainder += data
        *whole, self._remainder = self._remainder.split(b"\n\n")
        if len(self._remainder) > MOST_BYTES:
            raise ScipError(FAILED)
        return [reply.lstrip(b"\n").split(b"\n") for reply in whole]


def measure(parameters: ScannerParameters) -> bytes:
    """The command for distances of all steps, turn after turn until `STOP`."""
    return f"MD{parameters.first:04d}{parameters.last:04d}01000\n".encode()


def checked(line: bytes) -> bytes:
    """A line without its checksum.

    Raises:
        ScipError: the checksum is another.
    """
    body, check = line[:-1], line[-1:]
    if not body or check != bytes([(sum(body) & 0x3F) + 0x30]):
        raise ScipError("a line has a wrong checksum")
    return body


def parameters_of(reply: Sequence[bytes]) -> ScannerParameters:
    """The answer to `IDENTIFY`: `PP`, a status, and lines `KEY:VALUE;` with a checksum.

    Raises:
        ScipError: it is none.
    """
    values: dict[str, str] = {}
    for line in reply[2:]:
        text, _, check = line.rpartition(b";")
        if not text or check != bytes([(sum(text) & 0x3F) + 0x30]):
            raise ScipError("a line has a wrong checksum")
        key, _, value = text.decode("ascii", "replace").partition(":")
        values[key] = value
    return _parameters(values)


def _parameters(values: Mapping[str, str]) -> ScannerParameters:
    try:
        numbers = [int(values[key]) for key in ("DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")]
    except (KeyError, ValueError) as error:
        raise ScipError(f"it does not report its parameters: {error}") from error
    found = ScannerParameters(values.get("MODL", "").strip(), *numbers)
    if not (0 <= found.first < found.last < 10_000 and 0 < found.steps_a_turn < 100_000 and found.turns_a_minute > 0):
        raise ScipError("its parameters are impossible")
    return found


def turn_of(reply: Sequence[bytes], count: int) -> ScipScan:
    """A turn: the command's echo, `99` with a checksum, a stamp of four characters, then blocks of data.

    Args:
        reply: the lines.
        count: how many distances belong in it.

    Raises:
        ScipError: it is no turn, or damaged.
    """
    if len(reply) < 4 or not reply[0].startswith(b"MD") or reply[1][:2] != b"99":
        status = reply[1][:2].decode("ascii", "replace") if len(reply) > 1 else "none"
        raise ScipError(f"no turn, but status {status}")
    data = b"".join(checked(line) for line in reply[3:])
    if len(data) != 3 * count:
        raise ScipError(f"{len(data) // 3} distances, where {count} belong")
    digits = [byte - 0x30 for byte in data]
    if min(digits) < 0 or max(digits) > 0x3F:
        raise ScipError(FAILED)
    ranges = [
        high << 12 | middle << 6 | low
        for high, middle, low in zip(digits[::3], digits[1::3], digits[2::3], strict=True)
    ]
    stamp = 0
    for byte in checked(reply[2]):
        stamp = stamp << 6 | (byte - 0x30) & 0x3F
    return ScipScan(stamp, ranges)
