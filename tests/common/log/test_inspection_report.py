"""`gloc3 log report`: pictures of a wall with their poses become coverage, drawings and a contact sheet."""

import json
import os
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from gloc3.camera.model import CameraModel
from gloc3.camera.wall_coverage import CoverageLimits
from gloc3.errors import Refused
from gloc3.log.cli import app
from gloc3.log.reader import find_log
from gloc3.log.report.inspection_report import write_report
from gloc3.log.report.recording import read_recording
from gloc3.log.report.walls import read_wall
from gloc3.messages.envelope import Source
from gloc3.messages.frames import from_yaw
from gloc3.messages.vehicle import ImageRecorded, Pose
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.process.storage import PictureFolder

from .samples import LogInMemory

FRONT = CameraModel(width=64, height=48, focal_px=(40.0, 40.0), center_px=(31.5, 23.5))
NORTH = from_yaw(0.0)
# Three pictures from 5 m before a wall 10 m north: 8 m wide and 6 m high each, 4 m apart.
PLACES = ((5.0, -4.0, -3.0), (5.0, 0.0, -3.0), (5.0, 4.0, -3.0))
WALL = "10,8,6 10,-8,6 10,-8,0 10,8,0"
"""16 m wide and 6 m high; y is to the left of x."""


class Calibrated:
    def model(self, camera: str) -> CameraModel | None:
        return FRONT if camera == "front" else None


def write_pictures(folder: Path) -> None:
    from gloc3.messages.vehicle import Image

    store = PictureFolder(folder, Calibrated())
    for number, place in enumerate(PLACES, start=1):
        pixels = np.full((48, 64), 60 * number, np.uint8)
        image = Image(camera="front", width=64, height=48, data=pixels.tobytes())
        store.write(RecordedPicture(f"front-{number:05d}.png", float(number), image, place, NORTH))


def write_log(file: Path) -> None:
    log, pose, recorder = LogInMemory(), Source("pelican", "pose", 1), Source("pelican", "recorder", 2)
    log.recorder.write_metadata("mission", {"name": "hold <wall>", "text": ""})
    for number, place in enumerate(PLACES, start=1):
        still = Pose(position_ned_m=place, velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=NORTH)
        log.send("pose", still, float(number), pose, "ned")
        recorded = ImageRecorded(
            action_id="a",
            camera="front",
            file=f"front-{number:05d}.png",
            index=number,
            position_ned_m=place,
            ned_from_frd=NORTH,
        )
        log.send("image_recorded", recorded, float(number), recorder)
    file.write_bytes(log.close())


def run(*arguments: object) -> Any:
    return app(["report", *(str(argument) for argument in arguments)], exit_on_error=True, result_action="return_value")


@pytest.mark.thorough
def test_a_run_becomes_a_page_with_figures_drawings_and_a_contact_sheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pictures(tmp_path / "images")
    write_log(tmp_path / "log.mcap")
    assert run(tmp_path, "--wall", WALL) == 0
    assert "3 pictures, 100.0 % of the wall seen, 50.0 % at least twice" in capsys.readouterr().out
    figures = json.loads((tmp_path / "report/report.json").read_text())
    assert figures["flown_m"] == pytest.approx(8.0)
    assert figures["coverage"] == pytest.approx(1.0, abs=0.05)
    assert figures["pixel_mm"] == pytest.approx(125.0, rel=0.02)
    page = (tmp_path / "report/report.html").read_text()
    assert "Inspection: hold &lt;wall&gt;" in page
    assert page.count("<svg") == 2
    assert str(tmp_path) not in page
    sheet = cv2.imread(str(tmp_path / "report/contact.png"), cv2.IMREAD_GRAYSCALE)
    assert sheet is not None
    assert {60, 120, 180} <= set(np.unique(sheet).tolist())


