"""The image recorder: by distance, by time, so many; each picture with the pose of its own moment; disks that are full."""

import itertools
import math
from collections.abc import Container
from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused
from gloc3.messages.frames import from_yaw, yaw_of
from gloc3.messages.vehicle import Image, ImageRecorded
from gloc3.mission.model.messages import ActionStatus
from gloc3_onboard.components.drivers.image_recorder import (
    MOST_WAITING,
    ImageRecorder,
    PictureFormat,
    RecordedPicture,
    RecorderSettings,
)
from gloc3_onboard.process.storage import NoPictures


class Shelf(NoPictures):
    """Keeps pictures, has no room, or is slow."""

    def __init__(self, used: int = 0) -> None:
        super().__init__()
        self.pictures: list[RecordedPicture] = []
        self.used = used
        self.is_full = self.is_slow = False

    def highest(self, camera: str) -> int:
        return self.used

    def write(self, picture: RecordedPicture) -> None:
        super().write(picture)
        self.pictures.append(picture)

    def written(self, cameras: Container[str]) -> list[RecordedPicture]:
        if self.is_full:
            raise OSError(28, "No space left on device")
        return [] if self.is_slow else super().written(cameras)


def image(camera: str = "ground", **fields: Any) -> Image:
    return Image(camera=camera, width=2, height=1, data=b"ab", **fields)


class Rig:
    """A recorder on a vehicle that flies north; a frame every 0.1 s, a pose every 0.05 s."""

    def __init__(self, speed_m_s: float = 1.0, used: int = 0) -> None:
        self.shelf = Shelf(used)
        self.stage = Stage(ImageRecorder(self.shelf))
        self.speed_m_s = speed_m_s
        self.has_pose = True

    def run(self, seconds: float, **fields: Any) -> None:
        for _ in range(round(seconds / 0.05)):
            now_s = self.stage.now_s + 0.05
            messages: dict[str, Any] = {}
            if self.has_pose:
                velocity = (self.speed_m_s, 0.0, 0.0)
                messages["pose"] = pose(self.speed_m_s * now_s, velocity_ned_m_s=velocity)
            if round(now_s / 0.05) % 2 == 0:
                messages["image"] = image(**fields)
            self.stage.step(0.05, **messages)


def test_by_distance_the_first_at_once() -> None:
    rig = Rig()
    rig.run(0.5)
    rig.stage.begin("record_images", camera="ground", every_m=0.5)
    rig.run(3.0)
    norths = [picture.position_ned_m[0] for picture in rig.shelf.pictures]
    assert len(norths) == 6
    assert norths[0] == pytest.approx(0.6)
    assert all(0.5 <= b - a <= 0.61 for a, b in itertools.pairwise(norths))
    recorded = rig.stage.all(ImageRecorded)
    assert [message.file for message in recorded] == [picture.file for picture in rig.shelf.pictures]
    assert recorded[0].action_id == "go"


def test_a_vehicle_that_stands_is_pictured_once_by_distance_and_again_by_time() -> None:
    for every, count in (({"every_m": 0.5}, 1), ({"every_s": 0.5}, 6)):
        rig = Rig(speed_m_s=0.0)
        rig.run(0.2)
        order: dict[str, Any] = {"camera": "ground", **every}
        rig.stage.begin("record_images", **order)
        rig.run(3.0)
        assert len(rig.shelf.pictures) == count


def test_so_many_and_then_it_is_done() -> None:
    rig = Rig()
    rig.run(0.2)
    rig.stage.begin("record_images", camera="ground", every_s=0.2, count=3)
    rig.run(2.0)
    assert len(rig.shelf.pictures) == 3
    assert (rig.stage.status.state, rig.stage.status.progress) == ("done", 1.0)


def test_pictures_of_an_earlier_attempt_count_and_each_is_reported_at_once() -> None:
    rig = Rig()
    rig.run(0.2)
    rig.stage.begin("record_images", camera="ground", every_s=0.2, count=7, progress=4 / 7)
    rig.run(2.0)
    assert len(rig.shelf.pictures) == 3
    reports = [(status.state, status.achieved) for status in rig.stage.all(ActionStatus)]
    assert reports[-3:] == [("running", 5), ("running", 6), ("done", 7)]


