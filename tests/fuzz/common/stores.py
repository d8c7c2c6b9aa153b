"""Targets of what a process finds on its disk after a power cut, or after somebody has edited it."""

from typing import Final

import msgspec
from tests.fuzz.target import as_file, fuzz_target

from gloc3.messages.command_interface import CiReply, CiRequest, Outcome, Steer, Verb
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent
from gloc3.platform.reader import load_platform
from gloc3.store import DocumentFile, MemoryRecords, RecordFile
from gloc3_groundstation.station.event_feed import Cursor
from gloc3_groundstation.store.contact_queue import Queued
from gloc3_groundstation.store.kept_state import KeptSilence
from gloc3_onboard.command_server.journal import Journal
from gloc3_onboard.command_server.report_store import ReportStore
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.process.memory import RecordMemory

PLATFORM: Final = load_platform("pelican_rtk")


def records_of(data: bytes) -> list[bytes]:
    """The bytes as records: a length of two bytes before each."""
    found, place = [], 0
    while place + 2 <= len(data):
        length = int.from_bytes(data[place : place + 2], "little") % 600
        found.append(data[place + 2 : place + 2 + length])
        place += 2 + length
    return found


@fuzz_target("gloc3.store")
def record_file(data: bytes) -> None:
    """A file of records gives the whole ones at its begin; what is added after that is read with them."""
    path = as_file(data, "records/x.1")
    for other in path.parent.iterdir():
        if other != path:
            other.unlink()
    file = RecordFile(path.with_name("x"))
    kept = file.load()
    assert sum(map(len, kept)) <= len(data)
    file.append(b"new", outlives_power_cut=False)
    assert RecordFile(path.with_name("x")).load() == [*kept, b"new"]


@fuzz_target("gloc3_onboard.command_server.journal", "gloc3_onboard.command_server.report_store", "gloc3.messages")
def records_of_the_command_server(data: bytes) -> None:
    """Journal, events, progress and memory begin with whatever records there are, and go on."""
    records = records_of(data)

    def kept() -> MemoryRecords:
        found = MemoryRecords()
        found.rewrite(records)
        return found

    journal = Journal(kept())
    request = CiRequest(sender="fuzz", boot=1, sequence=2**53, body=Steer(verb=Verb.PAUSE))
    if journal.begin(request).is_new:
        journal.end(CiReply(sender="fuzz", boot=1, sequence=2**53, outcome=Outcome.ACCEPTED))
        assert journal.query("fuzz", 1, 2**53)[0] is Outcome.ACCEPTED
    store = ReportStore(kept(), 5, "computer")
    first = store.add(CiEvent(severity=Severity.INFO, source="c", text="t", t_s=1.0))
    assert store.last == first.number > 0
    assert store.after(first.number - 1, 10)[-1].text == "t"
    RecordMemory(kept(), "computer").load()
    Site(PLATFORM, kept(), kept(), kept()).load()


@fuzz_target("gloc3.store.files", "gloc3_groundstation.store")
def kept_documents(data: bytes) -> None:
    """The files in which a station keeps its state are read, or count as unreadable, and are written again."""
    for kind in (dict[str, Cursor], dict[str, KeptSilence], list[Queued]):
        path = as_file(data, "state.json")
        path.with_name("state.json.old").unlink(missing_ok=True)
        file: DocumentFile[object] = DocumentFile(path, kind)
        found = file.read()
        assert found is not None or file.problem
        if found is not None:
            assert msgspec.json.decode(msgspec.json.encode(found), type=kind) == found