def test_pictures_without_a_log_and_a_wall_of_a_world_file_will_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pictures(tmp_path / "images")
    world = tmp_path / "world.yaml"
    world.write_text(
        "frames: {hold: {origin: {geo: [39.0, 2.0, 0.0]}, x_axis_bearing_deg: 0}}\nspawn: {frame: hold}\n"
        "surfaces: {fore: {corner_m: [10, 8, 6], across_m: [0, -16, 0], down_m: [0, 0, -6], texture: end}}\n"
    )
    assert run(tmp_path / "images", "--wall", f"{world}#fore", "--out", tmp_path / "there") == 0
    assert "100.0 % of the wall" in capsys.readouterr().out
    assert read_recording(tmp_path).pictures[1].camera == "front"
    (tmp_path / "images" / "front-00002.png").unlink()
    assert run(tmp_path, "--farthest", 4) == 0
    assert "3 pictures\n" in capsys.readouterr().out
    lifted = read_recording(tmp_path).lifted(0.5)
    assert [picture.position_ned_m[2] for picture in lifted.pictures] == [-3.5, -3.5, -3.5]


@pytest.mark.thorough
def test_the_last_flight_of_a_folder_is_reported_in_a_folder_of_its_own(tmp_path: Path) -> None:
    for number in ("", "-2", "-10"):
        write_pictures(tmp_path / f"images{number}")
        write_log(tmp_path / f"log{number}.mcap")
    assert find_log(tmp_path) == tmp_path / "log-10.mcap"
    assert run(tmp_path) == run(tmp_path / "log-2.mcap") == 0
    assert [(tmp_path / f"report{number}").exists() for number in ("", "-2", "-10")] == [False, True, True]
    (tmp_path / "empty").mkdir()
    with pytest.raises(Refused, match="no log in this folder"):
        find_log(tmp_path / "empty")


def test_of_several_hosts_logs_the_newest_with_the_wanted_topic_is_read(tmp_path: Path) -> None:
    for number, name in enumerate(("log-vision", "log-main", "log-base")):
        write_log(tmp_path / f"{name}.mcap")
        os.utime(tmp_path / f"{name}.mcap", (number, number))
    (tmp_path / "log-base.mcap").write_bytes(LogInMemory().close())
    with pytest.raises(Refused, match="more than one log"):
        find_log(tmp_path)
    assert find_log(tmp_path, "pose") == tmp_path / "log-main.mcap"
    with pytest.raises(Refused, match="more than one log"):
        find_log(tmp_path, "ci/request")


def test_pictures_are_told_in_the_frame_of_the_platform_and_with_the_time_of_day(tmp_path: Path) -> None:
    write_pictures(tmp_path / "images")
    recording = read_recording(tmp_path)
    assert recording.time_of(recording.pictures[0], 1) == "1.0 s"
    assert recording.frame is None
    known = msgspec.structs.replace(recording, bearings_deg={"hold": 90.0}, utc_offset_s=1_700_000_000.0)
    assert known.time_of(known.pictures[0], 1) == "22:13:21.0"
    write_report(known, known.cameras, None, CoverageLimits(), tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "<td>22:13:21.00</td><td>-4.00</td><td>5.00</td><td>3.00</td>" in page
    assert "in the frame hold" in page


def test_what_cannot_be_reported_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="neither a log nor pictures"):
        read_recording(tmp_path)
    write_pictures(tmp_path / "images")
    (tmp_path / "images/cameras.json").unlink()
    with pytest.raises(Refused, match="unknown camera 'front'"):
        run(tmp_path, "--wall", WALL)
    with pytest.raises(Refused, match="write each corner as x,y,height"):
        read_wall("1,2 3,4", {})
    with pytest.raises(Refused, match="choose one of a, b"):
        read_wall(WALL, {"a": 0.0, "b": 90.0})
    assert read_wall(WALL, {"a": 0.0, "b": 90.0}, "b").corner_ned_m == pytest.approx((8.0, 10.0, -6.0))
