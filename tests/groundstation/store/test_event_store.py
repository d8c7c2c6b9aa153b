"""All events of a session: kept on disk, found by any filter in slices, written to files."""

import csv
import io
import tempfile
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3_groundstation.desk.events_desk import check_target, export
from gloc3_groundstation.station.snapshots import FleetEvent
from gloc3_groundstation.store.event_search import SLICE, STATION, EventFilter, Search
from gloc3_groundstation.store.event_store import MOST_IN_MEMORY, RECENT, EventStore

pytestmark = pytest.mark.thorough

UTC_S = 1_700_000_000.0


def event(number: int, text: str = "", **changes: object) -> FleetEvent:
    plain = FleetEvent(
        number=number + 1,
        platform=("heron", "egret", "")[number % 3],
        received_s=float(number),
        severity=Severity(7 - number % 5),
        source=("pose", "", "driver")[number % 3],
        text=text or f"number {number}",
    )
    return msgspec.structs.replace(plain, **changes)


def filled(count: int, file: object = None) -> EventStore:
    store = EventStore(file, UTC_S)  # type: ignore[arg-type]
    for number in range(count):
        store.add(event(number))
    return store


def test_events_come_back_as_they_were_kept_the_old_ones_from_disk() -> None:
    store = filled(3 * RECENT)
    numbers = [0, 1, RECENT, 3 * RECENT - RECENT - 1, 3 * RECENT - 1]
    assert store.events(numbers) == [event(number) for number in numbers]
    odd = event(0, 'a "quoted" line\nand\x1b another — ünïcode')
    store.add(odd)
    at = len(store) - 1
    assert store.decode(store.lines(at, at + 1)).text == odd.text


def test_the_file_is_a_json_object_a_line_with_utc(tmp_path: Path) -> None:
    with (tmp_path / "events.jsonl").open("w+b") as file:
        filled(3, file).flush()
        lines = [msgspec.json.decode(line) for line in (tmp_path / "events.jsonl").read_bytes().splitlines()]
    assert lines[1] == {
        "number": 2,
        "utc_s": UTC_S + 1.0,
        "severity": "info",
        "platform": "egret",
        "component": "",
        "text": "number 1",
    }


FILTERS = [
    EventFilter(),
    EventFilter(severity=Severity.WARNING),
    EventFilter(platform="heron"),
    EventFilter(component=STATION, severity=Severity.NOTICE),
    EventFilter(text="NUMBER 77"),
    EventFilter(text="egr"),
    EventFilter(component="driver", text="9"),
    EventFilter(text="nothing has this"),
    EventFilter(platform="stork"),
]


@pytest.mark.parametrize("wanted", FILTERS)
def test_a_search_in_slices_finds_what_a_filter_lets_through_oldest_first(wanted: EventFilter) -> None:
    count = 2 * SLICE + 100
    store, search = filled(count - 50), None
    search = Search(store, wanted)
    search.step()
    for number in range(count - 50, count):
        store.add(event(number))
    search.finish()
    assert list(search) == [number for number in range(count) if wanted.fits(event(number))]
    assert search.is_done
    assert search.share == 1.0


@settings(max_examples=60)
@given(st.lists(st.text(max_size=12), max_size=30), st.text(max_size=3))
def test_any_text_is_found_whatever_it_is_made_of(texts: list[str], wanted: str) -> None:
    store = EventStore(tempfile.TemporaryFile())  # noqa: SIM115
    kept = [event(number, text=text or "empty") for number, text in enumerate(texts)]
    for one in kept:
        store.add(one)
    search = Search(store, EventFilter(text=wanted))
    search.finish()
    assert list(search) == [number for number, one in enumerate(kept) if search.wanted.fits(one)]
    store.close()


def test_the_newest_are_found_in_the_first_step_and_a_step_looks_at_one_slice_only() -> None:
    store = filled(10 * SLICE)
    search = Search(store, EventFilter(text="number"))
    assert search.step()
    assert list(search) == list(range(9 * SLICE, 10 * SLICE))
    assert search.share == pytest.approx(0.1)


class FullDisk(io.BytesIO):
    def write(self, data: object) -> int:
        raise OSError(28, "No space left on device")


def test_a_full_disk_is_told_and_the_last_events_stay() -> None:
    store = filled(2 * RECENT, FullDisk())
    search = Search(store, EventFilter(platform="heron"))
    search.finish()
    store.flush()
    assert store.problem == "events cannot be written: No space left on device"
    assert store.events([len(store) - 1]) == [event(2 * RECENT - 1)]
    assert store.generation > 0
    for number in range(MOST_IN_MEMORY + 10):
        store.add(event(number))
    assert len(store) <= MOST_IN_MEMORY + 1
    search.finish()
    assert {one.platform for one in store.events(list(search))} == {"heron"}


def test_a_disk_that_is_full_leaves_nothing_behind_that_fails_at_the_end_of_the_process() -> None:
    file = Path("/dev/full").open("r+b")  # noqa: SIM115 - the store closes it
    store = filled(3, file)
    store.flush()
    assert store.problem == "events cannot be written: No space left on device"
    assert file.closed


@pytest.mark.parametrize("name", ["all.csv", "all.jsonl"])
def test_what_fits_is_written_to_a_file_that_other_programs_read(name: str, tmp_path: Path) -> None:
    store = filled(5000)
    store.add(event(0, 'commas, "quotes"\nand lines'))
    path = check_target(str(tmp_path / name))
    wanted = EventFilter(platform="heron")
    assert export(store, wanted, path) == 1668
    if name.endswith("csv"):
        rows: list[dict[str, str]] = list(csv.DictReader(io.StringIO(path.read_text(), newline="")))
    else:
        rows = [msgspec.json.decode(line) for line in path.read_bytes().splitlines()]
    assert len(rows) == 1668
    assert rows[1]["time_utc"] == "2023-11-14T22:13:23.000Z"
    assert rows[-1]["text"] == 'commas, "quotes"\nand lines'
    assert {row["platform"] for row in rows} == {"heron"}
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_file_that_cannot_be_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "there.csv").write_text("mine")
    for name, reason in (
        ("events.txt", "must end in .csv or .jsonl"),
        ("nowhere/events.csv", "there is no folder 'nowhere'"),
        (str(tmp_path / "there.csv"), "is there already; give another name"),
    ):
        with pytest.raises(Refused, match=reason):
            check_target(name)
    with pytest.raises(Refused, match="cannot be written"):
        export(filled(1), EventFilter(), tmp_path / "there.csv" / "below.csv")
