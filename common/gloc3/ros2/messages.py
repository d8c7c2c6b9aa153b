"""Messages of GLOC3 as ROS 2 messages, nested dictionaries by the names of the definitions' fields."""

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from gloc3.component.lci import State
from gloc3.messages.envelope import ComponentStatus, Envelope, Event, Severity
from gloc3.messages.frames import ENU_FROM_NED, IDENTITY, Quaternion, Vector3, multiply, normalize, rotate_back
from gloc3.messages.perception import DepthImage, ImuSample, LaserScan, PointCloud, SatelliteFix
from gloc3.messages.vehicle import AutopilotState, HeightAboveGround, Image, Pose
from gloc3.messages.watch import Preview

MAP: Final = "map"
BODY: Final = "base_link"
FRD_FROM_FLU: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)
UNKNOWN: Final = float("nan")
NOT_MEASURED: Final = -1.0
"""First element of a covariance: there is no such estimate (sensor_msgs/Imu)."""

FLOAT32: Final = 7
"""Of `sensor_msgs/PointField`."""
CLOUD_STEP: Final = 12
"""Bytes of a point."""
SAME_SHARE: Final = 1e-6
"""A unit that is off a millimetre by less is one: it was a number of 32 bits."""

OK, WARN, ERROR, STALE = range(4)
"""Levels of `diagnostic_msgs/DiagnosticStatus`."""

RosMessage = dict[str, Any]


class RosRecord(NamedTuple):
    """A message for one topic of ROS."""

    topic: str
    """Absolute: `/PLATFORM/...`, or one that all of ROS shares, such as `/tf`."""
    type: str
    message: RosMessage


def ros_records(envelope: Envelope[Any], utc_offset_ns: int) -> Iterator[RosRecord]:
    """What a message is in ROS; nothing for a type without a counterpart, and for data that is not valid.

    Args:
        envelope: the message.
        utc_offset_ns: from its time to UTC.
    """
    convert = _CONVERTERS.get(type(envelope.payload))
    if convert is not None and getattr(envelope.payload, "is_valid", True):
        yield from convert(envelope, stamp(round(envelope.t_s * 1e9) + utc_offset_ns))


def announced(platform: str, topic: str, message: str) -> tuple[tuple[str, str], ...]:
    """Topics of ROS, each with its type, that a topic of ours becomes; none for a type without a counterpart.

    Args:
        platform: its name.
        topic: below the platform's name.
        message: name of the message's type, such as `Pose`.
    """
    kind = _TYPES.get(message)
    if kind is None:
        return ()
    end = _ENDS.get(message, topic)
    moved = (("/tf", "tf2_msgs/TFMessage"),) if (topic, message) == ("pose", "Pose") else ()
    return ((f"/{platform}/{end.format(topic=topic)}", kind), *moved)