def test_another_camera_is_refused() -> None:
    rig = Rig()
    rig.run(0.2)
    with pytest.raises(Refused, match="this recorder has camera 'ground', not 'front'"):
        rig.stage.begin("record_images", camera="front", every_s=1.0)


def test_one_of_several_cameras_is_recorded_and_its_silence_is_told() -> None:
    rig = Rig()
    for camera in ("ground", "front_left"):
        rig.run(0.2, camera=camera)
    rig.stage.begin("record_images", camera="front_left", every_s=0.2)
    rig.run(0.5, camera="front_left")
    rig.run(3.0, camera="ground")
    assert {picture.image.camera for picture in rig.shelf.pictures} == {"front_left"}
    assert [picture.file for picture in rig.shelf.pictures][:2] == ["front_left-00001.jpg", "front_left-00002.jpg"]
    assert rig.stage.status.reason == "no picture of front_left received"


def test_a_picture_is_tagged_with_the_pose_of_its_own_time() -> None:
    rig = Rig()
    stage = rig.stage
    stage.begin("record_images", camera="ground", every_s=0.1)
    stage.put(1.00, pose=pose(10.0, ned_from_frd=from_yaw(0.0)))
    stage.put(1.10, pose=pose(12.0, height=4.0, ned_from_frd=from_yaw(0.4)))
    stage.put(1.025, image=image())
    stage.now_s = 1.12
    stage.cycle()
    (picture,) = rig.shelf.pictures
    assert picture.t_s == 1.025
    assert picture.position_ned_m == pytest.approx((10.5, 0.0, -2.5))
    assert yaw_of(picture.ned_from_frd) == pytest.approx(0.1)


def test_a_picture_newer_than_the_last_pose_is_placed_by_its_velocity() -> None:
    rig = Rig()
    rig.stage.begin("record_images", camera="ground", every_s=0.1)
    rig.stage.put(1.0, pose=pose(10.0, velocity_ned_m_s=(2.0, 0.0, 0.0)))
    rig.stage.put(1.05, image=image())
    rig.stage.cycle()
    assert rig.shelf.pictures[0].position_ned_m == pytest.approx((10.1, 0.0, -2.0))


def test_across_a_jump_of_the_estimate_nothing_is_interpolated() -> None:
    rig = Rig()
    rig.stage.begin("record_images", camera="ground", every_s=0.1)
    rig.stage.put(1.0, pose=pose(10.0))
    rig.stage.put(1.1, pose=pose(20.0, reset_counter=1))
    rig.stage.put(1.02, image=image())
    rig.stage.cycle()
    assert rig.shelf.pictures[0].position_ned_m[0] == pytest.approx(10.0)


def test_without_a_pose_of_the_time_no_picture_is_taken_and_the_reason_is_told() -> None:
    rig = Rig()
    rig.run(0.5)
    rig.has_pose = False
    rig.run(0.5)
    rig.stage.begin("record_images", camera="ground", every_s=0.2)
    rig.run(1.0)
    assert rig.shelf.pictures == []
    assert rig.stage.status.reason == "there is no valid pose at the time of the picture"
    assert rig.stage.status.state == "running"
    rig.has_pose = True
    rig.run(0.5)
    assert rig.shelf.pictures
    assert rig.stage.status.reason == ""
    rig.stage.put(pose=replace(pose(math.nan), is_valid=False))
    rig.run(0.2)


def test_frames_that_are_not_valid_are_left_out() -> None:
    rig = Rig()
    rig.stage.begin("record_images", camera="ground", every_s=0.1)
    rig.run(1.0, is_valid=False, reason="black")
    assert rig.shelf.pictures == []


def test_while_paused_or_cancelled_nothing_is_taken() -> None:
    rig = Rig()
    rig.stage.begin("record_images", camera="ground", every_s=0.1)
    rig.run(0.5)
    rig.stage.call("action.pause", action_id="go")
    count = len(rig.shelf.pictures)
    rig.run(1.0)
    assert len(rig.shelf.pictures) == count
    rig.stage.call("action.resume", action_id="go")
    rig.run(0.3)
    assert len(rig.shelf.pictures) > count
    rig.stage.call("action.cancel", action_id="go")
    count = len(rig.shelf.pictures)
    rig.run(1.0)
    assert len(rig.shelf.pictures) == count


