"""Nodes of ROS 2 as sensors: odometry, scans, point clouds and depth pictures from the wire of rmw_zenoh."""

import math
import queue
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

import msgspec

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.perception import DepthImage, EstimatorPose, LaserScan, PointCloud
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.camera_sources.depth import DEPTH, depth_name
from gloc3_onboard.sensors.devices import StampedCloud, StampedDepth, StampedEstimatorPose, StampedScan
from gloc3_onboard.sensors.lidar_sources.lidar import LIDAR, PLACE, LidarMount
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import DELAY, DEPTHS, FAR_M, NEAR_M, Number, Options, SourceUrl
from gloc3_onboard.sensors.sources.estimator_wire import FLU, pose_of
from gloc3_onboard.sensors.sources.laser import MOUNT, mounted_scan
from gloc3_onboard.sensors.threaded import ThreadedSource

if TYPE_CHECKING:
    from gloc3.ros2.node import Received

T = TypeVar("T")

WAITING: Final = 64
"""Messages that wait to be read; the oldest are dropped."""
WAIT_S: Final = 0.3
_NONSENSE: Final = 50
"""Messages that are not accepted, without one that is, after which the topic is taken for something else."""
DEPTH_UNIT_M: Final = 0.001
MOST_DEPTH_M: Final = 65.0
MOST_CLOUD_M: Final = 100.0
NETWORK: Final[Options] = {"router": None, "domain": Number(0, 232, True)}
"""The options of every source in ROS 2."""


class RosSource(ThreadedSource[T]):
    """A subscription to a topic.

    Args:
        name: name of the device.
        url: `ros2://TOPIC?router=tcp/127.0.0.1:7447&domain=0`; `delay_s` is the age of a message's stamp beyond what it says.
        now_s: our time.
    """

    kind: ClassVar[str]
    """Type of the messages."""

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url

    @abstractmethod
    def convert(self, message: Any) -> tuple[float, Any]:
        """The stamp of a message, s, and what it is here.

        Raises:
            ValueError: it cannot be used; the text says why.
        """

    @abstractmethod
    def stamped(self, t_s: float, item: Any) -> T:
        """The item with its time of validity."""

    @contextmanager
    def connect(self) -> Iterator[Iterator[T | None]]:
        """Joins the graph as a node with one subscription. The router and the publisher need not be there yet."""
        from gloc3.ros2.node import RosNetwork, open_node
        from gloc3.ros2.wire import ROUTER, SENSOR

        options = self._url.options
        network = RosNetwork(router=options.get("router", ROUTER), domain=int(options.get("domain", 0)))
        came: queue.Queue[Received] = queue.Queue(WAITING)

        def keep(received: "Received") -> None:
            with suppress(queue.Empty):
                if came.full():
                    came.get_nowait()
            came.put(received)

        with open_node(network, f"/gloc3/{self.name}") as node:
            node.subscribe(self._url.place, self.kind, keep, SENSOR)
            yield self._messages(came, node.problems)

    def _messages(self, came: "queue.Queue[Received]", problems: dict[str, int]) -> Iterator[T | None]:
        clock, delay_s, has_understood = BootClock(), self._url.number("delay_s", 0.0), False
        reason, refused = "", 0
        while True:
            unread = dict(problems)
            if not has_understood and refused + sum(unread.values()) > _NONSENSE:
                raise Gloc3Error(f"{self.name}: {reason or next(iter(unread))}")
            try:
                message = came.get(timeout=WAIT_S).message
                stamp_s, item = self.convert(message)
            except queue.Empty:
                yield None
            except ValueError as error:
                reason, refused = f"{self._url.place}: {error}", refused + 1
                yield None
            else:
                has_understood = True
                yield self.stamped(clock.t_s(stamp_s * 1e3, self.now_s()) - delay_s, item)


