"""The journal: a request is carried out at most once, whatever is repeated, forgotten, compacted or cut off."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.messages.command_interface import CiReply, CiRequest, Hello, Outcome
from gloc3.store import MemoryRecords
from gloc3_onboard.command_server.journal import COMPACT_AFTER, MOST_FLOORS, MOST_SENDERS, Journal


def request(sequence: int, boot: int = 1, sender: str = "255") -> CiRequest:
    return CiRequest(sender=sender, boot=boot, sequence=sequence, body=Hello())


def reply(to: CiRequest, reason: str = "") -> CiReply:
    return CiReply(sender=to.sender, boot=to.boot, sequence=to.sequence, outcome=Outcome.ACCEPTED, reason=reason)


def carry_out(journal: Journal, requested: CiRequest) -> bool:
    """Whether it is carried out now."""
    known = journal.begin(requested)
    if known.is_new:
        journal.end(reply(requested))
    return known.is_new


def test_a_repeat_gets_the_same_reply_and_runs_nothing() -> None:
    journal = Journal(MemoryRecords())
    assert journal.begin(request(1)).is_new
    journal.end(reply(request(1), "done"))
    again = journal.begin(request(1))
    assert (again.is_new, again.reply) == (False, reply(request(1), "done"))


def test_a_repeat_while_it_is_carried_out_is_not_answered_yet() -> None:
    journal = Journal(MemoryRecords())
    journal.begin(request(1))
    assert journal.begin(request(1)) == (False, None)
    assert journal.query("255", 1, 1) == (Outcome.UNKNOWN, None)


def test_what_the_process_did_not_end_is_unknown_after_its_restart() -> None:
    store = MemoryRecords()
    Journal(store).begin(request(1))
    known = Journal(store).begin(request(1))
    assert not known.is_new
    assert known.reply is not None
    assert known.reply.outcome is Outcome.UNKNOWN


def test_replies_survive_the_process() -> None:
    store = MemoryRecords()
    carry_out(Journal(store), request(1))
    journal = Journal(store)
    assert journal.begin(request(1)).reply == reply(request(1))
    assert journal.query("255", 1, 1) == (Outcome.ACCEPTED, reply(request(1)))
    assert journal.query("255", 1, 2) == (Outcome.UNKNOWN, None)


def test_the_last_256_of_each_sender_are_remembered_and_older_ones_are_expired() -> None:
    journal = Journal(MemoryRecords())
    for sequence in range(256 + 10):
        carry_out(journal, request(sequence))
    carry_out(journal, request(0, sender="254"))
    assert journal.begin(request(10)).reply == reply(request(10))
    known = journal.begin(request(9))
    assert known.reply is not None
    assert known.reply.outcome is Outcome.EXPIRED
    assert journal.query("255", 1, 9) == (Outcome.EXPIRED, None)
    assert not carry_out(journal, request(0, sender="254"))


@pytest.mark.parametrize("is_restarted", [True, False])
def test_expired_requests_stay_expired_after_the_file_was_written_anew(is_restarted: bool) -> None:
    store = MemoryRecords()
    journal = Journal(store)
    for sequence in range(COMPACT_AFTER):
        carry_out(journal, request(sequence))
    assert len(store.load()) < COMPACT_AFTER
    if is_restarted:
        journal = Journal(store)
    assert not [sequence for sequence in range(COMPACT_AFTER) if carry_out(journal, request(sequence))]


def test_requests_of_an_earlier_life_of_a_station_are_not_run_again() -> None:
    store = MemoryRecords()
    journal = Journal(store)
    for sequence in range(5):
        carry_out(journal, request(sequence, boot=1))
    for sequence in range(COMPACT_AFTER):
        carry_out(journal, request(sequence, boot=2))
    for life in (journal, Journal(store)):
        assert not [sequence for sequence in range(5) if carry_out(life, request(sequence, boot=1))]


def test_more_senders_than_are_remembered_do_not_make_old_requests_new() -> None:
    store = MemoryRecords()
    journal = Journal(store)
    for sender in range(MOST_SENDERS + 5):
        carry_out(journal, request(3, sender=str(sender)))
    assert not [s for s in range(MOST_SENDERS + 5) if carry_out(Journal(store), request(3, sender=str(s)))]


@pytest.mark.thorough
def test_the_file_does_not_grow_with_the_number_of_restarts() -> None:
    store = MemoryRecords()
    for life in range(60):
        journal = Journal(store)
        for sequence in range(50):
            carry_out(journal, request(life * 50 + sequence))
    assert len(store.load()) <= COMPACT_AFTER


def test_what_is_remembered_is_bounded() -> None:
    journal = Journal(MemoryRecords())
    for number in range(MOST_FLOORS + 200):
        carry_out(journal, request(0, boot=number, sender=str(number % 40)))
    assert len(journal._floors) <= MOST_FLOORS
    assert len(journal._senders) <= MOST_SENDERS


def test_records_of_another_version_do_not_keep_it_from_starting() -> None:
    store = MemoryRecords()
    carry_out(Journal(store), request(1))
    store.append(b"\xc1 no msgpack")
    store.append(b"\x93\x01\x02\x03")
    journal = Journal(store)
    assert journal.unreadable == 2
    assert not journal.begin(request(1)).is_new


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 2), st.sampled_from(["a", "b"]), st.integers(0, 9))))
def test_no_request_ever_runs_twice(steps: list[tuple[int, int, str, int]]) -> None:
    store = MemoryRecords()
    journal = Journal(store)
    ran: set[tuple[str, int, int]] = set()
    for sequence, boot, sender, chance in steps:
        requested = request(sequence, boot, sender)
        if journal.begin(requested).is_new:
            assert (sender, boot, sequence) not in ran
            ran.add((sender, boot, sequence))
            if chance:
                journal.end(reply(requested))
        if chance == 9:
            journal = Journal(store)
