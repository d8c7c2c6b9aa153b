"""Logs of a vehicle: listed, downloaded, and taken up again where a download was cut off."""

import asyncio
import random
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.transport.memory import Conditions
from gloc3_groundstation.services.progress import JobProgress

from .scripted_vehicle import ARDUPILOT, Logs, Scene, over

CONTENT = random.Random(4).randbytes(60_000)


def test_logs_are_listed_the_newest_first_and_named(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        lines = await scene.services.logs.list()
        assert [(line.entry.number, line.entry.size) for line in lines] == [(2, 60_000), (1, 10)]
        assert lines[0].begun == "2023-11-14 22:13"
        assert lines[0].file_name == "log_002_2023-11-14_22-13-20.bin"

    over(play, Conditions(latency_s=0.02), autopilot=ARDUPILOT, logs=Logs(b"0123456789", CONTENT))


def test_a_vehicle_without_logs_has_an_empty_list() -> None:
    async def play(scene: Scene) -> None:
        assert await scene.services.logs.list() == ()

    over(play)


def test_a_log_is_downloaded_with_progress(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        seen: list[JobProgress] = []
        (line,) = await scene.services.logs.list()
        path = await scene.services.logs.download(line, tmp_path, seen.append)
        assert path.read_bytes() == CONTENT
        assert [file.name for file in tmp_path.iterdir()] == [line.file_name]
        assert seen[-1].fraction == 1.0
        assert seen[-1].detail == "0.06 of 0.06 MB"

    over(play, Conditions(latency_s=0.02, loss=0.1), logs=Logs(CONTENT))


@pytest.mark.parametrize("how", ["cancelled", "link lost"])
def test_a_download_that_was_cut_off_goes_on_where_it_ended(tmp_path: Path, how: str) -> None:
    logs = Logs(CONTENT)

    async def play(scene: Scene) -> None:
        (line,) = await scene.services.logs.list()
        task = asyncio.ensure_future(scene.services.logs.download(line, tmp_path))
        await scene.pass_s(1.0)
        if how == "cancelled":
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        else:
            scene.cut()
            with pytest.raises(Refused, match="log 1 was not downloaded: no answer"):
                await task
            scene.mend()
        (part,) = tmp_path.iterdir()
        begun = part.read_bytes()
        assert part.name.endswith(".part")
        assert 10_000 < len(begun) < len(CONTENT)
        assert CONTENT.startswith(begun)
        await scene.pass_s(1.0)
        logs.bytes_read = 0
        path = await scene.services.logs.download(line, tmp_path)
        assert path.read_bytes() == CONTENT
        assert logs.bytes_read < len(CONTENT) - len(begun) + 500
        assert list(tmp_path.iterdir()) == [path]

    over(play, Conditions(latency_s=0.02), logs=logs)


def test_what_is_left_of_another_log_is_not_used(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        (line,) = await scene.services.logs.list()
        (tmp_path / f"{line.file_name}.1-59000-1700000000.part").write_bytes(b"other" * 1000)
        path = await scene.services.logs.download(line, tmp_path)
        assert path.read_bytes() == CONTENT

    over(play, logs=Logs(CONTENT))


def test_a_log_of_the_same_name_stays_and_the_same_log_is_not_kept_twice(tmp_path: Path) -> None:
    other = random.Random(5).randbytes(60_000)

    async def play(scene: Scene) -> Path:
        (line,) = await scene.services.logs.list()
        return await scene.services.logs.download(line, tmp_path)

    first, second, again = (over(play, logs=Logs(content)) for content in (CONTENT, other, other))
    assert first.read_bytes() == CONTENT
    assert second.read_bytes() == other
    assert (second.name, again) == (f"{first.stem}-2{first.suffix}", second)
    assert sorted(tmp_path.iterdir()) == sorted([first, second])


def test_a_folder_that_is_not_there_is_refused_at_once(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        (line,) = await scene.services.logs.list()
        with pytest.raises(Refused, match="there is no folder"):
            await scene.services.logs.download(line, tmp_path / "none")
        assert (await scene.services.logs.download(line, tmp_path)).exists()

    over(play, logs=Logs(CONTENT))


def test_one_request_at_a_time(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        (line,) = await scene.services.logs.list()
        task = asyncio.ensure_future(scene.services.logs.download(line, tmp_path))
        await scene.pass_s(0.1)
        with pytest.raises(Refused, match="being listed or read"):
            await scene.services.logs.list()
        await task

    over(play, logs=Logs(CONTENT))
