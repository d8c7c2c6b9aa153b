"""Odometry and scans of other people's nodes as sources of sensors, over a real Zenoh session."""

import threading
from collections.abc import Callable, Iterator
from math import inf, nan, pi
from pathlib import Path
from time import monotonic
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.ros_peer import Peer, peer, router

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.frames import rotate, to_euler
from gloc3_onboard.ros2.sources import RosDepthCamera, RosEstimator, RosLaser, RosLidar
from gloc3_onboard.sensors.registry import parse_source

CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY, SCAN, IMAGE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Image"


@pytest.fixture
def endpoint() -> Iterator[str]:
    with router() as endpoint:
        yield endpoint


@pytest.fixture
def other(endpoint: str, tmp_path: Path) -> Iterator[Peer]:
    with peer(endpoint, tmp_path) as found:
        yield found


def estimator(endpoint: str, topic: str = "odometry") -> RosEstimator:
    return RosEstimator("estimator", parse_source("estimator", f"ros2://{topic}?router={endpoint}"), monotonic)


def laser(url: str = "ros2://scan") -> RosLaser:
    return RosLaser("laser", parse_source("laser", url), monotonic)


def header(other: Peer, stamp_s: float) -> Any:
    stamp = other.message("builtin_interfaces/msg/Time", sec=int(stamp_s), nanosec=round(stamp_s % 1.0 * 1e9))
    return other.message("std_msgs/msg/Header", stamp=stamp, frame_id="odom")


