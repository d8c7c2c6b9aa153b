"""Status as it crosses the link: rows of a few bytes, the latest of each topic, parts that may be missing."""

from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.exchange.tunnel import status as packing
from gloc3.exchange.tunnel.body import unpack_payload, unpack_status
from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import Status, StatusPart, SummaryRows
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD
from gloc3.exchange.tunnel.reader import TunnelFrameError
from gloc3.exchange.tunnel.status import MAX_PARTS, StatusReceiver, StatusSender
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.motion import MotionSummary
from gloc3.messages.summaries import ComponentLine, ControlState, Health, MissionSummary, Summary
from gloc3.messages.wire import type_name

SOURCE = Source("minoas", "ci", 1)


def envelope(payload: Message, sequence: int = 0) -> Envelope[Any]:
    return Envelope("minoas/ci/x", SOURCE, sequence, 12.5, "", type_name(type(payload)), payload)


def summary(lines: list[ComponentLine], table: int = 1) -> Summary:
    return Summary(table=table, health=Health.FAULTY, lines=lines)


def mission(letters: int, seed: int = 1) -> MissionSummary:
    random = Random(seed)
    tasks = {f"{random.getrandbits(64):x}": "done" for _ in range(letters // 16)}
    return MissionSummary(name="m", digest="", state="running", tasks=tasks)


def drain(sender: StatusSender) -> list[Any]:
    frames = []
    while (frame := sender.next_frame()) is not None:
        frames.append(frame)
    return frames


byte = st.integers(0, 255)
lines = st.lists(
    st.builds(ComponentLine, st.integers(0, 300), byte, byte, byte, st.integers(0, 65535), st.integers(0, 65535)),
    max_size=60,
    unique_by=lambda line: line.index,
)


@settings(max_examples=50)
@given(lines=lines)
def test_every_row_crosses_in_frames_that_stand_for_themselves(lines: list[ComponentLine]) -> None:
    sender = StatusSender(Counters())
    sender.offer(1, envelope(summary(lines), sequence=5))
    frames = drain(sender)
    assert frames
    unpacked = [packing.unpack_summary(frame.body) for frame in frames]
    assert all(t_s == 12.5 and (part.table, part.health) == (1, Health.FAULTY) for t_s, part in unpacked)
    assert [line for _, part in unpacked for line in part.lines] == lines
    assert all(len(frame.encode(1)) <= MAX_PAYLOAD for frame in frames)


def test_20_components_fit_one_frame() -> None:
    rows = [ComponentLine(n, 0, 100, 30, n, 0) for n in range(20)]
    sender = StatusSender(Counters())
    sender.offer(1, envelope(summary(rows)))
    assert len(drain(sender)) == 1


def test_a_row_takes_at_most_16_bytes() -> None:
    def size(count: int) -> int:
        rows = [ComponentLine(n, 5, 255, 255, 65535, 65535) for n in range(count)]
        sender = StatusSender(Counters())
        sender.offer(1, envelope(summary(rows)))
        return len(drain(sender)[0].encode(1))

    assert size(2) - size(1) <= 16


def test_the_packing_knows_every_field_there_is() -> None:
    assert [field.name for field in msgspec.structs.fields(Summary)] == ["table", "health", "lines", "columns"]


def test_rows_that_were_not_sent_yet_give_way_to_newer_ones_and_keep_their_turn() -> None:
    counters = Counters()
    sender = StatusSender(counters)
    sender.offer(1, envelope(summary([ComponentLine(n, 0, 0, 0, 0, 0) for n in range(30)]), 1))
    first = sender.next_frame()
    assert isinstance(first, SummaryRows)
    sent = len(packing.unpack_summary(first.body)[1].lines)
    sender.offer(1, envelope(summary([ComponentLine(n, 1, 0, 0, 0, 0) for n in range(30)]), 2))
    rest = [line for frame in drain(sender) for line in packing.unpack_summary(frame.body)[1].lines]
    assert [line.index for line in rest] == [*range(sent, 30), *range(sent)]
    assert all(line.state == 1 for line in rest)
    assert counters.replaced == 30 - sent


def test_only_the_latest_message_of_a_topic_is_sent() -> None:
    counters = Counters()
    sender = StatusSender(counters)
    for sequence in range(5):
        sender.offer(2, envelope(mission(16, sequence), sequence))
    (frame,) = drain(sender)
    assert frame.sequence == 4
    assert counters.replaced == 4


def test_the_summary_and_the_others_take_turns() -> None:
    sender = StatusSender(Counters())
    sender.offer(1, envelope(summary([ComponentLine(n, 0, 0, 0, 0, 0) for n in range(60)])))
    sender.offer(2, envelope(mission(16)))
    sender.offer(3, envelope(mission(16)))
    kinds = [type(frame) for frame in drain(sender)]
    assert kinds[:4] == [SummaryRows, Status, SummaryRows, Status]


@settings(max_examples=40)
@given(letters=st.integers(150, 1500), seed=st.integers(0, 99))
def test_a_long_message_arrives_although_any_one_of_its_parts_is_lost(letters: int, seed: int) -> None:
    random, message = Random(seed), mission(letters)
    sender, receiver = StatusSender(Counters()), StatusReceiver(Counters())
    sender.offer(2, envelope(message))
    parts = [frame for frame in drain(sender) if isinstance(frame, StatusPart)]
    if len(parts) > 3:
        parts.pop(random.randrange(len(parts)))
    random.shuffle(parts)
    bodies = [body for part in parts if (body := receiver.receive_part(part)) is not None]
    t_s, payload = unpack_status(bodies[0]) if parts else (12.5, b"")
    assert len(bodies) == min(1, len(parts))
    assert not parts or (t_s, unpack_payload(payload, MissionSummary)) == (12.5, message)


def test_what_is_incomplete_when_a_newer_one_comes_is_dropped_and_counted() -> None:
    counters = Counters()
    sender, receiver = StatusSender(Counters()), StatusReceiver(counters)
    for sequence in (1, 2):
        sender.offer(2, envelope(mission(400), sequence))
        parts = drain(sender)
        assert len(parts) > 3
        results = [receiver.receive_part(part) for part in (parts[:2] if sequence == 1 else parts)]
    assert len([body for body in results if body is not None]) == 1
    assert counters.incomplete == 1
    assert receiver.receive_part(parts[0]) is None
    assert counters.late == 2  # the last part of the second one was not needed, and this one came twice


def test_old_and_repeated_frames_are_dropped() -> None:
    counters = Counters()
    receiver = StatusReceiver(counters)
    assert receiver.receive_whole(1, 5)
    assert not receiver.receive_whole(1, 5)
    assert not receiver.receive_whole(1, 4)
    assert receiver.receive_rows(2, 7, b"a")
    assert receiver.receive_rows(2, 7, b"b")
    assert not receiver.receive_rows(2, 7, b"b")
    assert counters.late == 3


@pytest.mark.parametrize(
    "part",
    [
        StatusPart(1, 0, 0, 1, 10, b"x"),
        StatusPart(1, 0, 0, MAX_PARTS + 1, 10, b"x"),
        StatusPart(1, 0, 5, 4, 10, b"x"),
        StatusPart(1, 0, 2, 2, 10, b"x"),
        StatusPart(1, 0, 0, 2, 10, b""),
    ],
)
def test_a_part_without_a_place_is_damage(part: StatusPart) -> None:
    with pytest.raises(TunnelFrameError):
        StatusReceiver(Counters()).receive_part(part)


def test_parts_that_contradict_each_other_are_damage() -> None:
    receiver = StatusReceiver(Counters())
    receiver.receive_part(StatusPart(1, 0, 0, 2, 10, b"x"))
    with pytest.raises(TunnelFrameError):
        receiver.receive_part(StatusPart(1, 0, 1, 2, 11, b"x"))
    receiver.receive_part(StatusPart(1, 1, 0, 2, 10, b"x"))
    with pytest.raises(TunnelFrameError):
        receiver.receive_part(StatusPart(1, 1, 1, 2, 10, b"x"))


def test_the_motion_waits_until_nothing_else_does_and_then_the_latest_goes() -> None:
    sender = StatusSender(Counters())
    for sequence in (1, 2):
        motion = MotionSummary(
            t_s=0.0, attitude_cdeg=(0, 0, 0), position_cm=(0, 0, 0), velocity_cm_s=(0, 0, 0), is_pose_valid=True
        )
        sender.offer(1, envelope(motion, sequence))
    sender.offer(2, envelope(mission(600), sequence=3))
    sender.offer(3, envelope(ControlState(holder="255"), sequence=4))
    frames = drain(sender)
    assert [frame.channel for frame in frames[-1:]] == [1]
    assert [frame.sequence for frame in frames if frame.channel == 1] == [2]
    assert not sender.is_waiting