def stamp(utc_ns: int) -> RosMessage:
    """A `builtin_interfaces/Time`."""
    seconds, nanoseconds = divmod(utc_ns, 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def header(time: RosMessage, frame: str) -> RosMessage:
    """A `std_msgs/Header`."""
    return {"stamp": time, "frame_id": frame}


def point(vector: Vector3) -> RosMessage:
    """A `geometry_msgs/Point` or `Vector3`."""
    x, y, z = vector
    return {"x": x, "y": y, "z": z}


def quaternion(rotation: Quaternion) -> RosMessage:
    """A `geometry_msgs/Quaternion` of one in the order w, x, y, z."""
    w, x, y, z = rotation
    return {"x": x, "y": y, "z": z, "w": w}


def enu(ned: Vector3) -> Vector3:
    """East, north, up."""
    north, east, down = ned
    return east, north, -down


def flu(frd: Vector3) -> Vector3:
    """Forward, left, up."""
    forward, right, down = frd
    return forward, -right, -down


def enu_from_flu(ned_from_frd: Quaternion) -> Quaternion:
    """The attitude as ROS has it."""
    return normalize(multiply(ENU_FROM_NED, multiply(ned_from_frd, FRD_FROM_FLU)))


def transform(parent: str, child: str, translation: Vector3, rotation: Quaternion, time: RosMessage) -> RosRecord:
    """One moving transform, for `/tf`."""
    one = {
        "header": header(time, parent),
        "child_frame_id": child,
        "transform": {"translation": point(translation), "rotation": quaternion(rotation)},
    }
    return RosRecord("/tf", "tf2_msgs/TFMessage", {"transforms": [one]})


def path(platform: str, points_ned_m: Sequence[Vector3], time: RosMessage) -> RosRecord:
    """A path, such as the one requested by a mission."""
    poses = [
        {
            "header": header(time, MAP),
            "pose": {"position": point(enu(one)), "orientation": quaternion(IDENTITY)},
        }
        for one in points_ned_m
    ]
    return RosRecord(f"/{platform}/requested_path", "nav_msgs/Path", {"header": header(time, MAP), "poses": poses})


def _diagonal(size: int, *values: float) -> list[float]:
    found = [0.0] * (size * size)
    for index, value in enumerate(values):
        found[index * size + index] = value
    return found


def _pose(envelope: Envelope[Pose], time: RosMessage) -> Iterator[RosRecord]:
    pose = envelope.payload
    position, rotation = enu(pose.position_ned_m), enu_from_flu(pose.ned_from_frd)
    std_north, std_east, std_down = pose.position_std_m
    velocity = flu(rotate_back(pose.ned_from_frd, pose.velocity_ned_m_s))
    message = {
        "header": header(time, MAP),
        "child_frame_id": BODY,
        "pose": {
            "pose": {"position": point(position), "orientation": quaternion(rotation)},
            "covariance": _diagonal(6, std_east**2, std_north**2, std_down**2),
        },
        "twist": {
            "twist": {"linear": point(velocity), "angular": point(flu(pose.rate_frd_rad_s))},
            "covariance": _diagonal(6),
        },
    }
    yield RosRecord(f"/{envelope.topic}", "nav_msgs/Odometry", message)
    if envelope.topic.endswith("/pose"):
        yield transform(MAP, BODY, position, rotation, time)


def _imu(envelope: Envelope[ImuSample], time: RosMessage) -> Iterator[RosRecord]:
    sample = envelope.payload
    message = {
        "header": header(time, BODY),
        "orientation": quaternion(IDENTITY),
        "orientation_covariance": _diagonal(3, NOT_MEASURED),
        "angular_velocity": point(flu(sample.rate_frd_rad_s)),
        "angular_velocity_covariance": _diagonal(3),
        "linear_acceleration": point(flu(sample.specific_force_frd_m_s2)),
        "linear_acceleration_covariance": _diagonal(3),
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/Imu", message)


def _scan(envelope: Envelope[LaserScan], time: RosMessage) -> Iterator[RosRecord]:
    scan = envelope.payload
    ranges = array("f", scan.ranges_m)
    message = {
        "header": header(time, scan.scanner),
        "angle_min": scan.angle_min_rad,
        "angle_max": scan.angle_min_rad + scan.angle_step_rad * (len(ranges) - 1),
        "angle_increment": scan.angle_step_rad,
        "time_increment": scan.duration_s / max(len(ranges) - 1, 1),
        "scan_time": scan.duration_s,
        "range_min": scan.range_min_m,
        "range_max": scan.range_max_m,
        "ranges": ranges,
        "intensities": [],
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/LaserScan", message)


def _depth(envelope: Envelope[DepthImage], time: RosMessage) -> Iterator[RosRecord]:
    """In millimetres, whatever the camera's unit is."""
    depth = envelope.payload
    units = array("H", depth.data)
    millimetres = depth.scale_m * 1e3
    if abs(millimetres - 1.0) > SAME_SHARE:
        units = array("H", [min(round(unit * millimetres), 0xFFFF) for unit in units])
    message = {
        "header": header(time, depth.camera),
        "height": depth.height,
        "width": depth.width,
        "encoding": "16UC1",
        "is_bigendian": 0,
        "step": 2 * depth.width,
        "data": units.tobytes(),
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/Image", message)


def _cloud(envelope: Envelope[PointCloud], time: RosMessage) -> Iterator[RosRecord]:
    """On the axes of ROS's body: forward, left, up."""
    points = array("f", envelope.payload.data[: len(envelope.payload.data) // CLOUD_STEP * CLOUD_STEP])
    for axis in (1, 2):
        points[axis::3] = array("f", [-part for part in points[axis::3]])
    count = len(points) // 3
    message = {
        "header": header(time, BODY),
        "height": 1,
        "width": count,
        "fields": [
            {"name": name, "offset": 4 * index, "datatype": FLOAT32, "count": 1} for index, name in enumerate("xyz")
        ],
        "is_bigendian": False,
        "point_step": CLOUD_STEP,
        "row_step": CLOUD_STEP * count,
        "data": points.tobytes(),
        "is_dense": True,
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/PointCloud2", message)


def _image(envelope: Envelope[Image], time: RosMessage) -> Iterator[RosRecord]:
    image = envelope.payload
    message = {
        "header": header(time, image.camera),
        "height": image.height,
        "width": image.width,
        "encoding": "bgr8" if image.bgr else "mono8",
        "is_bigendian": 0,
        "step": image.width * (3 if image.bgr else 1),
        "data": image.bgr or image.data,
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/Image", message)


def _preview(envelope: Envelope[Preview], time: RosMessage) -> Iterator[RosRecord]:
    preview = envelope.payload
    message = {"header": header(time, preview.camera), "format": "webp", "data": preview.data}
    if preview.data:
        yield RosRecord(f"/{envelope.topic}/compressed", "sensor_msgs/CompressedImage", message)


def _fix(envelope: Envelope[SatelliteFix], time: RosMessage) -> Iterator[RosRecord]:
    fix = envelope.payload
    latitude, longitude, altitude = fix.place_geo
    message = {
        "header": header(time, BODY),
        "status": {"status": 0, "service": 1},
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "position_covariance": _diagonal(3, fix.std_m**2, fix.std_m**2, fix.height_std_m**2),
        "position_covariance_type": 2,  # the diagonal is known
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/NavSatFix", message)


def _height(envelope: Envelope[HeightAboveGround], time: RosMessage) -> Iterator[RosRecord]:
    message = {
        "header": header(time, BODY),
        "radiation_type": 1,
        "field_of_view": 0.0,
        "min_range": 0.0,
        "max_range": float("inf"),
        "range": envelope.payload.height_m,
        "variance": 0.0,  # not known
    }
    yield RosRecord(f"/{envelope.topic}", "sensor_msgs/Range", message)


def _battery(envelope: Envelope[AutopilotState], time: RosMessage) -> Iterator[RosRecord]:
    state = envelope.payload
    message = {
        "header": header(time, BODY),
        "voltage": state.battery_v,
        "temperature": UNKNOWN,
        "current": -state.battery_a,  # negative while it discharges
        "charge": UNKNOWN,
        "capacity": UNKNOWN,
        "design_capacity": UNKNOWN,
        "percentage": state.battery_remaining if state.battery_remaining >= 0.0 else UNKNOWN,
        "power_supply_status": 2,
        "power_supply_health": 0,
        "power_supply_technology": 0,
        "present": True,
        "cell_voltage": [],
        "cell_temperature": [],
        "location": "",
        "serial_number": "",
    }
    yield RosRecord(f"/{envelope.source.platform}/battery", "sensor_msgs/BatteryState", message)


def diagnostics(statuses: Sequence[RosMessage], time: RosMessage) -> RosRecord:
    """A report for `/diagnostics`."""
    message = {"header": header(time, ""), "status": list(statuses)}
    return RosRecord("/diagnostics", "diagnostic_msgs/DiagnosticArray", message)


def diagnostic_status(
    platform: str, component: str, level: int, state: str, cause: str, values: Mapping[str, float]
) -> RosMessage:
    """A component's `diagnostic_msgs/DiagnosticStatus`.

    Args:
        platform: its platform.
        component: its name.
        level: `OK`, `WARN`, `ERROR` or `STALE`.
        state: in a word.
        cause: of its last error; empty without one.
        values: further ones, by name.
    """
    return {
        "level": level,
        "name": f"{platform}: {component}",
        "message": f"{state}: {cause}" if cause else state,
        "hardware_id": platform,
        "values": [{"key": key, "value": f"{value:g}"} for key, value in values.items()],
    }


def _diagnostics(envelope: Envelope[ComponentStatus], time: RosMessage) -> Iterator[RosRecord]:
    status, platform = envelope.payload, envelope.source.platform
    level = STALE if status.state is None else ERROR if status.state is State.FAULTY else OK
    values = {"rate_hz": status.rate_hz, "errors": status.errors, "overruns": status.overruns, **status.values}
    state = str(status.state or "absent")
    yield diagnostics([diagnostic_status(platform, status.name, level, state, status.cause, values)], time)


def _event(envelope: Envelope[Event], time: RosMessage) -> Iterator[RosRecord]:
    event = envelope.payload
    message = {
        "stamp": time,
        "level": _LEVELS[event.severity],
        "name": f"{envelope.source.platform}.{envelope.source.component}",
        "msg": event.text,
        "file": "",
        "function": "",
        "line": 0,
    }
    yield RosRecord("/rosout", "rcl_interfaces/Log", message)


_LEVELS: Final[Mapping[Severity, int]] = {
    Severity.EMERGENCY: 50,
    Severity.ALERT: 50,
    Severity.CRITICAL: 50,
    Severity.ERROR: 40,
    Severity.WARNING: 30,
    Severity.NOTICE: 20,
    Severity.INFO: 20,
    Severity.DEBUG: 10,
}
_TYPES: Final[Mapping[str, str]] = {
    "Pose": "nav_msgs/Odometry",
    "ImuSample": "sensor_msgs/Imu",
    "LaserScan": "sensor_msgs/LaserScan",
    "Image": "sensor_msgs/CompressedImage",
    "SatelliteFix": "sensor_msgs/NavSatFix",
    "HeightAboveGround": "sensor_msgs/Range",
    "AutopilotState": "sensor_msgs/BatteryState",
}
"""Of live topics; pictures come as previews."""
_ENDS: Final[Mapping[str, str]] = {"Image": "{topic}/compressed", "AutopilotState": "battery"}
"""Of those whose topic of ROS has another name."""
_CONVERTERS: Final[Mapping[type, Callable[[Any, RosMessage], Iterator[RosRecord]]]] = {
    Pose: _pose,
    ImuSample: _imu,
    LaserScan: _scan,
    DepthImage: _depth,
    PointCloud: _cloud,
    Image: _image,
    Preview: _preview,
    SatelliteFix: _fix,
    HeightAboveGround: _height,
    AutopilotState: _battery,
    ComponentStatus: _diagnostics,
    Event: _event,
}
