"""MAVLink 2 signing: signs what is sent, and tells genuine frames from forged and repeated ones.

A frame is judged by its signature first and by its time only then, so that a forged one never moves a clock of ours.
"""

from __future__ import annotations

import hmac
from collections.abc import Collection
from datetime import UTC, datetime
from enum import StrEnum
from hashlib import sha256
from typing import Final

from gloc3.errors import Misuse
from gloc3.link.parser import SIGNATURE_LENGTH, Frame

KEY_BYTES: Final = 32
EPOCH_UTC_S: Final = datetime(2015, 1, 1, tzinfo=UTC).timestamp()
TICKS_PER_S: Final = 100_000
NEW_STREAM_MAY_BE_LATE: Final = 60 * TICKS_PER_S
MOST_STREAMS: Final = 256
RADIO_STATUS: Final = 109
"""Comes from the radio at our own end of the link, which has no key."""
_LARGEST_TIME: Final = (1 << 48) - 1


class Verdict(StrEnum):
    """What is to be thought of a frame; the text is for a person."""

    GENUINE = "genuine"
    ALLOWED = "not signed, and need not be"
    UNSIGNED = "not signed"
    FORGED = "the signature is wrong"
    REPEATED = "an old frame once more"

    @property
    def is_good(self) -> bool:
        """Whether the frame may be used."""
        return self in (Verdict.GENUINE, Verdict.ALLOWED)


def timestamp(utc_s: float) -> int:
    """Signing's time: 10 µs since 2015.

    Args:
        utc_s: seconds since 1970.
    """
    return max(0, int((utc_s - EPOCH_UTC_S) * TICKS_PER_S))


class Signing:
    """One end's key and times.

    Args:
        key: 32 secret bytes, the same at both ends.
        link_id: tells our links apart, 0..255.
        now: `timestamp` of now, or the one that was kept from last time if that is later.
        unsigned_ids: messages that are accepted without a signature.
    """

    def __init__(
        self, key: bytes, *, link_id: int, now: int, unsigned_ids: Collection[int] = frozenset({RADIO_STATUS})
    ) -> None:
        if len(key) != KEY_BYTES:
            raise Misuse(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._link = bytes([link_id])
        self._unsigned_ids = frozenset(unsigned_ids)
        self._streams: dict[tuple[int, int, int], int] = {}
        self.timestamp = now
        """Of the last frame, to be kept over a restart; it never goes back."""
        self.verdicts = dict.fromkeys(Verdict, 0)
        """How many frames were judged how."""

    @property
    def refused(self) -> int:
        """Frames that were not good."""
        return sum(count for verdict, count in self.verdicts.items() if not verdict.is_good)

    def advance(self, now: int) -> None:
        """Sets the time forward, about once a second."""
        self.timestamp = max(self.timestamp, now)

    def sign(self, frame: bytes) -> bytes:
        """A frame, whose flag says already that it is signed, with its signature."""
        self.timestamp = min(self.timestamp + 1, _LARGEST_TIME)
        frame += self._link + self.timestamp.to_bytes(6, "little")
        return frame + sha256(self._key + frame).digest()[:6]

    def verify(self, frame: Frame) -> Verdict:
        """Judges a frame that came; one that is not good is to be dropped."""
        verdict = self._judge(frame)
        self.verdicts[verdict] += 1
        return verdict

    def _judge(self, frame: Frame) -> Verdict:
        if not frame.is_signed:
            return Verdict.ALLOWED if frame.message_id in self._unsigned_ids else Verdict.UNSIGNED
        raw = frame.raw
        if not hmac.compare_digest(sha256(self._key + raw[:-6]).digest()[:6], raw[-6:]):
            return Verdict.FORGED
        time = int.from_bytes(raw[-12:-6], "little")
        stream = (frame.system, frame.component, raw[-SIGNATURE_LENGTH])
        last = self._streams.get(stream)
        if last is None:
            if time + NEW_STREAM_MAY_BE_LATE < self.timestamp or len(self._streams) >= MOST_STREAMS:
                return Verdict.REPEATED
        elif time <= last:
            return Verdict.REPEATED
        self._streams[stream] = time
        self.timestamp = max(self.timestamp, time)
        return Verdict.GENUINE
