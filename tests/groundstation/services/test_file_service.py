"""Files of a vehicle: listed, downloaded, uploaded and removed over a link that loses frames; refused in words."""

import asyncio
import random
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.files.ftp import FolderEntry
from gloc3.mavlink.transport.memory import Conditions
from gloc3_groundstation.services.progress import JobProgress

from .scripted_vehicle import Scene, over

CONTENT = random.Random(3).randbytes(20_000)
LOSSY = Conditions(loss=0.1, latency_s=0.02)


@pytest.fixture
def top(tmp_path: Path) -> Path:
    folder = tmp_path / "vehicle"
    (folder / "log").mkdir(parents=True)
    (folder / "log" / "a.ulg").write_bytes(CONTENT)
    (folder / "b.txt").write_text("text")
    return folder


def test_folders_are_listed_folders_first(top: Path) -> None:
    async def play(scene: Scene) -> None:
        files = scene.services.files
        found = await files.list()
        assert found.entries == (FolderEntry("log", True), FolderEntry("b.txt", False, 4))
        inner = await files.list(found.path_of(found.entries[0]))
        assert (inner.path, inner.parent, inner.entries) == ("/log", "/", (FolderEntry("a.ulg", False, 20_000),))
        assert (await files.list("/log/../log/.")).path == "/log"

    over(play, LOSSY, folder=top)


def test_a_file_is_downloaded_with_progress_and_has_its_name_only_when_it_is_whole(top: Path, tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        seen: list[JobProgress] = []
        path = await scene.services.files.download("/log/a.ulg", tmp_path, seen.append)
        assert path == tmp_path / "a.ulg"
        assert path.read_bytes() == CONTENT
        assert seen[-1].fraction == 1.0
        assert len(seen) > 10
        assert [file.name for file in tmp_path.iterdir() if file.is_file()] == ["a.ulg"]

    over(play, LOSSY, folder=top)


def test_another_file_of_the_same_name_stays_unless_the_new_path_is_given(top: Path, tmp_path: Path) -> None:
    (tmp_path / "b.txt").write_text("of another vehicle")
    (tmp_path / "c.txt").write_text("of another vehicle")

    async def play(scene: Scene) -> None:
        files = scene.services.files
        for _ in range(2):
            path = await files.download("/b.txt", tmp_path)
            assert (path.name, path.read_text()) == ("b-2.txt", "text")
        assert (tmp_path / "b.txt").read_text() == "of another vehicle"
        await files.download("/b.txt", tmp_path / "c.txt")
        assert (tmp_path / "c.txt").read_text() == "text"

    over(play, folder=top)


def test_a_file_is_uploaded_checked_and_removed(top: Path, tmp_path: Path) -> None:
    (tmp_path / "new.bin").write_bytes(CONTENT[:5000])

    async def play(scene: Scene) -> None:
        files, seen = scene.services.files, list[JobProgress]()
        await files.make_folder("/up")
        assert await files.upload(tmp_path / "new.bin", "/up", seen.append) == "/up/new.bin"
        assert (top / "up" / "new.bin").read_bytes() == CONTENT[:5000]
        assert seen[-1].fraction == 1.0
        await files.rename("/up/new.bin", "/up/old.bin")
        await files.remove("/up/old.bin")
        await files.remove_folder("/up")
        assert not (top / "up").exists()

    over(play, LOSSY, folder=top)


def test_refusals_are_in_words(top: Path, tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        files = scene.services.files
        for work, words in (
            (files.list("/none"), "/none cannot be listed: there is no such file or folder"),
            (files.download("/none.bin", tmp_path), "/none.bin cannot be downloaded: there is no such file or folder"),
            (files.remove("/none"), "/none cannot be removed: there is no such file or folder"),
            (files.make_folder("/log"), "the folder /log cannot be made: it exists already"),
            (files.list("/../secret"), "leads above the top folder"),
            (files.upload(tmp_path / "none", "/"), "none cannot be read: No such file or directory"),
            (files.download("/b.txt", tmp_path / "no" / "where.txt"), "there is no folder"),
        ):
            with pytest.raises(Refused, match=words):
                await work

    over(play, folder=top)


def test_a_vehicle_without_files_is_not_waited_for_long() -> None:
    async def play(scene: Scene) -> None:
        begun_s = asyncio.get_running_loop().time()
        with pytest.raises(Refused, match="no answer"):
            await scene.services.files.list()
        assert asyncio.get_running_loop().time() - begun_s < 10.0

    over(play)


def test_a_download_is_cancelled_and_the_next_one_works(top: Path, tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        task = asyncio.ensure_future(scene.services.files.download("/log/a.ulg", tmp_path))
        await scene.pass_s(0.1)
        assert not task.done()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert await scene.services.files.read("/b.txt") == b"text"

    over(play, Conditions(latency_s=0.02, bandwidth_bit_s=57_600, bits_per_byte=10), folder=top)


def test_the_services_that_are_closed_refuse_who_waits(top: Path) -> None:
    async def play(scene: Scene) -> None:
        scene.cut()
        task = asyncio.ensure_future(scene.services.files.list())
        await scene.pass_s(0.1)
        await scene.services.close()
        with pytest.raises(Refused, match="are closed"):
            await task
        with pytest.raises(Refused, match="are closed"):
            await scene.services.files.list()

    over(play, folder=top)


RADIO = Conditions(latency_s=0.02, bandwidth_bit_s=200_000, bits_per_byte=10)


def test_a_download_goes_to_the_disk_as_it_comes_and_goes_on_where_it_was_cut_off(top: Path, tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        seen: list[JobProgress] = []
        task = asyncio.ensure_future(scene.services.files.download("/log/a.ulg", tmp_path))
        await scene.pass_s(0.6)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        part = tmp_path / "a.ulg.20000.part"
        begun = part.read_bytes()
        assert 2_000 < len(begun) < 18_000
        assert CONTENT.startswith(begun)
        path = await scene.services.files.download("/log/a.ulg", tmp_path, seen.append)
        assert path.read_bytes() == CONTENT
        assert not part.exists()
        assert seen[1].fraction is not None
        assert seen[1].fraction >= len(begun) / len(CONTENT)

    over(play, RADIO, folder=top)


def test_what_is_left_of_a_file_that_was_another_is_found_out_and_not_used(top: Path, tmp_path: Path) -> None:
    part = tmp_path / "a.ulg.20000.part"
    part.write_bytes(b"other" * 1000)

    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match=r"a.ulg has changed since its download was begun; download it again"):
            await scene.services.files.download("/log/a.ulg", tmp_path)
        assert not part.exists()
        assert (await scene.services.files.download("/log/a.ulg", tmp_path)).read_bytes() == CONTENT

    over(play, folder=top)


def test_a_disk_that_is_full_ends_a_download_in_words_and_the_next_one_works(top: Path, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a.ulg.20000.part").symlink_to("/dev/full")

    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match=r"a.ulg.20000.part cannot be written: No space left on device"):
            await scene.services.files.download("/log/a.ulg", tmp_path / "full")
        assert (await scene.services.files.download("/log/a.ulg", tmp_path)).read_bytes() == CONTENT

    over(play, RADIO, folder=top)


def test_an_empty_file_is_downloaded(top: Path, tmp_path: Path) -> None:
    (top / "empty").touch()

    async def play(scene: Scene) -> None:
        assert (await scene.services.files.download("/empty", tmp_path)).read_bytes() == b""

    over(play, folder=top)
