"""MAVLink 2 signing: signs sent frames, and rejects forged, replayed and wrongly dated ones.

The signature of a frame is checked before its time, so that a forged one never changes our clock, and a holder of the
key changes it by a minute at most.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable, Collection, Mapping
from datetime import UTC, datetime
from enum import StrEnum
from hashlib import sha256
from typing import Final

from gloc3.errors import Misuse
from gloc3.mavlink.parser import SIGNATURE_LENGTH, Frame

KEY_BYTES: Final = 32
EPOCH_UTC_S: Final = datetime(2015, 1, 1, tzinfo=UTC).timestamp()
TICKS_PER_S: Final = 100_000
MAY_BE_OFF: Final = 60 * TICKS_PER_S
"""A new stream may be so late, and any so early. Where the clock can be relied on, any may be no later either."""
MOST_STREAMS: Final = 256
RADIO_STATUS: Final = 109
"""Comes from the radio at our own end of the link, which has no key."""
_LARGEST_TIME: Final = (1 << 48) - 1

Stream = tuple[int, int, int]
"""System, component and link of a sender."""


class SigningVerdict(StrEnum):
    """Results of a frame's verification; the text is for a person."""

    GENUINE = "genuine"
    ALLOWED = "not signed, and need not be"
    UNSIGNED = "not signed"
    FORGED = "the signature is wrong"
    REPEATED = "a replayed frame"
    FUTURE = "dated in the future"

    @property
    def is_good(self) -> bool:
        """Whether the frame may be used."""
        return self in (SigningVerdict.GENUINE, SigningVerdict.ALLOWED)


def timestamp(utc_s: float) -> int:
    """Signing's time: 10 µs since 2015.

    Args:
        utc_s: seconds since 1970.
    """
    return max(0, int((utc_s - EPOCH_UTC_S) * TICKS_PER_S))


def is_signed_with(key: bytes, frame: Frame) -> bool:
    """Whether a frame has a right signature, whatever its time."""
    raw = frame.raw
    return frame.is_signed and hmac.compare_digest(sha256(key + raw[:-6]).digest()[:6], raw[-6:])


class Streams:
    """Progress of each sender that signs with one key: what is not later is a repetition.

    The links of a process that have the same key share it, so that what was heard on one is not taken on another.

    Args:
        latest: what was kept over a restart.
        noted: is called with each stream that has come further.
    """

    def __init__(
        self, latest: Mapping[Stream, int] | None = None, noted: Callable[[Stream], None] = lambda _: None
    ) -> None:
        self.latest: Final = dict(latest or {})
        """Signing's time of the last frame of each stream."""
        self._noted = noted

    def accepts(self, stream: Stream, time: int, earliest: int, *, is_clock_right: bool) -> bool:
        """Whether a frame is the next of its stream, and not too late. It is noted then.

        Args:
            stream: the sender's.
            time: signing's time of the frame.
            earliest: a new stream begins no earlier than that.
            is_clock_right: whether that goes for a stream that has begun, too: what somebody has held back stays out.
        """
        last = self.latest.get(stream)
        if time < earliest and (last is None or is_clock_right):
            return False
        if last is None:
            if len(self.latest) >= MOST_STREAMS:
                return False
        elif time <= last:
            return False
        self.latest[stream] = time
        self._noted(stream)
        return True


