"""Intervals, texts, time and version: each end against the other."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.mavlink import codec
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.interval import StreamScheduler
from gloc3.mavlink.services.statustext import CHUNK_BYTES, GAP, StatusTextReceiver, StatusTextSender
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.mavlink.services.version import ProtocolCapability, Version, VersionServer, read_version, version_number
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair

RATES = {"ATTITUDE": 10.0, "GLOBAL_POSITION_INT": 5.0, "ODOMETRY": 0.0, "AUTOPILOT_VERSION": 0.0}


def counts(scheduler: StreamScheduler, from_s: float, to_s: float, step_s: float = 0.004) -> dict[str, int]:
    found: dict[str, int] = {}
    for step in range(round((to_s - from_s) / step_s)):
        for number in scheduler.due(from_s + step * step_s):
            name = codec.name_of(number)
            found[name] = found.get(name, 0) + 1
    return found


def request(command: int, *params: float) -> MavCommandRequest:
    server = MavCommandServer(VEHICLE)
    values = {f"param{index}": value for index, value in enumerate(params, start=1)}
    server.receive(message("COMMAND_LONG", command=command, target_system=1, **values), STATION, 0.0)
    return server.events()[0]


def test_streams_are_due_at_their_rates() -> None:
    scheduler = StreamScheduler(VEHICLE, RATES)
    assert counts(scheduler, 0.0, 10.0) == {"ATTITUDE": 100, "GLOBAL_POSITION_INT": 50}
    assert scheduler.next_tick_s() == pytest.approx(10.0)


def test_a_late_scheduler_does_not_make_up_for_what_it_missed() -> None:
    scheduler = StreamScheduler(VEHICLE, {"ATTITUDE": 10.0})
    scheduler.due(0.0)
    assert len(scheduler.due(5.0)) == 1
    assert scheduler.due(5.01) == []


def test_rates_are_set_told_and_reset_by_command() -> None:
    scheduler = StreamScheduler(VEHICLE, RATES)
    assert scheduler.command(request(511, 30, 20_000), 0.0) is CommandResult.ACCEPTED
    assert scheduler.command(request(511, 33, -1), 0.0) is CommandResult.ACCEPTED
    assert counts(scheduler, 0.0, 2.0) == {"ATTITUDE": 100}
    for number in (30, 33, 331, 24):
        assert scheduler.command(request(510, number), 2.0) is CommandResult.ACCEPTED
    assert [m.interval_us for m in scheduler.outgoing()] == [20_000, -1, -1, 0]
    scheduler.command(request(511, 33, 0), 2.0)
    assert scheduler.rate_hz("GLOBAL_POSITION_INT") == 5.0
    assert scheduler.rate_hz("ODOMETRY") == 0.0


def test_a_message_is_sent_once_on_request_and_what_cannot_be_is_refused() -> None:
    scheduler = StreamScheduler(VEHICLE, RATES)
    scheduler.due(0.0)
    assert scheduler.command(request(512, 148), 0.01) is CommandResult.ACCEPTED
    assert scheduler.next_tick_s() == 0.0
    assert scheduler.due(0.02) == [148]
    assert scheduler.due(0.03) == []
    assert scheduler.command(request(512, 24), 0.1) is CommandResult.DENIED
    assert scheduler.command(request(512, 99_999), 0.1) is CommandResult.UNSUPPORTED
    assert scheduler.command(request(511, float("nan"), 1), 0.1) is CommandResult.DENIED
    assert scheduler.command(request(511, 30, float("nan")), 0.1) is CommandResult.DENIED
    assert scheduler.command(request(400), 0.1) is None


def test_the_old_request_for_all_streams_is_honoured() -> None:
    scheduler = StreamScheduler(VEHICLE, RATES)
    previous = message("REQUEST_DATA_STREAM", target_system=1, target_component=1, req_message_rate=2, start_stop=1)
    scheduler.receive(previous, STATION, 0.0)
    assert counts(scheduler, 0.0, 2.0) == {"ATTITUDE": 4, "GLOBAL_POSITION_INT": 4}


@settings(max_examples=40)
@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=300), st.randoms())
def test_texts_of_any_length_and_order_arrive_whole(text: str, chance: random.Random) -> None:
    sender, receiver = StatusTextSender(VEHICLE), StatusTextReceiver(STATION)
    sender.send(4, text)
    chunks = sender.outgoing()
    assert all(len(chunk.text.encode()) <= CHUNK_BYTES for chunk in chunks)
    chance.shuffle(chunks)
    for chunk in chunks:
        receiver.receive(chunk, VEHICLE, 0.0)
    (whole,) = receiver.events()
    assert whole.severity == 4
    if len(text.encode()) <= 1000:
        assert whole.text.replace(" ", "") == text.replace(" ", "")
        if text.isascii():
            assert whole.text == text
    assert receiver.next_tick_s() is None


def test_texts_with_lost_chunks_come_with_their_gaps_marked() -> None:
    sender, receiver = StatusTextSender(VEHICLE), StatusTextReceiver(STATION)
    sender.send(6, "a" * 50 + "b" * 50 + "c" * 50 + "end")
    chunks = sender.outgoing()
    for chunk in (chunks[0], chunks[2]):
        receiver.receive(chunk, VEHICLE, 1.0)
    assert receiver.events() == []
    assert receiver.next_tick_s() == 3.0
    receiver.tick(3.0)
    (text,) = receiver.events()
    assert text.text == "a" * 50 + GAP + "c" * 50 + GAP


def test_unfinished_texts_are_bounded() -> None:
    receiver = StatusTextReceiver(STATION)
    for number in range(1, 500):
        receiver.receive(message("STATUSTEXT", text="x" * 50, id_=number), VEHICLE, 0.0)
    assert len(receiver.events()) == 499 - 32


class AheadClock(TimeSync):
    """A peer whose clock is ahead of ours."""

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        super().receive(message, sender, now_s + 1234.5)


def test_clocks_are_compared_over_a_jittery_link() -> None:
    pair = Pair(5, Conditions(latency_s=0.01, jitter_s=0.03, loss=0.1))
    ours = TimeSync(STATION, VEHICLE)
    theirs = AheadClock(VEHICLE)
    pair.add([theirs], [ours])
    assert ours.to_peer_s(1.0) is None
    pair.run(10.0)
    assert ours.is_converged
    assert ours.best is not None
    assert ours.best.offset_s == pytest.approx(1234.5, abs=0.008)
    assert abs(ours.best.offset_s - 1234.5) <= ours.best.round_trip_s / 2
    assert ours.to_peer_s(1.0) == pytest.approx(1235.5, abs=0.008)


def test_an_answer_at_time_zero_is_not_taken_for_a_question() -> None:
    clock = TimeSync(VEHICLE)
    clock.receive(message("TIMESYNC", ts1=5), STATION, 0.0)
    (answer,) = clock.outgoing()
    assert (answer.tc1, answer.ts1) == (1, 5)


def test_answers_meant_for_others_are_ignored_and_a_restart_is_believed() -> None:
    clock = TimeSync(STATION, VEHICLE, period_s=0.1)
    clock.receive(message("TIMESYNC", tc1=5_000_000_000, ts1=1), VEHICLE, 1.0)
    assert clock.best is None
    for step in range(30):
        now_s = step * 0.125
        clock.tick(now_s)
        (requested,) = clock.outgoing()
        peer_s = now_s + (100.0 if step < 20 else -50.0)
        clock.receive(message("TIMESYNC", tc1=round((peer_s + 60) * 1e9), ts1=requested.ts1), VEHICLE, now_s + 0.001)
        if step == 21:
            assert clock.best is not None
            assert clock.best.offset_s == pytest.approx(160, abs=0.1), "two odd samples are not believed"
    assert clock.best is not None
    assert clock.best.offset_s == pytest.approx(10.0, abs=0.1)
    assert clock.restarts == 1


def test_a_version_is_told_to_who_asks_for_it() -> None:
    reported = Version(
        capabilities=ProtocolCapability.MISSION_INT | ProtocolCapability.FTP | ProtocolCapability.MAVLINK2,
        flight_software=version_number(1, 15, 4),
        uid=0xFEED,
    )
    server, version = MavCommandServer(VEHICLE, is_autopilot=True), VersionServer(VEHICLE, reported)
    for command in (512, 520, 400):
        requested = message("COMMAND_LONG", command=command, param1=148, target_system=1, target_component=1)
        server.receive(requested, STATION, 0.0)
    assert [version.command(request) for request in server.events()] == [CommandResult.ACCEPTED] * 2 + [None]
    answers = version.outgoing()
    assert [read_version(answer) for answer in answers] == [reported, reported]
    assert reported.words == "1.15.4"
