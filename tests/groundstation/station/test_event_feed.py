"""Events of platforms are shown in their order and once, whatever was lost, doubled or late on the way."""

import random

import pytest

from gloc3.messages.command_interface import CiReply, CiRequest, Outcome, ReadReports, StationRole
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent, ContactSummary, Health
from gloc3.store import MemoryRecords
from gloc3_groundstation.station.event_feed import Cursor, EventFeed, FeedEvent
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.report_store import MOST_KEPT, SPARE, ReportStore

STORE = 7


def event(number: int) -> CiEvent:
    return CiEvent(severity=Severity.INFO, source="s", text=f"event {number}", t_s=number, number=number, store=STORE)


def contact(last: int, delivered: int = 0) -> ContactSummary:
    return ContactSummary(
        station="255",
        t_s=0.0,
        silent_s=60.0,
        health=Health.WORKING,
        mission="",
        state="",
        doing="",
        policy="",
        landed="in_air",
        battery_percent=90,
        position_m=(0.0, 0.0, 0.0),
        geo=None,
        conditions=[],
        store=STORE,
        last=last,
        delivered=delivered,
    )


def reply(numbers: range, last: int, store: int = STORE) -> CiReply:
    rows = [[number, 6, "s", f"event {number}", float(number)] for number in numbers]
    result = {"store": store, "last": last, "reports": rows}
    return CiReply(sender="255", boot=0, sequence=0, outcome=Outcome.ACCEPTED, result=result)


def texts(reported: list[FeedEvent]) -> list[str]:
    return [one.text for one in reported]


def test_what_was_missed_comes_before_what_happens_now() -> None:
    feed = EventFeed({"auv": Cursor(STORE, 2)})
    assert texts(feed.event("auv", event(3), 0.0)) == ["event 3"]
    feed.note_contact("auv", 100.0)
    assert feed.event("auv", event(9), 100.1) == [], "the summary is shown first"
    assert feed.contact("auv", contact(last=9)) == []
    requested = feed.wanted("auv", 100.2)
    assert requested == ReadReports(store=STORE, after=3, most=40)
    assert feed.wanted("auv", 100.2) is None
    reported = feed.answered("auv", requested, reply(range(4, 9), 9), 104.0)
    assert texts(reported) == [f"event {number}" for number in range(4, 10)]
    assert reported[0].age_s == 100.0
    assert feed.event("auv", event(9), 100.4) == []


def test_a_summary_that_does_not_come_holds_nothing_back_for_long() -> None:
    feed = EventFeed({"auv": Cursor(STORE, 2)})
    feed.event("auv", event(3), 0.0)
    feed.note_contact("auv", 100.0)
    assert feed.event("auv", event(4), 100.1) == []
    assert feed.release("auv", 101.9) == []
    assert texts(feed.release("auv", 102.1)) == ["event 4"]


def test_what_the_store_had_no_room_for_is_told_as_lost() -> None:
    feed = EventFeed({"auv": Cursor(STORE, 2)})
    feed.contact("auv", contact(last=5000))
    requested = feed.wanted("auv", 0.0)
    assert requested is not None
    assert texts(feed.answered("auv", requested, reply(range(1000, 1002), 5000), None))[:2] == [
        "997 events before were not kept onboard",
        "event 1000",
    ]


def test_a_platform_that_counts_anew_is_read_from_its_begin() -> None:
    feed = EventFeed({"auv": Cursor(STORE, 40)})
    feed.contact("auv", contact(last=50))
    requested = feed.wanted("auv", 0.0)
    assert requested is not None
    assert texts(feed.answered("auv", requested, reply(range(1, 3), 2, store=8), None)) == ["event 1", "event 2"]
    assert feed.cursors() == {"auv": Cursor(8, 2)}


