"""Converted logs, read by other programs' readers: gpxpy, pyarrow, rosbags."""

import csv
import json
import sys
import zlib
from collections import Counter
from math import atan2, degrees, sqrt
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import gpxpy
import pytest
from pyarrow.parquet import read_table
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gloc3.component.lci import State
from gloc3.errors import Gloc3Error, Refused
from gloc3.log.cli import app
from gloc3.messages.envelope import ComponentStatus, Event, Kind, Severity, Source
from gloc3.messages.frames import GeoPoint, TangentPlane, from_euler
from gloc3.messages.perception import (
    CELL_FREE,
    CELL_OCCUPIED,
    CELL_UNKNOWN,
    DepthImage,
    ImuSample,
    LaserScan,
    OccupancyMap,
    PointCloud,
    SatelliteFix,
)
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.vehicle import AutopilotState, Home, Image, ImageRecorded, Pose
from gloc3.ros2.definitions import DEFINITIONS, definition
from gloc3.terrain.map_file import read_map

from .foreign_logs import FOREIGN
from .samples import LogInMemory

ORIGIN = (39.5528, 2.6285, 2.0)
POSE, SERVER = Source("pelican", "pose", 1), Source("pelican", "server", 2)
REQUESTED = [(0.0, 0.0, -2.0), (10.0, 0.0, -2.0)]
COUNT = 40
PLANE = TangentPlane(GeoPoint(*ORIGIN))


def north_m(index: int) -> float:
    return 0.25 * index


