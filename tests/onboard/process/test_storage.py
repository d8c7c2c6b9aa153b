"""Pictures as files, which are never overwritten."""

import json
from pathlib import Path

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


def test_the_numbers_that_are_taken_are_known(tmp_path: Path) -> None:
    folder = PictureFolder(tmp_path)
    assert folder.highest("ground") == 0
    folder.write(picture(7))
    folder.write(picture(9, "front"))
    (tmp_path / "ground-odd.png").write_bytes(b"")
    assert (folder.highest("ground"), folder.highest("front")) == (7, 9)
    nothing = NoPictures()
    nothing.write(picture(1))
    assert (nothing.written, nothing.highest("ground")) == (1, 0)
