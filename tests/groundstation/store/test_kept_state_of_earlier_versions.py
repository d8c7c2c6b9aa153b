"""Files that an earlier version of the station has kept (`tests/data/stores`) are read, and written on."""

import asyncio
import shutil
from pathlib import Path

from gloc3.clock import VirtualLoop
from gloc3.exchange import LocalExchange
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.station.event_feed import Cursor
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.contact_queue import ContactQueue
from gloc3_groundstation.store.kept_state import FeedFile, SilenceFile

DATA = next(folder for folder in Path(__file__).parents if folder.name == "tests") / "data" / "stores"


def test_silences_cursors_and_what_waits_are_those_of_the_version_before(tmp_path: Path) -> None:
    shutil.copytree(DATA, tmp_path, dirs_exist_ok=True)

    async def steps() -> None:
        loop = asyncio.get_running_loop()
        feed = FeedFile(tmp_path / "255-shown.json", loop)
        assert feed.feed.cursors() == {"heron": Cursor(4711, 3)}
        station = Station(LocalExchange(TopicTable.installed()), loop, "255", 1, feed.feed)
        silences = SilenceFile(tmp_path / "255-silences.json", station, loop)
        known = station.fleet.get("auv")
        assert known is not None
        assert known.silence is not None
        assert (known.silence.target, known.silence.until_s) == ("dive", 600.0)
        queue = ContactQueue(station, tmp_path / "255-queue.json")
        assert [(queued.number, queued.plan.title) for queued in queue.of("petrel")] == [(1, "one")]
        assert queue.withdraw("petrel")
        for part in (queue, silences, feed):
            part.close()
        assert ContactQueue(station, tmp_path / "255-queue.json").of("petrel") == []
        assert (tmp_path / "255-shown.json").read_bytes() == (DATA / "255-shown.json").read_bytes()
        station.close()

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(steps())