def odometry(other: Peer, stamp_s: float) -> dict[str, Any]:
    """At 1 m forward, 2 m left, 3 m up, with the nose 90 degrees to the left."""
    turn = other.message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.5**0.5, w=0.5**0.5)
    at = other.message("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)
    zero = other.message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    covariance = np.diag([0.01, 0.04, 0.09, 1e-4, 2e-4, 3e-4]).ravel()
    pose = other.message("geometry_msgs/msg/Pose", position=at, orientation=turn)
    twist = other.message("geometry_msgs/msg/Twist", linear=zero, angular=zero)
    return {
        "header": header(other, stamp_s),
        "child_frame_id": "base_link",
        "pose": other.message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        "twist": other.message("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    }


def first(device: Any, read: Callable[[], Any], send: Callable[[], None]) -> Any:
    """The first data that come while `send` is called again and again."""
    received = threading.Event()
    unwatch = device.on_new_data(received.set)
    device.open()
    try:
        for _ in range(100):
            send()
            if received.wait(0.1):
                break
        found = read()
    finally:
        device.close()
        unwatch()
    assert found is not None
    return found


@pytest.mark.sockets
def test_a_pose_of_another_node_comes_with_its_covariance_in_our_axes(endpoint: str, other: Peer) -> None:
    device, publisher = estimator(endpoint, "vio/odometry"), other.publisher("/vio/odometry", ODOMETRY)
    stamped = first(device, device.estimated_pose, lambda: publisher.publish(**odometry(other, 1_700_000_000.25)))
    pose = stamped.pose
    assert pose.position_m == (1.0, -2.0, -3.0)
    assert to_euler(pose.world_from_body) == pytest.approx((0.0, 0.0, -pi / 2))
    assert rotate(pose.world_from_body, (1.0, 0.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))
    assert [pose.covariance[7 * index] for index in range(6)] == [0.01, 0.04, 0.09, 1e-4, 2e-4, 3e-4]
    assert 0.0 <= monotonic() - stamped.t_s < 20.0


@pytest.mark.sockets
def test_a_scan_of_another_node_comes_as_a_scanners_turn(endpoint: str, other: Peer) -> None:
    device = laser(f"ros2://scan?router={endpoint}&yaw_deg=10")
    publisher = other.publisher("/scan", SCAN)
    scan = {
        "header": header(other, 1_700_000_000.0),
        "angle_min": -1.0,
        "angle_max": 1.0,
        "angle_increment": 1.0,
        "time_increment": 0.05,
        "scan_time": 0.1,
        "range_min": 0.1,
        "range_max": 8.0,
        "ranges": np.array([1.0, inf, 3.0], "f4"),
        "intensities": np.zeros(0, "f4"),
    }
    stamped = first(device, device.scan, lambda: publisher.publish(**scan))
    found = stamped.scan
    assert (found.scanner, found.range_min_m, found.range_max_m) == ("laser", pytest.approx(0.1), 8.0)
    assert (found.angle_min_rad, found.angle_step_rad) == (pytest.approx(-1.0 + pi / 18), 1.0)
    assert list(np.frombuffer(found.ranges_m, "<f4")) == [1.0, inf, 3.0]
    assert found.duration_s == pytest.approx(0.1)


def depth_camera(url: str = "ros2://depth") -> RosDepthCamera:
    return RosDepthCamera("rear_depth_camera", parse_source("rear_depth_camera", url), monotonic)


@pytest.mark.sockets
def test_a_depth_picture_of_another_node_comes_in_millimetres(endpoint: str, other: Peer) -> None:
    device = depth_camera(f"ros2://camera/depth?router={endpoint}&max_m=6")
    publisher = other.publisher("/camera/depth", IMAGE)
    values = np.array([[0, 1000, 65535], [2, 3, 4]], "<u2")
    image = {
        "height": 2,
        "width": 3,
        "encoding": "16UC1",
        "is_bigendian": 0,
        "step": 6,
        "data": values.view("u1").ravel(),
    }
    send = {"header": header(other, 1_700_000_000.0), **image}
    depth = first(device, device.depth, lambda: publisher.publish(**send)).depth
    assert (depth.camera, depth.width, depth.height, depth.scale_m) == ("rear_depth", 3, 2, 0.001)
    assert (depth.data, depth.range_max_m) == (values.tobytes(), 6.0)


def lidar(url: str = "ros2://points") -> RosLidar:
    return RosLidar("lidar", parse_source("lidar", url), monotonic)


@pytest.mark.sockets
def test_a_point_cloud_of_another_node_comes_on_the_body(endpoint: str, other: Peer) -> None:
    device = lidar(f"ros2://points?router={endpoint}&forward_m=0.5&max_m=30")
    publisher = other.publisher("/points", CLOUD)
    rows = np.array([[(1, 2, 3, 7), (nan, 0, 0, 7), (0.01, 0, 0, 7)], [(40, 0, 0, 7), (-4, 0, 0, 7), (0, inf, 0, 7)]])
    form = other.message
    fields = [
        form("sensor_msgs/msg/PointField", name=name, offset=4 * number, datatype=7, count=1)
        for number, name in enumerate(("x", "y", "z", "intensity"))
    ]
    cloud = {"height": 2, "width": 3, "fields": fields, "is_bigendian": False, "point_step": 16, "row_step": 48}
    cloud |= {"data": rows.astype("<f4").view("u1").ravel(), "is_dense": False}
    send = {"header": header(other, 1_700_000_000.0), **cloud}
    found = first(device, device.cloud, lambda: publisher.publish(**send)).cloud
    assert (found.sensor, found.origin_frd_m, found.range_max_m) == ("lidar", (0.5, 0.0, 0.0), 30.0)
    points = np.frombuffer(found.data, "<f4").reshape(-1, 3)
    assert points.tolist() == [[1.5, -2.0, -3.0], [-3.5, 0.0, 0.0]]


def points(**changes: Any) -> SimpleNamespace:
    """One point as it is decoded, in eight bytes a number, in the other order of bytes, z first."""
    fields = [SimpleNamespace(name=name, offset=8 * n, datatype=8) for n, name in enumerate("zxy")]
    values = {"fields": fields, "height": 1, "width": 1, "point_step": 24, "row_step": 30, "is_bigendian": True}
    values |= {"data": np.array([3.0, 1.0, 2.0], ">f8").tobytes() + bytes(6)}
    return SimpleNamespace(**values | {"header": SimpleNamespace(stamp=SimpleNamespace(sec=10, nanosec=0))} | changes)


def test_the_fields_of_a_cloud_are_found_by_their_names() -> None:
    assert np.frombuffer(lidar().convert(points())[1].data, "<f4").tolist() == [1.0, -2.0, -3.0]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"fields": []}, "have no x, y and z"),
        ({"fields": [SimpleNamespace(name=name, offset=0, datatype=2) for name in "xyz"]}, "have no x, y and z"),
        ({"point_step": 16}, "30 bytes are not 1 rows of 1 points of 16 bytes"),
        ({"height": 2}, "30 bytes are not 2 rows"),
        ({"width": 2}, "30 bytes are not 1 rows of 2 points"),
    ],
)
def test_a_cloud_that_is_torn_is_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        lidar().convert(points(**changes))


def image(values: Any, encoding: str, padding: int = 0, **changes: Any) -> SimpleNamespace:
    """A picture as it is decoded, with some bytes behind each row."""
    height, width = values.shape
    rows = np.hstack([np.ascontiguousarray(values).view("u1").reshape(height, -1), np.zeros((height, padding), "u1")])
    fields = {"height": height, "width": width, "step": rows.shape[1], "is_bigendian": values.dtype.byteorder == ">"}
    stamp = SimpleNamespace(sec=10, nanosec=0)
    fields |= {"encoding": encoding, "data": rows.tobytes(), "header": SimpleNamespace(stamp=stamp)} | changes
    return SimpleNamespace(**fields)


