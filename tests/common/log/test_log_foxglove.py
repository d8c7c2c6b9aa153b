"""What Foxglove reads of a log, checked against the message types and layouts of Foxglove's own SDK."""

import base64
import io
import json
import zlib
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove.layouts as fl
import msgspec
import pytest
from google.protobuf import json_format
from mcap.reader import make_reader

from gloc3.camera.model import CameraModel
from gloc3.log.description import RunDescription
from gloc3.log.foxglove.layout import LAYOUT_FILE, SCENE_TOPICS, layout
from gloc3.log.foxglove.scene import stamped
from gloc3.log.record import CAMERAS_FILE, PLATFORM_FILE
from gloc3.messages.envelope import Event, Severity, Source
from gloc3.messages.frames import from_euler
from gloc3.messages.perception import DepthImage, LaserScan, OccupancyMap, PointCloud, SatelliteFix
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import AutopilotPose, Image, MotionLimits, ObstacleScan, Pose
from gloc3.mission.model.fence import Area, Fence
from gloc3.platform.reader import load_platform, whole_text

from .foxglove_sdk import foxglove_fields, parsed
from .samples import FENCE, POSE, LogInMemory

OTHER = Source("pelican", "other", 5)


def limits(fence: Fence | None) -> MotionLimits:
    return MotionLimits(
        speed_m_s=1.0, climb_m_s=1.0, acceleration_m_s2=1.0, height_min_m=0.3, height_max_m=8.0, fence=fence
    )


MAP = OccupancyMap(
    corner_ne_m=(-1.0, 2.0), cell_m=0.5, rows=3, columns=2, layer_m=0.5, levels=[2, 3], level=2,
    cells=zlib.compress(bytes([1, 2, 1, 0, 0, 1, 0, 2, 0, 0, 0, 0])),
)  # fmt: skip