def test_pictures_of_an_earlier_life_are_not_overwritten() -> None:
    rig = Rig(used=41)
    rig.stage.begin("record_images", camera="ground", every_s=0.1)
    rig.run(0.3)
    assert rig.shelf.pictures[0].file == "ground-00042.jpg"


def test_two_recorders_with_one_folder_count_their_own_pictures() -> None:
    rigs = {"ground": Rig(), "front_left": Rig()}
    rigs["front_left"].shelf = rigs["ground"].shelf
    rigs["front_left"].stage = Stage(ImageRecorder(rigs["ground"].shelf))
    for camera, rig in rigs.items():
        rig.run(0.2, camera=camera)
        rig.stage.begin("record_images", camera=camera, every_s=0.2, count=3)
    for _ in range(20):
        for camera, rig in rigs.items():
            rig.run(0.1, camera=camera)
    for camera, rig in rigs.items():
        assert (rig.stage.status.state, rig.stage.status.achieved) == ("done", 3)
        assert [recorded.camera for recorded in rig.stage.all(ImageRecorded)] == [camera] * 3


def test_a_full_disk_makes_it_faulty_and_says_why() -> None:
    shelf = Shelf()
    with Bench() as bench:
        row = ComponentRow(name="recorder", class_name="x:Recorder", rate_hz=2.0, trigger="image")
        bench.host(row, lambda: ImageRecorder(shelf))
        arguments = {"camera": "ground", "every_s": 0.02}
        bench.call("recorder", "action.start", action_id="a", capability="record_images", arguments=arguments)
        for is_full in (False, False, True):
            shelf.is_full = is_full
            bench.send("pose", pose())
            bench.send("image", image())
            bench.run(0.1)
        assert bench.state("recorder") is State.FAULTY
        assert "No space left on device" in bench.last("components/recorder/status").cause
        assert len(bench.all("image_recorded")) == 1


def test_a_picture_counts_once_it_is_on_the_disk_and_a_slow_disk_takes_no_more_than_it_can() -> None:
    rig = Rig()
    rig.run(0.2)
    rig.shelf.is_slow = True
    rig.stage.begin("record_images", camera="ground", every_s=0.1, count=20)
    rig.run(4.0)
    assert len(rig.shelf.pictures) == MOST_WAITING
    assert (rig.stage.status.state, rig.stage.status.progress) == ("running", 0.0)
    assert rig.stage.status.reason == "the disk is too slow: 16 pictures wait to be written"
    assert rig.stage.all(ImageRecorded) == []
    rig.shelf.is_slow = False
    rig.run(1.0)
    assert [message.index for message in rig.stage.all(ImageRecorded)] == list(range(1, 21))
    assert (rig.stage.status.state, rig.stage.status.achieved) == ("done", 20)


def test_the_last_picture_may_come_to_the_disk_during_a_pause() -> None:
    rig = Rig()
    rig.run(0.2)
    rig.shelf.is_slow = True
    rig.stage.begin("record_images", camera="ground", every_s=0.1, count=2)
    rig.run(0.5)
    rig.stage.call("action.pause", action_id="go")
    rig.shelf.is_slow = False
    rig.run(0.5)
    assert rig.stage.status.state == "paused"
    rig.stage.call("action.resume", action_id="go")
    rig.run(0.2)
    assert rig.stage.status.state == "done"
    assert len(rig.shelf.pictures) == 2


def test_the_format_is_a_setting_and_the_origin_goes_with_the_picture() -> None:
    shelf = Shelf()
    stage = Stage(ImageRecorder(shelf), RecorderSettings(format=PictureFormat.PNG, quality=80))
    stage.begin("record_images", camera="ground", every_s=0.1)
    stage.put(1.0, pose=pose(10.0, origin_geo=(39.5, 2.6, 2.0), position_std_m=(0.1, 0.2, 0.3)), image=image())
    stage.cycle()
    (picture,) = shelf.pictures
    assert (picture.file, picture.quality) == ("ground-00001.png", 80)
    assert (picture.origin_geo, picture.position_std_m) == ((39.5, 2.6, 2.0), (0.1, 0.2, 0.3))