@pytest.mark.thorough
def test_at_random_every_event_is_shown_once_and_in_order() -> None:
    for seed in range(200):
        chance = random.Random(seed)
        store = ReportStore(MemoryRecords(), STORE)
        contacts, feed, shown = Contacts(store), EventFeed({"auv": Cursor(STORE, 0)}), list[str]()
        store.owe()
        now_s, requested = 0.0, None
        for step in range(60):
            now_s += chance.random()
            live = store.add(CiEvent(severity=Severity.INFO, source="s", text=str(step + 1), t_s=now_s))
            for _ in range(chance.choice((0, 1, 1, 2))):  # lost, or doubled
                shown += texts(feed.event("auv", live, now_s))
            if chance.random() < 0.2:
                feed.note_contact("auv", now_s)
                shown += texts(feed.contact("auv", contact(store.last)))
            if chance.random() < 0.1:
                feed = EventFeed(feed.cursors())  # the station restarts
                requested = None
            requested = requested or feed.wanted("auv", now_s)
            if requested is not None and chance.random() < 0.5:
                shown += texts(feed.answered("auv", requested, _request(contacts, requested), now_s))
                requested = None
        shown += texts(feed.contact("auv", contact(store.last)))
        while (requested := requested or feed.wanted("auv", now_s := now_s + 10.0)) is not None:
            shown += texts(feed.answered("auv", requested, _request(contacts, requested), now_s))
            requested = None
        assert " ".join(shown) == " ".join(str(number) for number in range(1, 61)), seed
        assert store.delivered == 60


def test_what_an_observer_has_read_is_still_owed_to_the_operators() -> None:
    store = ReportStore(MemoryRecords(), STORE)
    store.owe()
    store.add(CiEvent(severity=Severity.INFO, source="s", text="1", t_s=0.0))
    requested = ReadReports(store=STORE, after=1, most=40)
    observer = CiRequest(sender="254", boot=0, sequence=0, body=requested, role=StationRole.OBSERVER)
    Contacts(store).read(observer, requested)
    assert store.delivered == 0
    _request(Contacts(store), requested)
    assert store.delivered == 1


def _request(contacts: Contacts, requested: ReadReports) -> CiReply:
    return contacts.read(CiRequest(sender="255", boot=0, sequence=0, body=requested), requested)


def test_the_store_outlives_its_process_and_stays_bounded() -> None:
    records = MemoryRecords()
    store = ReportStore(records, STORE)
    for number in range(MOST_KEPT + 2 * SPARE):
        store.add(CiEvent(severity=Severity.INFO, source="s", text=f"event {number + 1}", t_s=float(number)))
    store.deliver(3)
    again = ReportStore(records, 99)
    assert (again.id, again.last, again.delivered) == (STORE, MOST_KEPT + 2 * SPARE, 3)
    assert len(records.load()) <= MOST_KEPT + SPARE + 2
    assert again.after(again.last - 2, 10)[0].text == f"event {again.last - 1}"
    assert again.add(CiEvent(severity=Severity.INFO, source="s", text="x", t_s=0.0)).number == again.last


def test_numbers_that_a_power_cut_took_back_are_not_given_again_to_other_events() -> None:
    records = MemoryRecords()
    store = ReportStore(records, STORE, "first start")
    for number in range(3):
        store.add(CiEvent(severity=Severity.INFO, source="s", text="told", t_s=float(number)))
    assert ReportStore(records, 98, "first start").id == STORE, "the process alone had ended"
    records.rewrite(records.load()[:-1])
    after = ReportStore(records, 99, "second start")
    assert (after.id, after.last) == (99, 2)
    again = after.add(CiEvent(severity=Severity.INFO, source="s", text="another", t_s=9.0))
    assert (again.store, again.number) == (99, 3)
    records.append(b"\xc1 of another version")
    assert ReportStore(records, 100, "second start").id == 100, "it counts anew"


def test_what_had_no_room_on_the_disk_is_there_with_the_next_event(monkeypatch: pytest.MonkeyPatch) -> None:
    records = MemoryRecords()
    store = ReportStore(records, STORE)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(records, "append", full)
        store.add(CiEvent(severity=Severity.INFO, source="s", text="1", t_s=0.0))
    assert store.problem == "the events cannot be kept: No space left on device"
    store.add(CiEvent(severity=Severity.INFO, source="s", text="2", t_s=1.0))
    assert store.problem == ""
    assert [event.text for event in ReportStore(records, 99).after(0, 9)] == ["1", "2"]
