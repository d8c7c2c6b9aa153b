"""What `gloc3 log pull` says: which logs there are, how far and how fast, and how to go on after Ctrl-C."""

import asyncio
import re
from collections.abc import Callable, Coroutine
from pathlib import Path
from random import Random
from typing import Any

import pytest
from tests.groundstation.store.test_log_pull import Vessel

from gloc3.clock import VirtualLoop
from gloc3.errors import Gloc3Error, Refused
from gloc3_groundstation.cli.log_pull import PullProgress, PullRequest, fetch, pull
from gloc3_groundstation.store.download_progress import DownloadProgress

SIZE = 6_000_000


@pytest.fixture
def there(tmp_path: Path) -> Path:
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "log.mcap").write_bytes(Random(0).randbytes(SIZE))
    (folder / "log-2.mcap").write_bytes(b"begun")
    return folder


def fetched(
    there: Path, out: Path, wanted: dict[str, Any] | None = None, play: Callable[..., Any] = lambda *_: None
) -> int:
    """The command's code; `play` may do something to vessel and command."""

    async def steps() -> int:
        vessel, loop = Vessel(there, unfinished="log-2.mcap"), asyncio.get_running_loop()
        progress = PullProgress(loop)
        puller = vessel.puller(progress.pause, progress.update)
        command = loop.create_task(fetch(puller, "auv", PullRequest(out=out, **(wanted or {})), progress))
        played = play(vessel, command)
        if isinstance(played, Coroutine):
            await played
        try:
            return await command
        finally:
            vessel.close()

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(steps())


def test_it_tells_how_far_and_how_fast_and_after_an_interruption_where_it_goes_on(
    there: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def interrupt(_: Vessel, command: "asyncio.Task[int]") -> None:
        await asyncio.sleep(5.0)
        command.cancel()

    with pytest.raises(asyncio.CancelledError):
        fetched(there, tmp_path, play=interrupt)
    text = capsys.readouterr().err
    assert re.search(r"log.mcap: \d+ % of 6.0 MB, \d+ kB/s, \d+ s to go\n", text), text
    left = re.search(r"log.mcap: (\d+) % is here and kept; the same command resumes it\n", text)
    assert left is not None, text
    assert fetched(there, tmp_path, {"is_list": True, "is_uncut": True}) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["log.mcap", "6.0", "MB", left[1], "%", "here"]
    assert lines[1].split() == ["log-2.mcap", "5", "bytes", "is", "being", "written"]
    assert fetched(there, tmp_path) == 0
    out, text = capsys.readouterr()
    assert f"log.mcap: resumes at {left[1]} % of 6.0 MB" in text
    assert "log.mcap: 6.0 MB, digest equal, deleted onboard" in text
    assert out == f"{tmp_path / 'auv' / 'log.mcap'}\n"
    assert not (there / "log.mcap").exists()


def test_a_station_that_may_only_look_fetches_what_is_finished_and_deletes_nothing(
    there: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def allow(vessel: Vessel, _: object) -> None:
        vessel.may_only_look = True

    assert fetched(there, tmp_path, play=allow) == 0
    text = capsys.readouterr().err
    assert "the current log was not closed: station 255 may look and not command" in text
    assert "log.mcap: 6.0 MB, digest equal, left onboard" in text
    assert (there / "log.mcap").read_bytes() == (tmp_path / "auv" / "log.mcap").read_bytes()


def test_logs_that_are_not_there_or_not_finished_are_refused_with_what_to_do(there: Path, tmp_path: Path) -> None:
    with pytest.raises(Gloc3Error, match=r"auv has no log 'log-3.mcap'; it has log.mcap, log-2.mcap"):
        fetched(there, tmp_path, {"names": ("log-3.mcap",)})
    with pytest.raises(Gloc3Error, match=r"log-2.mcap is still being written; without --no-cut it is closed first"):
        fetched(there, tmp_path, {"names": ("log-2.mcap",), "is_uncut": True})


def test_wrong_use_says_what_is_meant() -> None:
    with pytest.raises(Refused, match=r"'nowhere' is no link, such as udpin://0\.0\.0\.0:14550 .* and no network file"):
        pull("nowhere")
    with pytest.raises(Refused, match="--list names all logs and fetches none"):
        pull("udpin://127.0.0.1:0", "log.mcap", list_only=True)


def test_the_speed_is_that_of_late() -> None:
    pace = DownloadProgress()
    assert pace.words(0, 1_000_000, 0.0) == "0 % of 1.0 MB"
    assert pace.words(100_000, 1_000_000, 10.0) == "10 % of 1.0 MB, 10 kB/s, 1 min to go"
    pace.reset()
    assert pace.words(500_000, 1_000_000, 100.0) == "50 % of 1.0 MB"
    assert pace.words(700_000, 1_000_000, 102.0) == "70 % of 1.0 MB, 100 kB/s, 3 s to go"
