"""The events screen, driven by keys: typing a search, choosing, following, and writing a file."""

from pathlib import Path

import pytest
from tests.evidence.day import fill
from tests.groundstation.station_scene import scene
from textual.widgets import Input

from gloc3.messages.envelope import Severity
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.store.event_search import EventFilter, Search
from gloc3_groundstation.store.event_store import EventStore
from gloc3_groundstation.tui.dialogues.questions import TextQuestion
from gloc3_groundstation.tui.views.events import event_rows, filter_line
from gloc3_groundstation.tui.widgets.lines import text_of


def test_a_row_tells_time_severity_vehicle_component_and_text_in_one_line() -> None:
    fleet = reducers.note(Fleet(), "heron", Severity.WARNING, "gust of\n7 m/s " * 20, 65.0, source="limiter")
    (row,) = event_rows(fleet.events, 0.0, 80)
    assert text_of(row).split()[:5] == ["01:05", "warning", "heron", "limiter", "gust"]
    assert 75 < len(text_of(row)) <= 80


def test_the_filter_says_what_is_set_and_how_far_the_search_is() -> None:
    store = EventStore()
    fleet = Fleet()
    for number in range(10_000):
        fleet = reducers.note(Fleet(), "heron", Severity.INFO, f"{number}", 0.0)
        store.add(fleet.events[0])
    search = Search(store, EventFilter(text="99", severity=Severity.WARNING))
    search.step()
    line = text_of(filter_line(search.wanted, search, len(store), 100))
    assert "severity warning+" in line
    assert "text “99”" in line
    assert line.rstrip().endswith("0 of 10,000, 41 % searched")


@pytest.mark.sockets
async def test_an_operator_searches_while_typing_follows_the_end_and_writes_a_file(tmp_path: Path) -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.go("9")
        for number in range(300):
            here.platform.event(f"number {number}", Severity.WARNING if number % 10 else Severity.ERROR, "limiter")
        await here.until("event", "number 299")
        await here.press("slash")
        await here.types("num")
        await here.wait(lambda: here.app.desk.events.search.wanted.text == "num")
        here.app.screen.query_one("#search", Input).value = "NUMBER 17"
        await here.until("filter", "11 of 3")
        assert "number 179" in here.shown("event")
        await here.enter()
        await here.press("l", "l", "l")
        await here.until("filter", "severity error+")
        await here.until("event", "number 170")
        await here.press("e")
        await here.shows(TextQuestion)
        (await here.field()).value = str(tmp_path / "some.jsonl")
        await here.press("enter")
        await here.wait((tmp_path / "some.jsonl").exists)
        assert len((tmp_path / "some.jsonl").read_text().splitlines()) == 1
        await here.press("escape")
        await here.until("filter", "severity all")
        await here.until("event", "1 event is in")
        await here.press("up", "up")
        await here.until("event", "number 298")
        total = len(here.app.desk.events.store)
        here.platform.event("one more")
        await here.wait(lambda: len(here.app.desk.events.search) > total)
        assert "number 298" in here.shown("event"), "the cursor stays with its event"
        await here.press("home")
        await here.until("event", "is heard")
        await here.press("end")
        await here.until("event", "one more")


@pytest.mark.thorough
async def test_a_hundred_thousand_events_neither_slow_the_terminal_nor_fill_the_memory() -> None:
    figures = await fill(100_000)
    assert figures["found"] == 1
    assert figures["after_mb"] - figures["before_mb"] < 30.0
