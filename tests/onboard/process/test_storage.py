"""Pictures as files, which are never overwritten."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import exifread
import pytest

from gloc3.camera.model import CameraModel
from gloc3.messages.vehicle import Image
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.process.storage import NoPictures, PictureFolder


def picture(number: int, camera: str = "ground") -> RecordedPicture:
    image = Image(camera=camera, width=4, height=2, data=bytes(range(8)))
    return RecordedPicture(f"{camera}-{number:05d}.png", 1.5, image, (1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0))


def test_pictures_are_real_files_with_their_poses_beside_them(tmp_path: Path) -> None:
    import cv2

    folder = PictureFolder(tmp_path / "images")
    folder.write(picture(1))
    folder.write(picture(2))
    pixels = cv2.imread(str(tmp_path / "images" / "ground-00001.png"), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    assert pixels.tobytes() == bytes(range(8))
    colours = bytes(range(24))
    image = Image(camera="front", width=4, height=2, data=bytes(8), bgr=colours)
    folder.write(RecordedPicture("front-00001.png", 1.5, image, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    pixels = cv2.imread(str(tmp_path / "images" / "front-00001.png"), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.tobytes() == colours
    tags = [json.loads(line) for line in (tmp_path / "images" / "poses.jsonl").read_text().splitlines()]
    assert [tag["file"] for tag in tags] == ["ground-00001.png", "ground-00002.png", "front-00001.png"]
    assert tags[0]["position_ned_m"] == [1.0, 2.0, -3.0]
    assert not list((tmp_path / "images").glob("*.part"))
    assert [each.file for each in folder.written({"ground", "front"})] == [
        "ground-00001.png",
        "ground-00002.png",
        "front-00001.png",
    ]
    assert folder.written({"ground"}) == []


def test_pictures_carry_the_calibration_and_the_time(tmp_path: Path) -> None:
    class Rig:
        def model(self, camera: str) -> CameraModel:
            return CameraModel(
                width=4 * 16, height=2 * 16, focal_px=(64.0, 64.0), center_px=(31.5, 15.5), make="Arducam"
            )

    folder = PictureFolder(tmp_path, Rig(), lambda: 1_790_000_000.0)
    folder.write(picture(1)._replace(file="ground-00001.jpg", origin_geo=(39.5, 2.6, 4.0)))
    with (tmp_path / "ground-00001.jpg").open("rb") as file:
        found = exifread.process_file(file, details=False)
    assert str(found["Image Make"]) == "Arducam"
    assert str(found["EXIF DateTimeOriginal"]) == "2026:09:21 14:13:21"
    assert float(found["GPS GPSAltitude"].values[0]) == 7.0
    assert json.loads((tmp_path / "cameras.json").read_text())["ground"]["make"] == "Arducam"


def test_a_thread_writes_and_the_caller_does_not_wait(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as worker:
        gate, bell = Event(), Event()
        worker.submit(gate.wait)
        folder = PictureFolder(tmp_path / "images", worker=worker)
        folder.on_written(bell.set)
        folder.write(picture(1))
        assert folder.written({"ground"}) == []
        gate.set()
        assert bell.wait(10.0)
        assert [each.file for each in folder.written({"ground"})] == ["ground-00001.png"]
        (tmp_path / "images" / "ground-00002.png.part").mkdir()
        bell.clear()
        folder.write(picture(2))
        assert bell.wait(10.0)
        with pytest.raises(OSError, match="directory"):
            folder.written({"ground"})


def test_the_numbers_that_are_taken_are_known(tmp_path: Path) -> None:
    folder = PictureFolder(tmp_path)
    assert folder.highest("ground") == 0
    folder.write(picture(7))
    folder.write(picture(9, "front"))
    folder.write(picture(11, "front")._replace(file="front-00011.jpg"))
    (tmp_path / "ground-odd.png").write_bytes(b"")
    assert (folder.highest("ground"), folder.highest("front")) == (7, 11)
    nothing = NoPictures()
    nothing.write(picture(1))
    assert (nothing.count, nothing.highest("ground")) == (1, 0)