class RosEstimator(RosSource[StampedEstimatorPose]):
    """Odometry of another node (`nav_msgs/Odometry`), as an estimator that is not ours."""

    kind = "nav_msgs/Odometry"

    def estimated_pose(self) -> StampedEstimatorPose | None:
        """The latest pose; None before the first.

        Raises:
            Gloc3Error: the topic brings something else.
        """
        return self.latest()

    def convert(self, message: Any) -> tuple[float, EstimatorPose]:
        """The pose; a covariance of zeros claims nothing."""
        pose = message.pose.pose
        at, turn = pose.position, pose.orientation
        covariance = list(message.pose.covariance)
        found = pose_of(
            (at.x, at.y, at.z),
            (turn.w, turn.x, turn.y, turn.z),
            covariance if any(covariance) else [],
            axes=FLU,
            reset_counter=0,
            quality=1.0,
        )
        return _stamp_s(message), found

    def stamped(self, t_s: float, item: EstimatorPose) -> StampedEstimatorPose:
        """The pose with its time."""
        return StampedEstimatorPose(t_s, item)


class RosLaser(RosSource[StampedScan]):
    """A scanner of another node (`sensor_msgs/LaserScan`)."""

    kind = "sensor_msgs/LaserScan"

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first.

        Raises:
            Gloc3Error: the topic brings something else.
        """
        return self.latest()

    def convert(self, message: Any) -> tuple[float, LaserScan]:
        """The turn, whose time is that of its last beam; +inf is *nothing seen* in ROS, too (REP 117)."""
        import numpy as np

        ranges = np.asarray(message.ranges, "<f4")
        duration_s = float(message.time_increment) * max(len(ranges) - 1, 0)
        if not (math.isfinite(duration_s) and 0.0 <= duration_s <= 10.0):
            raise ValueError(f"a turn of {duration_s:g} s is impossible")
        scan = LaserScan(
            scanner=self.name,
            angle_min_rad=message.angle_min,
            angle_step_rad=message.angle_increment,
            range_min_m=message.range_min,
            range_max_m=message.range_max,
            ranges_m=ranges.tobytes(),
            duration_s=duration_s,
        )
        if message.angle_increment < 0.0:  # clockwise
            last_rad = message.angle_min + message.angle_increment * (len(ranges) - 1)
            scan = msgspec.structs.replace(
                scan, angle_min_rad=last_rad, angle_step_rad=-message.angle_increment, ranges_m=ranges[::-1].tobytes()
            )
        return mounted_scan(_stamp_s(message) + duration_s, scan, self._url)

    def stamped(self, t_s: float, item: LaserScan) -> StampedScan:
        """The turn with its time."""
        return StampedScan(t_s, item)


class RosDepthCamera(RosSource[StampedDepth]):
    """A depth camera of another node (`sensor_msgs/Image` of 16UC1 in millimetres, or 32FC1 in metres; REP 118)."""

    kind = "sensor_msgs/Image"

    def depth(self) -> StampedDepth | None:
        """The latest frame; None before the first.

        Raises:
            Gloc3Error: the topic brings something else.
        """
        return self.latest()

    def convert(self, message: Any) -> tuple[float, DepthImage]:
        """The picture; a depth that is no number, or farther away than 65 m, is none."""
        import numpy as np

        kinds = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
        if message.encoding not in kinds:
            raise ValueError(f"pictures of {message.encoding!r} are no depths, which are 16UC1 or 32FC1")
        form = np.dtype(kinds[message.encoding]).newbyteorder(">" if message.is_bigendian else "<")
        height, width, step, data = message.height, message.width, message.step, bytes(message.data)
        if not width * form.itemsize <= step <= len(data) // max(height, 1):
            raise ValueError(f"{len(data)} bytes are not {height} rows of {step} bytes with {width} depths")
        rows = np.frombuffer(data, np.uint8, height * step).reshape(height, step)[:, : width * form.itemsize]
        values = np.ascontiguousarray(rows).view(form)
        if form.kind == "f":
            metres = np.where(np.isfinite(values) & (values > 0.0), values, 0.0)
            values = np.where(metres < MOST_DEPTH_M, np.rint(metres / DEPTH_UNIT_M), 0.0)
        depth = DepthImage(
            camera=depth_name(self.name),
            width=width,
            height=height,
            data=values.astype("<u2").tobytes(),
            scale_m=DEPTH_UNIT_M,
            range_min_m=self._url.number("min_m", NEAR_M),
            range_max_m=self._url.number("max_m", FAR_M),
        )
        return _stamp_s(message), depth

    def stamped(self, t_s: float, item: DepthImage) -> StampedDepth:
        """The picture with its time."""
        return StampedDepth(t_s, item)


class RosLidar(RosSource[StampedCloud]):
    """A point cloud of another node (`sensor_msgs/PointCloud2`), on axes forward, left, up (REP 103)."""

    kind = "sensor_msgs/PointCloud2"

    def cloud(self) -> StampedCloud | None:
        """The latest cloud; None before the first.

        Raises:
            Gloc3Error: the topic brings something else.
        """
        return self.latest()

    def convert(self, message: Any) -> tuple[float, PointCloud]:
        """The cloud; points that are no numbers, or out of range, are left out."""
        import numpy as np

        forms = {7: "f4", 8: "f8"}
        fields = {field.name: field for field in message.fields if field.name in ("x", "y", "z")}
        if len(fields) < 3 or any(field.datatype not in forms for field in fields.values()):
            raise ValueError("its points have no x, y and z that are FLOAT32 or FLOAT64")
        order = ">" if message.is_bigendian else "<"
        names = list(fields)
        form = np.dtype(
            {
                "names": names,
                "formats": [order + forms[fields[name].datatype] for name in names],
                "offsets": [fields[name].offset for name in names],
            }
        )
        height, width, step, row = message.height, message.width, message.point_step, message.row_step
        data = np.frombuffer(bytes(message.data), np.uint8)
        if form.itemsize > step or width * step > row or height * row > len(data):
            raise ValueError(f"{len(data)} bytes are not {height} rows of {width} points of {step} bytes")
        points = np.ascontiguousarray(data[: height * row].reshape(height, row)[:, : width * step]).reshape(-1, step)
        values = np.ascontiguousarray(points[:, : form.itemsize]).view(form).ravel()
        found = np.column_stack((values["x"], -values["y"], -values["z"])).astype(np.float64)
        near_m, far_m = self._url.number("min_m", NEAR_M), self._url.number("max_m", MOST_CLOUD_M)
        away_m = np.linalg.norm(found, axis=1)
        found = found[(away_m >= near_m) & (away_m <= far_m)]
        mount = LidarMount.of(self._url)
        cloud = PointCloud(
            sensor=self.name,
            data=mount.placed(found).astype("<f4").tobytes(),
            origin_frd_m=mount.position_frd_m,
            range_max_m=far_m,
        )
        return _stamp_s(message), cloud

    def stamped(self, t_s: float, item: PointCloud) -> StampedCloud:
        """The cloud with its time."""
        return StampedCloud(t_s, item)


def _stamp_s(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9  # type: ignore[no-any-return]


def _library_problem() -> str:
    is_there = find_spec("mcap_ros2") is not None and find_spec("xxhash") is not None
    return "" if is_there else 'ROS 2 needs further packages: pip install "gloc3[ros2]"'


def _make(request: SourceRequest) -> RosSource[Any]:
    url, kind = request.url, request.sensor.name
    for option in url.options:
        if option not in {**NETWORK, **DELAY, **_OPTIONS[kind]}:
            raise Refused(f"{request.device}: {url.text!r}: there is no {option} of the device {kind}")
    return _KINDS[kind](request.device, url, request.now_s)


_KINDS: Final[Mapping[str, type[RosSource[Any]]]] = {
    "estimator": RosEstimator,
    "laser": RosLaser,
    DEPTH: RosDepthCamera,
    LIDAR: RosLidar,
}
_OPTIONS: Final[Mapping[str, Options]] = {"estimator": {}, "laser": MOUNT, DEPTH: DEPTHS, LIDAR: {**PLACE, **DEPTHS}}
SOURCES: Final = (
    SourceKind(
        "ros2",
        tuple(_KINDS),
        "ros2://odometry/filtered, or ros2://scan?router=tcp/192.168.1.20:7447",
        _make,
        {**NETWORK, **DELAY, **MOUNT, **PLACE, **DEPTHS},
        problem=_library_problem,
    ),
)