def flight(origin: tuple[float, float, float] | None = ORIGIN) -> bytes:
    """A flight to the north at 2.5 m/s, yawed by 30 degrees, without a valid pose in its middle, with all sensors."""
    everything = TopicTable({name: TopicRow(row.message, row.rate_hz) for name, row in TOPICS.items()})
    log = LogInMemory(everything)
    log.recorder.write_metadata("mission", {"name": "northwards", "text": ""})
    log.recorder.write_requested_path(REQUESTED)
    log.send("motion/home", Home(position_ned_m=(0.0, 0.0, 0.0)), 0.0, SERVER)
    for index in range(COUNT):
        t_s = 0.1 * index
        if index == 10:
            state = AutopilotState(
                is_connected=True, is_armed=True, mode_name="OFFBOARD", battery_v=12.5, battery_a=10.0
            )
            log.send("autopilot", state, t_s, SERVER)
        pose = Pose(
            position_ned_m=(north_m(index), 1.0, -2.0),
            velocity_ned_m_s=(2.5, 0.0, 0.0),
            ned_from_frd=from_euler(0.0, 0.0, 0.5235987755982988),
            rate_frd_rad_s=(0.1, 0.2, 0.3),
            position_std_m=(0.1, 0.2, 0.3),
            is_valid=index != 20,
            origin_geo=origin,
        )
        log.send("pose", pose, t_s, POSE, "ned")
        imu = ImuSample(rate_frd_rad_s=(0.1, 0.2, 0.3), specific_force_frd_m_s2=(0.0, 0.5, -9.81))
        log.send("imu", imu, t_s, SERVER)
    picture = ImageRecorded(
        action_id="a", camera="front", file="front-1.png", index=1, position_ned_m=(5.0, 1.0, -2.0),
        ned_from_frd=(1.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    log.send("image_recorded", picture, 3.9, SERVER)
    scan = LaserScan(
        scanner="laser", angle_min_rad=-1.0, angle_step_rad=0.5, range_min_m=0.1, range_max_m=30.0,
        ranges_m=bytes.fromhex("0000803f 00000040 00004040 00008040 0000a040"), duration_s=0.1,
    )  # fmt: skip
    log.send("laser", scan, 3.9, SERVER)
    depths = DepthImage(camera="depth", width=2, height=1, data=bytes.fromhex("e8030000"), scale_m=0.0005)
    log.send("depth/front", depths, 3.9, SERVER)
    cloud = PointCloud(sensor="depth", data=bytes.fromhex("0000803f 00000040 00004040"))
    log.send("cloud/front", cloud, 3.9, SERVER)
    log.send("camera/front", Image(camera="front", width=3, height=2, data=bytes(range(6))), 3.9, SERVER)
    log.send("satellites", SatelliteFix(place_geo=ORIGIN, std_m=2.0, satellites=9, height_std_m=3.0), 3.9, SERVER)
    status = ComponentStatus(name="pose", kind=Kind.PROCESSOR, state=State.FAULTY, cause="ValueError", rate_hz=20.0)
    log.send("components/pose/status", status, 3.9, POSE)
    log.send("components/pose/event", Event(severity=Severity.ERROR, text="broken"), 3.9, POSE)
    return log.close()


FLIGHT = flight()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "log.mcap"
    path.write_bytes(FLIGHT)
    return path


def run(*arguments: object) -> Any:
    return app([str(argument) for argument in arguments], exit_on_error=True, result_action="return_value")


def place(index: int) -> GeoPoint:
    return PLANE.geo_from_ned((north_m(index), 1.0, -2.0))


def test_gpx_has_the_track_with_times_the_route_and_places(file: Path) -> None:
    run("convert", file, "--to", "gpx")
    found = gpxpy.parse(file.with_suffix(".gpx").read_text())
    (track,) = found.tracks
    assert [len(segment.points) for segment in track.segments] == [20, COUNT - 21]  # apart where the pose was not valid
    assert track.name == "pelican: northwards"
    last = track.segments[1].points[-1]
    assert (last.latitude, last.longitude) == pytest.approx(place(39)[:2], abs=1e-8)
    assert last.elevation == pytest.approx(place(39).altitude_m, abs=1e-3)
    assert last.time is not None
    assert last.time.isoformat() == "2026-01-01T00:00:03.900000+00:00"
    assert track.length_2d() == pytest.approx(north_m(39) - 2 * north_m(1), rel=0.01)  # gpxpy's own sphere
    assert [point.elevation for point in found.routes[0].points] == pytest.approx([4.0, 4.0], abs=1e-3)
    assert [point.name for point in found.waypoints] == ["home", "front-1.png"]


def test_kml_has_lines_in_the_order_longitude_latitude_altitude(file: Path) -> None:
    run("convert", file, "--to", "kml")
    root = ET.parse(file.with_suffix(".kml")).getroot()
    space = {"k": "http://www.opengis.net/kml/2.2"}
    marks = root.findall("k:Document/k:Placemark", space)
    assert [mark.findtext("k:name", "", space) for mark in marks] == [
        "flown",
        "flown",
        "requested",
        "home",
        "front-1.png",
    ]
    text = marks[1].findtext("k:LineString/k:coordinates", "", space).split()[-1]
    longitude, latitude, altitude = map(float, text.split(","))
    assert GeoPoint(latitude, longitude, altitude) == pytest.approx(place(39), abs=1e-3)
    assert marks[0].findtext("k:LineString/k:altitudeMode", "", space) == "absolute"
    assert marks[0].findtext("k:TimeSpan/k:end", "", space) == "2026-01-01T00:00:01.900Z"


def test_geojson_has_a_line_for_each_stretch(file: Path) -> None:
    run("convert", file, "--to", "geojson")
    found = json.loads(file.with_suffix(".geojson").read_text())
    assert [feature["properties"]["name"] for feature in found["features"]][:3] == ["flown", "flown", "requested"]
    line = found["features"][1]
    longitude, latitude, altitude = line["geometry"]["coordinates"][-1]
    assert GeoPoint(latitude, longitude, altitude) == pytest.approx(place(39), abs=1e-3)
    assert len(line["properties"]["coordTimes"]) == len(line["geometry"]["coordinates"])


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_table_has_a_row_for_each_pose(to: str, file: Path) -> None:
    run("convert", file, "--to", to)
    target = file.with_suffix(f".{to}")
    rows = list(csv.DictReader(target.read_text().splitlines())) if to == "csv" else read_table(target).to_pylist()
    assert len(rows) == COUNT
    assert float(rows[39]["north_m"]) == north_m(39)
    assert float(rows[39]["yaw_deg"]) == pytest.approx(30.0)
    assert float(rows[39]["latitude_deg"]) == pytest.approx(place(39).latitude_deg)
    assert float(rows[39]["utc_s"]) == pytest.approx(1767225603.9)
    assert [str(rows[index]["is_valid"]).lower() for index in (19, 20, 21)] == ["true", "false", "true"]
    assert rows[9]["mode"] in ("", None)
    assert rows[10]["mode"] == "OFFBOARD"


def test_a_table_of_a_topic_has_all_its_fields(file: Path) -> None:
    run("convert", file, "--to", "parquet", "--topic", "imu")
    table = read_table(file.with_name("log-imu.parquet"))
    assert table.num_rows == COUNT
    assert table["specific_force_frd_m_s2[2]"].to_pylist() == [-9.81] * COUNT
    with pytest.raises(Refused, match="did you mean 'imu'"):
        run("convert", file, "--to", "csv", "--topic", "imus")
    with pytest.raises(Refused, match="--topic is for tables"):
        run("convert", file, "--to", "kml", "--topic", "imu")


@pytest.mark.parametrize("to", ["kml", "gpx", "geojson"])
def test_a_local_frame_without_an_origin_on_earth_is_refused_with_a_hint(to: str, tmp_path: Path) -> None:
    file = tmp_path / "log.mcap"
    file.write_bytes(flight(None))
    with pytest.raises(Refused, match=r"without an origin on Earth\. Set --origin LATITUDE,LONGITUDE,ALTITUDE"):
        run("convert", file, "--to", to)
    assert not file.with_suffix(f".{to}").exists()
    run("convert", file, "--to", to, "--origin", "39.5528,2.6285,2")
    assert "2.62851163" in file.with_suffix(f".{to}").read_text()


@pytest.mark.parametrize("origin", ["39", "91,0,0", "a,b,c", "nan,0,0", "0,0,inf"])
def test_an_origin_that_is_none_is_refused(origin: str, file: Path) -> None:
    with pytest.raises(Refused, match="--origin"):
        run("convert", file, "--to", "kml", "--origin", origin)


def test_a_bag_is_read_whole_by_rosbags_with_the_types_of_ros_itself(file: Path) -> None:
    run("convert", file, "--to", "rosbag2")
    types = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([file.with_name("log-ros2")], default_typestore=types) as reader:
        counts = Counter[str]()
        last: dict[str, Any] = {}
        for connection, stamp_ns, data in reader.messages():
            counts[connection.topic] += 1
            last[connection.topic] = types.deserialize_cdr(data, connection.msgtype)
            assert 1767225600_000_000_000 <= stamp_ns <= 1767225604_000_000_000
        assert reader.message_count == counts.total()
    assert counts == {
        "/pelican/requested_path": 1,
        "/pelican/pose": COUNT - 1,
        "/tf": COUNT - 1,
        "/pelican/imu": COUNT,
        "/pelican/battery": 1,
        "/pelican/laser": 1,
        "/pelican/camera/front": 1,
        "/pelican/depth/front": 1,
        "/pelican/cloud/front": 1,
        "/pelican/satellites": 1,
        "/diagnostics": 1,
        "/rosout": 1,
    }
    pose = last["/pelican/pose"]
    where, turned = pose.pose.pose.position, pose.pose.pose.orientation
    assert (where.x, where.y, where.z) == pytest.approx((1.0, north_m(39), 2.0))  # east, north, up
    yaw = degrees(2.0 * atan2(turned.z, turned.w))
    assert yaw % 360.0 == pytest.approx(60.0)  # 30 degrees clockwise from north is 60 counter-clockwise from east
    twist = pose.twist.twist.linear
    assert (twist.x, twist.y, twist.z) == pytest.approx((2.5 * sqrt(0.75), 1.25, 0.0))
    assert pose.pose.covariance[[0, 7, 14]] == pytest.approx([0.04, 0.01, 0.09])
    assert pose.header.stamp.sec == 1767225603
    assert pose.header.stamp.nanosec == 900_000_000
    imu = last["/pelican/imu"]
    assert (imu.linear_acceleration.y, imu.linear_acceleration.z) == pytest.approx((-0.5, 9.81))
    assert (imu.angular_velocity.x, imu.angular_velocity.z) == pytest.approx((0.1, -0.3))
    assert list(last["/pelican/laser"].ranges) == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert last["/pelican/laser"].angle_max == pytest.approx(1.0)
    assert bytes(last["/pelican/camera/front"].data) == bytes(range(6))
    depths, cloud = last["/pelican/depth/front"], last["/pelican/cloud/front"]
    assert (depths.encoding, depths.width, depths.step) == ("16UC1", 2, 4)
    assert list(depths.data.view("<u2")) == [500, 0], "millimetres"
    assert [field.name for field in cloud.fields] == ["x", "y", "z"]
    assert (cloud.width, cloud.point_step, list(cloud.data.view("<f4"))) == (1, 12, [1.0, -2.0, -3.0])
    assert last["/pelican/satellites"].latitude == ORIGIN[0]
    assert last["/pelican/battery"].current == -10.0
    (status,) = last["/diagnostics"].status
    assert (status.level, status.message) == (2, "faulty: ValueError")
    assert (last["/rosout"].level, last["/rosout"].msg) == (40, "broken")
    assert len(last["/pelican/requested_path"].poses) == 2


@pytest.mark.parametrize("kind", [kind for kind in DEFINITIONS if not kind.endswith(("_Request", "_Response"))])
def test_a_definition_is_the_one_of_ros(kind: str) -> None:
    package, name = kind.split("/")
    types = get_typestore(Stores.ROS2_JAZZY)
    found = get_types_from_msg(definition(kind), f"{package}/msg/{name}")
    for one, (_, fields) in found.items():  # distributions differ in constants
        assert fields == types.fielddefs[one][1]


def test_a_missing_library_is_said_with_its_extra(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    with pytest.raises(Gloc3Error, match=r'needs pyarrow; install it with: pip install "gloc3\[logs\]"'):
        run("convert", file, "--to", "parquet")
    with pytest.raises(Gloc3Error, match=r'mcap-ros2-support; install it with: pip install "gloc3\[logs\]"'):
        run("convert", file, "--to", "rosbag2")
    assert [path.name for path in file.parent.iterdir()] == ["log.mcap"]


def test_nothing_is_overwritten(file: Path) -> None:
    for to, name in (("csv", "log.csv"), ("rosbag2", "log-ros2")):
        run("convert", file, "--to", to)
        with pytest.raises(Refused, match=f"{name} exists already"):
            run("convert", file, "--to", to)


def test_the_last_map_of_a_flight_becomes_a_map_that_a_platform_can_know(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def known(corner: float, *cells: int) -> OccupancyMap:
        return OccupancyMap(
            corner_ne_m=(corner, -0.5),
            cell_m=0.1,
            rows=2,
            columns=3,
            layer_m=0.5,
            levels=[3],
            cells=zlib.compress(bytes(cells)),
        )

    log = LogInMemory(TopicTable(TOPICS))
    last = known(2.0, CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, CELL_FREE, CELL_FREE, CELL_FREE)
    for number, message in enumerate((known(1.0, 1, 1, 1, 1, 1, 1), last)):
        log.send("map", message, float(number), Source("pelican", "map", 3), "ned")
    path = tmp_path / "log.mcap"
    path.write_bytes(log.close())
    run("convert", path, "--to", "map")
    assert "log-map.yaml: 0.2 x 0.3 m, 1 layer of 0.5 m" in capsys.readouterr().out
    found = read_map(tmp_path / "log-map.yaml")
    assert (found.layers(), found.levels, found.corner_ne_m) == (last.layers(), [3], (2.0, -0.5))
    with pytest.raises(Gloc3Error, match=r"log-map\.yaml exists already"):
        run("convert", path, "--to", "map")
    bare = tmp_path / "bare.mcap"
    bare.write_bytes(flight())
    with pytest.raises(Refused, match="no map was recorded; a platform with the component map"):
        run("convert", bare, "--to", "map")


@pytest.mark.parametrize("to", ["kml", "csv", "rosbag2", "map"])
def test_a_foreign_log_is_refused(to: str, tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    FOREIGN["lz4"](file)
    with pytest.raises(Refused, match="not by GLOC3"):
        run("convert", file, "--to", to)
    run("convert", file, "--to", "csv", "--topic", "/thing")
    assert file.with_name("other-thing.csv").read_text().splitlines()[2].startswith("0.05,,0.5,1,1,a")
