"""Files that an earlier version of the onboard process has kept (`tests/data/stores`) are read, and written on."""

import asyncio
import shutil
from pathlib import Path

from gloc3.clock import Clock, run_virtual
from gloc3.mavlink.signing import timestamp
from gloc3.messages.command_interface import CiRequest, Hello, Outcome
from gloc3.platform.reader import find_platform, load_platform
from gloc3.store import RecordFile
from gloc3_onboard.command_server.journal import Journal
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.command_server.vehicle_state import KeptHome
from gloc3_onboard.process.process_storage import SigningMemory

DATA = next(folder for folder in Path(__file__).parents if folder.name == "tests") / "data" / "stores"
KEY = bytes(range(32))


def kept(folder: Path) -> Site:
    """A life of the process on the files of a folder."""
    names = ("requests.journal", "progress.state", "events.store")
    journal, progress, reports = (RecordFile(folder / name) for name in names)
    return Site(load_platform(str(find_platform("pelican"))), journal, progress, reports, computer="first start")


def test_the_journal_the_progress_and_the_events_are_those_of_the_version_before(tmp_path: Path) -> None:
    shutil.copytree(DATA, tmp_path, dirs_exist_ok=True)
    site = kept(tmp_path)
    journal = Journal(site.journal)
    answers = [journal.begin(CiRequest(sender="255", boot=7, sequence=n, body=Hello())).reply for n in range(3)]
    assert [answer and (answer.outcome, answer.reason) for answer in answers] == [
        (Outcome.ACCEPTED, "done 0"),
        (Outcome.ACCEPTED, "done 1"),
        (Outcome.UNKNOWN, "the process ended while it was carried out"),
    ]
    snapshot, home = site.load()
    assert snapshot is not None
    assert (snapshot.count, snapshot.cause, snapshot.has_pilot, snapshot.kept_s) == (12, "battery", True, 81.5)
    assert home == KeptHome((1.0, 2.0, -0.5), (47.4, 8.5, 430.0))
    assert site.holder == "254"
    reports = site.reports
    assert (reports.id, reports.last, reports.delivered) == (4711, 3, 2)
    assert [(event.number, event.text) for event in reports.undelivered()] == [(3, "event 2")]
    assert site.problems() == []
    reports.deliver(3)
    site.keep_holder("253")
    again = kept(tmp_path)
    again.load()
    assert (again.holder, again.reports.delivered) == ("253", 3)


def test_signed_senders_are_those_of_the_version_before(tmp_path: Path) -> None:
    shutil.copytree(DATA, tmp_path, dirs_exist_ok=True)
    reported: list[str] = []

    async def streams() -> dict[tuple[int, int, int], int]:
        clock = Clock(asyncio.get_running_loop())
        signing = SigningMemory(tmp_path, clock, reported.append).signing(KEY, 1)
        assert timestamp(clock.utc_s()) == 34_715_520_000_000
        return dict(signing._streams.latest)

    assert run_virtual(streams()) == {(255, 190, 1): 34_715_520_000_000, (254, 190, 2): 34_715_519_999_500}
    assert reported == []
