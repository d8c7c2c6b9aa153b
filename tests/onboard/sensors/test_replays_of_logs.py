"""Samplers take their data from logs: paced by the host's clock, here a virtual one, with the log's stamps mapped."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tests.data_folders import OUTSIDE
from tests.onboard.scripted_sources import HEIGHT, WIDTH, depth, euroc, measured, picture, scan

from gloc3.clock import Clock
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error
from gloc3.exchange import Publisher
from gloc3.log.record import Recorder
from gloc3.messages.perception import DepthImage, ImuSample, LaserScan
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.vehicle import HeightAboveGround, Image, ImageRecorded
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.components.samplers.camera import CameraSampler
from gloc3_onboard.components.samplers.depth_camera import DepthCameraSampler
from gloc3_onboard.components.samplers.height import HeightSampler
from gloc3_onboard.components.samplers.imu import ImuSampler
from gloc3_onboard.components.samplers.laser import LaserSampler
from gloc3_onboard.components.samplers.stereo_camera import StereoCameraSampler
from gloc3_onboard.sensors.registry import SourceHost, make_sources

SAMPLERS: dict[str, tuple[Any, float]] = {
    "camera": (CameraSampler, 20.0),
    "stereo_camera": (StereoCameraSampler, 20.0),
    "depth_camera": (DepthCameraSampler, 20.0),
    "laser": (LaserSampler, 10.0),
    "imu": (ImuSampler, 200.0),
    "height": (HeightSampler, 20.0),
}


def play(bench: Bench, folder: Path, **urls: str) -> dict[str, Any]:
    """Samplers on sources, by kind of device."""
    host = SourceHost(bench.loop, folder, lambda boot_s: boot_s, AutopilotSensors())
    sources = make_sources(urls, host)
    for name, source in sources.items():
        kind, rate_hz = SAMPLERS[name]
        row = ComponentRow(name=f"{name}_sampler", class_name="x:Y", rate_hz=rate_hz)
        bench.host(row, partial(kind, source))
    return sources


def reported(bench: Bench, topic: str) -> list[tuple[float, Any]]:
    return [(envelope.t_s, envelope.payload) for envelope in bench.envelopes if envelope.topic == f"bench/{topic}"]


def test_cameras_and_inertial_unit_of_one_data_set_stay_together_in_our_time(tmp_path: Path) -> None:
    euroc(tmp_path)
    with Bench() as bench:
        bench.run(5.0)
        play(bench, tmp_path, camera="euroc://.#cam0", stereo_camera="euroc://.", imu="euroc://.#imu0")
        bench.run(0.47)
        frames, samples = reported(bench, "image"), reported(bench, "imu")
        pairs = list(zip(reported(bench, "left"), reported(bench, "right"), strict=True))
    assert [t_s for t_s, _ in frames] == pytest.approx([5.0 + 0.05 * k for k in range(10)], abs=1e-6)
    assert [image.data for _, image in frames] == [picture(number).data for number in range(10)]
    assert all(image.is_valid for _, image in frames)
    assert [(left[0], left[1].camera, right[1].camera) for left, right in pairs] == [
        (t_s, "front_left", "front_right") for t_s, _ in frames
    ]
    assert pairs[3][1][1].data == picture(103).data
    assert len(samples) >= 90
    t_s, sample = samples[10]
    assert t_s == pytest.approx(5.05, abs=1e-6)
    # EuRoC's x is up, y right, z forward.
    assert sample.specific_force_frd_m_s2 == pytest.approx((0.5, 0.0, -9.81))
    assert sample.rate_frd_rad_s == pytest.approx((0.3, 0.2, -0.01))


def test_a_device_that_is_opened_anew_goes_on_where_the_log_is(tmp_path: Path) -> None:
    euroc(tmp_path, frames=20)
    with Bench() as bench:
        play(bench, tmp_path, camera="euroc://.")
        bench.run(0.12)
        bench.command("camera_sampler", "stop")
        bench.run(0.4)
        bench.command("camera_sampler", "start")
        bench.run(0.2)
        times = [t_s for t_s, _ in reported(bench, "image")]
    assert times[:3] == pytest.approx([0.0, 0.05, 0.1], abs=1e-6)
    assert times[3:] == pytest.approx([0.5, 0.55, 0.6, 0.65, 0.7], abs=1e-6)


def test_a_picture_that_is_missing_in_a_log_is_a_frame_that_is_not_valid(tmp_path: Path) -> None:
    euroc(tmp_path)
    third = sorted((tmp_path / "mav0" / "cam0" / "data").iterdir())[2]
    third.unlink()
    with Bench() as bench:
        play(bench, tmp_path, camera="euroc://.")
        bench.run(0.3)
        found = [(image.is_valid, image.reason) for _, image in reported(bench, "image")]
        assert bench.state("camera_sampler") is State.WORKING
    assert found[2] == (False, f"{third.name} is missing")
    assert [is_valid for is_valid, _ in found] == [True, True, False, True, True, True, True][: len(found)]


def test_a_sequence_of_kitti_is_played_with_its_times_or_at_a_rate(tmp_path: Path) -> None:
    for camera in ("image_0", "image_1"):
        (tmp_path / camera).mkdir()
        for number in range(4):
            pixels = np.frombuffer(picture(number).data, np.uint8).reshape(HEIGHT, WIDTH)
            cv2.imwrite(str(tmp_path / camera / f"{number:06d}.png"), pixels)
    with Bench() as bench:
        play(
            bench, tmp_path, camera="kitti://.#image_1?rate_hz=10".replace("#image_1?rate_hz=10", "?rate_hz=10#image_1")
        )
        bench.run(1.0)
        assert [t_s for t_s, _ in reported(bench, "image")][:4] == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-6)
    (tmp_path / "times.txt").write_text("0.0\n0.12\n0.21\n0.35\n")
    with Bench() as bench:
        play(bench, tmp_path, stereo_camera="kitti://.")
        bench.run(0.5)
        assert [t_s for t_s, _ in reported(bench, "left")] == pytest.approx([0.0, 0.12, 0.21, 0.35], abs=1e-6)


def test_a_laser_log_is_played(tmp_path: Path) -> None:
    lines = [f"FLASER 4 1.0 2.0 3.0 {4 + k} 0 0 0 0 0 0 {100 + 0.2 * k} host {0.2 * k}" for k in range(5)]
    (tmp_path / "walk.log").write_text("\n".join(lines))
    with Bench() as bench:
        play(bench, tmp_path, laser="carmen://walk.log?max_m=50")
        bench.run(0.9)
        found = reported(bench, "laser")
    assert [t_s for t_s, _ in found] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8], abs=1e-6)
    assert np.frombuffer(found[2][1].ranges_m, "<f4").tolist() == [1.0, 2.0, 3.0, 6.0]
    assert (found[0][1].scanner, found[0][1].range_max_m) == ("laser", 50.0)


def logged(path: Path) -> None:
    """A log of ours with every kind of sensor data."""
    rows = {
        "laser": TopicRow(LaserScan, 10.0),
        "imu": TopicRow(ImuSample, 100.0),
        "height": TopicRow(HeightAboveGround, 20.0),
        "camera/*": TopicRow(Image, 10.0),
        "depth/*": TopicRow(DepthImage, 10.0),
    }
    with Bench() as bench:
        recorder = Recorder(path, Clock(bench.loop), TopicTable(rows), {"platform": "bench"})
        recorder.attach(bench.exchange, bench.loop)
        publisher = Publisher(bench.exchange, "bench", "source", 7)
        for number in range(10):
            bench.run(0.1)
            t_s = bench.loop.time() - 0.02
            publisher.publish("bench/laser", scan([1.0, 2.0, 3.0 + number, math.inf]), t_s=t_s)
            publisher.publish("bench/imu", measured(0.0, 0.001 * number).sample, t_s=t_s)
            publisher.publish("bench/depth/depth", depth(number), t_s=t_s)
            publisher.publish("bench/height", HeightAboveGround(height_m=1.0 + 0.1 * number, is_valid=True), t_s=t_s)
            for camera in ("front_left", "front_right"):
                publisher.publish(f"bench/camera/{camera}", picture(number, camera=camera), t_s=t_s)
        recorder.close()


def test_every_sampler_takes_its_data_from_a_log_of_ours(tmp_path: Path) -> None:
    logged(tmp_path / "log.mcap")
    with Bench() as bench:
        log = "mcap://log.mcap"
        urls = {"laser": log, "imu": log, "height": log, "stereo_camera": log, "depth_camera": log}
        play(bench, tmp_path, **urls, camera=f"{log}#camera/front_left")
        bench.run(1.0)
        for topic in ("laser", "imu", "height", "left", "right", "image", "depth"):
            found = reported(bench, topic)
            assert [t_s for t_s, _ in found] == pytest.approx([0.1 * k for k in range(10)], abs=1e-6), topic
            assert all(payload.is_valid for _, payload in found), topic
        assert np.frombuffer(reported(bench, "laser")[4][1].ranges_m, "<f4").tolist() == [1.0, 2.0, 7.0, math.inf]
        assert reported(bench, "depth")[4][1] == depth(4)
        assert reported(bench, "height")[4][1].height_m == pytest.approx(1.4)
        assert reported(bench, "right")[4][1].data == picture(4).data


def test_pictures_that_a_flight_has_put_beside_its_log_are_played(tmp_path: Path) -> None:
    (tmp_path / "images-2").mkdir()
    with Bench() as bench:
        rows = {"image_recorded": TopicRow(ImageRecorded)}
        recorder = Recorder(tmp_path / "log-2.mcap", Clock(bench.loop), TopicTable(rows), {"platform": "bench"})
        recorder.attach(bench.exchange, bench.loop)
        publisher = Publisher(bench.exchange, "bench", "recorder", 7)
        for number in range(3):
            bench.run(0.5)
            file = f"camera-{number:05d}.png"
            pixels = np.frombuffer(picture(number).data, np.uint8).reshape(HEIGHT, WIDTH)
            cv2.imwrite(str(tmp_path / "images-2" / file), pixels)
            told_of = ImageRecorded(
                action_id="a",
                camera="camera",
                file=file,
                index=number,
                position_ned_m=(0.0, 0.0, 0.0),
                ned_from_frd=(1.0, 0.0, 0.0, 0.0),
            )
            publisher.publish("bench/image_recorded", told_of, t_s=bench.loop.time() - 0.1)
        recorder.close()
    with Bench() as bench:
        play(bench, tmp_path, camera="mcap://log-2.mcap#image_recorded")
        bench.run(1.3)
        found = [(t_s, image.data) for t_s, image in reported(bench, "image") if image.is_valid]
    assert [t_s for t_s, _ in found] == pytest.approx([0.0, 0.5, 1.0], abs=1e-6)
    assert [data for _, data in found] == [picture(number).data for number in range(3)]
    with Bench() as bench:
        other = "ground_camera"
        host = SourceHost(bench.loop, tmp_path, lambda boot_s: boot_s, AutopilotSensors())
        sources = make_sources({other: "mcap://log-2.mcap#image_recorded"}, host)
        with pytest.raises(Gloc3Error, match="no pictures of 'ground' were recorded"):
            sources[other].open()


def test_the_same_log_gives_the_same_messages_every_time(tmp_path: Path) -> None:
    euroc(tmp_path)
    runs = []
    for _ in range(2):
        with Bench() as bench:
            play(bench, tmp_path, camera="euroc://.", imu="euroc://.")
            bench.run(0.5)
            runs.append([(e.topic, e.t_s, e.payload) for e in bench.envelopes if "components" not in e.topic])
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("device", "url", "told_why"),
    [
        ("camera", "euroc://nowhere", "no data set of EuRoC's kind"),
        ("camera", "kitti://nowhere", "no pictures in image_0"),
        ("laser", "carmen://nowhere.log", "there is no file"),
        ("laser", "mcap://nowhere.mcap", "cannot be read"),
        ("imu", "mcap://log.mcap#imv", "did you mean 'imu'"),
        ("camera", "mcap://log.mcap#laser", "no Image in 'laser'"),
    ],
)
def test_a_log_that_cannot_be_played_makes_the_sampler_faulty_with_the_reason(
    tmp_path: Path, device: str, url: str, told_why: str
) -> None:
    logged(tmp_path / "log.mcap")
    with Bench() as bench:
        sources = play(bench, tmp_path, **{device: url})
        bench.run(0.1)
        assert bench.state(f"{device}_sampler") is not State.WORKING
        with pytest.raises(Gloc3Error) as found:
            sources[device].open()
    assert told_why in str(found.value)


def test_a_damaged_list_of_a_data_set_is_told_with_its_line(tmp_path: Path) -> None:
    euroc(tmp_path)
    path = tmp_path / "mav0" / "imu0" / "data.csv"
    path.write_text(path.read_text().replace("0.003,0.2", "0.003,x", 1))
    with Bench() as bench:
        sources = play(bench, tmp_path, imu="euroc://.")
        with pytest.raises(Gloc3Error, match=r"data\.csv:5:1: could not convert"):
            sources["imu"].open()


@pytest.mark.thorough
@pytest.mark.outside
def test_real_data_sets_are_sampled_without_a_complaint() -> None:
    with Bench() as bench:
        play(
            bench,
            OUTSIDE,
            stereo_camera="euroc://images/euroc_rest",
            imu="euroc://images/euroc_rest",
            camera="kitti://images/kitti_mono#image_l",
        )
        bench.run(1.9)
        for topic, least in (("left", 38), ("right", 38), ("imu", 300), ("image", 19)):
            found = reported(bench, topic)
            assert len(found) >= least, topic
            assert {payload.reason for _, payload in found} == {""}, topic
        force = np.mean([sample.specific_force_frd_m_s2 for _, sample in reported(bench, "imu")], axis=0)
    assert math.hypot(*force) == pytest.approx(9.81, abs=0.2)
    assert force[2] < -8.0, "at rest it is held up"
    with Bench() as bench:
        log = next((OUTSIDE / "lidar" / "aces").glob("*.log"))
        play(bench, OUTSIDE, laser=f"carmen://{log}")
        bench.run(5.0)
        assert len(reported(bench, "laser")) >= 3