def test_depths_in_metres_and_in_the_order_of_other_processors_are_the_same() -> None:
    metres = np.array([[nan, 1.0, inf], [-1.0, 70.0, 0.0024]], "<f4")
    expected = [0, 1000, 0, 0, 0, 2]
    for given in (image(metres, "32FC1"), image(metres.astype(">f4"), "32FC1", padding=8)):
        assert list(np.frombuffer(depth_camera().convert(given)[1].data, "<u2")) == expected
    found = depth_camera().convert(image(np.array([[5, 258]], ">u2"), "mono16", padding=2))[1]
    assert list(np.frombuffer(found.data, "<u2")) == [5, 258]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"encoding": "rgb8"}, "pictures of 'rgb8' are no depths"),
        ({"step": 2}, "12 bytes are not 2 rows of 2 bytes with 3 depths"),
        ({"height": 3}, "12 bytes are not 3 rows of 6 bytes with 3 depths"),
        ({"data": b""}, "0 bytes are not 2 rows"),
    ],
)
def test_a_picture_that_is_no_depths_is_refused(changes: dict[str, Any], why: str) -> None:
    given = image(np.zeros((2, 3), "<u2"), "16UC1")
    with pytest.raises(ValueError, match=why):
        depth_camera().convert(SimpleNamespace(**(vars(given) | changes)))


@pytest.mark.sockets
def test_a_topic_of_another_kind_is_named(endpoint: str, other: Peer) -> None:
    device, publisher = estimator(endpoint), other.publisher("/odometry", ODOMETRY)
    publisher.pub = other._open[-1].session_mgr.session.declare_publisher(publisher.keyexpr[:-4] + "0000")

    def read(stream: Iterator[Any]) -> None:
        for _ in zip(range(40), stream, strict=False):
            for _ in range(20):
                publisher.publish(**odometry(other, 1.0))

    with device.connect() as stream, pytest.raises(Gloc3Error, match="another version of nav_msgs/Odometry, RIHS01_"):
        read(stream)


def message(**changes: Any) -> SimpleNamespace:
    """A scan as it is decoded."""
    fields = {"angle_min": -1.0, "angle_increment": 1.0, "time_increment": 0.05, "range_min": 0.1, "range_max": 8.0}
    stamp = SimpleNamespace(sec=10, nanosec=500_000_000)
    return SimpleNamespace(**(fields | {"ranges": [1.0, 2.0, 3.0]} | changes), header=SimpleNamespace(stamp=stamp))


def test_the_time_of_a_turn_is_that_of_its_last_beam() -> None:
    assert laser().convert(message())[0] == pytest.approx(10.6)


def test_a_scanner_that_turns_clockwise_is_turned_round() -> None:
    _, scan = laser().convert(message(angle_min=1.0, angle_increment=-1.0))
    assert (scan.angle_min_rad, scan.angle_step_rad) == (-1.0, 1.0)
    assert list(np.frombuffer(scan.ranges_m, "<f4")) == [3.0, 2.0, 1.0]


@pytest.mark.parametrize("wrong", [{"time_increment": nan}, {"time_increment": -0.1}, {"time_increment": 100.0}])
def test_a_turn_that_lasts_impossibly_long_is_not_used(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"a turn of .* s is impossible"):
        laser().convert(message(**wrong))


def test_a_pose_that_is_none_is_not_used() -> None:
    wrong = SimpleNamespace(x=nan, y=0.0, z=0.0)
    right = SimpleNamespace(w=1.0, x=0.0, y=0.0, z=0.0)
    pose = SimpleNamespace(pose=SimpleNamespace(position=wrong, orientation=right), covariance=[0.0] * 36)
    with pytest.raises(ValueError, match="a number is not finite"):
        estimator("tcp/127.0.0.1:1").convert(SimpleNamespace(pose=pose, header=message().header))


@pytest.mark.sockets
def test_a_name_that_ros_does_not_allow_is_refused_when_the_device_is_opened() -> None:
    with (
        pytest.raises(Refused, match="'front-camera/odometry' is no name in ROS"),
        estimator("tcp/127.0.0.1:1", "front-camera/odometry").connect(),
    ):
        pass


@pytest.mark.sockets
def test_a_topic_whose_poses_are_none_is_named(endpoint: str, other: Peer) -> None:
    device, publisher = estimator(endpoint), other.publisher("/odometry", ODOMETRY)
    wrong = odometry(other, 1.0)
    wrong["pose"].pose.orientation.w = 7.0

    def read(stream: Iterator[Any]) -> None:
        for _ in zip(range(200), stream, strict=False):
            publisher.publish(**wrong)

    with (
        device.connect() as stream,
        pytest.raises(Gloc3Error, match="estimator: odometry: the attitude is no rotation"),
    ):
        read(stream)
