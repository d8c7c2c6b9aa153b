"""Signing: understood by pymavlink both ways, and not to be fooled."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as theirs

from gloc3.errors import Misuse
from gloc3.mavlink import codec
from gloc3.mavlink.codec import message
from gloc3.mavlink.signing import MAY_BE_OFF, MOST_STREAMS, Signing, SigningVerdict, Streams, timestamp

KEY = bytes(range(32))
NOW = timestamp(1_790_000_000.0)


def signing(key: bytes = KEY, now: int = NOW, link_id: int = 3) -> Signing:
    return Signing(key, link_id=link_id, now=now)


def parsed(raw: bytes) -> codec.Frame:
    (frame,) = codec.Parser().receive(raw)
    return frame


def test_pymavlink_accepts_what_we_sign() -> None:
    judge = theirs.MAVLink(None)
    judge.signing.secret_key = KEY
    judge.signing.timestamp = NOW
    encoder = codec.Encoder(7, 191, signing())
    for number in range(3):
        received = judge.decode(bytearray(encoder.encode(message("ATTITUDE", time_boot_ms=number))))
        assert received.get_signed()
        assert received.time_boot_ms == number
    forged = bytearray(codec.Encoder(7, 191, signing(bytes(32))).encode(message("ATTITUDE")))
    with pytest.raises(theirs.MAVError, match="signature"):
        judge.decode(forged)


def test_we_accept_what_pymavlink_signs_once() -> None:
    sender = theirs.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key = KEY
    sender.signing.sign_outgoing = True
    sender.signing.timestamp = NOW
    judge = signing()
    frame = parsed(theirs.MAVLink_system_time_message(1, 2).pack(sender))
    assert judge.verify(frame) is SigningVerdict.GENUINE
    assert judge.verify(frame) is SigningVerdict.REPEATED
    assert judge.refused == 1


def test_a_forged_time_locks_nobody_out() -> None:
    judge, sender = signing(), codec.Encoder(1, 1, signing())
    assert judge.verify(parsed(sender.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE
    future = codec.Encoder(1, 1, Signing(bytes(32), link_id=3, now=(1 << 48) - 10))
    assert judge.verify(parsed(future.encode(message("HEARTBEAT")))) is SigningVerdict.FORGED
    assert judge.verify(parsed(sender.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE


def test_a_new_stream_may_be_a_minute_late_and_no_more() -> None:
    for late, expected in ((59, SigningVerdict.GENUINE), (61, SigningVerdict.REPEATED)):
        sender = codec.Encoder(1, 1, signing(now=NOW - late * 100_000))
        assert signing().verify(parsed(sender.encode(message("HEARTBEAT")))) is expected


@pytest.mark.parametrize(("is_clock_right", "expected"), [(True, "REPEATED"), (False, "GENUINE")])
def test_what_was_held_back_for_more_than_a_minute_stays_out_where_the_clock_is_right(
    is_clock_right: bool, expected: str
) -> None:
    judge = Signing(KEY, link_id=3, now=NOW, is_clock_right=lambda: is_clock_right)
    sender = codec.Encoder(1, 1, signing())
    first, second, third = (parsed(sender.encode(message("HEARTBEAT"))) for _ in range(3))
    assert judge.verify(first) is SigningVerdict.GENUINE
    judge.advance(NOW + MAY_BE_OFF)
    assert judge.verify(second) is SigningVerdict.GENUINE
    judge.advance(NOW + 60 * MAY_BE_OFF)
    assert judge.verify(third) is SigningVerdict[expected]


def test_our_time_follows_and_never_goes_back() -> None:
    judge = signing()
    ahead = codec.Encoder(1, 1, signing(now=NOW + 500))
    judge.verify(parsed(ahead.encode(message("HEARTBEAT"))))
    assert judge.timestamp == NOW + 501
    judge.advance(NOW)
    assert judge.timestamp == NOW + 501


def test_who_has_the_key_moves_our_time_by_a_minute_and_no_more_however_often() -> None:
    judge = signing()
    wrong = codec.Encoder(1, 1, signing(now=NOW + 365 * 86_400 * 100_000))
    assert judge.verify(parsed(wrong.encode(message("HEARTBEAT")))) is SigningVerdict.FUTURE
    assert judge.timestamp == NOW
    for number in range(1, 11):
        creeping = codec.Encoder(number, 1, signing(now=NOW + number * (MAY_BE_OFF - 1000)))
        judge.verify(parsed(creeping.encode(message("HEARTBEAT"))))
    assert NOW < judge.timestamp <= NOW + MAY_BE_OFF
    assert (judge.verdicts[SigningVerdict.FUTURE], judge.refused) == (10, 10)
    right = codec.Encoder(20, 1, signing())
    assert judge.verify(parsed(right.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE, (
        "nobody else is locked out"
    )


def test_who_does_not_know_the_time_follows_the_first_that_does() -> None:
    later, is_known = 86_400 * 100_000, False
    judge = Signing(KEY, link_id=0, now=NOW, is_clock_right=lambda: is_known)
    first, wrong = codec.Encoder(1, 1, signing(now=NOW + later)), codec.Encoder(2, 1, signing(now=NOW + 9 * later))
    assert judge.verify(parsed(first.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE
    assert judge.timestamp == NOW + later + 1
    assert judge.verify(parsed(wrong.encode(message("HEARTBEAT")))) is SigningVerdict.FUTURE
    judge.advance(NOW + MAY_BE_OFF + 1000)
    assert judge.timestamp > NOW + later + MAY_BE_OFF, "the time that it was told goes on"
    second = codec.Encoder(3, 1, signing(now=NOW + later + 2 * MAY_BE_OFF))
    assert judge.verify(parsed(second.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE
    is_known = True
    judge.advance(NOW + later)
    third = codec.Encoder(4, 1, signing(now=NOW + later))
    assert judge.verify(parsed(third.encode(message("HEARTBEAT")))) is SigningVerdict.GENUINE


def test_what_was_heard_on_one_link_is_old_on_another_with_the_key() -> None:
    streams = Streams()
    here, there = (Signing(KEY, link_id=number, now=NOW, streams=streams) for number in (1, 2))
    frame = parsed(codec.Encoder(1, 1, signing()).encode(message("HEARTBEAT")))
    assert here.verify(frame) is SigningVerdict.GENUINE
    assert there.verify(frame) is SigningVerdict.REPEATED


def test_unsigned_frames_are_refused_but_for_the_radios() -> None:
    encoder = codec.Encoder(1, 1)
    assert signing().verify(parsed(encoder.encode(message("HEARTBEAT")))) is SigningVerdict.UNSIGNED
    assert signing().verify(parsed(encoder.encode(message("RADIO_STATUS")))) is SigningVerdict.ALLOWED


def test_streams_are_bounded() -> None:
    judge = signing()
    for number in range(MOST_STREAMS + 5):
        sender = codec.Encoder(1 + number % 255, 1 + number // 255, signing())
        judge.verify(parsed(sender.encode(message("HEARTBEAT"))))
    assert judge.refused == 5


def test_a_key_of_another_length_is_refused() -> None:
    with pytest.raises(Misuse, match="32 bytes"):
        signing(b"short")
