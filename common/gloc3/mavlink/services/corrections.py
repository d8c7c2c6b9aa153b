"""GPS_RTCM_DATA: splits RTCM 3 frames into messages of 180 bytes, and puts them together again on the vehicle."""

from typing import Final

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage

PIECE_BYTES: Final = 180
MOST_PIECES: Final = 4
MOST_BYTES: Final = PIECE_BYTES * MOST_PIECES
"""A longer frame does not fit."""
_FRAGMENTED: Final = 1
SEQUENCES: Final = 32


def correction_messages(frame: bytes, sequence: int) -> list[MavlinkMessage]:
    """The messages that carry a frame, in order; none for one above `MOST_BYTES`.

    A fragmented frame ends with a piece that is not full, or with the fourth: one of 360 or 540 bytes with an empty one.

    Args:
        frame: an RTCM 3 frame.
        sequence: counts frames; its five lowest bits tell the pieces of two frames apart.
    """
    if len(frame) > MOST_BYTES:
        return []
    if len(frame) <= PIECE_BYTES:
        return [_message(0, frame)]
    pieces = [frame[start : start + PIECE_BYTES] for start in range(0, len(frame), PIECE_BYTES)]
    if len(pieces) < MOST_PIECES and len(pieces[-1]) == PIECE_BYTES:
        pieces.append(b"")
    number = sequence % SEQUENCES << 3
    return [_message(_FRAGMENTED | index << 1 | number, piece) for index, piece in enumerate(pieces)]


def _message(flags: int, piece: bytes) -> MavlinkMessage:
    return message("GPS_RTCM_DATA", flags=flags, len=len(piece), data=piece.ljust(PIECE_BYTES, b"\0"))


class CorrectionAssembler:
    """The receiving end: gives whole frames, of which no piece is missing, in whatever order they have come."""

    def __init__(self) -> None:
        self._sequence = -1
        self._pieces: dict[int, bytes] = {}

    def receive(self, received: MavlinkMessage) -> bytes | None:
        """Takes a GPS_RTCM_DATA; returns the frame that it completes."""
        flags, piece = received.flags, bytes(received.data[: min(received.len, PIECE_BYTES)])
        if not flags & _FRAGMENTED:
            return piece
        index, sequence = flags >> 1 & 3, flags >> 3
        if sequence != self._sequence or index in self._pieces:
            self._sequence, self._pieces = sequence, {}
        self._pieces[index] = piece
        for count in range(1, len(self._pieces) + 1):
            last = self._pieces.get(count - 1)
            if last is None:
                return None
            if len(last) < PIECE_BYTES or count == MOST_PIECES:
                whole = b"".join(self._pieces[one] for one in range(count))
                self._sequence, self._pieces = -1, {}
                return whole
        return None