def full_log() -> bytes:
    """All that Foxglove has a schema for."""
    platform = load_platform("pelican")
    cameras = {name: model for name, model in platform.cameras.items() if isinstance(model, CameraModel)}
    log = LogInMemory(TopicTable(TOPICS), {"camera/*": True, "laser": True, "depth/*": True, "cloud/*": True})
    RunDescription(platform, whole_text("pelican"), cameras).write(log.recorder)
    log.recorder.write_requested_path([(0.0, 0.0, -1.0), (4.0, 0.0, -1.0), (4.0, 2.0, -1.0)])
    ranges = array("f", [1.0, 2.0, float("inf")])
    scan = LaserScan(
        scanner="laser", angle_min_rad=-0.5, angle_step_rad=0.5, range_min_m=0.1, range_max_m=30.0,
        ranges_m=ranges.tobytes(),
    )  # fmt: skip
    obstacles = ObstacleScan(points_ne_m=[(1.0, 2.0), (3.0, 4.0)], height_m=1.5, closest_ne_m=[(1.0, 2.0)])
    pose = Pose(
        position_ned_m=(1.0, 2.0, -3.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=from_euler(0.0, 0.0, 1.0)
    )
    autopilot = AutopilotPose(
        position_ned_m=(1.0, 2.0, -3.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0),
        rate_frd_rad_s=(0.0, 0.0, 0.0),
    )  # fmt: skip
    for index, fence in enumerate((None, FENCE, FENCE, Fence(keep_out=(Area(center_ne_m=(0.0, 0.0), radius_m=2.0),)))):
        log.send("motion/limits", limits(fence), 0.1 * index, OTHER)
    for topic, message in (
        ("pose", pose),
        ("autopilot_pose", autopilot),
        ("laser", scan),
        ("obstacles", obstacles),
        ("map", MAP),
        ("camera/front_left", Image(camera="front_left", width=3, height=2, data=bytes(range(6)))),
        ("depth/front", DepthImage(camera="depth", width=3, height=2, data=array("H", range(1000, 1006)).tobytes())),
        ("cloud/front", PointCloud(sensor="depth", data=array("f", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).tobytes())),
        ("satellites", SatelliteFix(place_geo=(39.5, 2.5, 3.0))),
        ("components/pose/event", Event(severity=Severity.ERROR, text="broken")),
    ):
        log.send(topic, message, 1.0, POSE, "ned")
    return log.close()


LOG = full_log()


def shown(topic: str = "") -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Topic, schema and fields of that schema of the messages that Foxglove has a schema for."""
    for schema, channel, message in make_reader(io.BytesIO(LOG)).iter_messages():
        if schema is not None and schema.name.startswith("foxglove.") and topic in ("", channel.topic):
            values = json.loads(message.data)
            yield channel.topic, schema.name, foxglove_fields(schema.name, values, is_ours="type" in channel.metadata)


def only(topic: str) -> dict[str, Any]:
    ((_, _, values),) = shown(topic)
    return values


def test_every_message_is_one_of_the_schema_of_its_channel() -> None:
    seen = set()
    for _, schema, values in shown():
        parsed(schema, values)
        seen.add(schema.removeprefix("foxglove."))
    assert seen == {
        "CameraCalibration", "CompressedImage", "FrameTransforms", "Grid", "LaserScan", "LocationFix", "Log", "PointCloud",
        "PoseInFrame", "PosesInFrame", "RawImage", "SceneUpdate",
    }  # fmt: skip


def test_a_wrong_field_or_type_would_be_found() -> None:
    for wrong in ({"ranges": ["a"]}, {"start_angel": 1.0}):
        with pytest.raises(json_format.ParseError):
            parsed("foxglove.LaserScan", {**only("pelican/laser"), **wrong})


def test_a_scan_has_its_angles_and_nothing_seen_is_as_far_as_it_reaches() -> None:
    scan = parsed("foxglove.LaserScan", only("pelican/laser"))
    assert (scan.start_angle, scan.end_angle, list(scan.ranges)) == (-0.5, 0.5, [1.0, 2.0, 30.0])
    assert scan.frame_id == "laser"


def test_obstacles_are_a_cloud_of_points_and_spheres() -> None:
    cloud = parsed("foxglove.PointCloud", only("pelican/obstacles"))
    assert list(array("f", cloud.data)) == [1.0, 2.0, -1.5, 3.0, 4.0, -1.5]
    assert [(field.name, field.offset, field.type) for field in cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    (spheres,) = [
        one["spheres"] for _, _, values in shown("scene") for one in values["entities"] if "obstacles" in one["id"]
    ]
    assert spheres[0]["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": -1.5}


def test_a_depth_picture_is_a_raw_one_of_16_bits() -> None:
    found = parsed("foxglove.RawImage", only("pelican/depth/front"))
    assert (found.frame_id, found.encoding, found.width, found.height, found.step) == ("depth", "16UC1", 3, 2, 6)
    assert list(array("H", found.data)) == [1000, 1001, 1002, 1003, 1004, 1005]


def test_a_cloud_is_one_on_the_body() -> None:
    cloud = parsed("foxglove.PointCloud", only("pelican/cloud/front"))
    assert (cloud.frame_id, cloud.point_stride) == ("pelican/body", 12)
    assert list(array("f", cloud.data)) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert [(field.name, field.offset, field.type) for field in cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]


def test_a_map_is_a_grid_whose_columns_run_north_with_the_height_up_to_which_cells_are_occupied() -> None:
    grid = parsed("foxglove.Grid", only("pelican/map"))
    assert (grid.column_count, grid.row_stride, grid.cell_stride, grid.cell_size.x) == (3, 6, 2, 0.5)
    assert (grid.pose.position.x, grid.pose.position.y, grid.pose.position.z) == (-1.0, 2.0, -1.25)
    assert [(field.name, field.offset, field.type) for field in grid.fields] == [("occupancy", 0, 1), ("top_dm", 1, 1)]
    assert list(grid.data[::2]) == [0, 0, 255, 100, 255, 0]
    assert list(grid.data[1::2]) == [0, 0, 0, 20, 0, 0]


def test_a_damaged_map_is_recorded_without_a_grid() -> None:
    log = LogInMemory(TopicTable(TOPICS))
    log.send("map", msgspec.structs.replace(MAP, cells=b"torn"), 1.0, POSE, "ned")
    ((_, _, message),) = [
        one for one in make_reader(io.BytesIO(log.close())).iter_messages() if one[1].topic == "pelican/map"
    ]
    assert "column_count" not in json.loads(message.data)


def test_the_fence_is_shown_when_it_changes() -> None:
    fences = [one for _, _, values in shown("scene") for one in values["entities"] if one["id"] == "pelican: fence"]
    assert [len(one["lines"]) for one in fences] == [2, 1]  # area and keep-out; keep-out
    area = fences[0]["lines"][0]["points"]
    assert {point["z"] for point in area} == {0.0, -8.0}
    assert len(area) == 4 * 6  # for each side its floor, its ceiling and an upright, two ends each
    assert len(fences[1]["lines"][0]["points"]) == 36 * 2  # at the height of the origin


def test_frames_hang_together_and_stand_where_the_platform_file_says() -> None:
    parents = {one["child_frame_id"]: one for _, _, values in shown("frames") for one in values["transforms"]}
    assert {child: one["parent_frame_id"] for child, one in parents.items()} == {
        "ned": "map",
        "pelican/body": "ned",
        "front_left": "pelican/body",
        "front_right": "pelican/body",
        "ground": "pelican/body",
        "tracker": "ned",
        "laser": "pelican/body",
    }
    assert parents["front_left"]["translation"] == {"x": 0.12, "y": -0.075, "z": 0.02}
    assert parents["laser"]["translation"]["z"] == -0.08
    assert parents["tracker"]["translation"]["x"] == 20.6
    assert parents["pelican/body"]["translation"] == {"x": 1.0, "y": 2.0, "z": -3.0}
    image = only("pelican/camera/front_left")
    assert image["frame_id"] == "front_left"
    assert base64.b64decode(image["data"]).startswith(b"\x89PNG")


def test_a_calibration_is_that_of_the_platform_file() -> None:
    found = parsed("foxglove.CameraCalibration", only("calibration/front_left"))
    assert (found.width, found.height, found.distortion_model) == (640, 480, "plumb_bob")
    assert list(found.D) == [-0.11, 0.035, 0.0004, -0.0003, 0.0]
    assert list(found.K) == [430.0, 0.0, 321.3, 0.0, 430.0, 238.1, 0.0, 0.0, 1.0]
    assert len(found.P) == 12


def test_the_requested_path_is_a_line_of_the_scene() -> None:
    (line,) = [
        one["lines"][0]
        for _, _, values in shown("scene")
        for one in values["entities"]
        if one["id"] == "requested path"
    ]
    assert [point["x"] for point in line["points"]] == [0.0, 4.0, 4.0]


def test_times_are_where_the_schema_has_them() -> None:
    time = {"sec": 1, "nsec": 2}
    assert stamped({"transforms": [{"a": 1}]}, time) == {"transforms": [{"timestamp": time, "a": 1}]}
    assert stamped({"a": 1}, time) == {"timestamp": time, "a": 1}


def test_each_topic_is_one_channel() -> None:
    summary = make_reader(io.BytesIO(LOG)).get_summary()
    assert summary is not None
    topics = [channel.topic for channel in summary.channels.values()]
    assert len(topics) == len(set(topics))
    attached = [attachment.name for attachment in make_reader(io.BytesIO(LOG)).iter_attachments()]
    assert attached == [PLATFORM_FILE, CAMERAS_FILE]


def test_the_layout_is_one_that_foxgloves_sdk_makes(tmp_path: Path) -> None:
    cameras = ["front_left", "ground"]

    def points(kind: Any) -> Any:
        return kind(visible=True, cube_outline=None, point_shape=None)

    def panel(kind: Any, config: Any, title: str) -> Any:
        return kind(config=config, title=title)

    def split(direction: Any, *items: tuple[float, Any]) -> Any:
        return fl.SplitContainer(
            direction=direction, items=[fl.SplitItem(proportion=share, content=one) for share, one in items]
        )

    scene = fl.ThreeDeeConfig(
        topics={
            "scene": fl.BaseRendererSceneUpdateTopicSettings(visible=True),
            "pelican/pose": fl.BaseRendererPoseTopicSettings(visible=True),
            "pelican/obstacles": points(fl.BaseRendererPointCloudTopicSettings),
            "pelican/map": fl.BaseRendererGridTopicSettings(visible=True),
            "pelican/laser": points(fl.BaseRendererLaserScanTopicSettings),
        },
        follow_tf="pelican/body",
        fixed_frame="map",
        follow_mode="follow-position",
    )
    pictures = [
        panel(
            fl.ImagePanel,
            fl.ImageConfig(
                image_mode=fl.ImageModeConfig(
                    image_topic=f"pelican/camera/{name}", calibration_topic=f"calibration/{name}"
                )
            ),
            name,
        )
        for name in cameras
    ]
    speeds = [fl.PlotSeries(value=f'"pelican/pose".velocity_ned_m_s[{axis}]') for axis in range(3)]
    height = [fl.PlotSeries(value='"pelican/pose".position_ned_m[2].@mul(-1)')]
    numbers = [
        panel(fl.PlotPanel, fl.PlotConfig(paths=height), "Height, m"),
        panel(fl.PlotPanel, fl.PlotConfig(paths=speeds), "Speed, m/s"),
        panel(fl.LogPanel, fl.LogConfig(topic_to_render="pelican/ci/event"), "Events"),
        panel(fl.MapPanel, fl.MapConfig(follow_topic="pelican/ci/vehicle"), "Map"),
    ]
    left = split(
        "column", (2.0, panel(fl.ThreeDeePanel, scene, "Scene")), (1.0, split("row", *((1.0, one) for one in pictures)))
    )
    content = split("row", (2.0, left), (1.0, split("column", *((1.0, one) for one in numbers))))
    assert json.loads(layout("pelican", cameras, SCENE_TOPICS)) == json.loads(fl.Layout(content=content).to_json())


def test_the_layout_beside_the_log_has_the_topics_that_are_published_and_recorded(tmp_path: Path) -> None:
    topics = TopicTable.installed()

    def written(name: str, log: dict[str, bool | float]) -> str:
        platform = msgspec.structs.replace(load_platform(name), log=log)
        cameras = {name: model for name, model in platform.cameras.items() if isinstance(model, CameraModel)}
        RunDescription(platform, "", cameras).write_layout(tmp_path, topics)
        return (tmp_path / LAYOUT_FILE).read_text()

    plain, chosen = written("pelican", {}), written("pelican", {"camera/ground": 2.0, "laser": True})
    assert "pelican/obstacles" in plain
    assert "camera/" not in plain
    assert "pelican/laser" not in plain
    assert "pelican/camera/ground" in chosen
    assert "pelican/camera/front_left" not in chosen
    assert "pelican/laser" in chosen
    row = 'name: depth_cloud, class: "gloc3_onboard.components.processors.depth_cloud:DepthCloudProcessor"'
    ports = "trigger: depth, ports: {depth: depth/front, cloud: cloud/front}, devices: {rig: rig}"
    (tmp_path / "seeing.yaml").write_text(f"platform: p\nextends: pelican_rtk\ncomponents:\n  - {{{row}, {ports}}}\n")
    assert "p/cloud/front" in written(str(tmp_path / "seeing.yaml"), {"cloud/front": 1.0})
    assert "cloud" not in written(str(tmp_path / "seeing.yaml"), {})
    without = written("pelican_rtk", {"laser": True})
    assert "pelican/pose" in without
    assert "obstacles" not in without
    assert "laser" not in without, "it has no scanner"
