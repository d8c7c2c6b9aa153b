"""The camera of the onboard process, over UDP: mavsdk's camera plugin finds and shoots it, QGroundControl's sequence too."""

import queue
import socket
import time
from contextlib import closing
from pathlib import Path

import exifread
import pytest
from mavsdk.plugins.camera import Camera, CameraError, CameraResult, CaptureInfo, Mode, PhotosRange, StorageUpdate
from tests.onboard.onboard_scene import LATITUDE_DEG, LONGITUDE_DEG, vehicle
from tests.onboard.qgc_sequences import Station
from tests.sitl.mavsdk_client import Client

from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

CAMERA = 100
IMAGE_START = 2000
ACCEPTED, DENIED = 0, 2
WITHIN_S = 60.0


def found(camera: Camera) -> list[int]:
    """The components of the cameras, once there is one."""
    end_s = time.monotonic() + WITHIN_S
    while not (cameras := camera.camera_list().cameras) and time.monotonic() < end_s:
        time.sleep(0.1)
    return [one.component_id for one in cameras]


def take_when_ready(camera: Camera) -> None:
    """Takes a picture, again while the onboard process does not know its position yet."""
    for _ in range(60):
        try:
            camera.take_photo(CAMERA)
        except CameraError:
            time.sleep(0.5)
        else:
            return
    camera.take_photo(CAMERA)


def test_it_finds_the_camera_and_takes_single_pictures_and_many(tmp_path: Path) -> None:
    (sensors,) = free_ports(1, socket.SOCK_STREAM)
    source = ("--device", f"ground_camera=tcp://127.0.0.1:{sensors}")
    with (
        vehicle(tmp_path, *source, simulator=("--sensors", str(sensors))) as scene,
        closing(Client(scene.port)) as client,
    ):
        client.await_armable()
        camera = client.plugin(Camera)
        assert found(camera) == [CAMERA]
        (about,) = camera.camera_list().cameras
        assert (about.vendor_name, about.model_name) == ("GLOC3", "ground")
        assert (about.horizontal_resolution_px, about.vertical_resolution_px) == (640, 480)
        camera.set_mode(CAMERA, Mode.PHOTO)
        assert camera.get_mode(CAMERA) is Mode.PHOTO
        disks: queue.SimpleQueue[StorageUpdate] = queue.SimpleQueue()
        camera.subscribe_storage(lambda update, _: disks.put(update))
        storage = disks.get(timeout=WITHIN_S).storage
        assert storage.total_storage_mib > storage.available_storage_mib > 0.0

        captured: queue.SimpleQueue[CaptureInfo] = queue.SimpleQueue()
        camera.subscribe_capture_info(lambda info, _: captured.put(info))
        take_when_ready(camera)
        first = captured.get(timeout=WITHIN_S)
        assert (first.component_id, first.is_success, first.index) == (CAMERA, True, 1)
        assert first.position.latitude_deg == pytest.approx(LATITUDE_DEG, abs=1e-4)
        assert first.position.longitude_deg == pytest.approx(LONGITUDE_DEG, abs=1e-4)
        assert first.attitude_euler_angle.pitch_deg == pytest.approx(-90.0, abs=3.0)
        camera.start_photo_interval(CAMERA, 1.0)
        many = [captured.get(timeout=WITHIN_S) for _ in range(3)]
        camera.stop_photo_interval(CAMERA)
        assert [one.index for one in many] == [2, 3, 4]
        listed = camera.list_photos(CAMERA, PhotosRange.SINCE_CONNECTION)
        assert {one.index for one in listed} >= {1, 2, 3, 4}
        for call, arguments in ((camera.start_video, (CAMERA,)), (camera.format_storage, (CAMERA, 1))):
            with pytest.raises(CameraError) as refused:
                call(*arguments)
            assert refused.value.result in (CameraResult.DENIED, CameraResult.ERROR, CameraResult.ACTION_UNSUPPORTED)
        with closing(Station(scene.port)) as qgc:
            beat = qgc.receive(qgc.kind("HEARTBEAT", CAMERA), 2.0, "the camera's heartbeat")
            assert (beat.type, beat.autopilot) == (30, 8)
            for command, name in ((521, "CAMERA_INFORMATION"), (522, "CAMERA_SETTINGS"), (525, "STORAGE_INFORMATION")):
                assert qgc.command(CAMERA, command, 1.0) == ACCEPTED
                qgc.receive(qgc.kind(name, CAMERA), 2.0, name)
            status = qgc.request(CAMERA, 262, "CAMERA_CAPTURE_STATUS")
            assert (status.image_status, status.image_count) == (0, len(many) + 1)
            assert qgc.request(CAMERA, 269, "VIDEO_STREAM_INFORMATION") is None
            assert qgc.command(CAMERA, IMAGE_START, 0.0, 0.0, 1.0, 1.0) == DENIED, "mavsdk holds control"
    (picture,) = scene.out.rglob(first.file_url)
    with picture.open("rb") as file:
        tags = exifread.process_file(file, details=False)
    assert "GPS GPSLatitude" in tags
    assert str(tags["Image Model"]) == "ground"


def test_without_control_mavsdk_is_denied_and_lives(tmp_path: Path) -> None:
    (sensors,) = free_ports(1, socket.SOCK_STREAM)
    source = ("--device", f"ground_camera=tcp://127.0.0.1:{sensors}")
    with (
        vehicle(tmp_path, *source, simulator=("--sensors", str(sensors))) as scene,
        closing(Station(scene.port)) as qgc,
    ):
        qgc.receive(qgc.kind("HEARTBEAT", CAMERA), WITHIN_S, "the camera's heartbeat")
        end_s = time.monotonic() + WITHIN_S
        while qgc.command(CAMERA, IMAGE_START, 0.0, 0.0, 1.0, 1.0) != ACCEPTED:
            assert time.monotonic() < end_s, qgc.texts
            time.sleep(0.5)
        with closing(Client(scene.port)) as client:
            camera = client.plugin(Camera)
            assert found(camera) == [CAMERA]
            calls = ((camera.take_photo, ()), (camera.start_photo_interval, (1.0,)), (camera.stop_photo_interval, ()))
            for call, arguments in calls:
                with pytest.raises(CameraError) as refused:
                    call(CAMERA, *arguments)
                assert refused.value.result is CameraResult.DENIED
            camera.set_mode(CAMERA, Mode.PHOTO)
        qgc.receive(lambda one: "station 255 holds control" in getattr(one, "text", ""), 2.0, "the reason")