class Signing:
    """Key and times of one end.

    Args:
        key: 32 secret bytes, the same at both ends.
        link_id: identifies our link, 0..255.
        now: `timestamp` of now.
        unsigned_ids: messages that are accepted without a signature.
        streams: shared by the links with this key.
        is_clock_right: whether `now` is reliable. A computer without the correct time adopts the first time that it
            receives.
        most_ahead: how far ahead of our time a frame may be; None for no limit.
    """

    def __init__(
        self,
        key: bytes,
        *,
        link_id: int,
        now: int,
        unsigned_ids: Collection[int] = frozenset({RADIO_STATUS}),
        streams: Streams | None = None,
        is_clock_right: Callable[[], bool] = lambda: True,
        most_ahead: int | None = MAY_BE_OFF,
    ) -> None:
        if len(key) != KEY_BYTES:
            raise Misuse(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._link = bytes([link_id])
        self._unsigned_ids = frozenset(unsigned_ids)
        self._streams = streams or Streams()
        self._is_clock_right, self._most_ahead = is_clock_right, most_ahead
        self.timestamp = max(now, *self._streams.latest.values(), 0)
        """Of the last frame; it never decreases, nor falls below the times stored over a restart."""
        self._ahead = 0 if is_clock_right() else self.timestamp - now
        """Correction to our clock, from received times while the clock was not reliable."""
        self._now = now + self._ahead
        self._has_seen = False
        """Whether a valid signed frame has shown the time."""
        self.verdicts = dict.fromkeys(SigningVerdict, 0)
        """How many frames were judged how."""

    @property
    def refused(self) -> int:
        """Frames that were not good."""
        return sum(count for verdict, count in self.verdicts.items() if not verdict.is_good)

    def advance(self, now: int) -> None:
        """Sets the time forward, about once a second."""
        if self._ahead and self._is_clock_right():
            self._ahead = 0
        self._now = now + self._ahead
        self.timestamp = max(self.timestamp, self._now)

    def sign(self, frame: bytes) -> bytes:
        """Appends the signature to a frame whose signed flag is already set."""
        self.timestamp = min(self.timestamp + 1, _LARGEST_TIME)
        frame += self._link + self.timestamp.to_bytes(6, "little")
        return frame + sha256(self._key + frame).digest()[:6]

    def verify(self, frame: Frame) -> SigningVerdict:
        """Judges a frame that came; one that is not good is to be dropped."""
        verdict = self._judge(frame)
        self.verdicts[verdict] += 1
        return verdict

    def _judge(self, frame: Frame) -> SigningVerdict:
        if not frame.is_signed:
            return SigningVerdict.ALLOWED if frame.message_id in self._unsigned_ids else SigningVerdict.UNSIGNED
        if not is_signed_with(self._key, frame):
            return SigningVerdict.FORGED
        raw = frame.raw
        time = int.from_bytes(raw[-12:-6], "little")
        is_early = self._most_ahead is not None and time > self._now + self._most_ahead
        is_clock_right = self._is_clock_right()
        if is_early and (self._has_seen or is_clock_right):
            return SigningVerdict.FUTURE
        stream = (frame.system, frame.component, raw[-SIGNATURE_LENGTH])
        if not self._streams.accepts(stream, time, self._now - MAY_BE_OFF, is_clock_right=is_clock_right):
            return SigningVerdict.REPEATED
        if is_early:
            self._ahead += time - self._now
            self._now = time
        self._has_seen = True
        self.timestamp = max(self.timestamp, time)
        return SigningVerdict.GENUINE


AGAIN_S: Final = 60.0
"""Period of reports about frames dropped for their signature, s."""
HINTS: Final = {
    SigningVerdict.UNSIGNED: "; is signing switched on there?",
    SigningVerdict.FORGED: "; has it another key?",
    SigningVerdict.REPEATED: "; is its clock right?",
    SigningVerdict.FUTURE: "; which clock is wrong, its own or the one here?",
}


class SignedOnly:
    """Signature gate of one link.

    Args:
        signing: verifies received frames.
        reported: called with text for users.
    """

    def __init__(self, signing: Signing, reported: Callable[[str], None]) -> None:
        self._signing, self._reported = signing, reported
        self._reported_s: dict[SigningVerdict, float] = {}

    def passes(self, frame: Frame, now_s: float) -> bool:
        """Whether a frame may be used."""
        verdict = self._signing.verify(frame)
        if not verdict.is_good and now_s >= self._reported_s.get(verdict, float("-inf")):
            self._reported_s[verdict] = now_s + AGAIN_S
            count, who = self._signing.verdicts[verdict], f"{frame.system}/{frame.component}"
            so_far = f"{count} so far" if count > 1 else "and so will others be"
            self._reported(f"a frame from {who} is dropped ({verdict}), {so_far}{HINTS.get(verdict, '')}")
        return verdict.is_good

    @property
    def genuine(self) -> int:
        """Frames with a right signature."""
        return self._signing.verdicts[SigningVerdict.GENUINE]

    def refused(self) -> dict[str, int]:
        """By reason, how many frames were dropped."""
        return {
            str(verdict): count for verdict, count in self._signing.verdicts.items() if count and not verdict.is_good
        }
