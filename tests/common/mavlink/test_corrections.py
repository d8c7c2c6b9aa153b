"""GPS_RTCM_DATA: frames of every length arrive whole, in any order, and never mixed."""

from itertools import permutations

import pytest

from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.corrections import MOST_BYTES, CorrectionAssembler, correction_messages


def over_the_wire(messages: list[MavlinkMessage]) -> list[MavlinkMessage]:
    encoder = Encoder(255, 190)
    frames = Parser().receive(b"".join(encoder.encode(one) for one in messages))
    return [decoded for frame in frames if (decoded := frame.decode()) is not None]


def frame_of(size: int, first: int = 1) -> bytes:
    return bytes((first + index) % 255 for index in range(size))


@pytest.mark.parametrize("size", [1, 179, 180, 181, 359, 360, 361, 540, 541, 719, 720])
def test_a_frame_of_any_length_is_put_together_in_any_order(size: int) -> None:
    sent = over_the_wire(correction_messages(frame_of(size), 37))
    assert [one.flags >> 3 for one in sent] == [0 if size <= 180 else 37 % 32] * len(sent)
    for order in permutations(sent):
        assembler = CorrectionAssembler()
        assert [assembler.receive(one) for one in order][-1] == frame_of(size)


def test_a_frame_that_does_not_fit_is_none() -> None:
    assert correction_messages(frame_of(MOST_BYTES + 1), 0) == []


def test_a_lost_piece_loses_its_frame_alone() -> None:
    assembler = CorrectionAssembler()
    for number, lost in ((0, 0), (1, 1), (32, 0)):
        pieces = over_the_wire(correction_messages(frame_of(300, number), number))
        del pieces[lost]
        assert [assembler.receive(one) for one in pieces] == [None]
    whole = over_the_wire(correction_messages(frame_of(300, 5), 5))
    assert [assembler.receive(one) for one in whole] == [None, frame_of(300, 5)]
