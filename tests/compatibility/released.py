"""What earlier versions have written and sent, kept in `tests/data`."""

import gzip
from typing import Any, Final, NamedTuple

import msgspec
from tests.data_folders import OWN

LOG: Final = OWN / "log-of-0.1" / "log.mcap"
PEER: Final = OWN / "peer-of-0.1"


class Example(msgspec.Struct):
    """A message of an earlier version."""

    type: str
    """`Name#hash`."""
    bytes: bytes
    """Its envelope as it was encoded."""
    fields: dict[str, Any]


class Examples(msgspec.Struct):
    """The messages that a version knew."""

    version: str
    protocol: str
    """What it told other ends of its types."""
    messages: list[Example]


class Piece(NamedTuple):
    """What arrived at one end of a link at once."""

    t_s: float
    sender: str
    """`station` or `platform`."""
    data: bytes


class Transcript(msgspec.Struct):
    """What a station and a platform received from each other."""

    station_boot: int
    platform_boot: int
    pieces: list[Piece]

    def sent_by(self, sender: str) -> list[Piece]:
        """The pieces of one end."""
        return [piece for piece in self.pieces if piece.sender == sender]


def examples() -> Examples:
    """The messages of version 0.1."""
    return msgspec.json.decode((PEER / "messages.json").read_bytes(), type=Examples)


def transcript() -> Transcript:
    """What station and platform of version 0.1 said to each other: a mission is loaded, started, watched and done."""
    data = gzip.decompress((PEER / "transcript.msgpack.gz").read_bytes())
    return msgspec.msgpack.decode(data, type=Transcript)
